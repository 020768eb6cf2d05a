"""Features of trailing windows: the stream's are those of the whole recording, wherever the person stands."""

import numpy as np
import pytest

from observer.features import BodyTrace, read_trace, width_of
from observer.model.trailing_features import TrailingFeatures, Windows
from observer.tracks import Tracks

PARTS = ("left_hand", "right_hand", "head", "left_foot", "right_foot")
RATE_HZ = 15.0
STANDING = np.array([[0.3, 0.1], [-0.3, 0.1], [0.0, -0.6], [0.1, 0.9], [-0.1, 0.9]])


def recording(seed=0, frames=90, at=(0.0, 0.0), size=1.0):
    """A person who stands for a second, then waves both hands at random."""
    rng = np.random.default_rng(seed)
    steps = rng.normal(0, 0.06, (frames, len(PARTS), 2)) * np.array([1, 1, 0.2, 0.1, 0.1])[None, :, None]
    steps[:15] = 0
    return [Tracks(size * p + at) for p in STANDING + np.cumsum(steps, axis=0) + rng.normal(0, 0.002, steps.shape)]


def features_learned():
    traces = [read_trace(PARTS, RATE_HZ, recording(seed)) for seed in range(4)]
    return TrailingFeatures.learn(Windows.of(RATE_HZ, 2.0), RATE_HZ, traces)


def newest(features, rows):
    """(size,) the features of the last row."""
    watch = features.watch()
    for row in rows:
        watch.update(row)
    return watch.features()


@pytest.fixture(scope="module")
def features():
    return features_learned()


@pytest.mark.parametrize("rate_hz", [15.0, 30.0])
def test_features_hold_velocities_per_fifteenth_of_a_second_and_statistics_of_trailing_windows(rate_hz):
    """Oracle: places and velocities (2 x 10 columns), now and over the last frames; the shares come first."""
    rng = np.random.default_rng(0)
    rows = np.cumsum(rng.normal(0, 0.1, (40, 13)), axis=0).astype(np.float32)
    channels = np.zeros((1, 84, 10), bool)
    own = TrailingFeatures(Windows((3,), (2, 7), (1,)), rate_hz, channels, np.ones((1, 84), np.float32))
    path = rows[:, :10] + np.tile(rows[:, 10:12], 5)
    velocity = np.diff(path, axis=0, prepend=path[:1]) * rate_hz / 15.0
    values = np.concatenate([rows[:, :10], velocity], axis=1)
    expected = [values[-1]]
    for length in (2, 7):
        last = values[-length:]
        expected += [last.mean(axis=0), last.min(axis=0), last.max(axis=0), last.std(axis=0)]
    np.testing.assert_allclose(own.of(rows, np.array([len(rows) - 1]))[0, 84:], np.concatenate(expected), atol=1e-4)


@pytest.mark.parametrize("rate_hz", [8.0, 12.5, 15.0, 30.0])
def test_a_watch_has_the_features_of_the_whole_recording_at_any_rate(rate_hz):
    """Also where a window is more than twice as long as the next shorter one, and after the watch has made room."""
    learned = [read_trace(PARTS, rate_hz, recording(seed)) for seed in range(4)]
    features = TrailingFeatures.learn(Windows.of(rate_hz, 1.1), rate_hz, learned)
    rows = read_trace(PARTS, rate_hz, recording(9, frames=8 * features.windows.history))
    watch, streamed = features.watch(), []
    for row in rows:
        watch.update(row)
        streamed.append(watch.features())
    different = np.abs(np.array(streamed) - features.of(rows, np.arange(len(rows)))) > 2e-5
    # A product of other shape may round differently where a convolution equals a bias.
    assert different.mean() < 1e-4


@pytest.mark.parametrize(("at", "size"), [((40.0, -7.0), 1.0), ((0.0, 0.0), 250.0), ((320.0, 240.0), 90.0)])
def test_where_and_how_large_the_person_is_does_not_matter(features, at, size):
    rows, moved = (read_trace(PARTS, RATE_HZ, recording(5, at=p, size=s)) for p, s in (((0, 0), 1.0), (at, size)))
    np.testing.assert_allclose(moved[:, :-1], rows[:, :-1], atol=1e-4)
    np.testing.assert_allclose(newest(features, moved), newest(features, rows), atol=0.02)


def test_a_hidden_part_keeps_its_place_and_the_others_go_on():
    tracks = recording(3)
    hidden = [Tracks(np.where(np.arange(5)[:, None] == 3, np.nan, t.centres)) for t in tracks[40:60]]
    rows = read_trace(PARTS, RATE_HZ, [*tracks[:40], *hidden])
    seen = read_trace(PARTS, RATE_HZ, tracks[:60])
    assert np.isfinite(rows).all() and rows.shape == (60, width_of(len(PARTS)))
    assert (rows[40:, 6:8] == rows[39, 6:8]).all()
    np.testing.assert_allclose(rows[40:, 0:2], seen[40:, 0:2], rtol=0.2)


def test_a_jump_of_one_frame_is_not_believed():
    tracks = recording(3)
    false = tracks[50].centres.copy()
    false[0] += 60.0
    rows = read_trace(PARTS, RATE_HZ, [*tracks[:50], Tracks(false), *tracks[51:]])
    np.testing.assert_allclose(rows[50, 0:2], rows[49, 0:2])
    np.testing.assert_allclose(rows[51:, 0:2], read_trace(PARTS, RATE_HZ, tracks)[51:, 0:2], atol=0.05)


def walk(trace, frames, step=(0.0, 0.0), at=(0.0, 0.0), hide=()):
    """Rows while the person stands as in STANDING and goes by `step` (u, v) in each frame from `at`; hide: frames."""
    rows = []
    for n in range(frames):
        centres = STANDING + at + np.multiply(step, n)
        rows.append(trace.update(Tracks(np.full_like(centres, np.nan) if n in hide else centres)))
    return np.array(rows)


def test_the_path_is_where_the_body_has_gone_right_and_up_in_body_sizes():
    trace = BodyTrace(PARTS, RATE_HZ)
    rows = np.concatenate([walk(trace, 20), walk(trace, 21, (0.02, -0.05))])
    size = rows[-1, -1]
    np.testing.assert_allclose(rows[-1, -3:-1] - rows[19, -3:-1], np.array([20 * 0.02, 20 * 0.05]) / size, atol=1e-5)
    np.testing.assert_allclose(rows[:, :-3], rows[:1, :-3] * rows[0, -1] / rows[:, -1:], atol=1e-5)
    expected = (STANDING - STANDING[2]) * (1, -1) / size
    np.testing.assert_allclose(rows[-1, :-3].reshape(-1, 2), expected, atol=1e-5)


@pytest.mark.parametrize(("hidden", "bridged"), [(3, True), (6, False), (16, False), (40, False)])
def test_a_body_that_was_hidden_for_long_has_not_moved(hidden, bridged):
    """It may be another person: up to 0.3 s without any part are bridged."""
    trace = BodyTrace(PARTS, RATE_HZ)
    before = walk(trace, 20)[-1]
    walk(trace, hidden, hide=range(hidden))
    after = walk(trace, 1, at=(0.5, 0.0))[-1]
    moved = 0.5 / after[-1] if bridged else 0.0
    assert after[-3] - before[-3] == pytest.approx(moved, abs=1e-4)


def test_the_longer_a_part_is_hidden_the_farther_it_may_be_and_a_jump_that_lasts_is_true():
    trace = BodyTrace(PARTS, RATE_HZ)
    size = walk(trace, 20)[-1, -1]
    far = STANDING.copy()
    far[0, 0] += 5.0 * size  # beyond 40 body sizes a second for one frame, within them for two
    assert trace.update(Tracks(far))[0] == pytest.approx(0.3 / size, abs=1e-4), "a jump"
    hidden = STANDING.copy()
    hidden[0] = np.nan
    trace = BodyTrace(PARTS, RATE_HZ)
    walk(trace, 20)
    trace.update(Tracks(hidden))
    row = trace.update(Tracks(far))
    assert row[0] == pytest.approx((far[0, 0] - far[2, 0]) / row[-1], abs=1e-4)


def test_before_the_first_sight_a_trace_is_still():
    nobody = Tracks(np.full((len(PARTS), 2), np.nan))
    trace = BodyTrace(PARTS, RATE_HZ)
    rows = [trace.update(nobody) for _ in range(5)]
    assert all((row == rows[0]).all() and np.isfinite(row).all() for row in rows)
