"""When the tracker is run: often while the person moves, seldom while nothing does, at once when something begins."""

import threading
from dataclasses import dataclass, field

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from common import SECOND_NS
from common.config_sections import FusionConfig
from common.load import LoadMeter
from observer.camera.opening import open_pictures
from observer.prepared_tracks import PreparedTracker
from observer.runtime.pacing import (
    ACTIVE_SHARE,
    COLUMNS,
    EMPTY_HEARTBEAT,
    EMPTY_SHARE,
    HEARTBEAT,
    HOLD_S,
    NOBODY_S,
    ROWS,
    SEARCH_SHARE,
    MotionGate,
    PacedObserver,
    TrackingPace,
    cells_of,
    is_still,
)
from observer.tracks import Frame, Tracks

BEGIN_NS = 1_700_000_000 * SECOND_NS
PERSON = np.array([[100.0, 200.0], [200.0, 200.0], [150.0, 50.0]])
NOBODY = np.full((3, 2), np.nan)
SOON_S = 0.07


def at(n, rate_hz=30.0):
    return BEGIN_NS + round(n * SECOND_NS / rate_hz)


def moving(n):
    return PERSON + 80 * np.sin(n / 5)


def standing(n):
    return PERSON + 0.5 * np.sin(n)


def nobody(n):
    return NOBODY


def runs(pace, shown, seconds, cost_s, rate_hz=30.0, first=0, changed=lambda n: False):
    """The numbers of the pictures that are tracked while the person does what is `shown`."""
    result = []
    for n in range(first, first + round(seconds * rate_hz)):
        if pace.due(at(n, rate_hz), changed(n)):
            pace.ran(at(n, rate_hz), Tracks(shown(n)), cost_s)
            result.append(n)
    return result


costs = st.floats(0.002, 0.2)


@given(costs, st.floats(5, 60))
@settings(max_examples=30, deadline=None)
def test_a_moving_person_is_tracked_as_often_as_its_share_of_a_core_allows(cost_s, rate_hz):
    seconds = 10
    count = len(runs(TrackingPace(), moving, seconds, cost_s, rate_hz)) - 1
    wanted_hz = min(rate_hz, ACTIVE_SHARE / cost_s)
    assert 0.85 * wanted_hz * seconds - 2 <= count <= wanted_hz * seconds + 2


@pytest.mark.parametrize(("shown", "limits", "hz"), [
    (moving, {"max_hz": 7}, 7),
    (standing, {"idle_hz": 3}, 3),
    (standing, {"max_hz": 1, "idle_hz": 3}, 1),
    (moving, {"max_hz": 100}, 30),
    (standing, {}, 2),
    (nobody, {}, EMPTY_SHARE / 0.03),
    (nobody, {"idle_hz": 0.2}, 0.2),
])  # fmt: skip
def test_limits_of_the_scene_file(shown, limits, hz):
    pace = TrackingPace(**limits)
    runs(pace, shown, NOBODY_S + 2, 0.03)
    later = runs(pace, shown, 30, 0.03, first=round(30 * (NOBODY_S + 2)))
    assert len(later) == pytest.approx(30 * hz, rel=0.1, abs=1)


@given(st.sampled_from([standing, nobody]), costs, st.integers(0, 200))
@settings(max_examples=30, deadline=None)
def test_a_change_ends_quiet_with_its_picture(shown, cost_s, later):
    pace, first = TrackingPace(), round(30 * (NOBODY_S + 2))
    runs(pace, shown, NOBODY_S + 2, cost_s)
    runs(pace, shown, later / 30, cost_s, first=first)
    assert pace.quiet(at(first + later))
    assert pace.due(at(first + later), changed=True)
    assert not pace.quiet(at(first + later))
    assert pace.quiet(at(first + later) + round(HOLD_S * SECOND_NS))


def test_after_a_change_the_rate_is_full_again():
    pace = TrackingPace()
    runs(pace, standing, 3, 0.02)
    assert len(runs(pace, moving, 2, 0.02, first=90, changed=lambda n: True)) == pytest.approx(40, abs=3)


def test_pictures_that_change_without_anybody_are_searched_ever_less_often():
    pace = TrackingPace()
    runs(pace, nobody, 8, 0.02)
    first = runs(pace, nobody, 1, 0.02, first=240, changed=lambda n: True)
    later = runs(pace, nobody, 10, 0.02, first=270, changed=lambda n: True)
    assert len(first) > 6 > len(later) / 10
    assert len(later) * 0.02 / 10 < 1.1 * SEARCH_SHARE


def test_a_clock_that_is_set_back_stops_nothing():
    pace = TrackingPace()
    runs(pace, moving, 3, 0.02)
    assert len(runs(pace, moving, 3, 0.02, first=-100_000)) == pytest.approx(60, abs=4)


@dataclass
class CountingTracker:
    """Finds `centres`; each run takes cost_s."""

    centres: np.ndarray
    cost_s: float = 0.02
    spent_s: float = 0.0
    seen: list = field(default_factory=list)
    body_parts = ("left_hand", "right_hand", "head")

    def update(self, frame):
        self.spent_s += self.cost_s
        self.seen.append(frame.captured_ns)
        return Tracks(self.centres)


PICTURES = [np.random.default_rng(seed).normal(120, 4, (120, 160, 3)).astype(np.uint8) for seed in range(5)]
"""Of nothing, with noise."""


class Recorder:
    """An observer whose posterior is its tracks."""

    vocabulary, complaint = None, ""

    def __init__(self, tracker):
        self._tracker = tracker

    def step(self, frame):
        return self._tracker.update(frame)


def paced(tracker, shown):
    """What an observer with this tracker publishes of each picture; None: skipped."""
    prepared = PreparedTracker(tracker, tracker.body_parts, cpu_s=lambda: tracker.spent_s)
    fusion = FusionConfig(fresh_s=0.1 / HEARTBEAT, drop_s=0.5 / EMPTY_HEARTBEAT)
    observer = PacedObserver(Recorder(prepared), prepared, TrackingPace(), fusion, LoadMeter("pictures", ""))
    return [observer.step(Frame(at(n), content, last=n == len(shown) - 1)) for n, content in enumerate(shown)]


@pytest.mark.parametrize(("centres", "longest_s"), [(PERSON, 0.14), (NOBODY, 0.54)])
def test_while_nothing_changes_the_last_tracks_are_repeated_as_a_heartbeat(centres, longest_s):
    tracker = CountingTracker(centres)
    results = paced(tracker, PICTURES * 60)
    told = [n for n, tracks in enumerate(results) if tracks is not None]
    assert max(np.diff(told)) / 30 <= longest_s
    assert all(np.allclose(results[n].centres, centres, equal_nan=True) for n in told)
    late = [captured_ns for captured_ns in tracker.seen if captured_ns >= at(240)]
    assert len(late) <= 5 < len([n for n in told if n >= 240]) or len(late) < 3
    assert tracker.seen[-1] == at(299), "the last picture of a film is always tracked"


def test_noise_and_light_are_no_movement_and_a_hand_is_one():
    random = np.random.default_rng(0)
    room = random.uniform(30, 200, (ROWS, COLUMNS)).astype(np.float32)
    gate = MotionGate()

    def changed(n, scale=1.0, hand=None):
        cells = room * scale + random.normal(0, 0.5, room.shape).astype(np.float32)
        if hand is not None:
            cells[20:23, hand : hand + 3] = 90
        return gate.update(cells, at(n))

    assert not any(changed(n) for n in range(90))
    assert not any(changed(90 + n, 1 + 0.2 * np.sin(n / 5)) for n in range(90)), "the light swings"
    changed(180, 0.5)
    assert not any(changed(181 + n, 0.5) for n in range(30)), "the light is switched"
    assert changed(211, 0.5, hand=40)
    assert changed(212, 0.5, hand=41)


def test_a_screen_is_no_movement_for_long_and_the_begin_of_one_is_not_learned():
    random = np.random.default_rng(1)
    gate = MotionGate()

    def changed(n, hand=False):
        cells = np.full((ROWS, COLUMNS), 100, np.float32) + random.normal(0, 0.5, (ROWS, COLUMNS)).astype(np.float32)
        cells[5:10, 5:12] += random.normal(0, 20, (5, 7)).astype(np.float32)
        cells[40:42, 40:43] += 30 * hand
        return gate.update(cells, at(n))

    assert sum(changed(n) for n in range(60)) > 20
    assert sum(changed(n) for n in range(60, 300)) < 60
    assert sum(changed(n) for n in range(300, 600)) < 10
    for begin in range(600, 900, 60):
        assert changed(begin, hand=True), "the same hand, again and again"
        for n in range(begin + 1, begin + 6):
            changed(n, hand=n % 2 == 0)
        gate.forget()
        assert not all(changed(n) for n in range(begin + 30, begin + 60))


@pytest.mark.parametrize("film", ["wave", "stand"])
def test_no_recorded_movement_begins_unnoticed(film, data):
    """A person who keeps still, in a noisy picture, and then goes on as recorded."""
    source = open_pictures(str(data / f"wave_webcam/{film}.mp4"), data, speed=0)
    shown = [frame.content for _, frame in zip(range(70), source.frames(threading.Event()), strict=False)]
    random = np.random.default_rng(0)
    noises = [random.normal(0, 4, shown[0].shape).astype(np.float32) for _ in range(4)]

    def cells(content, n):
        return cells_of(np.clip(content + noises[n % 4], 0, 255).astype(np.uint8))

    for begin in (5, 23, 41, 59):
        gate = MotionGate()
        noisy = [cells(shown[begin], n) for n in range(4)]
        assert not any([gate.update(noisy[n % 4], at(n)) for n in range(75)][30:]), "noise"
        # The film has 10 Hz: its next picture is 0.1 s of movement, of which a third and two thirds are shown before.
        steps = [
            shown[begin] + share * (shown[begin + 1].astype(np.float32) - shown[begin]) for share in (1 / 3, 2 / 3, 1)
        ]
        noticed = [gate.update(cells(step, n), at(75 + n)) for n, step in enumerate(steps)]
        assert any(noticed[: 1 + round(SOON_S * 30)])


@pytest.mark.parametrize(("tremble_px", "apart_px", "still"), [(10, 100, True), (14, 100, False), (1.9, 10, True)])
def test_parts_that_stay_within_a_share_of_their_distance_are_still(tremble_px, apart_px, still):
    """12 % of the distance between the farthest parts, or 2 px."""
    places = np.zeros((20, 3, 2))
    places[:, 1, 0] = apart_px
    places[:, 2] = np.nan
    places[::2, 0, 1] += tremble_px
    assert is_still(places) == still
