"""Facets during a movement: their formulas, when they are known, from which view, and with hidden parts."""

import itertools
import math

import numpy as np
import pytest
from performances import PassThrough

from common.errors import BadInput
from common.facets import FACETS
from common.posterior import check_facet_names
from common.vocabulary import Vocabulary
from observer.effort.features import DEGREE, FEATURE_NAMES, Course, coefficients, course_of, features
from observer.effort.model import EffortExample, learn_trials
from observer.effort.reader import (
    BEFORE_S,
    SHORTEST_S,
    EffortReader,
    FacetReader,
    ShapeReader,
    advancing,
    depth_in,
    rising,
    spreading,
    three_ways,
    triangle,
)
from observer.geometry.views import parse_view
from observer.model.base import Example, Header
from observer.model.phase import Phase
from observer.runtime.pipeline import Observer
from observer.tracks import BODY_PARTS, Frame, Tracks

RATE = 30.0


def wave(frames=90, quick=1.0, seed=None):
    """(T, 3, 2) image coordinates, v down: the right hand circles, the left hangs, the head nods a little."""
    t = np.arange(frames) / RATE * quick
    right = np.stack([60 + 40 * np.sin(3 * t), 20 - 40 * np.cos(2 * t)], axis=1)
    left = np.stack([-50 + 3 * np.sin(t), 150 + 0 * t], axis=1)
    head = np.stack([2 * np.sin(0.7 * t), 1 * np.cos(0.4 * t)], axis=1)
    tracks = np.stack([left, right, head], axis=1)
    return tracks if seed is None else tracks + np.random.default_rng(seed).normal(0, 0.5, tracks.shape)


def model():
    """Sudden is quick and sustained is slow; of the other factors nothing is known."""
    trials = [
        EffortExample(
            features(course_of(wave(120, quick, seed), BODY_PARTS, RATE)), (level, level, level, level), action
        )
        for action, seed in (("one", 1), ("two", 2))
        for quick, level in ((0.6, -1), (0.8, -1), (2.0, 1), (2.4, 1))
    ]
    return learn_trials(trials, "door", RATE)


def fed(reader, frames, rest):
    return [reader.update(Tracks(frame), rest) for frame in frames]


def test_all_features_of_a_whole_wave_are_known_and_none_of_its_first_frames():
    assert np.isfinite(features(course_of(wave(), BODY_PARTS, RATE))).all()
    assert len(features(course_of(wave(), BODY_PARTS, RATE))) == len(FEATURE_NAMES)
    assert np.isnan(features(course_of(wave(5), BODY_PARTS, RATE))).all()
    assert np.isnan(features(Course(BODY_PARTS, RATE))).all()


def quarter_lean(places, k):
    """The mean lean in a quarter of the movement; large ones by their logarithm."""
    lean = places[len(places) * k // 4 : len(places) * (k + 1) // 4, 0].mean()
    return np.sign(lean) * np.log(1 + abs(lean) / 0.02)


def path_over_net(places, frames):
    """Log of path over net displacement, both summed over all windows of so many frames."""
    windows = [places[n : n + frames + 1] for n in range(len(places) - frames)]
    path = sum(math.dist(one, other) for w in windows for one, other in itertools.pairwise(w))
    return np.log(path + 0.01) - np.log(sum(math.dist(w[0], w[-1]) for w in windows) + 0.01)


def test_the_features_are_their_formulas():
    """Oracle: each feature of docs/design/effort.md from positions and derivatives; the right hand moves more."""
    course = course_of(wave(seed=3), BODY_PARTS, RATE)
    places, speed = course.places, np.linalg.norm(course.moves, axis=-1)
    velocity, acceleration, _ = np.moveaxis(course.moves[:, :, 2], 1, 0)
    across = np.abs(velocity[:, 0] * acceleration[:, 1] - velocity[:, 1] * acceleration[:, 0])
    quiet = speed[:, 0, 1] <= np.quantile(speed[:, 0, 1], 0.3)
    moved, against_head = places[:, 2] - places[0, 2], places[:, :2] - places[:, 2:]
    log = np.log
    expected = {
        "acceleration": log(np.median(speed[:, 1, 1]) + 1e-3),
        "jerk": log(np.median(speed[:, 2, 1]) + 1e-3),
        "bending": path_over_net(against_head[:, 1], 8),
        "bending_other": path_over_net(against_head[:, 0], 15),
        "head_turning": log(np.median(across / (speed[:, 0, 2] ** 3 + 0.01)) + 1e-3),
        "head_quiet_speed": log(np.quantile(speed[:, 0, 2], 0.25) + 1e-3),
        "head_quiet_jerk": log(np.quantile(speed[:, 2, 2], 0.25) + 1e-3),
        "head_while_hand_quiet": log(np.abs(velocity[quiet, 0]).mean() + 2e-3) - log(speed[:, 0, 1].mean() + 0.01),
        "head_at_last": log(np.abs(np.diff(places[-18:, 2, 0])).mean() * RATE + 1e-3),
        "other_right": against_head[:, 0, 0].mean(),
        "other_up": against_head[:, 0, 1].mean(),
        "other_share": log(speed[:, 0, 0].mean() + 0.01) - log(speed[:, 0, 1].mean() + 0.01),
        "lean_last": moved[-1, 0],
    }
    for axis, way in enumerate(("lean", "rise")):
        for name, share in (("least", 0.05), ("median", 0.5), ("most", 0.95)):
            expected[f"{way}_{name}"] = np.quantile(moved[:, axis], share)
    for k, name in enumerate(("first", "second", "third", "fourth")):
        expected[f"lean_{name}_quarter"] = quarter_lean(moved, k)
    assert expected.keys() == set(FEATURE_NAMES)
    for name, value in zip(FEATURE_NAMES, features(course), strict=True):
        assert value == pytest.approx(expected[name], abs=1e-9), name


@pytest.mark.parametrize("size", [0.01, 7.0])
def test_features_do_not_depend_on_unit_and_place(size):
    there = wave() * size + (300.0, -40.0)
    mine, theirs = (features(course_of(tracks, BODY_PARTS, RATE)) for tracks in (wave(), there))
    np.testing.assert_allclose(theirs, mine, rtol=1e-6, atol=1e-6)


def test_left_and_right_hand_give_the_same_features():
    swapped = wave()[:, [1, 0, 2]]
    mine, theirs = (features(course_of(tracks, BODY_PARTS, RATE)) for tracks in (wave(), swapped))
    np.testing.assert_allclose(theirs, mine)


def test_a_hidden_hand_hides_only_its_own_features():
    gone = wave()
    gone[:, 0] = np.nan
    values = dict(zip(FEATURE_NAMES, features(course_of(gone, BODY_PARTS, RATE)), strict=True))
    assert all(np.isnan(values[name]) for name in ("other_right", "other_up", "other_share", "bending_other"))
    whole = dict(zip(FEATURE_NAMES, features(course_of(wave(), BODY_PARTS, RATE)), strict=True))
    assert values["rise_most"] > 0 and np.isfinite(values["acceleration"])
    assert np.sign(values["lean_last"]) == np.sign(whole["lean_last"])


def test_an_endless_movement_needs_no_more_memory():
    course = course_of(np.tile(wave(), (30, 1, 1)), BODY_PARTS, RATE)
    assert len(course) <= 20 * RATE
    newest = course.places[-1]
    np.testing.assert_allclose(newest, wave()[-1] * (1, -1) / course.size)
    moves = course_of(np.tile(wave(), (30, 1, 1))[-len(course) :], BODY_PARTS, RATE)
    np.testing.assert_allclose(course.moves * course.size, moves.moves * moves.size, atol=1e-6)


def test_effort_is_read_during_a_movement_and_not_at_rest():
    reader = EffortReader(model(), BODY_PARTS, RATE)
    assert fed(reader, wave(60), 0.95)[-1] == {}
    during = fed(reader, wave(90, 2.2, seed=6), 0.1)
    first = next(n for n, facets in enumerate(during) if facets)
    assert SHORTEST_S * RATE - 1 <= first <= SHORTEST_S * RATE + 8
    assert during[-1]["effort_time"][1] > 0.8
    check_facet_names(during[-1])
    assert all(abs(sum(p) - 1) < 1e-9 for p in during[-1].values())
    assert fed(reader, wave(1), 0.6)[-1] == during[-1]
    assert fed(reader, wave(1), 0.95)[-1] == {}


def test_a_new_movement_starts_from_nothing():
    reader = EffortReader(model(), BODY_PARTS, RATE)
    fed(reader, wave(120, 2.2), 0.1)
    fed(reader, wave(30, 0.0), 0.95)
    anew = fed(reader, wave(120, 0.6, seed=7), 0.1)[-1]
    fresh = EffortReader(model(), BODY_PARTS, RATE)
    fed(fresh, wave(30, 0.0), 0.95)
    alone = fed(fresh, wave(120, 0.6, seed=7), 0.1)[-1]
    assert anew["effort_time"][0] > 0.8
    for facet, p in alone.items():
        np.testing.assert_allclose(anew[facet], p, atol=0.05)


def test_the_last_frames_of_rest_belong_to_the_movement():
    reader = EffortReader(model(), BODY_PARTS, RATE)
    fed(reader, wave(60), 0.95)
    fed(reader, wave(1), 0.1)
    assert len(reader._course) == round(BEFORE_S * RATE)


def test_effort_needs_hands_and_head():
    with pytest.raises(BadInput, match="needs left_hand"):
        EffortReader(model(), ("right_hand", "head"), RATE)


def hands(left, right, frames=30):
    """(T, 3, 2), v down: both hands start beside and below the head and go so far in a second."""
    tracks = np.tile(np.array([[-40.0, 100.0], [40.0, 100.0], [0.0, 0.0]]), (frames, 1, 1))
    for part, way in enumerate((left, right)):
        tracks[:, part] += np.linspace(0, 1, frames)[:, None] * np.array(way, dtype=float)
    return tracks


@pytest.mark.parametrize(
    ("left", "right", "facet", "value"),
    [
        ((-80, 0), (80, 0), "shape_horizontal", "spreading"),
        ((38, 0), (-38, 0), "shape_horizontal", "enclosing"),
        ((0, -90), (0, -90), "shape_vertical", "rising"),
        ((0, 90), (0, 90), "shape_vertical", "sinking"),
        ((0, 0), (0, 0), "shape_vertical", "neither"),
        ((0, 0), (0, 0), "shape_horizontal", "neither"),
    ],
)
def test_shape_has_labans_names(left, right, facet, value):
    reader = ShapeReader(BODY_PARTS, RATE)
    facets = [reader.update(frame) for frame in hands(left, right)][-1]
    check_facet_names(facets)
    assert all(abs(sum(p) - 1) < 1e-9 for p in facets.values())
    assert FACETS[facet][facets[facet].argmax()] == value
    assert "shape_sagittal" not in facets


@pytest.mark.parametrize(
    ("view", "sees"), [("door", False), ("yaw:20", False), ("yaw:45", True), ("wheel", True), ("yaw:270", True)]
)
def test_advancing_is_read_only_where_depth_is_visible(view, sees):
    matrix = parse_view(view).matrix
    reader = ShapeReader(BODY_PARTS, RATE, depth_in(matrix))
    forward = np.tile(np.array([[-0.3, 1.0, -0.2], [0.3, 1.0, -0.2], [0.0, 1.6, 0.0]]), (30, 1, 1))
    forward[:, :2, 2] -= np.linspace(0, 0.6, 30)[:, None]
    image = forward @ matrix[:, :3].T[:, :2]
    facets = [reader.update(frame) for frame in image][-1]
    assert ("shape_sagittal" in facets) == sees
    if sees:
        assert FACETS["shape_sagittal"][facets["shape_sagittal"].argmax()] == "advancing"


def test_three_ways_is_a_distribution_and_symmetric():
    for rate in (-50.0, -1.0, -0.2, 0.0, 0.2, 1.0, 50.0):
        p = three_ways(rate)
        assert p.sum() == pytest.approx(1) and (p >= 0).all()
        np.testing.assert_allclose(p[::-1], three_ways(-rate), atol=1e-12)


@pytest.mark.parametrize(("hidden", "known"), [(0, ["shape_vertical"]), (2, [])])
def test_shape_with_hidden_parts(hidden, known):
    tracks, reader = hands((0, -90), (0, -90)), ShapeReader(BODY_PARTS, RATE)
    tracks[:, hidden] = np.nan
    assert list([reader.update(frame) for frame in tracks][-1]) == known


def test_the_facet_reader_gives_effort_and_shape():
    reader = FacetReader(BODY_PARTS, RATE, depth=1.0, effort=model())
    for frame in wave(60):
        reader.update(Tracks(frame), 0.1)
    check_facet_names(reader.facets)
    assert all(abs(sum(p) - 1) < 1e-9 for p in reader.facets.values())
    assert set(reader.facets) == set(FACETS)
    bare = FacetReader(("right_hand", "head"), RATE)
    bare.update(Tracks(wave(1)[0, 1:]), 0.1)
    assert bare.facets == {}


def moved(**by):
    """Hands left and right below the face, one second; `by` names the axis and the way of each hand along it."""
    tracks = np.tile(np.array([[-0.4, -1.0, -0.3], [0.4, -1.0, -0.3], [0.0, 0.0, 0.0]]), (31, 1, 1))
    for axis, (left, right) in by.items():
        tracks[:, 0, "xyz".index(axis)] += np.linspace(0, left, 31)
        tracks[:, 1, "xyz".index(axis)] += np.linspace(0, right, 31)
    return tracks


def test_shape_has_labans_signs():
    assert spreading(moved(x=(-0.5, 0.5)), 30) > 0.1
    assert spreading(moved(x=(0.3, -0.3)), 30) < -0.1
    assert rising(moved(y=(0.6, 0.6)), 30) == pytest.approx(0.6)
    assert rising(moved(y=(-0.6, 0.0)), 30) == pytest.approx(-0.3)
    assert advancing(moved(z=(-0.5, -0.5)), 30) == pytest.approx(0.5)
    assert advancing(moved(z=(0.2, 0.2)), 30) == pytest.approx(-0.2)


def test_the_triangle_is_half_base_by_height():
    assert triangle(moved())[0] == pytest.approx(0.8 * math.hypot(1.0, 0.3) / 2)


@pytest.mark.parametrize(("frames", "rate_hz"), [(5, 15.0), (7, 30.0), (13, 60.0)])
def test_the_coefficients_are_those_of_scipy(frames, rate_hz):
    savgol_coeffs = pytest.importorskip("scipy.signal").savgol_coeffs
    for order, row in enumerate(coefficients(frames, rate_hz)):
        wanted = savgol_coeffs(frames, DEGREE, deriv=order, delta=1 / rate_hz, use="dot")
        np.testing.assert_allclose(row, wanted, rtol=1e-7, atol=1e-9 * rate_hz**order)


@pytest.mark.parametrize(("reader", "names"), [(FacetReader(BODY_PARTS, RATE), {"shape_horizontal", "shape_vertical"}),
                                               (None, set())])  # fmt: skip
def test_an_observer_reads_facets_if_it_has_a_reader(reader, names):
    ways = [hands((0, -90 * way), (0, -90 * way)) for way in (1.0, -0.5)]
    header = Header("phase", Vocabulary(("up", "down")), "door", np.eye(3, 4), RATE, BODY_PARTS)
    learned = Phase.learn(header, [Example([Tracks(t) for t in way], m) for m, way in enumerate(ways)])
    observer = Observer(PassThrough(), learned, facets=reader)
    posteriors = [observer.step(Frame(n * 33_000_000, centres)) for n, centres in enumerate(ways[0])]
    assert posteriors[0].facets == {} and set(posteriors[-1].facets) == names
    if names:
        vertical = posteriors[-1].facets["shape_vertical"]
        assert FACETS["shape_vertical"][vertical.argmax()] == "rising"
