"""`labanmesh up` with real processes: recordings are learned from, played, judged, and everything ends by itself."""

import os
import signal
import subprocess
import threading
from pathlib import Path

import pytest
from e2e_stage import MOVEMENTS, PERFORMED, SOON_S, VIEWS, free_endpoint, labanmesh, played, run, write_scene

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


class Listener:
    """A hub that collects judgements and verdicts in a thread, until it is closed."""

    def __init__(self, scene):
        self.link = Link.open(scene.mesh, "hub")
        self.alive = self.link.presence(f"{scene.keys.root}/**/alive")
        self.judgements, self.verdicts = [], []
        self._inbox = self.link.inbox(scene.keys.judgement, scene.keys.verdict)
        self._keys, self._ended = scene.keys, threading.Event()
        self._thread = threading.Thread(target=self._listen)
        self._thread.start()

    def _listen(self):
        while not self._ended.is_set():
            for arrival in self._inbox.take(0.1):
                if arrival.key == self._keys.judgement:
                    self.judgements.append(decode(JudgementMessage, arrival.payload))
                else:
                    self.verdicts.append(decode(VerdictMessage, arrival.payload))

    def __enter__(self):
        return self

    def __exit__(self, *_):
        self._ended.set()
        self._thread.join()
        self.link.close()


def test_a_scene_is_played_judged_and_ends_by_itself(scene):
    read, path = scene("speed = 2.0\n")
    with Listener(read) as hub:
        done = run(path.parent, "up", path, "--exit-when-done")
        assert done.returncode == 0, done.stderr
        assert hub.alive.wait_for(0, SOON_S)
    assert {f"{name} finished" in done.stderr for name in VIEWS} == {True}
    assert "Traceback" not in done.stderr and "again in" not in done.stderr
    counted = [judgement for judgement in hub.judgements if judgement.agreement.n == len(VIEWS)]
    assert len(counted) > 10, done.stderr
    # Models and rules have tests of their own; here: one verdict a movement, published again when it ends.
    labels = {verdict.id: verdict.label for verdict in hub.verdicts}
    assert len(labels) == len(PERFORMED) and set(labels.values()) <= {*PERFORMED, ABSTAIN}, f"{labels}\n{done.stderr}"
    assert set(labels.values()) & {*PERFORMED}, f"{labels}\n{done.stderr}"
    assert {verdict.id for verdict in hub.verdicts if verdict.ended_ns is not None} == set(labels)


def test_a_killed_observer_comes_back_and_sigterm_ends_all(scene):
    read, path = scene("loop = true\n")
    with Listener(read) as hub:
        with subprocess.Popen(labanmesh("up", path), cwd=path.parent, stderr=subprocess.PIPE, text=True) as process:
            log = ProcessLog(process.stderr)
            assert hub.alive.wait_for(len(VIEWS) + 1, SOON_S), log.text
            answer = hub.link.ask(read.keys.vocabulary, SOON_S)[read.keys.vocabulary]
            assert set(decode(VocabularyMessage, answer).labels) == {*MOVEMENTS}
            answer = hub.link.ask(read.keys.observer_status("wheel"), SOON_S)[read.keys.observer_status("wheel")]
            assert decode(StatusMessage, answer).id == "wheel"
            kill_child(process.pid, "wheel")
            log.wait_for("wheel ended with status -9")
            assert hub.alive.wait_for(len(VIEWS) + 1, SOON_S), log.text
            process.send_signal(signal.SIGTERM)
            assert process.wait(SOON_S) == 0
        assert hub.alive.wait_for(0, SOON_S)


class ProcessLog:
    """A process's stderr, read in a thread so that it never blocks, and that can be waited for."""

    def __init__(self, stream):
        self.text = ""
        self._stream, self._changed = stream, threading.Condition()
        threading.Thread(target=self._read, daemon=True).start()

    def _read(self):
        for line in self._stream:
            with self._changed:
                self.text += line
                self._changed.notify_all()

    def wait_for(self, words):
        with self._changed:
            assert self._changed.wait_for(lambda: words in self.text, SOON_S), self.text


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
