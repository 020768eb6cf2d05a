"""Two people in one scene, between real Zenoh peers: whose verdicts, standby, restarts, plain and hostile observers."""

import pytest
from mesh_stage import LOOPBACK, NAMED, posterior, up_to
from processes import SOON_S

from common.config import read_scene
from common.floor_place import FloorPlace
from common.messages import JudgementMessage, StatusMessage, VerdictMessage
from common.wire import decode
from fusion.server import serve

REST, BOWING, LUNGING = ([0.5, 0.5], 0.95), ([0.98, 0.02], 0.05), ([0.02, 0.98], 0.05)
LEFT, RIGHT = (1.0, 0.0), (-1.0, 0.0)
ALONE = {"A": (LEFT, REST)}
STANDING = {"A": (LEFT, REST), "B": (RIGHT, REST)}
MOVING = {"A": (LEFT, BOWING), "B": (RIGHT, LUNGING)}


@pytest.fixture
def scene(tmp_path):
    text = (
        f'scene = "dojo"\n{NAMED}{LOOPBACK}[people]\nmost = 2\nnames = ["left", "right"]\n'
        '[observers.cam1]\nsource = "m.npz"\n[observers.cam2]\nsource = "m.npz"\n[observers.cam3]\nsource = "m.npz"\n'
        '[fusion]\nid = "a"\nstandby = ["b"]\nquorum = 2\nhold_s = 0.1\ntakeover_s = 0.6\nstart_s = 0\n'
    )
    (tmp_path / "s.toml").write_text(text)
    return read_scene(tmp_path / "s.toml", {})


class Room:
    """Observers that see people, and a hub. people: by a name of the test's, where each is and what each does. plain:
    what an observer without a place publishes, by its id, in place of the people."""

    def __init__(self, mesh, scene):
        self.mesh, self.scene, self.keys = mesh, scene, scene.keys
        self.people, self.plain, self.services, self.seq = ALONE, {}, {}, 0
        self.observer, self.hub = mesh.peer("observer"), mesh.peer("hub")
        self.publishers = {name: self.observer.publisher(self.keys.posterior(name)) for name in scene.roster}
        self._judgements, self._verdicts = self.hub.inbox(self.keys.judgement), self.hub.inbox(self.keys.verdict)
        mesh.run(self._publish)

    def begin(self, service, shared=False):
        link, scene = self.mesh.peer("standby"), self.scene
        body = self.mesh.run(lambda stop: serve([scene], service, link, stop, shared=shared))
        self.services[service] = (*body, link)
        if self.people is ALONE:
            # Names are given in the order in which people come.
            self.judgement(of("left"))
            self.people = STANDING

    def end(self, service):
        stop, thread, link = self.services.pop(service)
        stop.set()
        thread.join(SOON_S)
        link.close()

    def _publish(self, stop):
        while not stop.wait(0.03):
            # What a test takes out before it changes the people never shows the changed ones.
            people = self.people
            for name, publisher in tuple(self.publishers.items()):
                plain = {"": (None, self.plain[name])} if name in self.plain else people
                for person, (at, (p, rest)) in plain.items():
                    self.seq += 1
                    place = None if at is None else FloorPlace(at=at, covariance=(0.04, 0.0, 0.04))
                    track = None if at is None else f"{person}-{name}".lower()
                    fields = {"p": p, "rest": rest, "person": track, "place": place}
                    publisher.put(posterior(name, self.seq, **fields))

    def judgement(self, fits):
        return up_to(self._judgements, JudgementMessage, fits)[-1]

    def verdicts(self, *wanted):
        """The verdicts (label, person, stage) in whatever order; of each the last."""
        found, left = {}, set(wanted)

        def note(verdict):
            known = verdict.label, verdict.person, verdict.stage
            found[known] = verdict
            left.discard(known)
            return not left

        up_to(self._verdicts, VerdictMessage, note)
        return [found[each] for each in wanted]


@pytest.fixture
def room(mesh, scene):
    return Room(mesh, scene)


def of(person, **fields):
    """Whether a judgement is of that person, by that service."""
    return lambda j: j.person == person and all(getattr(j, name) == value for name, value in fields.items())


DECIDED = ("bowing", "left", "decided"), ("lunging", "right", "decided")
ENDED = ("bowing", "left", "ended"), ("lunging", "right", "ended")


def test_each_person_has_verdicts_of_their_own_and_one_who_leaves_ends(room):
    room.begin("a")
    assert room.judgement(of("right")).place == pytest.approx([-1, 0], abs=0.1)
    room.people = MOVING
    bowing, lunging = room.verdicts(*DECIDED)
    assert bowing.id.startswith("dojo-left-") and lunging.id.startswith("dojo-right-")
    assert bowing.agreement.k == lunging.agreement.k == 3
    room.people = dict(ALONE)
    ended = room.verdicts(*ENDED)
    assert [verdict.id for verdict in ended] == [bowing.id, lunging.id]


def test_a_standby_service_goes_on_with_the_movements_of_both(room):
    room.begin("a")
    room.judgement(of("right", fusion="a"))
    statuses = room.hub.inbox(room.keys.fusion_status("b"))
    room.begin("b")
    up_to(statuses, StatusMessage, lambda s: s.reason == "standing by for a")
    room.people = MOVING
    ids = [verdict.id for verdict in room.verdicts(*DECIDED)]
    room.judgement(lambda j: j.person == "right" and j.movement is not None and j.movement.label == "lunging")
    room.end("a")
    room.judgement(of("right", fusion="b"))
    room.people = STANDING
    ended = room.verdicts(*ENDED)
    assert [verdict.id for verdict in ended] == ids and {verdict.fusion for verdict in ended} == {"b"}


def test_a_service_that_is_started_again_ends_the_movements_of_both(room):
    room.begin("a")
    room.judgement(of("right"))
    room.people = MOVING
    ids = [verdict.id for verdict in room.verdicts(*DECIDED)]
    room.end("a")
    room.begin("a")
    room.judgement(lambda j: j.person == "right" and j.movement is not None and j.movement.id == ids[1])
    room.people = STANDING
    assert [verdict.id for verdict in room.verdicts(*ENDED)] == ids


def test_an_observer_that_knows_no_place_counts_while_nobody_else_is_there(room):
    room.plain = {"cam3": LUNGING}
    room.people = {"A": (LEFT, LUNGING)}
    room.begin("a")
    alone = room.judgement(lambda j: j.person == "left" and j.votes["cam3"].state == "counted" and j.agreement.n == 3)
    assert alone.label == "lunging"
    room.people = MOVING
    both = room.judgement(lambda j: j.person == "right" and j.agreement.n == 2)
    assert both.votes["cam3"].state == "silent"


def test_a_judge_that_lies_about_one_of_two_changes_no_verdict(room):
    room.begin("a")
    room.judgement(of("right"))
    # cam3 sees the people at each other's place, and says of both what the other one does.
    liar = room.publishers.pop("cam3")
    room.people = MOVING

    def lie(stop):
        seq = 10**6
        while not stop.wait(0.01):
            for track, at, (p, rest) in (("x", RIGHT, BOWING), ("y", LEFT, LUNGING), ("z", (0.0, 3.0), BOWING)):
                seq += 1
                place = FloorPlace(at=at, covariance=(0.01, 0.0, 0.01))
                liar.put(posterior("cam3", seq, session="liar", p=p, rest=rest, person=track, place=place))

    room.mesh.run(lie)
    bowing, lunging = room.verdicts(*DECIDED)
    assert bowing.agreement.k == lunging.agreement.k == 2
    people = []
    room.judgement(lambda j: people.append(j.person) or len(people) > 60)
    assert set(people) == {"left", "right"}


def test_late_joiners_get_the_last_judgement_of_each_person_and_all_verdicts_in_order(room):
    room.begin("a")
    room.judgement(of("right"))
    room.people = MOVING
    room.verdicts(*DECIDED)
    room.judgement(lambda j: j.person == "right" and j.movement is not None and j.movement.label == "lunging")
    answers = room.hub.ask_each(room.keys.judgement, SOON_S)
    assert {decode(JudgementMessage, payload).person for _, payload in answers} == {"left", "right"}
    verdicts = [decode(VerdictMessage, payload) for _, payload in room.hub.ask_each(room.keys.verdict, SOON_S)]
    assert {verdict.person for verdict in verdicts} == {"left", "right"}
    assert [verdict.at_ns for verdict in verdicts] == sorted(verdict.at_ns for verdict in verdicts)


def test_a_service_that_shares_the_scene_takes_over_both_movements(room):
    """It does not judge while it stands by; it goes on from the last messages of the owner."""
    fusion = room.scene.fusion.model_copy(update={"standby": (), "memory": ""})
    room.scene = room.scene.model_copy(update={"fusion": fusion})
    room.begin("a", shared=True)
    room.judgement(of("right"))
    statuses = room.hub.inbox(room.keys.fusion_status("b"))
    room.begin("b", shared=True)
    # It listens, or has been handed the scene.
    up_to(statuses, StatusMessage, lambda s: s.state == "running" and s.reason in ("", "standing by for a"))
    room.people = MOVING
    ids = [verdict.id for verdict in room.verdicts(*DECIDED)]
    room.judgement(lambda j: j.person == "right" and j.movement is not None and j.movement.id == ids[1])
    owner = room.judgement(of("left")).fusion
    room.end(owner)
    room.judgement(lambda j: j.person == "right" and j.fusion != owner)
    room.people = STANDING
    assert [verdict.id for verdict in room.verdicts(*ENDED)] == ids
