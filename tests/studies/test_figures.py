"""Figures are drawn completely and without warnings."""

from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from common.errors import BadInput
from common.probability import entropy_bits, normalise
from studies.experiments import MOVEMENTS, TABLE_III
from studies.figures import (
    LabelledInterval,
    belief_figure,
    confusion_figure,
    earliness_figure,
    reliability_figure,
    verdict_timeline_figure,
)
from studies.figures.accuracy import Figure, save, spread
from studies.figures.over_time import _is_right, _rows


@pytest.fixture(scope="module")
def beliefs():
    random = np.random.default_rng(7)
    return {name: normalise(np.cumsum(random.random((40, 8)) ** 6, axis=0)) for name in ("cam1", "cam2", "fused")}


def is_svg(path):
    return "<svg" in path.read_text("utf-8")


def test_confusion_is_drawn_in_both_kinds(tmp_path):
    png = confusion_figure(TABLE_III.confusion, MOVEMENTS, "fused", tmp_path / "deep" / "c.png")
    assert png.read_bytes().startswith(b"\x89PNG")
    assert is_svg(confusion_figure(TABLE_III.confusion, MOVEMENTS, "fused", tmp_path / "c.svg"))


def test_a_row_without_trials_is_drawn(tmp_path):
    assert is_svg(
        confusion_figure(np.zeros((20, 20), dtype=np.int64), list("abcdefghijklmnopqrst"), "", tmp_path / "c.svg")
    )


def test_beliefs_are_drawn_for_any_number_of_observers(tmp_path, beliefs):
    times_s = np.arange(40) / 30
    entropies = {name: entropy_bits(belief) for name, belief in beliefs.items()}
    assert is_svg(belief_figure(times_s, beliefs, entropies, MOVEMENTS, "nthrow", tmp_path / "three.svg"))
    one = {"cam1": beliefs["cam1"]}
    assert is_svg(belief_figure(times_s, one, entropies, MOVEMENTS, "ok", tmp_path / "one.svg"))
    frame = {"cam1": beliefs["cam1"][:1]}
    assert is_svg(belief_figure(np.zeros(1), frame, {"cam1": np.ones(1)}, MOVEMENTS, "ok", tmp_path / "frame.svg"))


def test_earliness_is_drawn(tmp_path):
    series = {"door": [0.3, 0.5, 0.6], "fused": [0.3, 0.7, 0.6]}
    assert is_svg(earliness_figure([0.2, 0.6, 1.0], series, tmp_path / "e.svg", chance=0.05))


def test_reliability_is_drawn_with_few_and_with_certain_judgements(tmp_path):
    random = np.random.default_rng(1)
    confidence = random.random(300)
    series = {"many": (confidence, random.random(300) < confidence), "one": (np.ones(1), np.ones(1, dtype=bool))}
    assert is_svg(reliability_figure(series, {"many": 0.02, "one": 0.0}, tmp_path / "r.svg"))


def test_the_timeline_is_drawn(tmp_path, beliefs):
    truth, verdicts = (
        [LabelledInterval(0.1, 0.5, "ok")],
        [LabelledInterval(0.2, 0.5, "shake"), LabelledInterval(0.7, 0.9, "abstain")],
    )
    path = tmp_path / "t.svg"
    assert is_svg(verdict_timeline_figure(np.arange(40) / 30, beliefs["fused"], MOVEMENTS, truth, verdicts, path))


def test_a_verdict_is_right_when_it_meets_a_span_of_its_label():
    truth = [LabelledInterval(1, 2, "ok"), LabelledInterval(5, 6, "shake")]
    assert _is_right(LabelledInterval(1.5, 3, "ok"), truth) and not _is_right(LabelledInterval(5, 6, "ok"), truth)
    assert not _is_right(LabelledInterval(2, 3, "ok"), truth), "touching is not meeting"


def test_true_movements_are_always_among_the_rows():
    labels = [f"m{i}" for i in range(20)]
    belief = normalise(np.tile(np.arange(20.0, 0, -1), (3, 1)))
    rows = _rows(belief, labels, [LabelledInterval(0, 1, "m19")], [LabelledInterval(0, 1, "abstain")])
    assert "m19" in rows and len(rows) == 10 and rows == sorted(rows, key=labels.index)


def test_the_same_figure_is_the_same_bytes(tmp_path):
    series = {"door": [0.3, 0.5]}
    first, second = (earliness_figure([0.5, 1.0], series, tmp_path / name) for name in ("a.svg", "b.svg"))
    assert first.read_bytes() == second.read_bytes()


def test_an_unknown_kind_of_file_is_bad_input(tmp_path):
    with pytest.raises(BadInput, match=r"\.bmp.*known: \.png"):
        save(Figure(), tmp_path / "x.bmp")


@given(st.lists(st.floats(0, 1), min_size=1, max_size=8))
def test_names_beside_lines_keep_their_order_and_distance(heights):
    placed = spread(heights, 0.05)
    ordered = [placed[i] for i in sorted(range(len(heights)), key=lambda i: -heights[i])]
    assert all(high - low >= 0.05 - 1e-9 for high, low in pairwise(ordered))
    assert min(placed) >= -1e-9
