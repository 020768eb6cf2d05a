"""The vocabulary: the movements that a scene tells apart, in one agreed order."""

import hashlib
import re
from dataclasses import dataclass
from functools import cache

from common.errors import BadInput

ABSTAIN = "abstain"
"""The label of a verdict when something was done and the observers could not agree what."""
LABEL = re.compile(r"[a-z0-9_]{1,64}\Z")


@dataclass(frozen=True, slots=True)
class Vocabulary:
    """Names of M movements in the order of every probability vector (1: M in {maestro, ..., nthrow}).

    Two processes understand each other when `digest` is equal: the order and every name count, the
    vocabulary's own `name` does not.

    Raises BadInput for fewer than two labels, a repeated label, one not in [a-z0-9_]{1,64}, or `abstain`, which is the
    judges' own word.
    """

    labels: tuple[str, ...]
    name: str = "movements"

    def __post_init__(self) -> None:
        if len(self.labels) < 2:
            raise BadInput(f"vocabulary = {list(self.labels)}: at least two movements are needed to tell them apart")
        for label in self.labels:
            if not LABEL.match(label):
                raise BadInput(f"label {label!r}: lower case letters, digits and underscores only, 1 to 64 of them")
        if ABSTAIN in self.labels:
            raise BadInput(f"label {ABSTAIN!r}: that is what judges say who cannot agree; choose another name")
        if len(set(self.labels)) != len(self.labels):
            twice = next(label for label in self.labels if self.labels.count(label) > 1)
            raise BadInput(f"label {twice!r} stands twice in the vocabulary: every movement needs a name of its own")

    @property
    def size(self) -> int:
        """M, the number of movements."""
        return len(self.labels)

    @property
    def digest(self) -> str:
        """First 16 hex digits of the SHA-256 of the labels, each ended by a newline."""
        return _digest(self.labels)

    def index(self, label: str) -> int:
        """Position of `label`; raises BadInput that lists the known ones."""
        try:
            return self.labels.index(label)
        except ValueError:
            raise BadInput(f"label {label!r}: not in the vocabulary; known: {', '.join(self.labels)}") from None


@cache
def _digest(labels: tuple[str, ...]) -> str:
    # Every message is checked against it, and a process meets few vocabularies.
    return hashlib.sha256("".join(f"{label}\n" for label in labels).encode()).hexdigest()[:16]
