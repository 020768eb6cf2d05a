"""How the referee pools counts: a median weighted by trust, freshness and how well a view sees the movement."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from common.posterior import Repeated
from fusion.engine.aged_posterior import AgedPosterior
from fusion.engine.segments import RepetitionCount, pooled_repetitions, weighted_median

COUNTS = st.floats(0, 50)


def counting(count, swing=1.0, trust=1.0, freshness=1.0, partial=0.0, name="cam"):
    more = None if swing is None else Repeated(partial=partial, swing=swing)
    return AgedPosterior(
        name, np.ones(2) / 2, 0.0, 0.0, "counted", reliability=trust, freshness=freshness, repetitions=count,
        repeated=more,
    )  # fmt: skip


@given(st.lists(st.tuples(COUNTS, st.integers(1, 5)), min_size=1, max_size=8))
def test_whole_weights_are_copies(pairs):
    copies = [value for value, weight in pairs for _ in range(weight)]
    values, weights = zip(*pairs, strict=True)
    assert weighted_median(values, weights) == pytest.approx(float(np.median(copies)))


@given(st.lists(COUNTS, min_size=1, max_size=5))
def test_without_any_weight_all_count_alike(values):
    assert weighted_median(values, [0.0] * len(values)) == pytest.approx(float(np.median(values)))


@given(lie=st.floats(0, 1e9), swing=st.floats(0, 1e9), honest=st.lists(st.integers(3, 5), min_size=3, max_size=6))
def test_one_liar_of_four_and_more_stays_between_the_honest(lie, swing, honest):
    pooled = pooled_repetitions([counting(lie, swing), *(counting(float(count)) for count in honest)])
    assert min(honest) <= pooled.done <= max(honest)


def test_a_view_that_sees_the_movement_better_outweighs_one_that_does_not():
    assert pooled_repetitions([counting(10.0, swing=2.0), counting(3.0, swing=0.5)]).done == 10
    assert pooled_repetitions([counting(10.0, swing=2.0), counting(3.0, swing=None)]).done == 10


def test_one_that_is_doubted_or_frozen_counts_less():
    for less in ({"trust": 0.1}, {"freshness": 0.1}):
        assert pooled_repetitions([counting(7.0), counting(3.0, **less)]).done == 7


def test_a_repetition_in_progress_does_not_count_and_partial_ones_are_told():
    pooled = pooled_repetitions([counting(8.5, partial=2.0), counting(8.0, partial=2.0), counting(8.0, partial=9.0)])
    assert pooled == RepetitionCount(8, 2)
    assert pooled_repetitions([counting(3.0, partial=7.0)]) == RepetitionCount(3, 3), "no more than there are"


def test_nobody_counts():
    silent = AgedPosterior("cam", np.ones(2) / 2, 0.0, 0.0, "counted")
    assert pooled_repetitions([]) is None and pooled_repetitions([silent]) is None
