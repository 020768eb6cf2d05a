"""The referee's score: the highest and the lowest of four and more are dropped, the rest is averaged by certainty."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from fusion.score_pool import JudgedScore, kept_judges, pooled_score

POINTS = st.floats(0, 10)


def judged(*scores):
    return {
        f"cam{n}": score if isinstance(score, JudgedScore) else JudgedScore(score) for n, score in enumerate(scores)
    }


def test_the_highest_and_the_lowest_of_four_are_dropped():
    assert pooled_score(judged(9, 7, 0, 8)) == pytest.approx(7.5)
    assert kept_judges(judged(9, 7, 0, 8)) == ["cam1", "cam3"]


def test_fewer_are_averaged_by_certainty_and_trust():
    assert pooled_score(judged(9, 6)) == pytest.approx(7.5)
    assert pooled_score(judged(JudgedScore(9, 1.0), JudgedScore(6, 0.5))) == pytest.approx(8)
    assert pooled_score(judged(JudgedScore(9), JudgedScore(6, trust=0.5))) == pytest.approx(8)
    assert pooled_score({}) is None and pooled_score(judged(JudgedScore(4, 0.0))) == 4


@given(honest=st.lists(POINTS, min_size=3, max_size=6), lie=POINTS)
def test_one_liar_among_four_stays_between_the_honest(honest, lie):
    assert min(honest) - 1e-9 <= pooled_score(judged(*honest, lie)) <= max(honest) + 1e-9


@given(st.lists(POINTS, min_size=1, max_size=7))
def test_the_order_of_the_judges_does_not_matter(scores):
    assert pooled_score(judged(*scores)) == pytest.approx(pooled_score(judged(*reversed(scores))))
