"""Whether takes are periodic: by synthetic oracles, by what must not matter, and on recorded people."""

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from observer.features import read_trace
from observer.geometry.views import parse_view
from observer.model.movement_segment import RepetitionCounter
from observer.model.periodicity import oscillation_of, period_in
from observer.motion.archive import movements_in
from observer.motion.archive_file import read_archive
from observer.motion.projected import view_tracks

RATE_HZ = 15.0
TREMOR = 0.015
"""Body sizes: a usual tracker's noise of each coordinate."""


def trace_of(hand, rng=None, parts=3):
    """(F, 2 P + 3) trace whose first part is at `hand` (F, 2), or at its side; the others stand still but for noise."""
    hand = np.asarray(hand, float)
    hand = np.stack([hand, np.zeros_like(hand)], axis=1) if hand.ndim == 1 else hand
    trace = np.zeros((len(hand), 2 * parts + 3))
    trace[:, :2], trace[:, -1] = hand, 1.0
    if rng is not None:
        trace[:, : 2 * parts] += rng.normal(0, TREMOR, (len(hand), 2 * parts))
    return trace


def seconds(duration_s, rate_hz=RATE_HZ):
    return np.arange(round(duration_s * rate_hz)) / rate_hz


def wave(period_s=0.8, duration_s=4.0, amplitude=0.3, rate_hz=RATE_HZ, drift=0.0):
    t = seconds(duration_s, rate_hz)
    return amplitude * np.sin(2 * np.pi * t / period_s) + drift * t


def strokes(count, length_s=0.8, rest_s=0.4, amplitude=1.0, rate_hz=RATE_HZ):
    """The hand goes out and comes back `count` times, with rest before, between and after."""
    rest = np.zeros(round(rest_s * rate_hz))
    stroke = amplitude * np.sin(np.pi * seconds(length_s, rate_hz) / length_s) ** 2
    return np.concatenate([rest, *[part for _ in range(count) for part in (stroke, rest)]])


def period_of(hand, rate_hz=RATE_HZ, seed=0):
    period = period_in(trace_of(hand, np.random.default_rng(seed))[:, :-3], rate_hz)
    return None if period is None else period.lag / rate_hz


@pytest.mark.parametrize("period_s", [0.4, 0.6, 0.8, 1.0, 1.3])
def test_the_period_of_a_sine_with_noise_and_drift(period_s):
    assert period_of(wave(period_s, drift=0.1)) == pytest.approx(period_s, abs=0.6 / RATE_HZ)


@pytest.mark.parametrize("count", [1, 2])
def test_one_stroke_is_not_periodic_and_two_are_not_enough(count):
    assert period_of(strokes(count)) is None


@pytest.mark.parametrize("count", [4, 6])
def test_strokes_with_a_short_rest_between_them_are(count):
    assert period_of(strokes(count)) == pytest.approx(1.2, abs=1.5 / RATE_HZ)


def test_an_arm_that_is_raised_before_and_lowered_after_hides_nothing():
    raised = np.concatenate([np.linspace(0, 2, 9), np.full(40, 2.0), np.linspace(2, 0, 9)])
    shaken = np.concatenate([np.zeros(9), wave(0.6, 40 / RATE_HZ, 0.2), np.zeros(9)])
    assert period_of(np.stack([shaken, raised], axis=1)) == pytest.approx(0.6, abs=0.5 / RATE_HZ)
    assert period_of(np.stack([0 * shaken, raised], axis=1)) is None


def test_noise_pauses_and_takes_of_a_few_frames_are_not_periodic():
    for seed in range(10):
        assert period_of(np.zeros(60), seed=seed) is None
    for frames in range(8):
        assert period_of(np.zeros(frames)) is None


@settings(max_examples=25, deadline=None)
@given(
    shift_s=st.floats(0, 1), scale=st.floats(0.5, 4), tempo=st.floats(0.7, 1.5), lost=st.floats(0, 0.2),
    angle=st.floats(0, np.pi), seed=st.integers(0, 99),
)  # fmt: skip
def test_begin_size_speed_direction_and_lost_frames_do_not_matter(shift_s, scale, tempo, lost, angle, seed):
    rng = np.random.default_rng(seed)
    hand = scale * wave(0.8 / tempo, 5.0)[round(shift_s * RATE_HZ) :]
    gone = rng.random(len(hand)) < lost
    gone[0] = False
    # A trace holds a part where it was last seen.
    hand = hand[np.maximum.accumulate(np.where(gone, 0, np.arange(len(hand))))]
    period_s = period_of(hand[:, None] * (np.cos(angle), np.sin(angle)), seed=seed)
    assert period_s == pytest.approx(0.8 / tempo, abs=1 / RATE_HZ)


def test_more_than_half_of_the_takes_have_to_be_periodic():
    rng = np.random.default_rng(0)
    waves = [trace_of(wave(period_s), rng) for period_s in (0.7, 0.8, 1.0)]
    single = [trace_of(strokes(1), rng) for _ in range(3)]
    assert oscillation_of([*waves, *single], RATE_HZ) is None and oscillation_of([], RATE_HZ) is None
    oscillation = oscillation_of([*waves, *single[1:]], RATE_HZ)
    assert oscillation.period_s == pytest.approx(0.8, abs=0.5 / RATE_HZ)
    assert oscillation.swing == pytest.approx(0.6, rel=0.1), "from one turning point to the next"
    assert abs(oscillation.axes[0, 0]) > 0.99, "from side to side"


@pytest.mark.parametrize("rate_hz", [10.0, 15.0, 30.0, 60.0])
def test_the_rate_of_the_camera_does_not_matter(rate_hz):
    takes = [trace_of(wave(rate_hz=rate_hz), np.random.default_rng(n)) for n in range(3)]
    assert oscillation_of(takes, rate_hz).period_s == pytest.approx(0.8, abs=0.05)


@pytest.fixture(scope="module")
def claps():
    return oscillation_of([trace_of(strokes(4), np.random.default_rng(n)) for n in range(3)], RATE_HZ)


def counts_of(oscillation, hand, seed=0, rests=(), rate_hz=RATE_HZ):
    """The count after each frame; rests: the frames in which the person is known to rest."""
    counter, counts = RepetitionCounter({1: oscillation}, rate_hz), []
    for n, row in enumerate(trace_of(hand, np.random.default_rng(seed))):
        counter.update(row, n in rests)
        counts.append(counter.count(1))
    return counts


@settings(max_examples=40, deadline=None)
@given(
    count=st.integers(1, 12), length_s=st.floats(0.4, 1.2), rest_s=st.floats(0, 0.5), scale=st.floats(0.6, 3),
    drift=st.floats(-0.1, 0.1), seed=st.integers(0, 99),
)  # fmt: skip
def test_every_repetition_counts_once_at_any_tempo_size_and_drift(claps, count, length_s, rest_s, scale, drift, seed):
    hand = np.concatenate([strokes(count, length_s, rest_s, scale), np.zeros(3)])
    counts = counts_of(claps, hand + drift * np.arange(len(hand)) / RATE_HZ, seed)
    assert counts[-1] == count and all(0 <= after - before <= 0.5 for before, after in pairwise(counts))


@pytest.mark.parametrize(("rest_s", "is_seen"), [(0.6, True), (4.0, False)])
def test_a_count_stays_at_rest_and_the_next_motion_begins_anew(claps, rest_s, is_seen):
    before, rest, after = strokes(5), np.zeros(round(rest_s * RATE_HZ)), strokes(2, rest_s=0.0)
    ended = len(before) + len(rest)
    hand = np.concatenate([before, rest, after, np.zeros(3)])
    counts = counts_of(claps, hand, rests=range(len(before), ended) if is_seen else ())
    assert counts[ended - 1] == 5 and max(counts[ended:]) == 5 and counts[-1] == 2
    short = counts_of(replace(claps, rest_s=rest_s + 0.1), hand, rests=range(len(before), ended))
    assert short[-1] == (7 if is_seen else 2), "a pause that is shorter than any rest between two takes is none"


def test_the_other_hand_counts_too_and_what_is_not_periodic_has_no_count():
    rng = np.random.default_rng(0)
    right, left = trace_of(wave(), rng), trace_of(wave(), rng)
    left[:, 2:4], left[:, :2] = left[:, :2].copy(), left[:, 2:4].copy()
    counter = RepetitionCounter({0: oscillation_of([right, right, left], RATE_HZ)}, RATE_HZ)
    for row in np.concatenate([right, np.repeat(right[-1:], 30, axis=0), left]):
        counter.update(row, resting=False)
    assert counter.count(0) == pytest.approx(5, abs=1) and counter.count(1) is None


def test_a_repetition_whose_return_is_not_seen_counts_if_it_went_as_far_as_usual(claps):
    """A film that is cut at the far side, or somebody who stays there."""
    whole = strokes(3, 0.8, 0.2, 1.0)
    far = len(whole) - 1 - int(np.abs(whole[::-1]).argmax())
    cut = whole[: far + 1]
    counter = RepetitionCounter({1: claps}, RATE_HZ)
    for row in trace_of(cut, np.random.default_rng(0)):
        counter.update(row, resting=False)
    assert counter.count(1) == 2.5
    counter.end()
    assert counter.count(1) == 3
    stays = np.concatenate([cut, np.full(10, cut[-1]), whole[far + 1 :]])
    counts = counts_of(claps, stays, rests=range(len(cut) + 5, len(cut) + 10))
    assert counts[len(cut)] == 2.5 and counts[len(cut) + 8] == counts[-1] == 3
    little = np.concatenate([strokes(2, 0.8, 0.2, 1.0), cut[: int(0.25 * len(cut) / 3)] * 0.4])
    counter = RepetitionCounter({1: claps}, RATE_HZ)
    for row in trace_of(little, np.random.default_rng(0)):
        counter.update(row, resting=False)
    counter.end()
    assert counter.count(1) < 3


REPEATED = ("horizontal_arm_wave", "jogging", "do_two_jumping_jacks", "fly_like_a_bird", "swim", "walk_in_place")
SINGLE = (
    "forward_punch", "hand_catch", "high_throw", "side_kick", "right_punch", "left_punch", "back_fist", "punch",
    "throw_a_ball", "bow", "raise_your_hand", "kick_a_ball", "signal_someone_to_stop",
)  # fmt: skip


@pytest.fixture(scope="module")
def recorded(data, msr):
    """The first five takes of the movements by label, as seen from the door."""
    takes = {}
    for archive in (msr, *(read_archive(data / name) for name in ("karate/karate.npz", "kinder_gator/adults.npz"))):
        for take in movements_in(archive):
            own = takes.setdefault(take.label, [])
            if take.label in (*REPEATED, *SINGLE) and len(own) < 5:
                tracks = view_tracks(parse_view("door"), take, archive.body_parts, archive.body_parts)
                own.append((read_trace(archive.body_parts, take.rate_hz, tracks), take.rate_hz))
    return takes


@pytest.mark.parametrize("label", [*REPEATED, *SINGLE])
def test_of_recorded_people_repetitions_are_periodic_and_strokes_are_not(recorded, label):
    takes, rates_hz = zip(*recorded[label], strict=True)
    oscillation = oscillation_of(takes, rates_hz[0])
    assert (oscillation is not None) == (label in REPEATED)


def test_recorded_people_who_squat_ten_times_are_counted_right(data):
    """People 1 and 2 show how it goes; 3, 4 and 5 are counted, who also do it incorrectly."""
    archive, takes = read_archive(data / "ui_prmd" / "sets.npz"), {}
    for recording in archive.recordings:
        if recording.spans[0].label == "deep_squat":
            tracks = view_tracks(parse_view("door"), recording, archive.body_parts, archive.body_parts)
            trace = read_trace(archive.body_parts, recording.rate_hz, tracks)
            takes.setdefault(recording.subject, []).append((trace, recording))
    oscillation = oscillation_of([trace for who in "12" for trace, _ in takes[who]], recording.rate_hz)
    for trace, recording in (each for who in "345" for each in takes[who]):
        counter = RepetitionCounter({0: oscillation}, recording.rate_hz)
        for row in trace:
            counter.update(row, resting=False)
        assert counter.count(0) == pytest.approx(len(recording.spans), abs=1), (recording.subject, recording.trial)
