"""Vector Symbols: against an oracle by angles, properties, and the stream of tracks; states of tracks."""

import math

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from common.errors import BadInput
from observer.features import BodySize
from observer.model.symbol_tables import SpaceReader, VectorSymbol, vector_symbols
from observer.tracks import BODY_PARTS, State, Tracks

RING = ["U", "UR", "R", "DR", "D", "DL", "L", "UL"]
ANGLE = st.floats(0, 360, exclude_max=True)
CENTRES = arrays(np.float64, (12, 3, 2), elements=st.integers(-300, 300).map(float))


def vector(clockwise_from_up_deg, length=1.0):
    angle = math.radians(clockwise_from_up_deg)
    return length * np.array([math.sin(angle), -math.cos(angle)])


def away_from_edges(angle_deg):
    return 1e-6 < (angle_deg + 22.5) % 45 < 45 - 1e-6


def test_the_order_of_the_paper():
    assert [symbol.name for symbol in VectorSymbol if symbol >= 0] == ["O", *RING]
    assert [symbol.value for symbol in VectorSymbol if symbol >= 0] == list(range(9))
    assert VectorSymbol.NOT_SEEN == -1


@given(ANGLE, st.floats(0.2, 1e6))
def test_against_an_oracle_that_compares_angles(angle_deg, length):
    assume(away_from_edges(angle_deg))
    inside = [name for k, name in enumerate(RING) if min((angle_deg - 45 * k) % 360, (45 * k - angle_deg) % 360) < 22.5]
    assert [VectorSymbol(int(vector_symbols(vector(angle_deg, length), 1.0, 0.1))).name] == inside  # exactly one


@given(st.floats(-1e9, 1e9), st.floats(-1e9, 1e9), st.floats(0, 1e3), st.floats(0, 1e3))
def test_every_displacement_has_a_symbol(du, dv, size, threshold):
    symbol = vector_symbols(np.array([du, dv]), size, threshold)
    assert 0 <= symbol <= 8
    length = math.hypot(du, dv)
    assume(abs(length - size * threshold) > 1e-6 * length)
    assert (symbol == VectorSymbol.O) == (length < size * threshold or length == 0)


def test_nothing_is_seen_with_an_unknown_size():
    assert (vector_symbols(np.ones((3, 2)), math.nan, 0.1) == VectorSymbol.NOT_SEEN).all()


def test_body_size_is_a_share_of_the_largest_distance_so_far():
    size = BodySize()
    gone = [np.nan, np.nan]
    assert math.isnan(size.update(np.array([gone, gone, [0, 0]]), BODY_PARTS))
    assert math.isnan(size.update(np.array([[3, 4], [6, 8], gone]), BODY_PARTS))
    assert size.update(np.array([[3, 4], gone, [0, 0]]), BODY_PARTS) == pytest.approx(0.45 * 5)
    assert size.update(np.array([[3, 4], [6, 8], [0, 0]]), BODY_PARTS) == pytest.approx(0.45 * 10)
    assert size.update(np.array([gone, gone, gone]), BODY_PARTS) == pytest.approx(0.45 * 10)
    assert size.update(np.array([[1, 0], [0, 1], [0, 0]]), BODY_PARTS) == pytest.approx(0.45 * 10)


def test_body_size_finds_parts_by_name():
    names = ("hip", "head", "right_hand")
    assert BodySize().update(np.array([[90, 90], [0, 0], [3, 4]]), names) == pytest.approx(0.45 * 5)
    for useless in (("left_hand", "right_hand"), ("head", "hip")):
        with pytest.raises(BadInput, match="body_parts"):
            BodySize().update(np.zeros((2, 2)), useless)


def read(centres, threshold=0.1):
    reader = SpaceReader(BODY_PARTS, threshold)
    return np.stack([reader.update(Tracks(frame)) for frame in centres])


def test_a_stream_by_hand():
    gone = [np.nan, np.nan]
    centres = [
        [[0, 100], [10, 100], [0, 0]],
        [[0, 80], gone, [0, 0]],
        [[20, 80], [10, 100], [0, 1]],
        [[20, 80], [30, 80], gone],
    ]
    assert read(np.array(centres, dtype=float)).tolist() == [
        [-1, -1, -1],
        [VectorSymbol.U, -1, VectorSymbol.O],
        [VectorSymbol.R, -1, VectorSymbol.O],
        [VectorSymbol.O, VectorSymbol.UR, -1],
    ]


def test_a_tracker_may_reuse_its_array():
    reader, centres = SpaceReader(BODY_PARTS, 0.1), np.array([[0.0, 100], [10, 100], [0, 0]])
    reader.update(Tracks(centres))
    centres -= (0, 50)
    assert reader.update(Tracks(centres)).tolist() == [VectorSymbol.U] * 3


@given(CENTRES, st.integers(-1000, 1000), st.sampled_from([0.25, 2.0, 1024.0]))
def test_place_and_size_of_the_person_do_not_matter(centres, shift, scale):
    np.testing.assert_array_equal(read((centres + shift) * scale), read(centres))


@given(CENTRES, arrays(np.bool_, (12, 3)))
def test_not_seen_is_a_part_missing_in_either_frame(centres, missing):
    centres[0] = [[0, 100], [10, 100], [0, 0]]
    missing[0] = False  # the size is known from the first frame
    centres[missing] = np.nan
    expected = missing.copy()
    expected[1:] |= missing[:-1]
    expected[0] = True
    np.testing.assert_array_equal(read(centres) == VectorSymbol.NOT_SEEN, expected)


def test_states_of_parts():
    gone = [np.nan, np.nan]
    tracks = Tracks(np.array([[1.0, 2.0], gone, gone]), np.array([gone, [3.0, 4.0], gone]))
    assert tracks.states == (State.SEEN, State.UNSURE, State.MISSING)
    assert tracks.visible.tolist() == [True, False, False]
