"""Metrics against plain loops over trials; confusion tables in text, the paper's as the oracle."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from studies.experiments import PAPER_MOVEMENTS, TABLE_I, TABLE_II, TABLE_III
from studies.metrics import (
    BINS,
    ConfusedPair,
    accuracy,
    beside,
    brier,
    confused_pairs,
    confusion,
    confusion_table,
    expected_calibration_error,
    log_loss,
)


@st.composite
def judged(draw):
    n, m = draw(st.integers(1, 30)), draw(st.integers(2, 5))
    rows = draw(
        st.lists(st.lists(st.sampled_from([0.0, 0.1, 0.3, 1.0, 7.0]), min_size=m, max_size=m), min_size=n, max_size=n)
    )
    p = np.array([[x / sum(row) for x in row] if sum(row) else [1 / m] * m for row in rows])
    return p, np.array(draw(st.lists(st.integers(0, m - 1), min_size=n, max_size=n)))


def map_of(row):
    return max(range(len(row)), key=lambda m: row[m])


@given(judged())
def test_metrics_are_those_of_loops_over_trials(case):
    p, truth = case
    trials = list(zip(p.tolist(), truth.tolist(), strict=True))
    size, right = p.shape[1], [map_of(row) == t for row, t in trials]
    assert accuracy(p, truth) == pytest.approx(sum(right) / len(right))
    counts = [[sum(t == i and map_of(row) == j for row, t in trials) for j in range(size)] for i in range(size)]
    assert confusion(p, truth).tolist() == counts
    squares = [sum((x - (m == t)) ** 2 for m, x in enumerate(row)) for row, t in trials]
    assert brier(p, truth) == pytest.approx(sum(squares) / len(p))
    losses = [-math.log(max(row[t], 1e-12)) for row, t in trials]
    assert log_loss(p, truth) == pytest.approx(sum(losses) / len(p), abs=1e-12)
    bins = [[] for _ in range(BINS)]
    for (row, _), is_right in zip(trials, right, strict=True):
        bins[min(int(max(row) * BINS), BINS - 1)].append(is_right - max(row))
    assert expected_calibration_error(p, truth) == pytest.approx(sum(map(abs, map(sum, bins))) / len(p), abs=1e-12)


counts = st.integers(2, 20).flatmap(lambda size: arrays(np.int64, (size, size), elements=st.integers(0, 120)))


def names(size):
    return [f"movement_{i}" for i in range(size)]


@pytest.mark.parametrize(
    ("table", "printed"),
    [
        (TABLE_I, [6, 8, 1, 6, 2, 0, 4, 5]),
        (TABLE_II, [3, 12, 6, 12, 2, 0, 7, 5]),
        (TABLE_III, [2, 2, 1, 6, 2, 0, 5, 0]),
    ],
)
def test_the_papers_counts_give_its_printed_errors_and_rates(table, printed):
    errors = table.confusion.sum(axis=1) - table.confusion.diagonal()
    assert errors.tolist() == printed
    assert round(1 - errors.sum() / 95, 2) == table.printed_rate


def test_the_papers_misprint_stays_as_printed():
    assert [table.confusion.sum() for table in (TABLE_I, TABLE_II, TABLE_III)] == [95, 95, 96]
    point = PAPER_MOVEMENTS.index("point")
    assert (TABLE_I.confusion[point].sum(), TABLE_III.confusion[point].sum()) == (12, 13)


def test_table_i_is_laid_out_as_in_the_paper():
    assert confusion_table(TABLE_I.confusion, PAPER_MOVEMENTS).splitlines() == [
        "           1  2  3  4  5  6  7  8   Σ errors",
        "--------------------------------------------",
        "1 lunging  7        5           1          6",
        "2 maestro     5           8                8",
        "3 stretch       12           1             1",
        "4 ok                7  1     5             6",
        "5 point             1 10     1             2",
        "6 byebye                 13                0",
        "7 shake             4        9             4",
        "8 nthrow            4        1             5",
        "                                   32(of 95)",
    ]


def test_a_title_stands_above_and_tables_beside_each_other():
    ours = confusion_table(TABLE_I.confusion, PAPER_MOVEMENTS, "ours")
    both = beside(ours, confusion_table(TABLE_III.confusion, PAPER_MOVEMENTS, "paper")).splitlines()
    assert both[0].split() == ["ours", "paper"] and both[-1].split() == ["32(of", "95)", "18(of", "96)"]
    assert beside("a\nbb", "1\n2\n3", gap=1) == "a  1\nbb 2\n   3"
    assert both[3].index("1 lunging", 5) == both[10].index("8 nthrow", 5)


def test_the_fusion_resolves_what_the_paper_says():
    pairs = confused_pairs(TABLE_I.confusion, TABLE_III.confusion, PAPER_MOVEMENTS)
    assert pairs[0] == ConfusedPair("maestro", "byebye", 8, 2)
    assert ConfusedPair("nthrow", "ok", 4, 0) in pairs


@given(counts)
def test_every_table_is_rectangular_and_tells_each_count(confusion):
    head, _, *rows, total = confusion_table(confusion, names(len(confusion))).splitlines()
    assert {len(line) for line in (head, *rows, total)} == {len(head)}
    for row, true in zip(rows, confusion, strict=True):
        assert [int(word) for word in row.split()[2:-1]] == [count for count in true if count]
    assert total.strip() == f"{confusion.sum() - confusion.trace()}(of {confusion.sum()})"


@given(counts)
def test_pairs_are_errors_that_became_fewer(confusion):
    pairs = confused_pairs(confusion, confusion.T, names(len(confusion)))
    resolved = [pair.count_in_one_view - pair.count_fused for pair in pairs]
    assert resolved == sorted(resolved, reverse=True) and all(fewer > 0 for fewer in resolved)
    assert all(pair.true != pair.judged for pair in pairs)
    assert confused_pairs(confusion, confusion, names(len(confusion))) == []
