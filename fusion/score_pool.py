"""The referee's score: as at Kata competitions the highest and the lowest are dropped, and the rest is averaged. Pure.

World Karate Federation, Kata competition rules (2019 to 2023): of seven judges two highest and two lowest of each
criterion were removed. Here one of each, of four judges and more; fewer are averaged (docs/design/score.md).
"""

from collections.abc import Mapping, Sequence
from itertools import chain
from typing import NamedTuple, Protocol, TypeVar

from common.score import REMARKS_LIMIT

LEAST_DROPPED = 4
SAME = 1.5
"""Remarks of two judges on one joint are one; it is as strong as its largest, times this for each further judge."""


class JudgedScore(NamedTuple):
    """One judge's score, 0 to 10, its certainty, and how far it is trusted, both 0 to 1."""

    score: float
    certainty: float = 1.0
    trust: float = 1.0

    @property
    def weight(self) -> float:
        """Of the score in the mean."""
        return self.certainty * self.trust


def pooled_score(scores: Mapping[str, JudgedScore]) -> float | None:
    """The mean by certainty and trust of the scores that stay; None without any."""
    kept = [scores[name] for name in kept_judges(scores)]
    total = sum(each.weight for each in kept)
    if not kept:
        return None
    if total <= 0.0:
        return sum(each.score for each in kept) / len(kept)
    return sum(each.score * each.weight for each in kept) / total


def kept_judges(scores: Mapping[str, JudgedScore]) -> list[str]:
    """Those whose scores are averaged; of equal scores the earlier name is dropped first."""
    ordered = sorted(scores, key=lambda name: (scores[name].score, name))
    return sorted(ordered[1:-1] if len(ordered) >= LEAST_DROPPED else ordered)


class JudgedRemark(Protocol):
    """One judge's remark on a joint, and how strong it is."""

    @property
    def joint(self) -> str:
        """The joint's name, as `left knee`."""

    @property
    def strength(self) -> float:
        """1 is just worth a remark."""


R = TypeVar("R", bound=JudgedRemark)


def pooled_remarks(of_judges: Sequence[Sequence[R]]) -> list[R]:
    """The strongest remarks, one for each joint that half of the judges remark: what more of them see stands first."""
    of_joint: dict[str, list[R]] = {}
    for remark in chain.from_iterable(of_judges):
        of_joint.setdefault(remark.joint, []).append(remark)
    agreed = [own for own in of_joint.values() if 2 * len(own) >= len(of_judges)]
    strongest = [(max(own, key=lambda each: each.strength), len(own)) for own in agreed]
    strongest.sort(key=lambda pair: -pair[0].strength * SAME ** (pair[1] - 1))
    return [remark for remark, _ in strongest[:REMARKS_LIMIT]]
