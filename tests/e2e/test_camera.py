"""Pictures through a real process: a film, its live picture and clips, and a missing camera."""

import threading

import cv2
import pytest
from e2e_stage import MOVEMENTS, SOON_S, run, started, write_scene
from processes import labanmesh, waited_s

from common.messages import Agreement, PosteriorMessage, StatusMessage, VerdictMessage, VocabularyReference
from common.picture_message import PictureMessage
from common.wire import decode, encode
from observer.geometry.views import parse_view
from observer.motion.playback import RecordedMotion
from observer.rendering.scenery import Scenery
from observer.rendering.virtual_camera import VirtualCamera
from observer.tracking.head import have_cascade
from observer.tracks import BODY_PARTS
from studies.performer import perform_continuously

SIZE = (640, 480)


@pytest.fixture
def film(stage):
    """A film of a performer who waves goodbye."""
    stream = perform_continuously("1", ("byebye",), rest_s=(0.5, 0.6))
    motion = RecordedMotion(BODY_PARTS, (stream,), speed=0)
    film = cv2.VideoWriter(str(stage / "film.avi"), cv2.VideoWriter.fourcc(*"MJPG"), stream.rate_hz, SIZE)
    for frame in VirtualCamera(motion, parse_view("door"), SIZE, Scenery(noise=2.0)).frames(threading.Event()):
        film.write(frame.content)
    film.release()
    return stage / "film.avi"


@pytest.fixture
def scene(stage, meeting):
    """Writes a scene with one observer."""

    def write(source, more):
        lines = f'source = "{source}"\nmodel = "door.model"\n{more}'
        return write_scene(stage / "scene.toml", meeting.locator, {"cam1": lines})

    return write


@pytest.fixture
def verdicts(meeting):
    """Ten times a second a verdict on the movement that goes on."""
    reference, agreement = VocabularyReference(name="movements", hash="0" * 16), Agreement(k=1, n=1)
    verdict = VerdictMessage(
        scene="dojo", fusion="fusion", seq=1, at_ns=1, vocabulary=reference, p=[0.5, 0.5], label="byebye", votes={},
        certainty_bits=0.1, rule="log", agreement=agreement, id="dojo-1", began_ns=1, decided_ns=2,
    )  # fmt: skip
    publisher, ended = meeting.publisher("laban/dojo/verdict"), threading.Event()

    def decide():
        while not ended.wait(0.1):
            publisher.put(encode(verdict))

    thread = threading.Thread(target=decide)
    thread.start()
    yield
    ended.set()
    thread.join()


@pytest.mark.skipif(not have_cascade(), reason="this OpenCV has no face cascade")
def test_a_film_is_recognised_and_shown_to_those_who_ask(stage, meeting, scene, film, verdicts):
    inbox = meeting.inbox("laban/dojo/observer/cam1/posterior")
    live, rest = meeting.inbox("laban/dojo/observer/cam1/@picture"), meeting.inbox("laban/**")
    more = 'speed = 0\npicture_hz = 5\n[observers.cam1.clips]\nfolder = "clips"\n'
    done = run(stage, "observe", scene("film.avi", more), "cam1")
    assert done.returncode == 0, done.stderr
    shown = decode(PictureMessage, live.take(SOON_S)[-1].payload)
    assert (shown.width, shown.height) == (320, 240) and shown.jpeg.startswith(b"\xff\xd8")
    assert not any("picture" in arrival.key for arrival in rest.take(0.0))
    (clip,) = (stage / "clips").iterdir()
    assert clip.name.endswith("Z_cam1_byebye_dojo-1.avi") and cv2.VideoCapture(str(clip)).read()[0]
    messages = [decode(PosteriorMessage, arrival.payload) for arrival in inbox.take(SOON_S)]
    surest = max(messages, key=lambda message: max(message.p) * (1 - message.rest))
    assert MOVEMENTS[surest.p.index(max(surest.p))] == "byebye" and max(surest.p) > 0.8


def test_a_missing_camera_is_degraded_within_a_second_of_the_start(stage, meeting, scene):
    statuses, received = meeting.inbox("laban/dojo/observer/cam1/status"), []
    file = scene("/dev/video97", "face = [1, 1, 60, 60]\n")
    with started(stage, labanmesh("observe", file, "cam1")) as observer:
        while not received or received[-1][1].state == "starting":
            arrivals = statuses.take(SOON_S)
            assert arrivals, f"only {received} arrived"
            received += [(a.arrived_ns, decode(StatusMessage, a.payload)) for a in arrivals]
        waiting_s = waited_s(observer.pid)
    (first_ns, _), (last_ns, last) = received[0], received[-1]
    assert last.state == "degraded" and "/dev/video97" in last.reason
    # What it waits for a processor is the time of a busy machine.
    assert last_ns - first_ns < (1 + waiting_s) * 1e9
