"""The referee's score: as at Kata competitions the highest and the lowest are dropped, and the rest is averaged. Pure.

World Karate Federation, Kata competition rules (2019 to 2023): of seven judges two highest and two lowest of each
criterion were removed. Here one of each, of four judges and more; fewer are averaged (docs/design/score.md).
"""

from collections.abc import Mapping
from typing import NamedTuple

LEAST_DROPPED = 4


class JudgedScore(NamedTuple):
    """One judge's score, 0 to 10, and its certainty, 0 to 1."""

    score: float
    certainty: float = 1.0


def pooled_score(scores: Mapping[str, JudgedScore]) -> float | None:
    """The mean by certainty of the scores that stay; None without any."""
    kept = [scores[name] for name in kept_judges(scores)]
    total = sum(each.certainty for each in kept)
    if not kept:
        return None
    if total <= 0.0:
        return sum(each.score for each in kept) / len(kept)
    return sum(each.score * each.certainty for each in kept) / total


def kept_judges(scores: Mapping[str, JudgedScore]) -> list[str]:
    """Those whose scores are averaged; of equal scores the earlier name is dropped first."""
    ordered = sorted(scores, key=lambda name: (scores[name].score, name))
    return sorted(ordered[1:-1] if len(ordered) >= LEAST_DROPPED else ordered)
