"""The watch for falls on a mesh: postures of observers, the stage that a fusion service publishes, and hubs."""

import time

import numpy as np
import pytest
from mesh_stage import LOOPBACK, NAMED, posterior
from processes import SOON_S, until

from benchmarks.simulated_falls import fall
from common import SECOND_NS
from common.config import read_scene
from common.fall_messages import FallMessage, PostureMessage
from common.floor_place import FloorPlace
from common.wire import decode, encode
from fusion.server import serve
from hub.session import SceneListener
from observer.geometry.projection import project
from observer.geometry.views import parse_view
from observer.preview.posture_outlet import PostureOutlet
from observer.preview.small_picture import Sighting
from observer.tracks import WHOLE_BODY, PersonTracks, Tracks
from studies.performer.perform import PEOPLE

OBSERVERS = "".join(f'[observers.{name}]\nsource = "m.npz"\n' for name in ("cam1", "cam2"))


@pytest.fixture
def scene(tmp_path):
    return scene_of(tmp_path)


def scene_of(tmp_path, more="[watch.fallen]\nafter_s = 0.5\n"):
    (tmp_path / "s.toml").write_text(f'scene = "dojo"\n{LOOPBACK}{OBSERVERS}{more}')
    return read_scene(tmp_path / "s.toml", {})


def posture(lying):
    return encode(PostureMessage(captured_ns=time.time_ns(), lying=lying))


class Postures:
    """Two observers that publish what the test says, again and again."""

    def __init__(self, mesh, scene):
        self.link = mesh.peer("observer")
        self.publishers = {name: self.link.publisher(scene.keys.posture(name)) for name in scene.roster}

    def show(self, **lying):
        for name, p in lying.items():
            self.publishers[name].put(posture(p))


def test_a_late_hub_knows_the_stage_and_a_forged_posture_changes_nothing(mesh, scene):
    mesh.run(serve, [scene], "fusion", mesh.meeting)
    postures = Postures(mesh, scene)
    inbox = mesh.peer("hub").inbox(scene.keys.fall)
    seen = []

    def fell():
        postures.show(cam1=1.0 if seen else 0.0, cam2=1.0 if seen else 0.0)
        postures.publishers["cam1"].put(b"\xc1 no message")
        seen.extend(decode(FallMessage, arrival.payload).stage for arrival in inbox.take(0.02))
        return "fallen" in seen

    until(fell)
    with SceneListener(scene, mesh.peer("hub"), lambda update: None) as late:
        until(lambda: late.state.fall is not None and late.state.fall.stage == "fallen")


def test_a_service_that_is_killed_while_somebody_lies_goes_on_with_the_alarm(mesh, scene):
    inbox = mesh.peer("hub").inbox(scene.keys.fall)
    messages = []

    def seen(stage, **lying):
        postures.show(**lying)
        messages.extend(decode(FallMessage, arrival.payload) for arrival in inbox.take(0.02))
        return bool(messages) and messages[-1].stage == stage

    stop, thread = mesh.run(serve, [scene], "fusion", mesh.peer("standby"))
    postures = Postures(mesh, scene)
    for stage, p in (("up", 0.0), ("fallen", 0.9)):
        until(lambda stage=stage, p=p: seen(stage, cam1=p, cam2=p))
    fall = messages[-1]
    stop.set()
    thread.join(SOON_S)
    messages.clear()
    mesh.run(serve, [scene], "fusion", mesh.peer("standby"))
    until(lambda: seen("fallen", cam1=0.9, cam2=0.9))
    assert messages[-1].id == fall.id and messages[-1].session != fall.session
    until(lambda: seen("up", cam1=0.0, cam2=0.0))
    assert messages[-1].id == fall.id


def test_a_scene_without_the_section_watches_for_nothing(mesh, tmp_path):
    scene = scene_of(tmp_path, "")
    assert scene.watch.fallen is None
    inbox = mesh.meeting.inbox(scene.keys.fall)
    mesh.run(serve, [scene], "fusion", mesh.peer("standby"))
    presence = mesh.meeting.presence(scene.keys.fusion_alive())
    assert presence.wait_for(1, SOON_S)
    Postures(mesh, scene).show(cam1=1.0)
    assert not mesh.meeting.ask(scene.keys.fall, 0.2) and not inbox.take(0.0)


class Sent:
    def __init__(self):
        self.messages = []

    def put(self, payload):
        self.messages.append(decode(PostureMessage, payload))


def shown(areas=(), picture=None, parts=WHOLE_BODY, scale=1.0, place=(0.0, 0.0)):
    """What an observer publishes of a fall."""
    recording = fall(PEOPLE[0], 90, slow=False).recording
    tracks = project(parse_view("door").matrix, recording.positions) * scale + place
    sent = Sent()
    outlet = PostureOutlet(sent, areas)
    for n, centres in enumerate(tracks):
        rows = centres[[WHOLE_BODY.index(part) for part in parts]]
        outlet.show(Sighting(picture, Tracks(rows), parts, SECOND_NS + n * SECOND_NS // 30), 0)
    return sent.messages


def test_an_observer_publishes_changes_and_a_sign_of_life():
    messages = shown()
    gaps = np.diff([message.captured_ns for message in messages])
    assert 12 < len(messages) < 60 and gaps.max() <= SECOND_NS * 0.55
    assert messages[0].lying < 0.1 and messages[-1].lying > 0.5


def test_whoever_lies_in_an_area_that_is_left_out_does_not_lie():
    picture = np.zeros((480, 640, 3), np.uint8)
    everywhere, elsewhere = ((0.0, 0.0, 1.0, 1.0),), ((0.9, 0.0, 1.0, 0.1),)
    placed = {"picture": picture, "scale": 100.0, "place": (320, 400)}
    assert max(message.lying for message in shown(everywhere, **placed)) == 0.0
    assert max(message.lying for message in shown(elsewhere, **placed)) > 0.5


def test_a_tracker_without_legs_takes_no_part(caplog):
    assert shown(parts=("left_hand", "right_hand", "head")) == []
    assert caplog.text.count("finds no torso and legs") == 1


LEFT, RIGHT = (1.0, 0.0), (-1.0, 0.0)


class Room:
    """Two observers that see two people stand at their places, and what each of them does. lying: by place."""

    def __init__(self, mesh, scene):
        self.scene, link = scene, mesh.peer("observer")
        self.posteriors = {name: link.publisher(scene.keys.posterior(name)) for name in scene.roster}
        self.postures = {name: link.publisher(scene.keys.posture(name)) for name in scene.roster}
        self.people, self.seq = {LEFT: 0.0, RIGHT: 0.0}, 0
        mesh.run(self._publish)

    def _publish(self, stop):
        while not stop.wait(0.03):
            for name, publisher in self.posteriors.items():
                people = {f"{name}-{'l' if at is LEFT else 'r'}": (at, p) for at, p in dict(self.people).items()}
                for track, (at, _) in people.items():
                    self.seq += 1
                    place = FloorPlace(at=at, covariance=(0.04, 0.0, 0.04))
                    publisher.put(posterior(name, self.seq, person=track, place=place, p=[0.5, 0.5], rest=0.95))
                tracks = {track: p for track, (_, p) in people.items() if p is not None}
                lying = max(tracks.values(), default=None)
                message = PostureMessage(captured_ns=time.time_ns(), lying=lying, people=tracks)
                self.postures[name].put(encode(message))


def test_of_two_people_the_one_who_has_fallen_is_named_and_the_other_one_ends_no_alarm(mesh, tmp_path):
    several = f'{NAMED}[people]\nmost = 2\nnames = ["left", "right"]\n'
    (tmp_path / "s.toml").write_text(
        f'scene = "dojo"\n{several}{LOOPBACK}{OBSERVERS}[watch.fallen]\nafter_s = 0.5\n[fusion]\nstart_s = 0\n'
    )
    scene = read_scene(tmp_path / "s.toml", {})
    with SceneListener(scene, mesh.meeting, lambda update: None) as listener:
        mesh.run(serve, [scene], "fusion", mesh.peer("standby"))
        room = Room(mesh, scene)
        until(lambda: {p: f.stage for p, f in listener.state.falls.items()} == {"left": "up", "right": "up"})
        room.people = {LEFT: 0.0, RIGHT: 0.9}
        until(lambda: listener.state.fall.stage == "fallen")
        fallen = listener.state.fall
        assert fallen.person == "right" and listener.state.falls["left"].stage == "up"
        # Nobody sees them any more, for longer than who leaves is remembered; the other one walks about.
        begun_ns = time.time_ns()
        room.people = {LEFT: 0.0}
        until(lambda: time.time_ns() - begun_ns > 3 * SECOND_NS and listener.state.judgement is not None)
        assert listener.state.falls["right"].stage == "fallen"
        room.people = {LEFT: 0.0, RIGHT: 0.0}
        until(lambda: listener.state.falls["right"].stage == "up")
        assert listener.state.falls["right"].id == fallen.id


def test_an_observer_publishes_the_posture_of_each_person():
    one, other = (fall(PEOPLE[0], 90, slow=False).recording.positions for _ in range(2))
    matrix, sent = parse_view("door").matrix, Sent()
    outlet = PostureOutlet(sent)
    for n, positions in enumerate(other):
        persons = tuple(
            PersonTracks(number, project(matrix, body), 0.0, 0.0, 1.7) for number, body in ((3, one[0]), (5, positions))
        )
        tracks = Tracks(persons[0].centres, persons=persons)
        outlet.show(Sighting(None, tracks, WHOLE_BODY, SECOND_NS + n * SECOND_NS // 30), 0)
    last = sent.messages[-1]
    assert last.people["3"] < 0.1 and last.people["5"] > 0.5 and last.lying == last.people["5"]
