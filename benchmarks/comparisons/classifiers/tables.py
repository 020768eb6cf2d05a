"""The tables of the comparison: accuracies with their bootstrap intervals, differences, spotting scores. Pure."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from benchmarks.command_line import markdown_table
from benchmarks.comparisons.classifiers.comparison import PEERS, PRODUCT, PeerComparison
from observer.motion.label_sets import SUBSETS
from observer.tracks import Floats

DRAWS = 2000
COVERAGE = 0.95


@dataclass(frozen=True, slots=True, eq=False)
class AccuracyInterval:
    """mean (F+1,): accuracy at each fraction, then the area under the curve; low, high (F+1,): 95 % of the draws."""

    mean: Floats
    low: Floats
    high: Floats


@dataclass(frozen=True, slots=True, eq=False)
class PeerRow:
    """One row of the table; `difference`: the interval is of one classifier's accuracy minus another's."""

    movements: str
    classifier: str
    interval: AccuracyInterval
    difference: bool = False


def accuracy_interval(rights: Sequence[Floats], people: Sequence[Sequence[str]], seed: int = 0) -> AccuracyInterval:
    """The mean over one or several sets of trials, each (F, N) with the names of the N trials' people.

    Also for the difference of two curves. The interval is a bootstrap in two stages: people are drawn with
    replacement, the same for every set, then as many trials of each person as there are. It is rough for few people.
    """
    known = sorted({person for names in people for person in names})
    rng = np.random.default_rng(seed)
    drawn = rng.multinomial(len(known), np.full(len(known), 1 / len(known)), size=DRAWS)
    sets = [
        _with_area(right @ _weights(names, known, drawn, rng).T) for right, names in zip(rights, people, strict=True)
    ]
    # A draw without a person of a set has no accuracy for that set.
    low, high = np.nanquantile(np.mean(sets, axis=0), [(1 - COVERAGE) / 2, (1 + COVERAGE) / 2], axis=1)
    mean = np.mean([_with_area(right.mean(axis=1)) for right in rights], axis=0)
    return AccuracyInterval(mean, low, high)


def _weights(names: Sequence[str], known: Sequence[str], drawn: NDArray[np.int64], rng: np.random.Generator) -> Floats:
    """(DRAWS, N) shares of the trials in each draw, NaN where no person of this set was drawn."""
    counts = np.zeros((len(drawn), len(names)))
    for person, times in zip(known, drawn.T, strict=True):
        own = [n for n, name in enumerate(names) if name == person]
        if own:
            counts[:, own] = rng.multinomial(times * len(own), np.full(len(own), 1 / len(own)))
    total = counts.sum(axis=1, keepdims=True)
    shares: Floats = np.where(total > 0, counts / np.maximum(total, 1), np.nan)
    return shares


def _with_area(accuracies: Floats) -> Floats:
    """(F, ...) -> (F+1, ...): the mean over the fractions is last."""
    return np.concatenate([accuracies, accuracies.mean(axis=0, keepdims=True)])


def peer_rows(comparisons: Sequence[PeerComparison]) -> list[PeerRow]:
    """By set of movements one row per curve and one per difference to a peer; then the mean of the subsets."""
    rows = [row for comparison in comparisons for row in _rows(comparison.movements, [comparison])]
    subsets = [comparison for comparison in comparisons if comparison.movements in SUBSETS]
    if len(subsets) > 1:
        rows += _rows(f"mean of {', '.join(comparison.movements for comparison in subsets)}", subsets)
    return rows


def _rows(movements: str, comparisons: Sequence[PeerComparison]) -> list[PeerRow]:
    people = [comparison.people for comparison in comparisons]
    curves = list(zip(*(comparison.curves for comparison in comparisons), strict=True))
    rows = [
        PeerRow(movements, same[0].name, accuracy_interval([curve.right for curve in same], people)) for same in curves
    ]
    ours = curves[0]
    for theirs in curves:
        if ours[0].name.startswith("ours") and theirs[0].name in (*PEERS, PRODUCT):
            differences = [mine.right - other.right for mine, other in zip(ours, theirs, strict=True)]
            name = f"{ours[0].name} − {theirs[0].name}"
            rows.append(PeerRow(movements, name, accuracy_interval(differences, people), difference=True))
    return rows


def as_markdown(rows: Sequence[PeerRow], fractions: Sequence[float]) -> str:
    """Accuracy after each fraction and the area under the curve, with the 95 % interval in brackets."""
    head = ["movements", "judged by", *(f"{fraction:.0%}" for fraction in fractions), "area"]
    before = ["", *(row.movements for row in rows)]
    cells = [
        ["" if row.movements == last else row.movements, row.classifier, *_cells(row)]
        for row, last in zip(rows, before, strict=False)
    ]
    return markdown_table(head, cells, left=2)


def _cells(row: PeerRow) -> list[str]:
    sign, interval = "+" if row.difference else "", row.interval
    return [
        f"{mean:{sign}.3f} ({low:{sign}.2f} to {high:{sign}.2f})"
        for mean, low, high in zip(interval.mean, interval.low, interval.high, strict=True)
    ]


def as_json(rows: Sequence[PeerRow], fractions: Sequence[float]) -> list[dict[str, Any]]:
    """One object per row; `accuracy_at` as in the contract, each figure with its interval [low, high]."""
    names = [*map(str, fractions), "area"]
    return [
        {
            "movements": row.movements,
            "judged_by": row.classifier,
            "accuracy_at": dict(zip(names[:-1], row.interval.mean[:-1].tolist(), strict=True)),
            "area": float(row.interval.mean[-1]),
            "interval": dict(zip(names, np.column_stack([row.interval.low, row.interval.high]).tolist(), strict=True)),
        }
        for row in rows
    ]


def streams_as_markdown(rows: Sequence[Mapping[str, Any]]) -> str:
    """Scores by the first word; false verdicts a minute are those outside all movements."""
    head = [
        *("observers", "judged by", "F1", "precision", "recall", "median latency", "false a minute of other motion"),
        "frames right",
    ]
    before = ["", *(row["observers"] for row in rows)]
    cells = [
        [
            "" if row["observers"] == last else row["observers"],
            row["judged_by"],
            *(f"{row[name]:.3f}" for name in ("f1", "precision", "recall")),
            "-" if row["median_latency_s"] is None else f"{row['median_latency_s']:.2f} s",
            f"{row['false_alarms_per_minute']:.2f}",
            f"{row['frames_right']:.3f}",
        ]
        for row, last in zip(rows, before, strict=False)
    ]
    return markdown_table(head, cells, left=2)
