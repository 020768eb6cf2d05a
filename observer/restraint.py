"""Which opinions are worth saying where every byte counts: those that change what the referee would judge. Pure.

1. An opinion is said at once when the likeliest movement, the side of rest or of "something else", or whether anything
   is seen at all is another than when it was last said.
2. It is said when some belief in it has moved by more than BOUND since then: over movements (and facings with them,
   where they are said), rest, "something else", and each facet. So what is held back is never further than BOUND from
   what was said.
3. It is said after `heartbeat_s` at the latest, so that nobody takes the judge for silent or his belief for old.
"""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from observer.opinion import OpinionLike
from observer.tracks import Floats

SECOND_NS = 1_000_000_000
BOUND = 0.01
"""Total variation: so much probability may have moved from some answers to others. Half of what on the training
subjects 1, 3, 5, 7, 9 of MSR Action3D, each judged by what the others taught, changed no label of a verdict."""


@dataclass(frozen=True, slots=True)
class Gist:
    """Of an opinion what is compared. sides: what must not change at all; beliefs: distributions by name."""

    sides: tuple[object, ...]
    beliefs: Mapping[str, Floats]

    @classmethod
    def of(cls, opinion: OpinionLike, directed: bool) -> "Gist":
        """directed: whether facing is said too."""
        facing = opinion.facing if directed else None
        joint = opinion.p if facing is None else opinion.p[:, None] * facing
        unlearned = opinion.unlearned
        beliefs = {"movement": joint.ravel(), "rest": _binary(opinion.rest), **opinion.facets}
        if unlearned is not None:
            beliefs["unlearned"] = _binary(unlearned)
        blind = bool(opinion.visible) and not any(opinion.visible.values())
        sides = (int(opinion.p.argmax()), opinion.rest >= 0.5, (unlearned or 0.0) >= 0.5, blind, facing is not None)
        return cls(sides, beliefs)


class Restraint:
    """Remembers what was said last. heartbeat_s: an opinion is never held back for longer."""

    def __init__(self, heartbeat_s: float, directed: bool = True, bound: float = BOUND) -> None:
        self._heartbeat_ns, self._directed, self._bound = heartbeat_s * SECOND_NS, directed, bound
        self._said: tuple[int, Gist] | None = None

    def lets_pass(self, opinion: OpinionLike, captured_ns: int) -> bool:
        """Whether to say the opinion about the frame captured then; it is taken to be said if so."""
        gist = Gist.of(opinion, self._directed)
        if self._said is not None:
            at_ns, said = self._said
            if 0 <= captured_ns - at_ns < self._heartbeat_ns and distance(gist, said) <= self._bound:
                return False
        self._said = captured_ns, gist
        return True


def distance(one: Gist, other: Gist) -> float:
    """Total variation, 0 to 1, of the belief in which two opinions differ most; infinite when another side is taken."""
    if one.sides != other.sides or one.beliefs.keys() != other.beliefs.keys():
        return float("inf")
    return max(_apart(p, other.beliefs[name]) for name, p in one.beliefs.items())


def _apart(p: Floats, q: Floats) -> float:
    return float(np.abs(p - q).sum()) / 2


def _binary(chance: float) -> Floats:
    return np.array([chance, 1.0 - chance])
