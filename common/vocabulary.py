"""The vocabulary: the movements of a scene in one agreed order. Pure."""

import hashlib
import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import lru_cache
from statistics import median

from common.errors import BadInput
from common.message_types import MovementTimes

ABSTAIN = "abstain"
"""The label of a verdict if a movement happened and the observers could not agree on it."""
LABEL = re.compile(r"[a-z0-9_]{1,64}\Z")
LABEL_RULE = "use 1 to 64 lower case letters, digits and underscores"
RESERVED = (ABSTAIN, "nothing", "rest", "something_else", "undecided", "unlearned")
"""Words that stand for something else than a movement, for people or in messages: none is taught by such a name."""


@dataclass(frozen=True, slots=True)
class Vocabulary:
    """Labels of M movements in the order of every probability vector (1: M in {maestro, ..., nthrow}).

    Two processes understand each other if their `digest` is equal: order and labels count, `name` does not, nor do
    `movements`, the durations of movements by label, as far as they are known.

    Raises BadInput for fewer than two labels, a repeated label, one not in [a-z0-9_]{1,64}, and `abstain`, which is the
    label of a verdict without agreement.
    """

    labels: tuple[str, ...]
    name: str = "movements"
    movements: Mapping[str, MovementTimes] = field(default_factory=dict, compare=False)

    def __post_init__(self) -> None:
        if len(self.labels) < 2:
            raise BadInput(f"vocabulary = {list(self.labels)}: name at least two movements")
        for label in self.labels:
            if not LABEL.match(label):
                raise BadInput(f"label {label!r}: {LABEL_RULE}")
        if ABSTAIN in self.labels:
            raise BadInput(f"label {ABSTAIN!r}: reserved for verdicts without agreement; choose another label")
        if len(set(self.labels)) != len(self.labels):
            twice = next(label for label in self.labels if self.labels.count(label) > 1)
            raise BadInput(f"label {twice!r} occurs twice in the vocabulary; give every movement a label of its own")

    @property
    def size(self) -> int:
        """M, the number of movements."""
        return len(self.labels)

    @property
    def periods(self) -> dict[str, float]:
        """Seconds of one repetition of each periodic movement, by label."""
        known = {label: times.period_s for label, times in self.movements.items()}
        return {label: period_s for label, period_s in known.items() if period_s is not None}

    @property
    def digest(self) -> str:
        """First 16 hex digits of the SHA-256 of the labels, each followed by a newline."""
        return _digest(self.labels)

    def index(self, label: str) -> int:
        """Position of `label`; raises BadInput that lists the known labels."""
        try:
            return self.labels.index(label)
        except ValueError:
            raise BadInput(f"label {label!r}: not in the vocabulary; known: {', '.join(self.labels)}") from None


def require_teachable(labels: Iterable[str]) -> None:
    """Raise BadInput, one line, for the first label by which no movement can be taught."""
    for label in labels:
        if not LABEL.match(label):
            raise BadInput(f"label {label[:64]!r}: {LABEL_RULE}")
        if label in RESERVED:
            raise BadInput(f"{label}: this word stands for something else than any movement; choose another name")


@lru_cache(maxsize=64)
def _digest(labels: tuple[str, ...]) -> str:
    # Every message is checked against it. Peers can send any number of vocabularies, so the cache is bounded.
    return hashlib.sha256("".join(f"{label}\n" for label in labels).encode()).hexdigest()[:16]


def agreed_times(answers: Sequence[Vocabulary]) -> dict[str, MovementTimes]:
    """The durations of each movement that one vocabulary, as several observers know it, is judged with.

    Each is the median over those that know the movement. It is periodic if it is so for more than half of them.
    """
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
