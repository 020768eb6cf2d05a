"""`labanmesh up`, `capture` and `replay` with real processes: what was judged live is judged again, bit for bit."""

import re
import signal

import pytest
from e2e_stage import PERFORMED, SOON_S, free_endpoint, played, started, write_scene
from processes import labanmesh as command
from processes import until

import labanmesh
from common.capture_file import CaptureFile
from common.config import read_scene
from common.link import Link
from common.message_types import OVERLOADED
from common.messages import JudgementMessage, VerdictMessage
from common.vocabulary import ABSTAIN
from common.wire import decode

SEEN_FROM = ("door", "corner")


def payloads(path, key):
    return [record.payload for record in CaptureFile(path).records() if (record.kind, record.key) == ("put", key)]


def process(path, *words):
    """A process in the folder of the scene file or capture `path`."""
    return started(path.parent, command(*words))


@pytest.fixture(scope="module")
def captured(stage):
    """What `capture` gives of a run in which the observers kept up: a busy machine plays the recording more slowly."""
    for speed in (2.0, 1.0, 0.5):
        sections = played(*SEEN_FROM, more=f"speed = {speed}\n")
        whole, killed, log = capture(write_scene(stage / f"captured-{speed:g}.toml", free_endpoint(), sections))
        if OVERLOADED not in log:
            break
    return whole, killed, log


def capture(scene_file):
    """Two captures of one run of `labanmesh up`, one of them killed after a verdict; and what `up` wrote."""
    whole, killed = scene_file.with_suffix(".mcap"), scene_file.with_suffix(".killed.mcap")
    keys = read_scene(scene_file, {}).keys
    with (
        process(scene_file, "capture", scene_file, "-o", whole) as listening,
        process(scene_file, "capture", scene_file, "-o", killed) as dying,
    ):
        until(lambda: whole.exists() and killed.exists())
        with process(scene_file, "up", scene_file, "--exit-when-done") as up:
            # Each look reads the whole capture.
            until(lambda: payloads(killed, keys.verdict))
            dying.send_signal(signal.SIGKILL)
            _, log = up.communicate(timeout=SOON_S)
            assert up.returncode == 0, log
        listening.send_signal(signal.SIGTERM)
        assert listening.wait(SOON_S) == 0
        assert f"{whole}: " in listening.stdout.read()
    return whole, killed, log


def test_a_scene_is_played_judged_and_ends_by_itself(captured):
    whole, _, log = captured
    keys = CaptureFile(whole).scene.keys
    assert {f"{name} finished" in log for name in SEEN_FROM} == {True}
    assert "Traceback" not in log and "again in" not in log
    judgements = [decode(JudgementMessage, payload) for payload in payloads(whole, keys.judgement)]
    assert sum(judgement.agreement.n == len(SEEN_FROM) for judgement in judgements) > 10, log
    # Models and rules have tests of their own; here: one verdict a movement, published again when it ends.
    verdicts = [decode(VerdictMessage, payload) for payload in payloads(whole, keys.verdict)]
    labels = {verdict.id: verdict.label for verdict in verdicts}
    assert len(labels) == len(PERFORMED) and set(labels.values()) <= {*PERFORMED, ABSTAIN}, f"{labels}\n{log}"
    assert set(labels.values()) & {*PERFORMED}, f"{labels}\n{log}"
    assert {verdict.id for verdict in verdicts if verdict.ended_ns is not None} == set(labels)


def test_a_replay_is_the_same_bit_for_bit_and_a_killed_capture_is_its_beginning(captured, capsys):
    whole, killed, _ = captured
    keys = CaptureFile(whole).scene.keys
    assert labanmesh.main(["replay", str(whole)]) == 0
    output = capsys.readouterr().out
    # How many there are is the machine's load; that they are the same is the replay's work.
    assert re.search(r"([1-9]\d*) of \1 verdicts? the same bit for bit", output), output
    assert not CaptureFile(killed).complete
    received = payloads(killed, keys.verdict)
    assert received == payloads(whole, keys.verdict)[: len(received)]
    assert labanmesh.main(["replay", str(killed)]) == 0
    assert "the capture was cut off" in (output := capsys.readouterr().out) and "bit for bit" in output


def played_onto(scene, scene_file, whole):
    """The verdicts of a fusion service onto whose mesh the posteriors of a capture are played."""
    with process(scene_file, "fuse", scene_file) as fusion, Link.open(scene.mesh, "hub") as hub:
        judgements, verdicts = hub.inbox(scene.keys.judgement), hub.inbox(scene.keys.verdict)
        words = ("replay", whole, "--onto", scene_file, "--only", "posteriors")
        with process(whole, *words) as player:
            assert player.wait(SOON_S) == 0, player.stdout.read()
        judgements.take(0.0)
        until(lambda: any(decode(JudgementMessage, a.payload).agreement.n == 0 for a in judgements.take(0.1)))
        fusion.send_signal(signal.SIGTERM)
        assert fusion.wait(SOON_S) == 0
        return [decode(VerdictMessage, arrival.payload) for arrival in verdicts.take(0.0)]


def test_played_onto_a_mesh_fusion_gives_the_same_labels(captured):
    whole, _, _ = captured
    scene_file = whole.with_suffix(".toml")
    scene = read_scene(scene_file, {})
    then = [decode(VerdictMessage, payload) for payload in payloads(whole, scene.keys.verdict)]
    assert then
    # It is played in real time, which a busy machine may not keep once.
    for _ in range(3):
        now = played_onto(scene, scene_file, whole)
        assert not {verdict.id for verdict in now} & {verdict.id for verdict in then}
        if [verdict.label for verdict in now] == [verdict.label for verdict in then]:
            return
    raise AssertionError(f"{now}, and it was {then}")
