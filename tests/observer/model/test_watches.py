"""The posteriors of the discriminative and the stacked model are their formulas, from what their members say."""

import numpy as np
import pytest
from performances import DOOR

from common.probability import softmax
from common.vocabulary import Vocabulary
from observer.learning.learn import learn_view
from observer.model.base import Onset
from observer.model.logistic import LogisticRegression
from observer.model.segment_classifier import SegmentClassifier
from observer.motion.projected import view_tracks
from studies.performer import perform

LABELS = ("ok", "shake")
PARAMETERS = {"facings": 2.0, "kernels": 84.0, "nearest_weight": 0.0, "generative": 0.3, "discriminative": 0.9}


def test_a_segment_in_progress_is_judged_by_both_parts_as_it_may_have_ended() -> None:
    """ln P = (1 - P(ended)) ln P(in progress) + P(ended) ln P(ended), not normalised."""
    rng = np.random.default_rng(0)
    running, ended, completion = (
        LogisticRegression(rng.normal(size=(4, k)).astype(np.float32), rng.normal(size=k).astype(np.float32))
        for k in (3, 3, 2)
    )
    features = rng.normal(size=(5, 4)).astype(np.float32)
    classifier = SegmentClassifier(None, running, ended, completion)
    in_progress, over, share = (np.exp(part.log_probabilities(features)) for part in (running, ended, completion))
    expected = (1 - share[:, 1:]) * np.log(in_progress) + share[:, 1:] * np.log(over)
    np.testing.assert_allclose(classifier.log_posterior_of(features, ended=False), expected, rtol=1e-4)
    np.testing.assert_allclose(classifier.log_posterior_of(features, ended=True), np.log(over), rtol=1e-4)


@pytest.fixture(scope="module")
def people():
    return perform(("1", "2"), LABELS, trials=1, seed=2)


@pytest.fixture(scope="module")
def model(people):
    return learn_view(people, DOOR, Vocabulary(LABELS), kind="stacked", parameters=PARAMETERS, calibrate=False)


def tracks_of(people, number=0):
    return view_tracks(DOOR, people.recordings[number], people.body_parts, people.body_parts)


def test_trailing_windows_and_the_segment_count_equally(people, model):
    own = model.discriminative
    watch = own.watch(Onset(known=True))
    # A frame is classified 15 times a second, the first one too.
    classified = range(1, 1000, max(round(model.header.rate_hz / 15), 1))
    for number, tracks in enumerate(tracks_of(people), 1):
        watch.update(tracks)
        if number in classified and watch.segment.begun:
            trailing = own.movement.log_probabilities(own.trailing.newest(watch.rows))[:-1]
            trailing = np.log(softmax(trailing.astype(float)))
            segment = own.segments.log_posterior(watch.segment.rows_of(watch.rows), watch.segment.over)
            joined = segment if watch.segment.over else (trailing + segment) / 2
            np.testing.assert_allclose(watch.p, softmax(np.asarray(joined, np.float64)), atol=1e-4)


def test_frames_that_are_passed_over_count_although_they_are_not_classified(people, model):
    plain, hurried = (model.discriminative.watch(Onset(known=True)) for _ in range(2))
    for number, tracks in enumerate(tracks_of(people)):
        before = hurried.p
        plain.update(tracks)
        if number % 4:
            hurried.pass_over(tracks)
            np.testing.assert_array_equal(hurried.p, before)
        else:
            hurried.update(tracks)
            np.testing.assert_array_equal(hurried.rows, plain.rows)
            if hurried.segment.begun == plain.segment.begun and hurried.judges_ended == plain.judges_ended:
                np.testing.assert_allclose(hurried.p, plain.p, atol=1e-6)


def test_the_stack_multiplies_both_members_with_their_exponents_and_takes_facings_from_the_phase_filter(people, model):
    stack, phase, other = (part.watch(Onset(known=True)) for part in (model, model.phase, model.discriminative))
    for tracks in tracks_of(people, 1):
        for watch in (stack, phase, other):
            watch.update(tracks)
        if other.judges_ended:
            break
        p = softmax(0.3 * np.log(np.maximum(phase.p, 1e-4)) + 0.9 * np.log(np.maximum(other.p, 1e-4)))
        facing = phase.joint / phase.p[:, None]
        np.testing.assert_allclose(stack.p, p, atol=1e-6)
        np.testing.assert_allclose(stack.joint, p[:, None] * facing, atol=1e-6)
