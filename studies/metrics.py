"""Accuracy, calibration and confusion tables. Pure functions on arrays.

Shapes: p (N, M) judged probabilities, truth (N,) indices of the true movements.
"""

from collections.abc import Sequence
from itertools import zip_longest
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from observer.tracks import Floats

Indices = NDArray[np.int64]

BINS = 15
LEAST_P = 1e-12
"""Floor of log_loss: a true movement with p = 0 costs 27.6 nats instead of infinitely many."""


def accuracy(p: Floats, truth: Indices) -> float:
    """Share of trials whose most probable movement is the true one (MAP, section IV.B)."""
    return float((p.argmax(axis=1) == truth).mean())


def confusion(p: Floats, truth: Indices) -> Indices:
    """(M, M) counts, rows true, columns judged."""
    counts = np.zeros((p.shape[1], p.shape[1]), dtype=np.int64)
    np.add.at(counts, (truth, p.argmax(axis=1)), 1)
    return counts


def expected_calibration_error(p: Floats, truth: Indices, bins: int = BINS) -> float:
    """Mean |accuracy - confidence| over equal bins of the confidence max p, weighted by the trials in each bin."""
    confidence, right = p.max(axis=1), p.argmax(axis=1) == truth
    # A confidence of exactly 1 belongs to the last bin.
    place = np.minimum((confidence * bins).astype(int), bins - 1)
    gaps = [
        (place == b).mean() * abs(right[place == b].mean() - confidence[place == b].mean())
        for b in range(bins)
        if (place == b).any()
    ]
    return float(sum(gaps))


def brier(p: Floats, truth: Indices) -> float:
    """Mean over trials of sum_m (p_m - [m is true])^2: 0 is perfect, 2 is certain and wrong."""
    target = np.eye(p.shape[1])[truth]
    return float(((p - target) ** 2).sum(axis=1).mean())


def log_loss(p: Floats, truth: Indices) -> float:
    """Mean of -ln p(true movement), in nats."""
    return float(-np.log(np.maximum(p[np.arange(len(p)), truth], LEAST_P)).mean())


ERRORS_HEAD = "Σ errors"


class ConfusedPair(NamedTuple):
    """How often one movement is judged as another, in one view and after fusion."""

    true: str
    judged: str
    count_in_one_view: int
    count_fused: int


def confusion_table(confusion: Indices, labels: Sequence[str], title: str = "") -> str:
    """(M, M) counts, rows true, columns judged -> the table as lines of text.

    Rows have a number and a name, columns a number; zeros are left empty. The last column has the errors of each row,
    the last line their sum as in `32(of 95)`. Raises ValueError unless confusion is (M, M) for M labels.
    """
    counts = _checked(confusion, labels)
    errors = counts.sum(axis=1) - counts.diagonal()
    number = len(str(len(labels)))
    names = [f"{place:>{number}} {label}" for place, label in enumerate(labels, 1)]
    side = max(map(len, names))
    cell = max(number, len(str(counts.max(initial=0)))) + 1
    total = f"{errors.sum()}(of {counts.sum()})"
    end = max(len(ERRORS_HEAD), len(total)) + 2
    head = " " * side + "".join(f"{place:>{cell}}" for place in range(1, len(labels) + 1)) + f"{ERRORS_HEAD:>{end}}"
    rows = [
        f"{name:<{side}}" + "".join(f"{count or '':>{cell}}" for count in row) + f"{wrong:>{end}}"
        for name, row, wrong in zip(names, counts.tolist(), errors.tolist(), strict=True)
    ]
    return "\n".join([*([title] if title else []), head, "-" * len(head), *rows, f"{total:>{len(head)}}"])


def beside(left: str, right: str, gap: int = 4) -> str:
    """Two texts side by side, `gap` spaces apart, aligned at the top, without trailing spaces."""
    lines_left, lines_right = left.splitlines(), right.splitlines()
    width = max(map(len, lines_left), default=0) + gap
    pairs = zip_longest(lines_left, lines_right, fillvalue="")
    return "\n".join(f"{ours:<{width}}{theirs}".rstrip() for ours, theirs in pairs)


def confused_pairs(confusion_one: Indices, confusion_fused: Indices, labels: Sequence[str]) -> list[ConfusedPair]:
    """Pairs of movements that fusion confuses less often than one view does, as nthrow and ok in the paper.

    Both are (M, M) counts, rows true, columns judged, of the same trials. Sorted by the largest reduction, then by
    frequency, then by label. Raises ValueError for shapes that do not match the labels.
    """
    one, fused = _checked(confusion_one, labels), _checked(confusion_fused, labels)
    places = [(i, j) for i, j in np.argwhere(one > fused).tolist() if i != j]
    places.sort(key=lambda at: (fused[at] - one[at], -one[at], at))
    return [ConfusedPair(labels[i], labels[j], int(one[i, j]), int(fused[i, j])) for i, j in places]


def _checked(confusion: Indices, labels: Sequence[str]) -> Indices:
    if confusion.shape != (len(labels), len(labels)):
        raise ValueError(f"confusion has shape {confusion.shape}; expected ({len(labels)}, {len(labels)})")
    return confusion
