"""The examples as processes of their own, between a real referee and each other, and without labanmesh in them."""

import ast
import json
import runpy
import subprocess
import sys
import threading
import time
from pathlib import Path

import pytest

from common.config import MeshConfig, read_scene
from common.link import Link
from common.messages import PosteriorMessage, VocabularyReference
from common.wire import encode
from fusion.server import serve

EXAMPLES = Path(__file__).parents[2] / "examples"
PROGRAMS = ("subscriber.py", "robot.py", "judge.py")
SOON_S = 30.0
SCENE = """
scene = "dojo"
vocabulary = ["lunging", "byebye"]
[mesh]
mode = "process"
endpoint = "tcp/127.0.0.1:0"
[fusion]
hold_s = 0.4
[observers.ear]
source = "brings its own ears"
"""


class Judged:
    """A referee on the mesh, and one link of the test's own."""

    def __init__(self, scene, meeting):
        self.keys, self.meeting = scene.keys, meeting
        self.link = Link.open(MeshConfig(mode="process", endpoint=meeting.locator), "observer")
        self.mouth = self.link.publisher(scene.keys.posterior("ear"))
        self.vocabulary = VocabularyReference(name="n", hash=scene.named_vocabulary.digest)
        self.seq = 0

    def say(self, p, rest=0.02):
        """One opinion of the scene's judge, as of now."""
        self.seq += 1
        now_ns = time.time_ns()
        said = PosteriorMessage(
            scene="dojo", observer="ear", seq=self.seq, session="s", captured_ns=now_ns, sent_ns=now_ns,
            vocabulary=self.vocabulary, p=[1 - p, p], frames=self.seq, rest=rest,
        )  # fmt: skip
        self.mouth.put(encode(said))


@pytest.fixture
def judged(tmp_path):
    (tmp_path / "scene.toml").write_text(SCENE)
    scene, stop = read_scene(tmp_path / "scene.toml", {}), threading.Event()
    with Link.open(scene.mesh, "fusion") as meeting:
        judging = threading.Thread(target=serve, args=([scene], scene.fusion.id, meeting, stop))
        judging.start()
        stage = Judged(scene, meeting)
        yield stage
        stage.link.close()
        stop.set()
        judging.join()


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
        """So many lines; `meanwhile` is done again and again."""
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


def hum(judge, level):
    def say():
        judge.process.stdin.write(f"{level}\n")
        judge.process.stdin.flush()

    return say


def test_a_subscriber_hears_what_a_judge_of_ones_own_brought_about(judged, started):
    subscriber = started("subscriber.py", judged.meeting.locator)
    assert judged.meeting.publisher(judged.keys.verdict).wait_for_subscriber(SOON_S)
    judge = started("judge.py", judged.meeting.locator)
    assert subscriber.wait_for(1, hum(judge, -20)) == ["dojo byebye 1 of 1 agree decided"]
    assert subscriber.wait_for(2, hum(judge, -60))[1] == "dojo byebye 1 of 1 agree ended"
    assert subscriber.wait_for(4, lambda: hum(judge, -3 if len(subscriber.lines) < 3 else -60)())[2:] == [
        "dojo lunging 1 of 1 agree decided", "dojo lunging 1 of 1 agree ended",
    ]  # fmt: skip


def test_a_robot_acts_before_the_verdict_and_takes_it_back_when_it_was_wrong(judged, started):
    robot = started("robot.py", judged.meeting.locator, 0.9)
    assert judged.meeting.publisher(judged.keys.judgement).wait_for_subscriber(SOON_S)
    verdicts = judged.link.inbox(judged.keys.verdict)
    (early,) = robot.wait_for(1, lambda: judged.say(0.99))
    assert early.startswith("wave back (byebye 9") and early.endswith(" s after it began)")
    assert not verdicts.take(0), "it acted before anything was decided"
    # The judge changes its mind before it has held the first for long enough.
    assert robot.wait_for(3, lambda: judged.say(0.005))[1:] == [
        "stop: wave back (it was lunging, not byebye)",
        "step aside (lunging by verdict)",
    ]
    rest = iter(range(10_000))
    verdicts.take(0)
    while not verdicts.take(0.03):
        assert next(rest) < SOON_S / 0.03
        judged.say(0.5, rest=0.98)
    assert len(robot.lines) == 3, "the end of the movement says the same again: nothing to do"


def test_a_robot_forgets_movements_that_have_ended():
    robot = runpy.run_path(str(EXAMPLES / "robot.py"))["Robot"](0.9)
    said = {"id": "v1", "label": "abstain", "ended_ns": 5, "movement": {"id": "v1", "began_ns": 0}, "at_ns": 1}
    robot.heard_judgement({**said, "label": "byebye", "p": [0.05, 0.95]})
    assert robot.acting == {"v1": "byebye"}
    robot.heard_verdict(said)
    assert robot.acting == {}
    robot.heard_judgement({**said, "label": "byebye", "p": [0.2, 0.8]})
    assert robot.acting == {}, "below its threshold"


@pytest.mark.parametrize("name", PROGRAMS)
def test_nothing_of_ours_is_needed(name):
    tree = ast.parse((EXAMPLES / name).read_text())
    imported = {a.name for n in ast.walk(tree) if isinstance(n, ast.Import) for a in n.names}
    imported |= {n.module.partition(".")[0] for n in ast.walk(tree) if isinstance(n, ast.ImportFrom)}
    assert imported - set(sys.stdlib_module_names) == {"zenoh", "msgpack"}


@pytest.mark.parametrize(("name", "most"), [("subscriber.py", 15), ("judge.py", 20)])
def test_they_are_as_short_as_they_say(name, most):
    """Lines without the docstring, blank ones, comments and imports."""
    text = (EXAMPLES / name).read_text()
    lines = text.splitlines()[ast.parse(text).body[0].end_lineno :]
    assert len([line for line in lines if line.strip() and not line.lstrip().startswith(("#", "import "))]) <= most


def test_the_early_one_acts_early_and_takes_it_back():
    words = [
        {"kind": "judgement", "label": "byebye"},
        {"kind": "early", "label": "byebye", "early": "byebye"},
        {"kind": "corrected", "label": "ok", "early": "byebye"},
        {"kind": "early", "label": "maestro", "early": "maestro"},
        {"kind": "confirmed", "label": "maestro", "early": "maestro"},
        {"kind": "early", "label": "ok", "early": "ok"},
    ]
    said = subprocess.run(
        [sys.executable, EXAMPLES / "early.py"],
        input="".join(f"{json.dumps(each)}\n" for each in words),
        capture_output=True,
        text=True,
        timeout=SOON_S,
        check=True,
    )
    assert said.stdout.splitlines() == ["lamp off", "lamp as before: it was not byebye", "lamp on"]
