"""What verdicts teach: who is sure and wrong is believed less, who agrees again is believed again, twins are known."""

from types import SimpleNamespace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from common.vocabulary import ABSTAIN, Vocabulary
from fusion.engine.reliability import LEAST, Reliability, learn_from_verdict

NAMES = Vocabulary(("bow", "lunge", "punch", "kick"))


def sure(label, p=0.9):
    return [p if name == label else (1 - p) / 3 for name in NAMES.labels]


def verdict(beliefs, label="bow", number=0, ended_ns=1):
    votes = {name: SimpleNamespace(p=None if p is None else list(p)) for name, p in beliefs.items()}
    return SimpleNamespace(id=f"v{number}", label=label, ended_ns=ended_ns, votes=votes)


def after(times, beliefs, lessons=None, label="bow"):
    lessons = lessons or Reliability()
    for n in range(times):
        lessons = learn_from_verdict(lessons, verdict(beliefs, label, f"{label}{n}{id(beliefs)}"), NAMES)
    return lessons


RIGHT = {"a": sure("bow"), "b": sure("bow", 0.8), "c": sure("bow", 0.7)}
LIAR = {**RIGHT, "d": sure("kick", 0.95)}


def test_who_is_sure_and_wrong_loses_and_the_others_lose_nothing():
    lessons = after(20, LIAR)
    assert lessons.reliability("d") < 0.2
    assert [lessons.reliability(name) for name in "abc"] == [1.0] * 3
    assert lessons.reliability("nobody") == 1.0


def test_who_agrees_again_recovers():
    bad = after(20, LIAR)
    good = after(30, {**RIGHT, "d": sure("bow", 0.95)}, bad)
    assert bad.reliability("d") < 0.2 and good.reliability("d") > 0.7


def test_a_wrong_majority_does_not_silence_for_ever():
    lessons = after(500, {"a": sure("kick"), "b": sure("kick"), "right": sure("bow")}, label="kick")
    assert lessons.reliability("right") >= LEAST


def test_who_is_honestly_unsure_loses_nothing():
    rng, lessons = np.random.default_rng(3), Reliability()
    for n in range(300):
        own = "bow" if rng.random() < 0.6 else "kick"
        lessons = learn_from_verdict(lessons, verdict({**RIGHT, "d": sure(own, 0.6)}, number=n), NAMES)
    assert lessons.reliability("d") > 0.6


def test_of_two_nobody_knows_who_is_right():
    lessons = after(20, {"a": sure("bow"), "b": sure("kick")})
    assert lessons.reliability("a") == lessons.reliability("b") == 1.0


@pytest.mark.parametrize(
    "said", [verdict(LIAR, ABSTAIN), verdict(LIAR, ended_ns=None), verdict(LIAR, "bow", "same")], ids=str
)
def test_what_teaches_nothing(said):
    taught = learn_from_verdict(Reliability(verdict="vsame"), said, NAMES)
    assert taught == Reliability(verdict="vsame")


def test_twins_are_known_and_strangers_are_not():
    rng, lessons = np.random.default_rng(0), Reliability()
    for n in range(20):
        label = NAMES.labels[n % 4]
        one, other = rng.dirichlet(np.where(np.array(NAMES.labels) == label, 6, 2), 2)
        twin = one * np.exp(rng.normal(0, 0.02, 4))
        said = {"left": one, "twin": twin / twin.sum(), "far": other}
        lessons = learn_from_verdict(lessons, verdict(said, label, n), NAMES)
    assert lessons.correlations("left")["twin"] == lessons.correlations("twin")["left"] > 0.5
    assert lessons.correlations("far").get("left", 0) < 0.1 and "far" not in lessons.correlations("left")


def test_two_who_are_certain_of_the_same_are_no_twins_for_that():
    certain = {name: sure("bow", 1.0) for name in "abc"}
    assert after(30, certain).correlations("a") == {}


def test_who_is_heard_no_more_is_forgotten():
    lessons = after(300, {name: p for name, p in RIGHT.items() if name != "c"}, after(20, RIGHT))
    assert set(lessons.right) <= {"a", "b"} and set(lessons.times) <= {"a b"}


@given(
    st.lists(
        st.tuples(
            st.sampled_from(NAMES.labels),
            st.dictionaries(st.sampled_from("abcd"), st.sampled_from([None, (1, 0, 0, 0), (0.25,) * 4, sure("kick")])),
        ),
        max_size=30,
    )
)
def test_whatever_was_said_the_lessons_are_sound(said):
    lessons = Reliability()
    for n, (label, beliefs) in enumerate(said):
        lessons = learn_from_verdict(lessons, verdict(beliefs, label, n), NAMES)
        for name in "abcd":
            assert LEAST <= lessons.reliability(name) <= 1
            for other, rho in lessons.correlations(name).items():
                assert other != name and 0 < rho <= 1 and lessons.correlations(other)[name] == rho
