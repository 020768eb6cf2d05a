"""Frames become instants at the model's rate; posteriors that are not sent are never off by more than the bound."""

import threading
from itertools import chain, pairwise

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from processes import SOON_S

from common import SECOND_NS
from common.config import MeshConfig, read_scene
from common.link import Link
from common.messages import PosteriorMessage
from common.probability import decode_facing
from common.vocabulary import Vocabulary
from common.wire import decode, encode
from observer.model.base import Header
from observer.prepared_tracks import LONGEST_GAP_S, Resampler
from observer.runtime.pipeline import Observer, Posterior, PosteriorEncoder
from observer.runtime.send_on_change import MAX_CHANGE, SendOnChange, Summary, distance
from observer.runtime.service import serve
from observer.tracks import Frame, Tracks

FRAME_NS = 33_333_333
HEARTBEAT_S = 0.1
HEARTBEAT_NS = HEARTBEAT_S * SECOND_NS
NAMES = Vocabulary(("bowing", "lunging"))
FACING = np.array([[0.7, 0.1, 0.1, 0.1], [0.25, 0.25, 0.25, 0.25]])
PROBABILITIES = st.floats(0, 1)


def posterior(p=(0.75, 0.25), rest=0.1, visible=True, **more):
    return Posterior(np.array(p), rest, 3, {"head": visible}, **more)


def encoded(posterior, **options):
    """The message as it arrives."""
    return decode(PosteriorMessage, encode(PosteriorEncoder(NAMES, "s", **options).encode(posterior, 1, 2)))


def test_facing_and_unlearned_are_in_the_message():
    message = encoded(posterior(facing=FACING, unlearned=0.125, repetitions=2.5))
    assert message.unlearned == 0.125 and message.repetitions == 2.5
    assert decode_facing(np.array(message.facing.surprise)) == pytest.approx(FACING, abs=0.03)
    without = encoded(posterior())
    assert {without.unlearned, without.facing, without.facets, without.repetitions} == {None}


@pytest.mark.parametrize("off", [1 + 2**-52, -(2**-60)])
def test_round_off_does_not_stop_an_observer(off):
    facets = {"effort_time": np.array([off, 1 - off])}
    message = encoded(posterior((off, 1 - off), off, unlearned=off, facets=facets, facing=FACING * (1 + 2**-52)))
    for value in (*message.p, message.rest, message.unlearned, *message.facets["effort_time"]):
        assert 0 <= value <= 1


class ConstantObserver:
    vocabulary, complaint, leans_on = NAMES, "", None

    def step(self, frame):
        return posterior(facing=FACING, unlearned=0.125)

    def end(self):
        return None


class OneFrame:
    rate_hz, body_parts = 10.0, ("head",)

    def frames(self, stop):
        yield Frame(1, np.zeros((1, 3)))


@pytest.mark.parametrize(("direction", "sent"), [("known", True), ("unknown", False)])
def test_facing_is_sent_only_if_the_scene_knows_the_direction(direction, sent, tmp_path):
    text = 'scene = "dojo"\n[mesh]\nmode = "process"\nendpoint = "tcp/127.0.0.1:0"\n'
    text += f'[observers.cam1]\nsource = "m.npz"\ndirection = "{direction}"\n'
    (tmp_path / "s.toml").write_text(text)
    scene = read_scene(tmp_path / "s.toml", {})
    with Link.open(scene.mesh, "fusion") as fusion:
        inbox = fusion.inbox(scene.keys.posterior())
        with Link.open(MeshConfig(mode="process", endpoint=fusion.locator), "observer") as link:
            assert link.publisher(scene.keys.posterior("cam1")).wait_for_subscriber(SOON_S)
            serve(scene, "cam1", ConstantObserver(), OneFrame(), link, threading.Event())
        (arrival,) = inbox.take(SOON_S)
    message = decode(PosteriorMessage, arrival.payload)
    assert (message.facing is not None) == sent and message.unlearned == 0.125 and message.p == [0.75, 0.25]


class CountingWatch:
    """Its posterior is in quarters of its number of frames; after the end, one movement is sure."""

    rest, unlearned, joint, p = 0.0, None, None, np.array([0.5, 0.5])
    repetitions = repeated = None

    def __init__(self):
        self.frames = self.passed = 0

    def update(self, tracks):
        self.frames += 1
        self.p = np.array([0.5, 0.5])

    def pass_over(self, tracks):
        self.passed += 1

    def end(self):
        self.p = np.array([1.0, 0.0])


class CountingModel:
    """Each watch is left in `watches`."""

    header = Header("phase", NAMES, "door", np.eye(3, 4), 10.0, ("head",))

    def __init__(self):
        self.watches = []

    def watch(self, onset):
        self.watches.append(CountingWatch())
        return self.watches[-1]


class PassThrough:
    body_parts = ("head",)

    def update(self, frame):
        return Tracks(frame.content)


def frame(n, last=False, skipped=0, seen=True):
    return Frame(n * SECOND_NS // 10, np.full((1, 2), 0.0 if seen else np.nan), last=last, skipped=skipped)


@pytest.mark.parametrize("resampler", [None, Resampler(10.0)])
def test_a_recording_ends_with_its_last_frame_and_the_next_is_watched_anew(resampler):
    observer = Observer(PassThrough(), model := CountingModel(), resampler=resampler)
    before, ended, again = (observer.step(frame(n, last=n == 1)) for n in range(3))
    assert before.p[0] == again.p[0] == 0.5 and ended.p[0] == 1.0
    assert [watch.frames for watch in model.watches] == [2, 1] and again.frames == 3
    assert observer.end().p[0] == 1.0 and observer.end() is None, "it ends once"


@pytest.mark.parametrize(
    ("frames", "watched"),
    [
        ([frame(n, seen=n % 20 > 9) for n in range(40)], [30, 10]),
        ([frame(n, seen=n % 20 > 8) for n in range(40)], [40]),
        ([frame(0), frame(11)], [1, 1]),
        ([frame(0), frame(11, skipped=10)], [2]),
        ([frame(0), frame(1, seen=False), frame(12, skipped=10)], [2, 1]),
        ([frame(30), frame(0)], [2]),
        ([frame(0, last=True), frame(12), frame(13)], [1, 2]),
    ],
    ids=["nobody for 1.1 s", "for 1 s", "no picture", "pictures left out", "nobody before", "clock back", "recordings"],
)
def test_who_comes_after_nobody_was_seen_for_a_second_is_watched_anew(frames, watched):
    observer = Observer(PassThrough(), model := CountingModel())
    for each in frames:
        observer.step(each)
    assert [watch.frames + watch.passed for watch in model.watches] == watched


def test_of_the_instants_between_frames_that_were_skipped_only_the_newest_is_classified():
    observer = Observer(PassThrough(), model := CountingModel(), resampler=Resampler(10.0))
    posteriors = [observer.step(each) for each in (frame(0), frame(2), frame(5, skipped=2), frame(6))]
    (watch,) = model.watches
    assert (watch.frames, watch.passed) == (5, 2) and [p.frames for p in posteriors] == [1, 3, 6, 7]


def test_an_observer_in_a_hurry_follows_more_frames_than_it_judges():
    observer = Observer(PassThrough(), model := CountingModel(), resampler=Resampler(10.0), judged_s=0.25)
    posteriors = [observer.step(each) for each in (frame(0), frame(2, skipped=1), frame(3), frame(5, skipped=1))]
    (watch,) = model.watches
    assert [p.judged for p in posteriors] == [True, False, True, False]
    assert (watch.frames, watch.passed) == (2, 4) and [p.frames for p in posteriors] == [1, 3, 4, 6]
    assert observer.step(frame(6, last=True)).judged, "the last word"


def test_an_observer_without_frames_has_no_last_word():
    assert Observer(PassThrough(), CountingModel()).end() is None


@st.composite
def distributions(draw, size=4):
    mass = np.array(draw(st.lists(st.floats(0.001, 1), min_size=size, max_size=size)))
    return mass / mass.sum()


@st.composite
def posteriors(draw):
    facing = np.array([draw(distributions(3)) for _ in range(4)]) if draw(st.booleans()) else None
    facets = {"shape_vertical": draw(distributions(3))} if draw(st.booleans()) else {}
    visible = {"head": draw(st.booleans()), "left_hand": draw(st.booleans())}
    unlearned = draw(st.none() | PROBABILITIES)
    return Posterior(draw(distributions()), draw(PROBABILITIES), 1, visible, facets, facing, unlearned)


@st.composite
def drifting(draw):
    """Posteriors that change little from one to the next, as those of a camera do."""
    ends = draw(st.lists(posteriors(), min_size=2, max_size=4))

    def mixed(a, b, s):
        rest, unlearned = (1 - s) * a.rest + s * b.rest, (1 - s) * (a.unlearned or 0.0) + s * (b.unlearned or 0.0)
        return Posterior((1 - s) * a.p + s * b.p, rest, 1, ends[0].visible, unlearned=unlearned)

    return [mixed(a, b, s) for a, b in pairwise(ends) for s in np.linspace(0, 1, 12)]


@given(st.lists(posteriors(), min_size=1, max_size=20) | drifting(), st.booleans())
def test_a_posterior_that_is_not_sent_is_within_the_bound_of_the_last_one_sent(stream, directed):
    on_change, last, last_ns = SendOnChange(HEARTBEAT_S, directed), None, 0
    for n, now in enumerate(stream):
        now_ns = n * FRAME_NS
        if on_change.should_send(now, now_ns):
            last, last_ns = now, now_ns
            continue
        assert last is not None and now_ns - last_ns < HEARTBEAT_NS
        assert np.abs(now.p - last.p).sum() / 2 <= MAX_CHANGE
        assert abs(now.rest - last.rest) <= MAX_CHANGE and (now.rest >= 0.5) == (last.rest >= 0.5)
        assert now.p.argmax() == last.p.argmax()
        assert any(now.visible.values()) == any(last.visible.values())
        assert (now.unlearned is None) == (last.unlearned is None)
        if directed and now.facing is not None:
            assert np.abs(now.p[:, None] * now.facing - last.p[:, None] * last.facing).sum() / 2 <= MAX_CHANGE
        for name, facet in now.facets.items():
            assert np.abs(facet - last.facets[name]).sum() / 2 <= MAX_CHANGE


@given(posteriors(), st.lists(st.integers(1, 300_000_000), min_size=5, max_size=40))
def test_an_unchanged_posterior_is_sent_at_each_heartbeat(unchanged, gaps_ns):
    on_change, times = SendOnChange(HEARTBEAT_S), np.cumsum(gaps_ns).tolist()
    sent = [at_ns for at_ns in times if on_change.should_send(unchanged, at_ns)]
    assert sent[0] == times[0]
    for before, after in pairwise(sent):
        assert after - before >= HEARTBEAT_NS
        # The first frame after the heartbeat is sent, and no later one.
        assert not any(before + HEARTBEAT_NS <= at_ns < after for at_ns in times)


@pytest.mark.parametrize(
    "changed",
    [{"p": (0.735, 0.265)}, {"rest": 0.115}, {"visible": False}, {"unlearned": 0.1},
     {"facets": {"effort_time": np.array([0.5, 0.5])}}],
)  # fmt: skip
def test_a_change_is_sent_at_once(changed):
    on_change = SendOnChange(HEARTBEAT_S)
    assert on_change.should_send(posterior(), 0)
    assert not on_change.should_send(posterior(p=(0.745, 0.255), rest=0.105), 1)
    assert on_change.should_send(posterior(**changed), 2)


@pytest.mark.parametrize(
    ("before", "after"),
    [({"p": (0.501, 0.499)}, {"p": (0.499, 0.501)}), ({"rest": 0.499}, {"rest": 0.5}),
     ({"unlearned": 0.499}, {"unlearned": 0.5}), ({"repetitions": 1.0}, {"repetitions": 1.5})],
)  # fmt: skip
def test_another_decision_is_sent_however_small_the_change(before, after):
    on_change = SendOnChange(HEARTBEAT_S)
    stream = [posterior(**fields) for fields in (before, before, after, after)]
    assert [on_change.should_send(each, n) for n, each in enumerate(stream)] == [True, False, True, False]


def test_a_clock_that_is_set_back_silences_no_observer():
    on_change = SendOnChange(HEARTBEAT_S)
    assert on_change.should_send(posterior(), 10**18) and on_change.should_send(posterior(), 5)


def test_facings_are_compared_only_if_they_are_sent():
    turned = [np.array([[1.0, 0.0]] * 2), np.array([[0.0, 1.0]] * 2)]
    for directed, far in ((True, 1.0), (False, 0.0)):
        one, other = (Summary.of(posterior(facing=facing), directed) for facing in turned)
        assert distance(one, other) == pytest.approx(far)


def at(seconds):
    """A part that moves in a straight line, and one that is never seen."""
    return Tracks(np.array([[3 * seconds, 7 - seconds], [np.nan, np.nan]]))


def resampled(rate_hz, times):
    resampler = Resampler(rate_hz)
    return [tracks for t in times for tracks in resampler.update(round(t * SECOND_NS), at(t))]


@given(st.floats(1, 120), st.integers(1, 60))
def test_a_camera_at_the_models_rate_keeps_its_own_frames(rate_hz, count):
    times = np.arange(count) / rate_hz
    instants = resampled(rate_hz, times)
    assert len(instants) == count
    assert np.allclose([i.centres[0] for i in instants], [at(t).centres[0] for t in times], atol=1e-6)


@given(st.floats(5, 60), st.lists(st.floats(0.001, 0.24), min_size=1, max_size=80))
def test_the_instants_are_the_models_whatever_the_camera_does(rate_hz, gaps):
    times = np.concatenate([[0.0], np.cumsum(gaps)])
    instants = resampled(rate_hz, times)
    assert abs(len(instants) - (times[-1] * rate_hz + 1)) <= 1
    expected = np.arange(len(instants)) / rate_hz
    assert np.allclose([i.centres[0, 0] for i in instants], 3 * expected, atol=1e-5)
    assert all(np.isnan(i.centres[1]).all() for i in instants)


def test_nothing_is_seen_in_a_gap_and_a_long_gap_is_cut_short():
    resampler = Resampler(10)
    resampler.update(0, at(0))
    late = resampler.update(SECOND_NS, at(1))
    assert [bool(i.visible[0]) for i in late] == [False] * 9 + [True]
    assert len(resampler.update(1000 * SECOND_NS, at(1000))) == LONGEST_GAP_S * 10
    assert len(resampler.update(round(1000.1 * SECOND_NS), at(1000.1))) == 1


@pytest.mark.parametrize("camera_hz", [2, 3, 4])
def test_a_slow_camera_shows_motion_between_its_own_frames(camera_hz):
    times = np.arange(12) / camera_hz
    instants = [bool(i.visible[0]) for i in resampled(10.0, times)]
    known = round(10 * times[5])
    assert all(instants[known:]), "its interval is known by then"


@pytest.mark.parametrize(("camera_hz", "away_s"), [(30, 0.3), (8, 0.3), (4, 0.5), (3, 0.6), (2, 0.9), (1, 1.0)])
def test_nothing_is_seen_while_a_camera_is_away_for_longer_than_its_own_interval(camera_hz, away_s):
    before = np.arange(20) / camera_hz
    instants = resampled(10.0, [*before, before[-1] + away_s])
    assert not any(i.visible[0] for i in instants[round(10 * before[-1]) + 1 : -1])


@pytest.mark.parametrize(("gap_s", "seen"), [(0.2, True), (0.5, True), (0.7, True), (1.0, False)])
def test_between_frames_that_an_observer_left_out_people_go_on(gap_s, seen):
    resampler, there = Resampler(10.0), Tracks(np.ones((1, 2)))
    for n in range(5):
        resampler.update(n * SECOND_NS // 10, there)
    at_ns = 4 * SECOND_NS // 10 + round(gap_s * SECOND_NS)
    *between, _ = resampler.update(at_ns, there, skipped=True)
    assert all(tracks.visible.all() == seen for tracks in between)


def thrown(seconds):
    """A part with constant acceleration, and one that is seen in the first half second."""
    return Tracks(np.array([[3 * seconds, 7 - 5 * seconds**2], [1.0, 1.0] if seconds < 0.5 else [np.nan, np.nan]]))


@given(st.lists(st.floats(0.1, 0.2), min_size=3, max_size=12))
def test_between_frames_that_an_observer_left_out_parts_move_on_a_parabola(gaps):
    resampler, times = Resampler(15.0), np.concatenate([[0.0], np.cumsum(gaps)])
    updates = [resampler.update(round(t * SECOND_NS), thrown(t), skipped=n > 1) for n, t in enumerate(times)]
    first, later = ([*chain(*some)] for some in (updates[:2], updates[2:]))
    instants = np.arange(len(first), len(first) + len(later)) / 15.0
    expected = [thrown(t).centres[0] for t in instants]
    assert np.allclose([tracks.centres[0] for tracks in later], expected, atol=1e-6)
    straight = np.interp(instants, times, 7 - 5 * times**2)
    assert np.abs(straight - np.array(expected)[:, 1]).max() > 1e-3


@pytest.mark.parametrize(("before_s", "skipped"), [(0.2, False), (0.01, True), (1.0, True)])
def test_parts_move_straight_between_frames_of_the_camera_and_without_a_sight_before(before_s, skipped):
    resampler = Resampler(20.0)
    for t in (-before_s, 0.0):
        resampler.update(round((t + 2) * SECOND_NS), Tracks(np.array([[t**2, 0.0]])))
    between = resampler.update(round(2.2 * SECOND_NS), Tracks(np.array([[0.04, 0.0]])), skipped=skipped)
    places = np.array([tracks.centres[0, 0] for tracks in between])
    assert len(places) >= 4 and np.allclose(np.diff(places), 0.01)


def test_an_empty_room_that_is_looked_at_seldom_makes_no_camera_slow():
    resampler = Resampler(10.0)
    times = [*np.arange(5) * 0.4, *(1.6 + np.arange(1, 10) / 30)]
    for t in times:
        resampler.update(round(t * SECOND_NS), at(t) if t > 1.6 else Tracks(np.full((2, 2), np.nan)))
        assert resampler.interval_s <= 1 / 29


def test_a_part_seen_in_one_of_two_frames_is_seen_near_that_one():
    resampler = Resampler(10)
    resampler.update(0, Tracks(np.full((1, 2), np.nan)))
    instants = resampler.update(2 * SECOND_NS // 10, Tracks(np.ones((1, 2))))
    assert [bool(i.visible[0]) for i in instants] == [False, True]


@pytest.mark.parametrize("back_s", [0.0, 5.0])
def test_a_clock_that_stands_or_is_set_back_loses_no_later_frame(back_s):
    resampler = Resampler(10)
    resampler.update(10 * SECOND_NS, at(10))
    resampler.update(round((10 - back_s) * SECOND_NS), at(10))
    assert len(resampler.update(round((10.1 - back_s) * SECOND_NS), at(10.1))) == 1
