"""Figures are drawn completely and without warnings."""

from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from common.errors import BadInput
from common.probability import entropy_bits, normalise
from studies.experiments import PAPER_MOVEMENTS, TABLE_III
from studies.figures import (
    LabelledInterval,
    StreamTimeline,
    VerdictBar,
    belief_figure,
    confusion_figure,
    earliness_figure,
    reliability_figure,
    stream_timeline_figure,
)
from studies.figures.accuracy import Figure, save, spread

RANDOM = np.random.default_rng(7)
TIMES_S = np.arange(40) / 30
BELIEFS = {name: normalise(np.cumsum(RANDOM.random((40, 8)) ** 6, axis=0)) for name in ("cam1", "cam2", "fused")}
ENTROPIES = {name: entropy_bits(belief) for name, belief in BELIEFS.items()}
CONFIDENCE = RANDOM.random(300)
CURVES = {"many": (CONFIDENCE, RANDOM.random(300) < CONFIDENCE), "one": (np.ones(1), np.ones(1, dtype=bool))}
EARLY = {"door": [0.3, 0.5, 0.6], "fused": [0.3, 0.7, 0.6]}
TRUTH = [LabelledInterval(0.1, 0.5, "ok")]
SPOKEN = [
    VerdictBar("shake", 0.3, "ok", 0.2, 0.6, False, True),
    VerdictBar("abstain", 31.0, "abstain", 29.0, 33.0, False, False),
]
ONE_FRAME = {"cam1": BELIEFS["cam1"][:1]}


@pytest.mark.parametrize(
    "draw",
    [
        lambda path: confusion_figure(TABLE_III.confusion, PAPER_MOVEMENTS, "fused", path),
        lambda path: confusion_figure(np.zeros((20, 20), dtype=np.int64), list("abcdefghijklmnopqrst"), "", path),
        lambda path: belief_figure(TIMES_S, BELIEFS, ENTROPIES, PAPER_MOVEMENTS, "nthrow", path),
        lambda path: belief_figure(TIMES_S, {"cam1": BELIEFS["cam1"]}, ENTROPIES, PAPER_MOVEMENTS, "ok", path),
        lambda path: belief_figure(np.zeros(1), ONE_FRAME, {"cam1": np.ones(1)}, PAPER_MOVEMENTS, "ok", path),
        lambda path: earliness_figure([0.2, 0.6, 1.0], EARLY, path, chance=0.05),
        lambda path: reliability_figure(CURVES, {"many": 0.02, "one": 0.0}, path),
        lambda path: stream_timeline_figure([StreamTimeline("trial 1", 70.0, TRUTH, SPOKEN)] * 2, "anna", path),
    ],
)
def test_every_figure_is_drawn(draw, tmp_path):
    assert "<svg" in draw(tmp_path / "a.svg").read_text("utf-8")


def test_an_unknown_kind_of_file_is_bad_input(tmp_path):
    assert save(Figure(), tmp_path / "deep" / "x.png").read_bytes().startswith(b"\x89PNG")
    with pytest.raises(BadInput, match=r"\.bmp.*known: \.png"):
        save(Figure(), tmp_path / "x.bmp")


@given(st.lists(st.floats(0, 1), min_size=1, max_size=8))
def test_names_beside_lines_keep_their_order_and_distance(heights):
    placed = spread(heights, 0.05)
    ordered = [placed[i] for i in sorted(range(len(heights)), key=lambda i: -heights[i])]
    assert all(high - low >= 0.05 - 1e-9 for high, low in pairwise(ordered))
    assert min(placed) >= -1e-9
