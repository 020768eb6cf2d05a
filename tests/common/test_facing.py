"""Which way a person faces, on the wire and back."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from common.messages import Facing
from common.probability import SURPRISE_LIMIT, SURPRISE_UNIT, decode_facing, encode_facing

SIZES = st.tuples(st.integers(2, 6), st.integers(1, 24))


def drawn(size, sharpness, seed):
    return np.random.default_rng(seed).dirichlet(np.full(size[1], sharpness), size=size[0])


@given(size=SIZES, sharpness=st.sampled_from([0.05, 0.5, 5.0]), seed=st.integers(0, 999))
@settings(max_examples=50, deadline=None)
def test_there_and_back_it_is_the_same_but_for_the_rounding(size, sharpness, seed):
    facing = drawn(size, sharpness, seed)
    again = decode_facing(encode_facing(facing))
    assert again.sum(axis=1) == pytest.approx(1)
    # Half a unit of rounding in each, and as much in the sum of its row; beyond the limit all is as unlikely.
    least = np.exp(-SURPRISE_LIMIT / SURPRISE_UNIT)
    ratio = np.log(again) - np.log(np.maximum(facing, least))
    assert np.abs(ratio).max() <= 1 / SURPRISE_UNIT + 1e-9


@given(size=SIZES, sharpness=st.sampled_from([0.05, 0.5, 5.0]), seed=st.integers(0, 999))
@settings(max_examples=50, deadline=None)
def test_what_travels_is_what_the_wire_allows(size, sharpness, seed):
    surprise = encode_facing(drawn(size, sharpness, seed))
    assert Facing(surprise=surprise.tolist()).surprise == surprise.tolist()
    assert (encode_facing(decode_facing(surprise)) - surprise >= -1).all()


def test_by_hand():
    facing = np.array([[0.5, 0.5, 0.0], [1.0, 0.0, 0.0]])
    assert encode_facing(facing).tolist() == [[6, 6, 255], [0, 255, 255]]
    assert decode_facing(encode_facing(facing))[0] == pytest.approx([0.5, 0.5, 0], abs=1e-12)


def test_only_differences_within_a_row_count():
    surprise = np.array([[0, 8, 16], [100, 108, 116]])
    assert decode_facing(surprise)[0] == pytest.approx(decode_facing(surprise)[1])
    assert decode_facing(np.full((2, 4), 255)) == pytest.approx(np.full((2, 4), 0.25))
