"""Probability vectors against plain sums, and at the edges where logarithms break; facings in messages."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from common.messages import Facing
from common.probability import (
    SURPRISE_LIMIT,
    SURPRISE_UNIT,
    decode_facing,
    encode_facing,
    entropy_bits,
    normalise,
    softmax,
    temper,
    uniform,
)

MASSES = arrays(np.float64, st.integers(2, 8), elements=st.sampled_from([0.0, 1e-300, 1e-12, 0.2, 1.0, 3.0]))
DISTRIBUTIONS = MASSES.map(normalise)
LOGS = arrays(np.float64, st.integers(2, 8), elements=st.floats(-1e6, 1e6) | st.just(-math.inf))


def is_distribution(p):
    return np.isfinite(p).all() and (p >= 0).all() and p.sum() == pytest.approx(1)


@given(st.lists(st.floats(-30, 30), min_size=2, max_size=6), st.floats(-1e5, 1e5))
def test_softmax_is_exp_and_divide_and_ignores_an_offset(logs, shift):
    plain = [math.exp(x) for x in logs]
    expected = [x / sum(plain) for x in plain]
    assert softmax(np.array(logs)) == pytest.approx(expected)
    assert softmax(np.array(logs) + shift) == pytest.approx(expected, rel=1e-6, abs=1e-9)


@given(LOGS, MASSES)
def test_softmax_and_normalise_always_give_a_distribution(logs, mass):
    assert is_distribution(softmax(logs)) and is_distribution(normalise(mass))
    assert normalise(mass) == pytest.approx(mass / mass.sum() if mass.sum() else 1 / len(mass))


def test_rows_are_independent_and_one_without_information_becomes_uniform():
    rows = np.array([[-np.inf, -np.inf], [0.0, -np.inf], [-1e300, -1e300]])
    assert softmax(rows).tolist() == [[0.5, 0.5], [1, 0], [0.5, 0.5]]
    assert normalise(np.array([[0.0, 0, 0], [1, 1, 2]])).tolist() == [[1 / 3] * 3, [0.25, 0.25, 0.5]]
    assert entropy_bits(np.full((3, 2, 8), 1 / 8)) == pytest.approx(np.full((3, 2), 3))


@given(DISTRIBUTIONS)
def test_entropy_against_the_sum(p):
    assert float(entropy_bits(p)) == pytest.approx(-sum(x * math.log2(x) for x in p if x > 0), abs=1e-12)
    assert 0 <= entropy_bits(p) <= math.log2(len(p))


def test_entropy_of_a_certainty_is_a_positive_zero():
    for p in ([1.0, 0, 0], [1.0, 1e-320, 0], [1 + 1e-15, 0, 0]):
        h = float(entropy_bits(np.array(p)))
        assert math.copysign(1, h) == 1 and h == pytest.approx(0, abs=1e-12)


@given(DISTRIBUTIONS, st.floats(0, 1))
def test_temper_against_the_formula(p, exponent):
    prior = uniform(len(p))
    mass = [(x / q) ** exponent * q if exponent else q for x, q in zip(p, prior, strict=True)]
    assert temper(p, prior, exponent) == pytest.approx([m / sum(mass) for m in mass], abs=1e-12)


@given(DISTRIBUTIONS, st.integers(0, 10))
def test_temper_with_exponent_1_is_the_identity_and_0_gives_the_prior(p, seed):
    prior = np.random.default_rng(seed).dirichlet(np.ones(len(p)))
    assert temper(p, prior, 1.0) == pytest.approx(p, abs=1e-12)
    assert temper(p, prior, 0.0) == pytest.approx(prior)
    assert temper(prior, prior, 0.3) == pytest.approx(prior)


@given(st.floats(0.05, 0.95), st.floats(0.05, 0.95))
def test_temper_twice_multiplies_the_exponents(one, other):
    p, prior = np.array([0.7, 0.2, 0.1]), np.array([0.2, 0.3, 0.5])
    assert temper(temper(p, prior, one), prior, other) == pytest.approx(temper(p, prior, one * other))


def test_temper_excludes_what_the_prior_excludes():
    assert temper(np.array([0.5, 0.5, 0]), np.array([0.5, 0.0, 0.5]), 0.5).tolist() == [1, 0, 0]


@given(st.tuples(st.integers(2, 6), st.integers(1, 24)), st.sampled_from([0.05, 0.5, 5.0]), st.integers(0, 999))
@settings(max_examples=50, deadline=None)
def test_facings_survive_the_round_trip_up_to_rounding(size, sharpness, seed):
    facing = np.random.default_rng(seed).dirichlet(np.full(size[1], sharpness), size=size[0])
    surprise = encode_facing(facing)
    assert Facing(surprise=surprise.tolist()).surprise == surprise.tolist()
    decoded = decode_facing(surprise)
    assert decoded.sum(axis=1) == pytest.approx(1) and (encode_facing(decoded) - surprise >= -1).all()
    # Half a unit of rounding in each value and as much in the sum of its row; below the limit all are equal.
    least = np.exp(-SURPRISE_LIMIT / SURPRISE_UNIT)
    assert np.abs(np.log(decoded) - np.log(np.maximum(facing, least))).max() <= 1 / SURPRISE_UNIT + 1e-9


def test_facings_by_hand():
    facing = np.array([[0.5, 0.5, 0.0], [1.0, 0.0, 0.0]])
    assert encode_facing(facing).tolist() == [[6, 6, 255], [0, 255, 255]]
    assert decode_facing(encode_facing(facing))[0] == pytest.approx([0.5, 0.5, 0], abs=1e-12)
    # Only differences within a row count.
    surprise = np.array([[0, 8, 16], [100, 108, 116]])
    assert decode_facing(surprise)[0] == pytest.approx(decode_facing(surprise)[1])
    assert decode_facing(np.full((2, 4), 255)) == pytest.approx(np.full((2, 4), 0.25))
