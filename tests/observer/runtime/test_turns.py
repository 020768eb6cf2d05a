"""Observers that cannot keep up take turns: one at a time for each core, and nobody waits for ever."""

import itertools
import signal
import subprocess
import sys
import threading
from dataclasses import dataclass, field

import numpy as np
import pytest

from common import SECOND_NS
from observer.runtime.turns import SourceInTurn, Turns
from observer.tracks import Frame

HOLDER = """
import sys
from pathlib import Path
from observer.runtime.turns import Turns
Turns(Path(sys.argv[1]), lambda: 1).begin()
print("begun", flush=True)
sys.stdin.read()
"""
SOON_S = 20.0


@dataclass
class Asking:
    """A turn that another thread waits for."""

    turns: Turns
    begun: threading.Event = field(default_factory=threading.Event)

    def __post_init__(self):
        threading.Thread(target=self._begin, daemon=True).start()

    def _begin(self):
        self.turns.begin()
        self.begun.set()


def turns(folder, cores=1, longest_wait_s=SOON_S):
    return Turns(folder, lambda: cores, longest_wait_s)


def test_one_observer_after_the_other(tmp_path):
    first, second = turns(tmp_path), turns(tmp_path)
    first.begin()
    asking = Asking(second)
    assert not asking.begun.wait(0.05)
    first.end()
    assert asking.begun.wait(SOON_S)
    again = Asking(first)
    assert not again.begun.wait(0.05)
    second.end()
    assert again.begun.wait(SOON_S)


def test_as_many_at_once_as_there_are_cores(tmp_path):
    several = [turns(tmp_path, cores=3) for _ in range(4)]
    for each in several[:3]:
        each.begin()
    asking = Asking(several[3])
    assert not asking.begun.wait(0.05)
    # The fourth waits for one of the locks.
    for each in several[:3]:
        each.end()
    assert asking.begun.wait(SOON_S)


def test_many_turns_are_all_had(tmp_path):
    several, order = [turns(tmp_path) for _ in range(3)], []

    def repeat(number):
        for _ in range(20):
            several[number].begin()
            order.append(number)
            several[number].end()

    threads = [threading.Thread(target=repeat, args=(number,)) for number in range(3)]
    holder = turns(tmp_path)
    holder.begin()
    for thread in threads:
        thread.start()
    holder.end()
    for thread in threads:
        thread.join(SOON_S)
    assert len(order) == 60 and {order.count(number) for number in range(3)} == {20}


def test_one_that_does_not_end_its_turn_delays_another_one_once(tmp_path):
    stopped, other, third = turns(tmp_path), turns(tmp_path, longest_wait_s=0.05), turns(tmp_path)
    stopped.begin()
    other.begin()
    other.end()
    patient = Turns(tmp_path, lambda: 1, SOON_S)
    for _ in range(100):
        other.begin()
        other.end()
    stopped.end()
    # What it asked for comes late, and is over at once.
    patient.begin()
    patient.end()
    third.begin()
    assert not Asking(patient).begun.wait(0.05)
    third.end()


@pytest.mark.parametrize("death", [signal.SIGKILL, signal.SIGTERM])
def test_a_turn_ends_with_a_process_that_is_killed(tmp_path, death):
    command = [sys.executable, "-P", "-c", HOLDER, str(tmp_path)]
    with subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True) as holder:
        assert holder.stdout.readline() == "begun\n"
        asking = Asking(turns(tmp_path))
        assert not asking.begun.wait(0.05)
        holder.send_signal(death)
        assert asking.begun.wait(SOON_S)


def test_without_the_folder_there_are_no_turns(tmp_path):
    for each in (turns(tmp_path / "gone"), turns(tmp_path / "gone")):
        each.begin()


@dataclass
class Recorded:
    """Notes when turns begin and end."""

    events: list = field(default_factory=list)

    def begin(self):
        self.events.append("begin")

    def end(self):
        self.events.append("end")


@dataclass
class Frames:
    """A source of these frames, 5 a second."""

    several: list
    rate_hz: float = 5.0
    body_parts: tuple = ()

    def frames(self, _stop):
        yield from self.several


def frame(at_s, skipped=0, last=False):
    return Frame(round(at_s * SECOND_NS), np.empty(0), skipped=skipped, last=last)


def delivered(frames, now_s, recorded):
    source = SourceInTurn(Frames(frames), recorded, lambda: round(now_s * SECOND_NS))
    for each in source.frames(threading.Event()):
        recorded.events.append((each.captured_ns / SECOND_NS, each.skipped, each.last))
    return recorded.events


def test_an_observer_that_keeps_up_takes_no_turns_nor_one_that_leaves_out_a_few():
    frames = [frame(0.0), frame(0.1), frame(0.4, skipped=2), frame(0.5, last=True)]
    assert delivered(frames, 5.0, Recorded()) == [(0.0, 0, False), (0.1, 0, False), (0.4, 2, False), (0.5, 0, True)]


def test_the_newest_picture_is_taken_when_the_turn_has_come():
    frames = [frame(0.4, skipped=3), frame(0.6, skipped=1)]
    assert delivered(frames, 0.65, Recorded()) == ["begin", (0.6, 5, False), "end"]
    assert delivered(frames[:1], 0.45, Recorded()) == ["begin", (0.4, 3, False), "end"]


def test_turns_go_on_until_the_gaps_are_short():
    recorded = delivered([frame(0.4, 3), frame(0.6, 1), frame(0.8, 1), frame(1.0, 1), frame(1.2, 1)], 0.0, Recorded())
    assert recorded == [
        "begin", (0.4, 3, False), "end", "begin", (0.6, 1, False), "end",
        (0.8, 1, False), (1.0, 1, False), (1.2, 1, False),
    ]  # fmt: skip


def test_the_last_picture_is_not_left_out_and_waits_for_nobody():
    assert delivered([frame(0.4, 3, last=True)], 9.0, Recorded()) == [(0.4, 3, True)]
    frames = [frame(0.4, skipped=3), frame(0.6, skipped=1, last=True)]
    assert delivered(frames, 9.0, Recorded()) == ["begin", (0.6, 5, True), "end"]
    assert delivered([frame(0.4, skipped=3)], 9.0, Recorded()) == ["begin", (0.4, 3, False), "end"]


def test_a_turn_ends_when_the_source_is_closed():
    recorded = Recorded()
    frames = SourceInTurn(Frames([frame(0.4, skipped=3)] * 3), recorded, lambda: 0).frames(threading.Event())
    assert len(list(itertools.islice(frames, 1))) == 1
    frames.close()
    assert recorded.events == ["begin", "end"]
