"""`labanmesh up` with real processes: it runs, is healthy, starts anew who dies, and ends; see test_capture_replay."""

import os
import signal
from pathlib import Path

import pytest
from e2e_stage import (
    MOVEMENTS,
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
from common.messages import StatusMessage, VocabularyMessage
from common.wire import decode


@pytest.fixture
def scene(stage):
    """A scene of three views, and its file."""
    path = write_scene(stage / "scene.toml", free_endpoint(), played(more="loop = true\n"))
    return read_scene(path, {}), path


def test_a_running_scene_is_healthy_a_killed_observer_comes_back_and_sigterm_ends_all(stage, scene):
    read, path = scene
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


def test_a_lesson_that_is_killed_ends_the_scene_that_it_started(stage):
    path = write_scene(stage / "lesson.toml", free_endpoint(), played("door", more="loop = true\n"))
    read = read_scene(path, {})
    with (
        Link.open(read.mesh, "hub") as hub,
        started(stage, labanmesh("teach", path, "wave", "clap", "--up")) as teacher,
    ):
        alive = hub.presence(f"{read.keys.root}/**/alive")
        assert alive.wait_for(2, SOON_S), "an observer and the fusion service"
        teacher.kill()
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
