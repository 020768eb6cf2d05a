"""Accuracies with bootstrap intervals, as a markdown table and as JSON. Pure.

Shapes: right (F, N) per fraction and trial: 1 right, 0 wrong, a share where several runs of one classifier differ.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from benchmarks.peers.classifiers import PEERS
from studies.trials import SUBSETS

Floats = NDArray[np.float64]

DRAWS = 2000
COVERAGE = 0.95


@dataclass(frozen=True, slots=True, eq=False)
class Curve:
    """Who judged, and right (F, N): how often he was right about each trial when each fraction was seen."""

    name: str
    right: Floats


@dataclass(frozen=True, slots=True, eq=False)
class Contest:
    """All who judged one set of movements: the same N trials, of people (N names), in every curve."""

    movements: str
    people: tuple[str, ...]
    curves: tuple[Curve, ...]


@dataclass(frozen=True, slots=True, eq=False)
class Score:
    """mean (F+1,): accuracy at each fraction, and last the area under the curve. low, high (F+1,): where 95 % of the
    bootstrap's draws lie."""

    mean: Floats
    low: Floats
    high: Floats


def scored(rights: Sequence[Floats], people: Sequence[Sequence[str]], seed: int = 0) -> Score:
    """The mean over one or several sets of trials, each (F, N) with the names of the N trials' people.

    Differences of two curves are scored as any curve is. The interval is a bootstrap in two stages: people are drawn
    with replacement, the same ones for every set, then as many trials of each as he has. With few people it is rough.
    """
    known = sorted({person for names in people for person in names})
    rng = np.random.default_rng(seed)
    drawn = rng.multinomial(len(known), np.full(len(known), 1 / len(known)), size=DRAWS)
    sets = [
        _with_area(right @ _weights(names, known, drawn, rng).T) for right, names in zip(rights, people, strict=True)
    ]
    # A set none of whose people was drawn has no accuracy in that draw.
    low, high = np.nanquantile(np.mean(sets, axis=0), [(1 - COVERAGE) / 2, (1 + COVERAGE) / 2], axis=1)
    return Score(np.mean([_with_area(right.mean(axis=1)) for right in rights], axis=0), low, high)


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
    """(F, ...) -> (F+1, ...): the mean over the fractions comes last."""
    return np.concatenate([accuracies, accuracies.mean(axis=0, keepdims=True)])


BEGIN = "<!-- peers: from here to the end mark, `make peers` writes -->"
END = "<!-- peers: end -->"


@dataclass(frozen=True, slots=True, eq=False)
class Row:
    """Who was how good at which movements; `apart`: the score is how much one was better than another."""

    movements: str
    who: str
    score: Score
    apart: bool = False


def rows_of(contests: Sequence[Contest]) -> list[Row]:
    """One row a curve, then ours against each peer, by sets of movements; then the same for the mean of the subsets."""
    rows = [row for contest in contests for row in _rows(contest.movements, [contest])]
    subsets = [contest for contest in contests if contest.movements in SUBSETS]
    if len(subsets) > 1:
        rows += _rows(f"mean of {', '.join(contest.movements for contest in subsets)}", subsets)
    return rows


def _rows(movements: str, contests: Sequence[Contest]) -> list[Row]:
    people = [contest.people for contest in contests]
    together = list(zip(*(contest.curves for contest in contests), strict=True))
    rows = [Row(movements, same[0].name, scored([curve.right for curve in same], people)) for same in together]
    ours = together[0]
    for theirs in together:
        if theirs[0].name in PEERS:
            apart = [mine.right - other.right for mine, other in zip(ours, theirs, strict=True)]
            rows.append(Row(movements, f"{ours[0].name} − {theirs[0].name}", scored(apart, people), apart=True))
    return rows


def as_markdown(rows: Sequence[Row], fractions: Sequence[float]) -> str:
    """A table: accuracy when so much was seen, the area under the curve, in brackets the 95 % interval."""
    titles = ["movements", "judged by", *(f"{fraction:.0%}" for fraction in fractions), "area"]
    lines = [_line(titles), _line(["---", "---", *["---:"] * (len(fractions) + 1)])]
    said = ""
    for row in rows:
        lines.append(_line([row.movements if row.movements != said else "", row.who, *_cells(row)]))
        said = row.movements
    return "\n".join(lines)


def _cells(row: Row) -> list[str]:
    sign, score = "+" if row.apart else "", row.score
    return [
        f"{mean:{sign}.3f} ({low:{sign}.2f} to {high:{sign}.2f})"
        for mean, low, high in zip(score.mean, score.low, score.high, strict=True)
    ]


def _line(cells: Sequence[str]) -> str:
    return f"| {' | '.join(cells)} |"


def as_json(rows: Sequence[Row], fractions: Sequence[float]) -> list[dict[str, Any]]:
    """One object a row; `accuracy_at` as the contract's, each figure with its interval [low, high]."""
    names = [*map(str, fractions), "area"]
    return [
        {
            "movements": row.movements,
            "judged_by": row.who,
            "accuracy_at": dict(zip(names[:-1], row.score.mean[:-1].tolist(), strict=True)),
            "area": float(row.score.mean[-1]),
            "interval": dict(zip(names, np.column_stack([row.score.low, row.score.high]).tolist(), strict=True)),
        }
        for row in rows
    ]


def rewritten(page: str, table: str) -> str | None:
    """The page with the table between its two marks instead of what stood there; None when it lacks the marks."""
    before, begin, rest = page.partition(BEGIN)
    _, end, after = rest.partition(END)
    return f"{before}{begin}\n{table}\n{end}{after}" if begin and end else None
