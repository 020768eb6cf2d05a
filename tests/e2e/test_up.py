"""`labanmesh up` with real processes: recordings are learned from, played, judged, and everything ends by itself."""

import os
import signal
from pathlib import Path

import pytest
from e2e_stage import (
    MOVEMENTS,
    PERFORMED,
    SOON_S,
    VIEWS,
    findings_in,
    free_endpoint,
    marks,
    played,
    run,
    started,
    write_scene,
)
from processes import labanmesh

from common.config import read_scene
from common.link import Link
from common.messages import JudgementMessage, StatusMessage, VerdictMessage, VocabularyMessage
from common.vocabulary import ABSTAIN
from common.wire import decode


@pytest.fixture
def scene(stage):
    """Writes a scene of three views; gives it with its file."""

    def write(more):
        path = write_scene(stage / "scene.toml", free_endpoint(), played(more=more))
        return read_scene(path, {}), path

    return write


def test_a_scene_is_played_judged_and_ends_by_itself(scene):
    read, path = scene("speed = 2.0\n")
    with Link.open(read.mesh, "hub") as hub:
        alive = hub.presence(f"{read.keys.root}/**/alive")
        judgements, verdicts = (hub.inbox(key, limit=100_000) for key in (read.keys.judgement, read.keys.verdict))
        done = run(path.parent, "up", path, "--exit-when-done")
        assert done.returncode == 0, done.stderr
        assert alive.wait_for(0, SOON_S)
        judgements = [decode(JudgementMessage, arrival.payload) for arrival in judgements.take(0.0)]
        verdicts = [decode(VerdictMessage, arrival.payload) for arrival in verdicts.take(0.0)]
    assert {f"{name} finished" in done.stderr for name in VIEWS} == {True}
    assert "Traceback" not in done.stderr and "again in" not in done.stderr
    counted = [judgement for judgement in judgements if judgement.agreement.n == len(VIEWS)]
    assert len(counted) > 10, done.stderr
    # Models and rules have tests of their own; here: one verdict a movement, published again when it ends.
    labels = {verdict.id: verdict.label for verdict in verdicts}
    assert len(labels) == len(PERFORMED) and set(labels.values()) <= {*PERFORMED, ABSTAIN}, f"{labels}\n{done.stderr}"
    assert set(labels.values()) & {*PERFORMED}, f"{labels}\n{done.stderr}"
    assert {verdict.id for verdict in verdicts if verdict.ended_ns is not None} == set(labels)


def test_a_running_scene_is_healthy_a_killed_observer_comes_back_and_sigterm_ends_all(stage, scene):
    read, path = scene("loop = true\n")
    status_key = read.keys.observer_status("wheel")
    with Link.open(read.mesh, "hub") as hub:
        alive = hub.presence(f"{read.keys.root}/**/alive")
        with started(stage, labanmesh("up", path)) as process:
            assert alive.wait_for(len(VIEWS) + 1, SOON_S)
            again = run(path.parent, "up", path)
            assert again.returncode == 1 and "stop that one first" in again.stderr and again.stderr.count("\n") == 1
            vocabulary = decode(VocabularyMessage, hub.ask(read.keys.vocabulary, SOON_S)[read.keys.vocabulary])
            assert set(vocabulary.labels) == {*MOVEMENTS}
            assert decode(StatusMessage, hub.ask(status_key, SOON_S)[status_key]).id == "wheel"
            examined = run(path.parent, "doctor", path, "--json")
            assert_healthy(examined.returncode, findings_in(examined.stdout))
            kill_child(process.pid, "wheel")
            assert any("wheel ended with status -9" in line for line in process.stderr)
            assert alive.wait_for(len(VIEWS) + 1, SOON_S)
            process.send_signal(signal.SIGTERM)
            process.communicate(timeout=SOON_S)
            assert process.returncode == 0
        assert alive.wait_for(0, SOON_S)


def assert_healthy(status, findings):
    """That the doctor has no error to report."""
    assert status == 0 and "error" not in {mark for mark, *_ in findings}, findings
    running = [f"{name}: running" for name in ("door", "wheel", "fusion service fusion")]
    for words in ("Zenoh answers", "judgements in", *running):
        assert marks(findings, words) == {"ok"}, findings
    assert marks(findings, "vocabulary of the models: lunging, byebye, nthrow, stretch") == {"ok"}


def kill_child(parent, observer):
    """SIGKILL the launcher's process that runs `observer`, found by its parent and its last argument."""
    children = Path(f"/proc/{parent}/task/{parent}/children")
    if not children.exists():
        pytest.skip("this /proc does not list a process's children")
    for child in children.read_text().split():
        words = Path(f"/proc/{child}/cmdline").read_bytes().split(b"\0")
        if observer.encode() in words:
            os.kill(int(child), signal.SIGKILL)
            return
    raise AssertionError(f"{observer} does not run")
