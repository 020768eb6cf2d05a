"""In which vocabulary a scene is fused, with which durations, and when that changes. Pure: time is passed in.

1. A scene whose file names its vocabulary is fused in that one for ever. Any other is fused in the vocabulary in which
   more than half of its observers publish; while none has a majority, in the one before. So a single observer with
   another model changes nothing, and observers that were taught together take the fusion service with them.
2. An observer counts until its process disappears, or nothing of it has arrived for AGE_LIMIT_S: a camera that is lost
   holds nothing up for longer.
3. Only the owner of the scene decides so. A standby service follows what the owner publishes (fusion/membership.py).
4. The durations of a movement are the medians over the observers that know it. It is periodic if it is so for more than
   half of them. So no single observer decides how the others are judged.
"""

from collections import Counter
from collections.abc import Collection, Iterable, Sequence
from statistics import median

from common import SECOND_NS
from common.message_types import MovementTimes
from common.vocabulary import Vocabulary

AGE_LIMIT_S = 2.0
"""An observer that has published nothing for this long has no say."""


class ObservedVocabularies:
    """The vocabulary, by its hash, in which each observer of the scene published its newest posterior."""

    def __init__(self, roster: Collection[str]) -> None:
        self._roster = frozenset(roster)
        self._newest: dict[str, tuple[str, int]] = {}
        self._present: frozenset[str] = frozenset()

    def note(self, observer: str, digest: str, now_ns: int) -> None:
        """An observer published a posterior in the vocabulary `digest`; one that the scene does not name is ignored."""
        if observer in self._roster:
            self._newest[observer] = digest, now_ns

    def set_present(self, observers: frozenset[str]) -> None:
        """Record which observers are present on the mesh. One that was never announced still counts."""
        for observer in self._present - observers:
            self._newest.pop(observer, None)
        self._present = observers

    def majority(self, now_ns: int) -> str | None:
        """The vocabulary of more than half of the observers that count (rule 2); None if there is none."""
        counts = Counter(
            digest for digest, at_ns in self._newest.values() if abs(now_ns - at_ns) <= AGE_LIMIT_S * SECOND_NS
        )
        if not counts:
            return None
        digest, votes = counts.most_common(1)[0]
        return digest if 2 * votes > counts.total() else None


def agreed_times(answers: Sequence[Vocabulary]) -> dict[str, MovementTimes]:
    """The durations of each movement that one vocabulary, as several observers know it, is judged with (rule 4)."""
    known: dict[str, list[MovementTimes]] = {}
    for answer in answers:
        for label, times in answer.movements.items():
            known.setdefault(label, []).append(times)
    return {label: _median_times(times) for label, times in known.items()}


def _median_times(known: Sequence[MovementTimes]) -> MovementTimes:
    periods = [times.period_s for times in known if times.period_s is not None]
    return MovementTimes(
        shortest_s=_median(times.shortest_s for times in known),
        rest_s=_median(times.rest_s for times in known),
        period_s=_median(periods) if 2 * len(periods) > len(known) else None,
    )


def _median(values_s: Iterable[float | None]) -> float | None:
    known_s = [value_s for value_s in values_s if value_s is not None]
    return median(known_s) if known_s else None
