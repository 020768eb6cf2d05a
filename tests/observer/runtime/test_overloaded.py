"""When an observer says that it is too slow for its source."""

import numpy as np
import pytest

from common import SECOND_NS
from common.config_sections import FusionConfig
from common.load import LoadMeter
from observer.prepared_tracks import PreparedTracker
from observer.runtime.pacing import EMPTY_HEARTBEAT, HEARTBEAT, PacedObserver, TrackingPace
from observer.runtime.service import ObserverAround
from observer.tracks import Frame, Tracks

ADVICE = "another machine helps"
RATE, PICTURE = 30, np.zeros((48, 64, 3), np.uint8)
PERSON = np.array([[100.0, 200.0], [200.0, 200.0], [150.0, 50.0]])


def complaints(observer, seconds, elapsed_s):
    """What the observer says of itself after each frame of a camera. elapsed_s: its time for a frame, in seconds."""
    said, number = [], -1
    while number < seconds * RATE:
        newest = max(number + 1, int(elapsed_s() * RATE))
        observer.step(Frame(1 + round(newest * SECOND_NS / RATE), PICTURE, skipped=newest - number - 1))
        number = newest
        said.append(observer.complaint)
    return said


class Slow:
    """An observer that takes `step_s` for each frame, and a tracker of a moving person that takes that for each run."""

    vocabulary, complaint, body_parts = None, "", ("left_hand", "right_hand", "head")

    def __init__(self, step_s):
        self.step_s, self.elapsed_s, self.spent_s = step_s, 0.0, 0.0

    def step(self, frame):
        self.elapsed_s = max(self.elapsed_s, frame.captured_ns / SECOND_NS) + self.step_s(self.elapsed_s)

    def update(self, frame):
        self.step(frame)
        return Tracks(PERSON + 80 * np.sin(frame.captured_ns / SECOND_NS * 6))


def said(step_s, seconds=20):
    slow = Slow(step_s)
    return complaints(ObserverAround(slow, LoadMeter("frames", ADVICE)), seconds, lambda: slow.elapsed_s)


def said_paced(step_s, cost_s, seconds=20):
    """With a tracker that takes `cost_s` of processor time, and `step_s` on a machine with other work."""
    slow = Slow(lambda now_s: step_s)

    class Observer:
        vocabulary, complaint = None, ""

        def step(self, frame):
            return prepared.update(frame)

    def spent_s():
        slow.spent_s += cost_s  # read before and after each run
        return slow.spent_s

    prepared = PreparedTracker(slow, slow.body_parts, cpu_s=spent_s)
    meter = LoadMeter("pictures", ADVICE)
    fusion = FusionConfig(fresh_s=0.1 / HEARTBEAT, drop_s=0.5 / EMPTY_HEARTBEAT)
    observer = PacedObserver(Observer(), prepared, TrackingPace(), fusion, meter)
    return complaints(observer, seconds, lambda: slow.elapsed_s)


@pytest.mark.parametrize(
    "step_s",
    [
        pytest.param(lambda now_s: 0.01, id="fast"),
        pytest.param(lambda now_s: 0.04, id="nearly"),
        pytest.param(lambda now_s: 2.5 if 9 < now_s < 10 else 0.01, id="one long stall"),
        pytest.param(lambda now_s: 3.0 if now_s < 1 else 0.01, id="slow to start"),
    ],
)
def test_an_observer_that_keeps_up_has_nothing_to_say(step_s):
    assert set(said(step_s)) == {""}


def test_one_that_does_not_says_what_it_uses_once_until_it_keeps_up_again():
    words = said(lambda now_s: 0.1 if now_s < 10 else 0.01)
    changes = [a for a, b in zip(words, ["", *words], strict=False) if a != b]
    assert len(changes) == 2 and changes[1] == "" and words[-1] == ""
    assert changes[0].startswith("uses 10 of 30 frames a second: ") and "another machine" in changes[0]


def test_much_worse_is_said_anew():
    words = list(dict.fromkeys(said(lambda now_s: 0.1 if now_s < 10 else 0.3, 30)))
    assert len(words) == 3 and words[1].startswith("uses 10 of") and words[2].startswith("uses ")


def test_a_tracker_that_rests_between_its_runs_is_not_too_slow():
    assert set(said_paced(0.05, cost_s=0.05)) == {""}, "8 runs a second are wanted, and done"
    assert set(said_paced(0.11, cost_s=0.05)) == {""}, "beside other work, too"
    words = said_paced(0.4, cost_s=0.05)[-1].split()
    assert words[0] == "uses" and 2 < float(words[1]) <= 2.5 and 6 < float(words[3]) <= 8, "wanted are 8 of the 30"
