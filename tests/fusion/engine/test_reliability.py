"""Reliability: a sure and wrong observer loses it and regains it by agreeing; correlated observers are found."""

import math
from itertools import pairwise
from types import SimpleNamespace

import numpy as np
import pytest
from engine_stage import aged
from hypothesis import given
from hypothesis import strategies as st

from common.vocabulary import ABSTAIN, Vocabulary
from fusion.engine.aged_posterior import answers_of
from fusion.engine.trust import (
    BLUR,
    FAULT,
    HONEST,
    LEAST_TRUST,
    MEMORY,
    Reliability,
    after_message,
    learn_from_verdict,
    log_odds_of,
    nats_of,
    observed,
    overlap_of,
    published_trust,
)

VOCABULARY = Vocabulary(("bow", "lunge", "punch", "kick"))


def sure(label, p=0.9):
    return [p if name == label else (1 - p) / 3 for name in VOCABULARY.labels]


def verdict(posteriors, label="bow", number=0, ended_ns=1, unlearned=None):
    votes = {
        name: SimpleNamespace(p=None if p is None else list(p), unlearned=(unlearned or {}).get(name))
        for name, p in posteriors.items()
    }
    return SimpleNamespace(id=f"v{number}", label=label, ended_ns=ended_ns, votes=votes)


def after(times, posteriors, start=None, label="bow"):
    reliability = start or Reliability()
    for n in range(times):
        final = verdict(posteriors, label, f"{label}{n}{id(posteriors)}")
        reliability = learn_from_verdict(reliability, final, VOCABULARY)
    return reliability


def trust(reliability, observer):
    """The trust in its labels, as far as verdicts have taught it."""
    return published_trust(reliability.honest(observer), HONEST, HONEST)


RIGHT = {"a": sure("bow"), "b": sure("bow", 0.8), "c": sure("bow", 0.7)}
ONE_WRONG = {**RIGHT, "d": sure("kick", 0.95)}


def test_only_a_sure_and_wrong_observer_loses_reliability_and_it_recovers_by_agreeing():
    wrong = after(20, ONE_WRONG)
    assert trust(wrong, "d") < 0.2 and trust(wrong, "nobody") == 1.0
    assert [trust(wrong, name) for name in "abc"] == [1.0] * 3
    assert trust(after(30, {**RIGHT, "d": sure("bow", 0.95)}, wrong), "d") > 0.7


def test_a_wrong_majority_does_not_silence_for_ever():
    reliability = after(500, {"a": sure("kick"), "b": sure("kick"), "right": sure("bow")}, label="kick")
    assert trust(reliability, "right") < 0.05
    agreeing = after(12, {name: sure("bow") for name in ("a", "b", "right")}, reliability)
    assert trust(reliability, "right") < 0.05 < 0.2 < trust(agreeing, "right")


def test_three_movements_expose_a_liar_and_one_error_costs_little_after_agreement():
    liar, erring = after(3, ONE_WRONG), after(1, ONE_WRONG, after(5, {**RIGHT, "d": sure("bow", 0.95)}))
    assert trust(liar, "d") < 0.05 and trust(erring, "d") > 0.6


def test_an_honestly_unsure_observer_loses_nothing():
    rng, reliability = np.random.default_rng(3), Reliability()
    for n in range(300):
        label = "bow" if rng.random() < 0.6 else "kick"
        final = verdict({**RIGHT, "d": sure(label, 0.6)}, number=n)
        reliability = learn_from_verdict(reliability, final, VOCABULARY)
    assert trust(reliability, "d") > 0.6


def test_one_that_is_always_sure_of_something_else_loses_reliability_and_one_that_is_unsure_does_not():
    always, unsure = Reliability(), Reliability()
    for n in range(20):
        posteriors = {**RIGHT, "d": sure("bow")}
        always = learn_from_verdict(always, verdict(posteriors, number=n, unlearned={"d": 0.98}), VOCABULARY)
        unsure = learn_from_verdict(unsure, verdict(posteriors, number=n, unlearned={"d": 0.4}), VOCABULARY)
    assert trust(always, "d") < 0.2 and trust(unsure, "d") == 1.0


def test_of_two_votes_nobody_knows_which_is_right():
    reliability = after(20, {"a": sure("bow"), "b": sure("kick")})
    assert trust(reliability, "a") == trust(reliability, "b") == 1.0


@pytest.mark.parametrize(
    "useless",
    [verdict(ONE_WRONG, ABSTAIN), verdict(ONE_WRONG, ended_ns=None), verdict(ONE_WRONG, "bow", "same")],
    ids=["abstention", "not ended", "repeated"],
)
def test_some_verdicts_teach_nothing(useless):
    before = Reliability(verdict="vsame")
    assert learn_from_verdict(before, useless, VOCABULARY) == before


def test_long_agreement_excuses_few_errors():
    agreed = after(100, {**RIGHT, "d": sure("bow", 0.95)})
    assert trust(after(1, ONE_WRONG, agreed), "d") > 0.9 > 0.05 > trust(after(5, ONE_WRONG, agreed), "d")


def test_an_observer_that_left_is_forgotten():
    remaining = {name: p for name, p in RIGHT.items() if name != "c"}
    reliability = after(300, remaining, after(20, RIGHT))
    assert set(reliability.evidence) <= {"a", "b"}


POSTERIORS = st.dictionaries(st.sampled_from("abcd"), st.sampled_from([None, (1, 0, 0, 0), (0.25,) * 4, sure("kick")]))


@given(st.lists(st.tuples(st.sampled_from(VOCABULARY.labels), POSTERIORS), max_size=30))
def test_after_any_verdicts_trust_is_in_range(verdicts):
    reliability = Reliability()
    for n, (label, posteriors) in enumerate(verdicts):
        reliability = learn_from_verdict(reliability, verdict(posteriors, label, n), VOCABULARY)
        for name in "abcd":
            assert LEAST_TRUST <= trust(reliability, name) <= 1


# The course over time


def trust_in_course(posteriors, seconds=1 / 15):
    """After posteriors over the movements and something else that follow one another at this interval."""
    steady = HONEST
    for last, new in pairwise(np.array(posteriors, dtype=float)):
        steady = after_message(steady, len(last) * float(last @ new), seconds)
    return published_trust(HONEST, steady, HONEST)


@pytest.mark.parametrize("seconds", [0.5, 0.25, 1 / 15], ids=["2 Hz", "4 Hz", "15 Hz"])
def test_an_observer_may_change_its_mind_once_and_not_again_and_again(seconds):
    once, jumps = [sure("bow")] * 9 + [sure("lunge")] * 9, [sure("bow", 0.95), sure("lunge", 0.95)] * 9
    assert min(trust_in_course(once[:n], seconds) for n in range(2, 19)) > 0.6
    assert trust_in_course(jumps, seconds) < 0.05


def test_an_observer_that_jumps_about_is_not_steady_and_one_that_follows_its_evidence_is():
    rng, labels = np.random.default_rng(0), VOCABULARY.labels
    jumps = [sure(labels[n % 4], 0.95) for n in range(8)]
    noise = rng.dirichlet(np.full(20, 0.2), 15)
    grows = [sure("bow", p) for p in np.linspace(0.25, 0.99, 8)]
    changes = [sure("bow", p) for p in np.linspace(0.97, 0.01, 8)]
    assert trust_in_course(jumps) < 0.2 and trust_in_course(noise) < 0.5
    assert trust_in_course(grows) == trust_in_course([sure("bow")] * 9) == trust_in_course([[0.25] * 4] * 3) == 1.0
    assert trust_in_course(changes) == 1.0
    # The return is slow, however sure it is.
    assert trust_in_course([*jumps, *[sure("bow")] * 20]) < 0.2
    assert trust_in_course([*jumps, *[sure("bow")] * 900]) > 0.9


def test_what_most_observers_do_is_no_fault():
    assert published_trust(HONEST, 0.01, 0.02) == 1.0 and published_trust(HONEST, 0.01, HONEST) < 0.02
    assert published_trust(HONEST, 0.5, HONEST) == round(0.5 / HONEST, 3)
    assert published_trust(0.0, 0.0, 1.0) == LEAST_TRUST


def test_overlap_by_the_formula():
    p, q = np.array([0.7, 0.1, 0.1, 0.1]), np.array([0.1, 0.7, 0.1, 0.1])
    assert overlap_of(answers_of(p, 0.6), answers_of(q, 0.8)) == pytest.approx(
        5 * (0.4 * 0.2 * float(p @ q) + 0.6 * 0.8)
    )
    assert overlap_of(answers_of(p, None), answers_of(q, None)) == pytest.approx(5 * (0.8**2 * float(p @ q) + 0.2**2))


@pytest.mark.parametrize(
    ("p", "unlearned", "information"),
    [((1, 0, 0, 0), None, 1.0), ((0.25,) * 4, 0.0, 0.0), ((0.5, 0.5, 0, 0), 0.0, 0.5), ((1, 0, 0, 0), 0.75, 0.25)],
)
def test_the_information_of_a_posterior(p, unlearned, information):
    assert aged("cam", p, unlearned=unlearned).information == pytest.approx(information)


@given(
    st.lists(st.sampled_from([(1, 0, 0, 0), (0, 1, 0, 0), (0.25,) * 4, sure("kick")]), max_size=30), st.floats(-1, 1)
)
def test_trust_in_a_course_is_above_zero_and_at_most_one(posteriors, seconds):
    assert LEAST_TRUST <= trust_in_course(posteriors, seconds) <= 1


# The filter

OBSERVATIONS = st.lists(st.tuples(st.floats(0, 5), st.floats(0, 3)), max_size=6)


@given(OBSERVATIONS)
def test_the_filter_is_bayes_rule_over_both_states(observations):
    """The oracle follows both states with a transition matrix, P(observation | faulty) = 1."""
    belief, honest = np.array([HONEST, FAULT]), HONEST
    for overlap, passed in observations:
        stays = math.exp(-passed / MEMORY)
        transition = stays * np.eye(2) + (1 - stays) * np.array([[HONEST, FAULT], [HONEST, FAULT]])
        belief = belief @ transition * np.array([(1 - BLUR) * overlap + BLUR, 1.0])
        belief /= belief.sum()
        honest = observed(honest, nats_of(overlap), passed)
    assert honest == pytest.approx(belief[0], abs=1e-9) and observed(HONEST, log_odds_of(honest)) == pytest.approx(
        honest
    )
