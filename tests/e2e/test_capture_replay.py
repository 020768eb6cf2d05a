"""`labanmesh capture` and `replay` with real processes: live judgements are judged again, bit for bit."""

import signal
import subprocess
import sys
import threading
import time
from contextlib import contextmanager
from pathlib import Path

import pytest

import labanmesh
from common.capture_file import CaptureFile
from common.config import MeshConfig, read_scene
from common.link import Link
from common.messages import VerdictMessage
from common.wire import decode
from observer.motion.archive import MotionArchive
from observer.motion.archive_file import write_archive
from studies.performer import perform, perform_continuously

ROOT = Path(__file__).parents[2]
DONE = ("byebye", "stretch")
VIEWS = {"door": "door", "corner": "yaw:45"}
SOON_S = 60.0


@contextmanager
def process(*words):
    """A process of ours that does not outlive a failing test."""
    command = [sys.executable, "-P", "-m", "labanmesh", *map(str, words)]
    with subprocess.Popen(command, cwd=ROOT, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True) as started:
        try:
            yield started
        finally:
            started.kill()


def wait_for(condition):
    deadline_s = time.monotonic() + SOON_S
    pause = threading.Event()
    while not condition():
        assert time.monotonic() < deadline_s
        pause.wait(0.05)


def payloads(path, key):
    return [record.payload for record in CaptureFile(path).records() if (record.kind, record.key) == ("put", key)]


@pytest.fixture(scope="module")
def scene_file(tmp_path_factory):
    """A scene of two views on recorded motion of person 1, with models learned from others."""
    place = tmp_path_factory.mktemp("captured")
    learned = perform(people=("2", "3", "4"), movements=(*DONE, "lunging"), trials=2)
    write_archive(place / "learned.npz", learned)
    stream = perform_continuously("1", DONE)
    write_archive(place / "stream.npz", MotionArchive(learned.body_parts, (stream,)))
    with Link.open(MeshConfig(), "fusion", listen=["tcp/127.0.0.1:0"]) as free:
        text = f'scene = "dojo"\n[mesh]\nendpoint = "{free.locator}"\n'
    for observer, view in VIEWS.items():
        words = [place / "learned.npz", "--view", view, "-o", place / f"{observer}.model"]
        assert labanmesh.main(["learn", *map(str, words)]) == 0
        text += f'[observers.{observer}]\nsource = "stream.npz"\nview = "{view}"\nspeed = 2.0\n'
    (place / "scene.toml").write_text(text)
    return place / "scene.toml"


@pytest.fixture(scope="module")
def captured(scene_file):
    """Two captures of the same run of `labanmesh up`: a whole one, and one killed after it had received a verdict."""
    whole, killed = scene_file.with_name("whole.mcap"), scene_file.with_name("killed.mcap")
    keys = read_scene(scene_file, {}).keys
    with process("capture", scene_file, "-o", whole) as listens, process("capture", scene_file, "-o", killed) as dies:
        wait_for(lambda: whole.exists() and killed.exists())
        with process("up", scene_file, "--exit-when-done") as up:
            wait_for(lambda: payloads(killed, keys.verdict))
            dies.send_signal(signal.SIGKILL)
            assert up.wait(SOON_S) == 0, up.stdout.read()
        listens.send_signal(signal.SIGTERM)
        assert listens.wait(SOON_S) == 0
        assert f"{whole}: " in listens.stdout.read()
    return whole, killed


def test_a_replay_is_the_same_bit_for_bit_also_of_a_killed_capture(captured, capsys):
    whole, killed = captured
    keys = CaptureFile(whole).scene.keys
    assert labanmesh.main(["replay", str(whole)]) == 0
    text = capsys.readouterr().out
    assert f"{len(DONE)} of {len(DONE)} verdicts the same bit for bit" in text, text
    assert not CaptureFile(killed).complete
    received = payloads(killed, keys.verdict)
    assert received == payloads(whole, keys.verdict)[: len(received)]
    assert labanmesh.main(["replay", str(killed)]) == 0
    assert "the capture was cut off" in (text := capsys.readouterr().out) and "bit for bit" in text
    assert labanmesh.main(["replay", str(whole), "--from", "posteriors"]) == 0


def test_played_onto_a_mesh_a_live_fusion_service_gives_the_same_labels(captured, scene_file):
    whole, _ = captured
    scene = read_scene(scene_file, {})
    with process("fuse", scene_file) as fusion, Link.open(scene.mesh, "hub") as hub:
        verdicts = hub.inbox(scene.keys.verdict)
        words = ("replay", whole, "--onto", scene_file, "--only", "posteriors")
        with process(*words) as player:
            assert player.wait(SOON_S) == 0, player.stdout.read()
        received, recorded = [], payloads(whole, scene.keys.verdict)
        wait_for(lambda: received.extend(verdicts.take(0.1)) or len(received) >= len(recorded))
        fusion.send_signal(signal.SIGTERM)
        assert fusion.wait(SOON_S) == 0
    then = [decode(VerdictMessage, payload) for payload in recorded]
    now = [decode(VerdictMessage, arrival.payload) for arrival in received]
    assert [verdict.label for verdict in now] == [verdict.label for verdict in then]
    assert not {verdict.id for verdict in now} & {verdict.id for verdict in then}
