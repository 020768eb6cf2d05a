"""The posterior of the stacked model is its stacker's, from what its members say in each frame. Motion too small for
any learned movement is something else: standing, trembling, shifting one's weight."""

from types import SimpleNamespace

import numpy as np
import pytest
from performances import DOOR

from common.vocabulary import Vocabulary
from observer.features import BodyTrace, extent
from observer.learning.learn import learn_view
from observer.model.base import Onset
from observer.model.nearest_take import NearestTakeWatch
from observer.model.stacker import LOWEST, instant_of, shown_by
from observer.motion.projected import view_tracks
from observer.tracks import BODY_PARTS, Tracks
from studies.performer import perform

LABELS = ("ok", "shake")


@pytest.fixture(scope="module")
def people():
    return perform(("1", "2"), LABELS, trials=1, seed=2)


@pytest.fixture(scope="module", params=[1, 2], ids=["one facing", "two facings"])
def model(request, people):
    parameters = {"facings": float(request.param), "kernels": 84.0}
    return learn_view(people, DOOR, Vocabulary(LABELS), kind="stacked", parameters=parameters, calibrate=False)


def tracks_of(people, number=0):
    return view_tracks(DOOR, people.recordings[number], people.body_parts, people.body_parts)


def rows_of(model, tracks):
    """(F, 9) the trace, as a watch of the model reads it."""
    trace = BodyTrace(BODY_PARTS, model.header.rate_hz, model.usual_posture)
    return np.array([trace.update(each) for each in tracks])


@pytest.mark.parametrize("begin_known", [True, False])
def test_the_posterior_is_that_of_the_stacker_from_what_each_member_says(people, model, begin_known):
    tracks = list(tracks_of(people, 1))
    # Where one movement follows another for longer than any example, nobody knows where it began.
    tracks = tracks[: len(tracks) // 2] if begin_known else tracks * 4
    watch = model.watch(Onset(known=True))
    for each in tracks:
        (watch.pass_over if begin_known else watch.update)(each)
    watch.classify()
    assert watch.instant.context[3] == (not begin_known)
    rows, rate_hz = rows_of(model, tracks), model.header.rate_hz
    log_trailing = model.trailing_answers.log_probabilities(model.trailing.of(rows, np.array([len(rows) - 1])))[0]
    of_begin = {"phase": None, "log_segment": None, "distances": None, "elapsed": 1.0}
    if begin_known:
        phase = model.phase.watch(Onset(known=True))
        for each in tracks:
            phase.update(each)
        log_segment = model.segments.log_posteriors([rows])[:, 0].astype(float)
        length = np.exp(log_segment[0]) @ model.lengths
        of_begin = {"phase": phase.p, "log_segment": log_segment, "distances": None, "elapsed": len(rows) / length}
        if model.takes is not None:
            of_begin["distances"] = NearestTakeWatch(model.takes, rows).relative_distances
    expected = instant_of(
        log_trailing=log_trailing.astype(float), extents=extent(rows, rate_hz) / model.extents, over=False, **of_begin
    )
    p, something_else = model.stacker.judge(expected)
    np.testing.assert_allclose(watch.p, p, atol=1e-3)
    assert watch.unlearned.sum() == pytest.approx(float(something_else), abs=2e-3)


def test_after_the_end_the_course_since_the_begin_counts_too(people, model):
    watch, instants = model.watch(Onset(known=True)), []
    for each in tracks_of(people, 1):
        watch.update(each)
        instants += [watch.instant] if watch.instant not in instants else []
    watch.end()
    judged = [model.stacker.judge(instant) for instant in [*instants, watch.instant]]
    course = sum(shown_by(*each) for each in judged)
    np.testing.assert_allclose(watch.p, model.stacker.judge_ended(watch.instant, course)[0], atol=1e-9)
    assert watch.unlearned.sum() == pytest.approx(float(judged[-1][1]))


def test_in_the_rest_after_a_movement_its_segment_is_not_judged_again(people, model, monkeypatch):
    tracks = [*tracks_of(people, 1)]
    tracks += tracks[-1:] * 20
    judged, segments = [], model.segments
    counted = SimpleNamespace(log_posteriors=lambda rows: judged.extend(rows) or segments.log_posteriors(rows))
    monkeypatch.setattr(model, "segments", counted)
    watch, at_rest = model.watch(Onset(known=True)), []
    for each in tracks:
        before = len(judged)
        watch.update(each)
        if watch.instant.context[1]:
            at_rest.append((len(judged) - before, watch.instant.members[2:4]))
    assert len(at_rest) > 8 and sum(calls for calls, _ in at_rest) <= 1
    anew = segments.log_posteriors(judged[-1:])[:, 0]
    np.testing.assert_allclose(at_rest[-1][1], np.maximum(anew, LOWEST), atol=1e-5)


def test_a_movement_that_begins_and_ends_between_two_judgements_is_judged_by_its_own_segment(people, model):
    first, second = (list(tracks_of(people, number)) for number in (0, 1))
    watch, judged = model.watch(Onset()), []
    for watched, see in ((first[:1] * 20 + first, watch.update), (second, watch.pass_over)):
        for each in watched + watched[-1:] * 20:
            see(each)
        watch.classify()
        assert watch.instant.context[1] and not watch.instant.context[3], "over, its begin known"
        judged.append(watch.instant.members[2:4])
    assert not np.array_equal(*judged)


@pytest.mark.parametrize("trembling", [0.01, 0.03])
def test_trembling_in_the_rest_after_a_movement_leaves_the_belief(people, model, trembling):
    """A frame or two of it look like the begin of the next movement."""
    moves = [t.centres for t in tracks_of(people, 1)]
    size, rng = np.ptp(moves[0], axis=0).max(), np.random.default_rng(1)
    watch, believed = model.watch(Onset()), []
    for centres in [*moves[:1] * 20, *moves]:
        watch.update(Tracks(centres))
    truth = int(watch.p.argmax())
    for _ in range(45):
        watch.update(Tracks(moves[-1] + rng.normal(0, trembling * size, moves[-1].shape)))
        believed.append(watch.p[truth])
    assert min(believed) > 0.85 * believed[0]


def test_facings_are_those_of_the_phase_filter(people, model):
    watch, phase = model.watch(Onset(known=True)), model.phase.watch(Onset(known=True))
    for tracks in tracks_of(people, 1):
        watch.update(tracks)
        phase.update(tracks)
    if model.phase.facings == 1:
        assert watch.joint is None and phase.joint is None
        return
    np.testing.assert_allclose(watch.joint, watch.p[:, None] * phase.joint / phase.p[:, None], atol=1e-6)
    assert watch.unlearned.sum() <= 1


def test_a_person_out_of_sight_is_forgotten(people, model):
    watch = model.watch(Onset(known=True))
    for tracks in tracks_of(people):
        watch.update(tracks)
    before = watch.p.max()
    for _ in range(60 * round(model.header.rate_hz)):
        watch.update(Tracks(np.full((3, 2), np.nan)))
    assert watch.p.max() < 0.55 < before
    assert watch.unlearned.sum() == pytest.approx(1 / 3, abs=0.05)


@pytest.fixture(scope="module")
def two_takes():
    return perform(("1", "2"), LABELS, trials=2, seed=2)


@pytest.fixture(scope="module")
def calibrated(two_takes):
    return learn_view(two_takes, DOOR, Vocabulary(LABELS))


def centres_of(people, number=0):
    recording = people.recordings[number]
    return np.array([t.centres for t in view_tracks(DOOR, recording, people.body_parts, people.body_parts)])


def something_else(model, centres):
    """P(something else) in each frame, and P(rest) in the last one."""
    watch, result = model.watch(Onset()), []
    for frame in centres:
        watch.update(Tracks(frame))
        result.append(float(watch.unlearned[0]))
    return np.array(result), watch.rest


@pytest.mark.parametrize("share", [0.0, 0.3, 0.5, 0.7, 1.0])
def test_a_person_who_holds_any_posture_does_something_else(two_takes, calibrated, share):
    centres, rate = centres_of(two_takes), round(calibrated.header.rate_hz)
    held = np.repeat(centres[round(share * (len(centres) - 1))][None], 3 * rate, axis=0)
    standing, _ = something_else(calibrated, held)
    assert standing.min() > 0.8 and standing[rate // 3 :].min() > 0.89
    stopped, rest = something_else(calibrated, np.concatenate([centres[: round(share * len(centres))], held]))
    assert stopped[-rate:].min() > 0.6 and rest > 0.5


def test_a_shift_of_weight_is_something_else(two_takes, calibrated):
    centres, rate = centres_of(two_takes), round(calibrated.header.rate_hz)
    shown = np.repeat(centres[:1], 4 * rate, axis=0)
    size = np.ptp(centres[0], axis=0).max()
    shown[..., 0] += 0.4 * size * np.sin(2 * np.pi * 0.5 * np.arange(len(shown)) / rate)[:, None]
    assert something_else(calibrated, shown)[0].min() > 0.65


def test_movements_are_large_enough(two_takes, calibrated):
    for number in range(len(two_takes.recordings)):
        assert something_else(calibrated, centres_of(two_takes, number))[0].min() < 0.5


def test_extent_is_that_of_the_part_that_goes_farthest():
    rows = np.zeros((5, 2 * 2 + 3), np.float32)
    rows[:, 2] = [0, 3, 1, 0, 0]
    rows[:, 3] = [0, 0, 4, 0, 0]
    rows[:, -3] = [0, 9, 9, 9, 9]
    assert extent(rows, 15.0) == pytest.approx(5.0)
    assert extent(rows, 1.0) == 0.0
    rows[:, -2] = [0, 0, 0, 0, 12]
    assert extent(rows, 15.0) >= 12.0
