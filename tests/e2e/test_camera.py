"""Pictures through a real process: a film, its preview, and a missing camera."""

import subprocess
import sys
import threading
from pathlib import Path

import cv2
import pytest

from common.config import MeshConfig
from common.link import Link
from common.messages import PosteriorMessage, StatusMessage
from common.wire import decode
from observer.geometry.views import parse_view
from observer.motion.archive import resample
from observer.motion.archive_file import write_archive
from observer.motion.playback import RecordedMotion
from observer.rendering.scenery import Scenery
from observer.rendering.virtual_camera import VirtualCamera
from observer.tracking.head import have_cascade
from studies.performer import perform, perform_continuously

ROOT = Path(__file__).parents[2]
MOVEMENTS = ("lunging", "byebye", "nthrow", "stretch")
SOON_S = 30.0
SIZE = (640, 480)


def labanmesh(*words):
    return [sys.executable, "-P", "-m", "labanmesh", *map(str, words)]


@pytest.fixture(scope="module")
def stage(tmp_path_factory):
    """A folder with a model of the door and a film of a performer who waves goodbye."""
    folder = tmp_path_factory.mktemp("camera")
    learned = perform(people=("2", "3", "4"), movements=MOVEMENTS, trials=2)
    write_archive(folder / "learned.npz", learned)
    learn = labanmesh("learn", folder / "learned.npz", "--view", "door", "-o", folder / "cam1.model")
    subprocess.run(learn, cwd=ROOT, check=True, capture_output=True, timeout=60)
    stream = resample(perform_continuously("1", ("byebye",)), 30.0)
    motion = RecordedMotion(learned.body_parts, (stream,), speed=0)
    film = cv2.VideoWriter(str(folder / "film.avi"), cv2.VideoWriter.fourcc(*"MJPG"), 30.0, SIZE)
    for frame in VirtualCamera(motion, parse_view("door"), SIZE, Scenery(noise=2.0)).frames(threading.Event()):
        film.write(frame.content)
    film.release()
    return folder


@pytest.fixture
def meeting():
    with Link.open(MeshConfig(), "fusion", listen=["tcp/127.0.0.1:0"]) as link:
        yield link


def scene_file(stage, meeting, source, extra=""):
    file = stage / "scene.toml"
    file.write_text(
        f'scene = "dojo"\n[mesh]\nendpoint = "{meeting.locator}"\n[observers.cam1]\nsource = "{source}"\n{extra}'
    )
    return file


@pytest.mark.skipif(not have_cascade(), reason="this OpenCV has no face cascade")
def test_a_film_is_recognised_and_previewed(stage, meeting):
    inbox = meeting.inbox("laban/dojo/observer/cam1/posterior")
    words = ("observe", scene_file(stage, meeting, "film.avi", "speed = 0\n"), "cam1")
    run = subprocess.run(
        labanmesh(*words, "--preview", stage / "seen.mp4"), cwd=ROOT, capture_output=True, text=True, timeout=SOON_S
    )
    assert run.returncode == 0, run.stderr
    messages = [decode(PosteriorMessage, arrival.payload) for arrival in inbox.take(SOON_S)]
    surest = max(messages, key=lambda message: max(message.p) * (1 - message.rest))
    assert MOVEMENTS[surest.p.index(max(surest.p))] == "byebye" and max(surest.p) > 0.8
    film, preview = (cv2.VideoCapture(str(stage / name)) for name in ("film.avi", "seen.mp4"))
    assert preview.get(cv2.CAP_PROP_FRAME_COUNT) == film.get(cv2.CAP_PROP_FRAME_COUNT)
    film.release()
    preview.release()


def test_a_missing_camera_is_degraded_within_a_second_of_the_start(stage, meeting):
    statuses = meeting.inbox("laban/dojo/observer/cam1/status")
    messages = []
    command = labanmesh("observe", scene_file(stage, meeting, "/dev/video97", "face = [1, 1, 60, 60]\n"), "cam1")
    with subprocess.Popen(command, cwd=ROOT, stderr=subprocess.DEVNULL) as process:
        watchdog = threading.Timer(SOON_S, process.kill)
        watchdog.start()
        try:
            while not messages or messages[-1][1].state == "starting":
                arrived = statuses.take(SOON_S)
                assert arrived, f"only {messages} arrived"
                messages += [(a.arrived_ns, decode(StatusMessage, a.payload)) for a in arrived]
        finally:
            watchdog.cancel()
            process.terminate()
            process.wait(SOON_S)
    first, last = messages[0], messages[-1]
    assert last[1].state == "degraded" and "/dev/video97" in last[1].reason
    assert last[0] - first[0] < 1e9
