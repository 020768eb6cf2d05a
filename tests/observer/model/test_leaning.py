"""Which regions of the body a model leans on: what `learn` prints, and what an observer publishes."""

import json

import numpy as np
import pytest

from common.vocabulary import Vocabulary
from observer.learning.descriptions import describe_leaning
from observer.model.base import Header
from observer.model.leaning import LEANS_ON, region_shares

LABELS = ("bow", "wave")


def header_of(table, body_parts=("left_hand", "right_hand", "head")):
    provenance = {} if table is None else {LEANS_ON: table if isinstance(table, str) else json.dumps(table)}
    return Header("stacked", Vocabulary(LABELS), "door", np.eye(3, 4), 15.0, body_parts, provenance=provenance)


def test_shares_are_percents_of_the_regions_with_a_tenth_and_more():
    header = header_of({"wave": {"left arm": 0.3, "right arm": 8.1, "trunk": 1.2}, "bow": {"trunk": 2.0, "gone": 0.0}})
    shares = region_shares(header)
    assert (shares.hash, shares.regions) == (header.vocabulary.digest, ["right arm", "trunk"])
    assert shares.shares == [[0, 100], [84, 12]], "in the order of the vocabulary"
    assert describe_leaning(header) == ["  wave  leans on right arm 84%, trunk 12%", "  bow   leans on trunk 100%"]


@pytest.mark.parametrize(
    "table",
    [None, "", "[]", "NaN", {"bow": 3}, {"bow": {"trunk": "x"}}, {"bow": {"trunk": 0.0}}, {"bow": {"trunk": np.inf}}],
)
def test_a_model_that_does_not_know_publishes_nothing(table):
    assert region_shares(header_of(table)) is None and describe_leaning(header_of(table)) == []


def test_one_region_is_nothing_to_tell_and_any_numbers_are_in_range():
    assert region_shares(header_of({"bow": {"left arm": 1.0}}, ("left_hand",))) is None
    damaged = {"bow": {"trunk": 10.0, "left arm": -8.0}, "jump": {f"tail{n}": 1.0 for n in range(9)}}
    assert region_shares(header_of(damaged)).shares[0][0] == 100
