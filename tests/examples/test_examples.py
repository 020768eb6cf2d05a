"""The examples as processes, with a real fusion service and each other, and without labanmesh in them."""

import ast
import json
import os
import runpy
import subprocess
import sys
import threading
import time
from pathlib import Path

import pytest
from processes import SOON_S

from common.config import read_scene
from fusion.server import serve
from labanmesh_testing.mesh import Mesh
from labanmesh_testing.stub_observer import StubObserver

EXAMPLES = Path(__file__).parents[2] / "examples"
PROGRAMS = ("subscriber.py", "robot.py", "observer.py")
SCENE = """
scene = "dojo"
vocabulary = ["lunging", "byebye"]
[mesh]
mode = "process"
endpoint = "tcp/127.0.0.1:0"
[fusion]
hold_s = {0}
[observers.ear]
source = "brings its own sensor"
"""


@pytest.fixture
def scene(request, tmp_path):
    (tmp_path / "scene.toml").write_text(SCENE.format(getattr(request, "param", 0.4)))
    return read_scene(tmp_path / "scene.toml", {})


@pytest.fixture
def mesh(scene):
    mesh = Mesh(scene.mesh)
    mesh.run(serve, [scene], scene.fusion.id, mesh.meeting)
    yield mesh
    mesh.close()


class Running:
    """An example as a process; its lines are read by a thread and can be waited for."""

    def __init__(self, name, *arguments):
        command = [sys.executable, "-W", "error", str(EXAMPLES / name), *map(str, arguments)]
        self.process = subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True)
        self.lines, self._changed = [], threading.Condition()
        self._reader = threading.Thread(target=self._read)
        self._reader.start()

    def _read(self):
        for line in self.process.stdout:
            with self._changed:
                self.lines.append(line.rstrip("\n"))
                self._changed.notify_all()

    def wait_for(self, count, meanwhile=lambda: None):
        """The first `count` lines; calls `meanwhile` until they are there."""
        deadline_s = time.monotonic() + SOON_S
        with self._changed:
            while not self._changed.wait_for(lambda: len(self.lines) >= count, 0.03):
                assert time.monotonic() < deadline_s and self.process.poll() is None, self.lines
                meanwhile()
        return self.lines[:count]

    def close(self):
        self.process.kill()
        self._reader.join()
        self.process.stdin.close()
        self.process.stdout.close()
        self.process.wait()


@pytest.fixture
def started():
    running = []

    def start(name, *arguments):
        running.append(Running(name, *arguments))
        return running[-1]

    yield start
    for each in running:
        each.close()


def hum(observer, level):
    def write():
        observer.process.stdin.write(f"{level}\n")
        observer.process.stdin.flush()

    return write


def test_a_subscriber_prints_the_verdicts_on_an_observer_of_your_own(scene, mesh, started):
    subscriber = started("subscriber.py", mesh.config.endpoint)
    assert mesh.meeting.publisher(scene.keys.verdict).wait_for_subscriber(SOON_S)
    observer = started("observer.py", mesh.config.endpoint)
    assert subscriber.wait_for(1, hum(observer, -20)) == ["dojo byebye 1 of 1 agree decided"]
    assert subscriber.wait_for(2, hum(observer, -60))[1] == "dojo byebye 1 of 1 agree ended"
    assert subscriber.wait_for(4, lambda: hum(observer, -3 if len(subscriber.lines) < 3 else -60)())[2:] == [
        "dojo lunging 1 of 1 agree decided", "dojo lunging 1 of 1 agree ended",
    ]  # fmt: skip


# Time enough to act before the decision, also on a busy machine.
@pytest.mark.parametrize("scene", [2.0], indirect=True)
def test_a_robot_acts_before_the_verdict_and_takes_a_wrong_action_back(scene, mesh, started):
    robot = started("robot.py", mesh.config.endpoint, 0.9)
    assert mesh.meeting.publisher(scene.keys.judgement).wait_for_subscriber(SOON_S)
    link = mesh.peer("observer")
    verdicts = link.inbox(scene.keys.verdict)
    observer = StubObserver("ear", scene.keys, scene.named_vocabulary, link)
    (early,) = robot.wait_for(1, lambda: observer.publish("byebye", 0.99))
    assert early.startswith("wave back (byebye 9") and early.endswith(" s after it began)")
    assert not verdicts.take(0), "it acted before the decision"
    # The observer changes its mind before the first label has held for long enough.
    assert robot.wait_for(3, lambda: observer.publish("lunging", 0.995))[1:] == [
        "stop: wave back (it was lunging, not byebye)",
        "step aside (lunging by verdict)",
    ]
    verdicts.take(0)
    deadline_s = time.monotonic() + SOON_S
    while not verdicts.take(0.03):
        assert time.monotonic() < deadline_s
        observer.publish(None)
    assert len(robot.lines) == 3, "the end of the movement has the same label"


def test_a_robot_forgets_movements_that_have_ended():
    robot = runpy.run_path(str(EXAMPLES / "robot.py"))["Robot"](0.9)
    message = {"id": "v1", "label": "abstain", "ended_ns": 5, "movement": {"id": "v1", "began_ns": 0}, "at_ns": 1}
    robot.handle_judgement({**message, "label": "byebye", "p": [0.05, 0.95]})
    assert robot.acting == {"v1": "byebye"}
    robot.handle_verdict(message)
    assert robot.acting == {}
    robot.handle_judgement({**message, "label": "byebye", "p": [0.2, 0.8]})
    assert robot.acting == {}, "below its threshold"


@pytest.mark.parametrize(
    ("name", "words"), [*((name, ()) for name in (*PROGRAMS, "early.py")), ("robot.py", ("tcp/127.0.0.1:7447", "soon"))]
)
def test_without_the_right_arguments_the_usage_with_an_example_is_shown(name, words):
    # A terminal as standard input: nothing is piped in.
    keyboard, terminal = os.openpty()
    try:
        command = [sys.executable, str(EXAMPLES / name), *words]
        ended = subprocess.run(command, stdin=terminal, capture_output=True, text=True, timeout=SOON_S, check=False)
    finally:
        os.close(keyboard)
        os.close(terminal)
    lines = ended.stderr.splitlines()
    assert ended.returncode and lines[0].startswith("usage: ") and "e.g. " in lines[0] and len(lines) <= 2, lines


@pytest.mark.parametrize("name", PROGRAMS)
def test_they_need_nothing_of_labanmesh(name):
    tree = ast.parse((EXAMPLES / name).read_text())
    imported = {a.name for n in ast.walk(tree) if isinstance(n, ast.Import) for a in n.names}
    imported |= {n.module.partition(".")[0] for n in ast.walk(tree) if isinstance(n, ast.ImportFrom)}
    assert imported - set(sys.stdlib_module_names) == {"zenoh", "msgpack"}


@pytest.mark.parametrize(("name", "most"), [("subscriber.py", 15), ("observer.py", 20)])
def test_they_are_as_short_as_they_say(name, most):
    """Lines without the docstring, blank ones, comments and imports."""
    text = (EXAMPLES / name).read_text()
    lines = text.splitlines()[ast.parse(text).body[0].end_lineno :]
    assert len([line for line in lines if line.strip() and not line.lstrip().startswith(("#", "import "))]) <= most


def test_the_lamp_acts_early_and_takes_it_back():
    words = (("judgement", "byebye", ""), ("early", "byebye", "byebye"), ("corrected", "ok", "byebye"),
             ("early", "maestro", "maestro"), ("confirmed", "maestro", "maestro"), ("early", "ok", "ok"))  # fmt: skip
    lines = "".join(f"{json.dumps({'kind': kind, 'label': label, 'early': early})}\n" for kind, label, early in words)
    command = [sys.executable, EXAMPLES / "early.py"]
    result = subprocess.run(command, input=lines, capture_output=True, text=True, timeout=SOON_S, check=True)
    assert result.stdout.splitlines() == ["lamp off", "lamp as before: it was not byebye", "lamp on"]
