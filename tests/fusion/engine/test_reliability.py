"""Reliability: a sure and wrong observer loses it and regains it by agreeing; correlated observers are found."""

import math
from itertools import pairwise
from types import SimpleNamespace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from common.vocabulary import ABSTAIN, Vocabulary
from fusion.engine.reliability import (
    MIN_RELIABILITY,
    Reliability,
    information_of,
    learn_from_verdict,
    overlap_of,
    steadiness_after,
    steadiness_after_overlap,
    steady_enough,
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


RIGHT = {"a": sure("bow"), "b": sure("bow", 0.8), "c": sure("bow", 0.7)}
ONE_WRONG = {**RIGHT, "d": sure("kick", 0.95)}


def test_only_a_sure_and_wrong_observer_loses_reliability_and_it_recovers_by_agreeing():
    wrong = after(20, ONE_WRONG)
    assert wrong.reliability("d") < 0.2 and wrong.reliability("nobody") == 1.0
    assert [wrong.reliability(name) for name in "abc"] == [1.0] * 3
    assert after(30, {**RIGHT, "d": sure("bow", 0.95)}, wrong).reliability("d") > 0.7


def test_a_wrong_majority_does_not_silence_for_ever():
    reliability = after(500, {"a": sure("kick"), "b": sure("kick"), "right": sure("bow")}, label="kick")
    assert reliability.reliability("right") == MIN_RELIABILITY
    agreeing = after(12, {name: sure("bow") for name in ("a", "b", "right")}, reliability)
    assert reliability.reliability("right") < 0.01 < 0.2 < agreeing.reliability("right")


def test_three_movements_expose_a_liar_and_one_error_costs_little_after_agreement():
    liar, erring = after(3, ONE_WRONG), after(1, ONE_WRONG, after(5, {**RIGHT, "d": sure("bow", 0.95)}))
    assert liar.reliability("d") < 0.05 and erring.reliability("d") > 0.6


def test_an_honestly_unsure_observer_loses_nothing():
    rng, reliability = np.random.default_rng(3), Reliability()
    for n in range(300):
        label = "bow" if rng.random() < 0.6 else "kick"
        final = verdict({**RIGHT, "d": sure(label, 0.6)}, number=n)
        reliability = learn_from_verdict(reliability, final, VOCABULARY)
    assert reliability.reliability("d") > 0.6


def test_one_that_is_always_sure_of_something_else_loses_reliability_and_one_that_is_unsure_does_not():
    always, unsure = Reliability(), Reliability()
    for n in range(20):
        posteriors = {**RIGHT, "d": sure("bow")}
        always = learn_from_verdict(always, verdict(posteriors, number=n, unlearned={"d": 0.98}), VOCABULARY)
        unsure = learn_from_verdict(unsure, verdict(posteriors, number=n, unlearned={"d": 0.4}), VOCABULARY)
    assert always.reliability("d") < 0.2 and unsure.reliability("d") == 1.0


def test_of_two_votes_nobody_knows_which_is_right():
    reliability = after(20, {"a": sure("bow"), "b": sure("kick")})
    assert reliability.reliability("a") == reliability.reliability("b") == 1.0


@pytest.mark.parametrize(
    "useless",
    [verdict(ONE_WRONG, ABSTAIN), verdict(ONE_WRONG, ended_ns=None), verdict(ONE_WRONG, "bow", "same")],
    ids=["abstention", "not ended", "repeated"],
)
def test_some_verdicts_teach_nothing(useless):
    before = Reliability(verdict="vsame")
    assert learn_from_verdict(before, useless, VOCABULARY) == before


def test_correlated_observers_are_found_and_independent_ones_are_not():
    rng, reliability = np.random.default_rng(0), Reliability()
    for n in range(20):
        label = VOCABULARY.labels[n % 4]
        one, other = rng.dirichlet(np.where(np.array(VOCABULARY.labels) == label, 6, 2), 2)
        twin = one * np.exp(rng.normal(0, 0.02, 4))
        posteriors = {"left": one, "twin": twin / twin.sum(), "far": other}
        reliability = learn_from_verdict(reliability, verdict(posteriors, label, n), VOCABULARY)
    assert reliability.correlations("left")["twin"] == reliability.correlations("twin")["left"] > 0.5
    assert reliability.correlations("far").get("left", 0) < 0.1 and "far" not in reliability.correlations("left")


def test_being_certain_of_the_same_is_no_correlation():
    assert after(30, {name: sure("bow", 1.0) for name in "abc"}).correlations("a") == {}


def test_rho_grows_with_the_number_of_verdicts():
    same = {name: sure("bow", 0.5) for name in "ab"}
    assert [after(n, same).correlations("a")["b"] for n in (1, 2)] == [0.2, round(1.95 / 5.95, 3)]


def test_long_agreement_excuses_few_errors():
    agreed = after(100, {**RIGHT, "d": sure("bow", 0.95)})
    assert after(1, ONE_WRONG, agreed).reliability("d") > 0.9 > 0.05 > after(5, ONE_WRONG, agreed).reliability("d")


def test_an_observer_that_left_is_forgotten():
    remaining = {name: p for name, p in RIGHT.items() if name != "c"}
    reliability = after(300, remaining, after(20, RIGHT))
    assert set(reliability.right) <= {"a", "b"} and set(reliability.times) <= {"a b"}
    assert set(reliability.evidence) <= {"a", "b"}


POSTERIORS = st.dictionaries(st.sampled_from("abcd"), st.sampled_from([None, (1, 0, 0, 0), (0.25,) * 4, sure("kick")]))


@given(st.lists(st.tuples(st.sampled_from(VOCABULARY.labels), POSTERIORS), max_size=30))
def test_after_any_verdicts_reliability_and_correlations_are_in_range_and_symmetric(verdicts):
    reliability = Reliability()
    for n, (label, posteriors) in enumerate(verdicts):
        reliability = learn_from_verdict(reliability, verdict(posteriors, label, n), VOCABULARY)
        for name in "abcd":
            assert MIN_RELIABILITY <= reliability.reliability(name) <= 1
            for other, rho in reliability.correlations(name).items():
                assert other != name and 0 < rho <= 1 and reliability.correlations(other)[name] == rho


# Steadiness


def steadiness(posteriors, seconds=1 / 15):
    """After posteriors that follow one another at this interval."""
    level = 1.0
    for last, new in pairwise(np.array(posteriors, dtype=float)):
        level = steadiness_after(level, last, new, seconds)
    return level


def test_at_four_messages_a_second_one_may_change_its_mind_and_not_again_and_again():
    once, jumps = [sure("bow")] * 9 + [sure("lunge")] * 9, [sure("bow"), sure("lunge")] * 9
    enough = steady_enough(0.25)
    assert min(steadiness(once[:n], seconds=0.25) for n in range(2, 19)) > enough
    assert steadiness(jumps, seconds=0.25) < enough / 2 and steady_enough(1 / 15) == 1.0


def test_an_observer_that_jumps_about_is_not_steady_and_one_that_follows_its_evidence_is():
    rng, labels = np.random.default_rng(0), VOCABULARY.labels
    jumps = [sure(labels[n % 4], 0.95) for n in range(8)]
    noise = rng.dirichlet(np.full(20, 0.2), 15)
    grows = [sure("bow", p) for p in np.linspace(0.25, 0.99, 8)]
    changes = [sure("bow", p) for p in np.linspace(0.97, 0.01, 8)]
    assert steadiness(jumps) < 0.2 and steadiness(noise) < 0.5
    assert steadiness(grows) == steadiness([sure("bow")] * 9) == steadiness([[0.25] * 4] * 3) == 1.0
    assert steadiness(changes) > 0.9
    # It is regained in a second, and long gaps tell nothing.
    assert steadiness([*jumps, *[sure("bow")] * 20]) > 0.8 and steadiness(jumps, seconds=0.4) == 1.0


def test_overlap_and_steadiness_by_the_formula():
    p, q = np.array([0.7, 0.1, 0.1, 0.1]), np.array([0.1, 0.7, 0.1, 0.1])
    assert overlap_of(p, 0.6, q, 0.8) == pytest.approx(5 * (0.4 * 0.2 * float(p @ q) + 0.6 * 0.8))
    assert overlap_of(p, None, q, None) == pytest.approx(5 * (0.8**2 * float(p @ q) + 0.2**2))
    # At 4 Hz one contradiction counts as o = 0.3, over eight messages; at 20 Hz as 0.01, over 0.25 s.
    assert steadiness_after_overlap(1.0, 0.0, 0.25) == pytest.approx(0.3 ** (2 * (1 - math.exp(-1 / 8))))
    assert steadiness_after_overlap(1.0, 0.0, 0.05) == pytest.approx(0.01 ** (2 * (1 - math.exp(-0.2))))


@pytest.mark.parametrize(
    ("p", "unlearned", "information"),
    [((1, 0, 0, 0), None, 1.0), ((0.25,) * 4, 0.0, 0.0), ((0.5, 0.5, 0, 0), 0.0, 0.5), ((1, 0, 0, 0), 0.75, 0.25)],
)
def test_the_information_of_a_posterior(p, unlearned, information):
    assert information_of(p, unlearned) == pytest.approx(information)


@given(
    st.lists(st.sampled_from([(1, 0, 0, 0), (0, 1, 0, 0), (0.25,) * 4, sure("kick")]), max_size=30), st.floats(-1, 1)
)
def test_steadiness_is_above_zero_and_at_most_one(posteriors, seconds):
    assert 0 < steadiness(posteriors, seconds) <= 1
