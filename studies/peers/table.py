"""The comparison as a table in markdown, and as JSON: who was right how often, and what a difference means. Pure."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from studies.peers.classifiers import PEERS
from studies.peers.scores import Contest, Score, scored
from studies.subsets import SUBSETS

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
