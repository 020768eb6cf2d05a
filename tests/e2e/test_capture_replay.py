"""`labanmesh capture` and `replay` with real processes: what was judged live is judged again, bit for bit."""

import signal
import threading
import time

import pytest
from e2e_stage import PERFORMED, SOON_S, free_endpoint, played, started, write_scene
from e2e_stage import labanmesh as command

import labanmesh
from common.capture_file import CaptureFile
from common.config import read_scene
from common.link import Link
from common.messages import VerdictMessage
from common.wire import decode


def wait_for(condition):
    deadline_s = time.monotonic() + SOON_S
    pause = threading.Event()
    while not condition():
        assert time.monotonic() < deadline_s
        pause.wait(0.05)


def payloads(path, key):
    return [record.payload for record in CaptureFile(path).records() if (record.kind, record.key) == ("put", key)]


def process(path, *words):
    """A process in the folder of the scene file or capture `path`."""
    return started(path.parent, command(*words))


@pytest.fixture(scope="module")
def scene_file(stage):
    """A scene of two views."""
    return write_scene(stage / "captured.toml", free_endpoint(), played("door", "corner", more="speed = 2.0\n"))


@pytest.fixture(scope="module")
def captured(scene_file):
    """Two captures of the same run of `labanmesh up`: a whole one, and one killed after it had received a verdict."""
    whole, killed = scene_file.with_name("whole.mcap"), scene_file.with_name("killed.mcap")
    keys = read_scene(scene_file, {}).keys
    with (
        process(scene_file, "capture", scene_file, "-o", whole) as listening,
        process(scene_file, "capture", scene_file, "-o", killed) as dying,
    ):
        wait_for(lambda: whole.exists() and killed.exists())
        with process(scene_file, "up", scene_file, "--exit-when-done") as up:
            wait_for(lambda: payloads(killed, keys.verdict))
            dying.send_signal(signal.SIGKILL)
            assert up.wait(SOON_S) == 0, up.stdout.read()
        listening.send_signal(signal.SIGTERM)
        assert listening.wait(SOON_S) == 0
        assert f"{whole}: " in listening.stdout.read()
    return whole, killed


def test_a_replay_is_the_same_bit_for_bit_and_a_killed_capture_is_its_beginning(captured, capsys):
    whole, killed = captured
    keys = CaptureFile(whole).scene.keys
    assert labanmesh.main(["replay", str(whole)]) == 0
    output = capsys.readouterr().out
    assert f"{len(PERFORMED)} of {len(PERFORMED)} verdicts the same bit for bit" in output, output
    assert not CaptureFile(killed).complete
    received = payloads(killed, keys.verdict)
    assert received == payloads(whole, keys.verdict)[: len(received)]
    assert labanmesh.main(["replay", str(killed)]) == 0
    assert "the capture was cut off" in (output := capsys.readouterr().out) and "bit for bit" in output
    assert labanmesh.main(["replay", str(whole), "--from", "posteriors"]) == 0


def test_played_onto_a_mesh_fusion_gives_the_same_labels(captured, scene_file):
    whole, _ = captured
    scene = read_scene(scene_file, {})
    with process(scene_file, "fuse", scene_file) as fusion, Link.open(scene.mesh, "hub") as hub:
        verdicts = hub.inbox(scene.keys.verdict)
        words = ("replay", whole, "--onto", scene_file, "--only", "posteriors")
        with process(whole, *words) as player:
            assert player.wait(SOON_S) == 0, player.stdout.read()
        received, recorded = [], payloads(whole, scene.keys.verdict)
        wait_for(lambda: received.extend(verdicts.take(0.1)) or len(received) >= len(recorded))
        fusion.send_signal(signal.SIGTERM)
        assert fusion.wait(SOON_S) == 0
    then = [decode(VerdictMessage, payload) for payload in recorded]
    now = [decode(VerdictMessage, arrival.payload) for arrival in received]
    assert [verdict.label for verdict in now] == [verdict.label for verdict in then]
    assert not {verdict.id for verdict in now} & {verdict.id for verdict in then}
