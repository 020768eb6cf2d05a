"""Whether a posterior differs enough from the one sent last. No network and no clock.

Rules of `SendOnChange`:

1. A posterior is sent at once if the most probable movement, its repetitions, its score, the side of 0.5 of rest or of
   `unlearned`, or whether any body part is seen differs from the last one sent.
2. It is sent if one of its distributions has moved by more than MAX_CHANGE since then: movements (with their facings,
   where these are sent), rest, `unlearned`, and each facet. So receivers are never further off than that.
3. It is sent after `heartbeat_s` at the latest, so that no receiver takes it for silent or stale.
"""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from common import SECOND_NS
from observer.runtime.pipeline import Posterior
from observer.tracks import Floats

MAX_CHANGE = 0.01
"""Total variation distance. Half of the largest value that changed no label of a verdict on the training subjects
1, 3, 5, 7, 9 of MSR Action3D, each observed with models of the others."""


@dataclass(frozen=True, slots=True)
class Summary:
    """What is compared of a posterior: `discrete` must not change at all, `distributions` by MAX_CHANGE at most."""

    discrete: tuple[object, ...]
    distributions: Mapping[str, Floats]

    @classmethod
    def of(cls, posterior: Posterior, directed: bool) -> "Summary":
        """directed: whether facings are sent too."""
        p, unlearned = posterior.p, posterior.unlearned
        facing = posterior.facing if directed else None
        joint = p if facing is None else p[:, None] * facing
        distributions = {"movement": joint.ravel(), "rest": _binary(posterior.rest), **posterior.facets}
        if unlearned is not None:
            distributions["unlearned"] = _binary(unlearned)
        blind = bool(posterior.visible) and not any(posterior.visible.values())
        sides = (int(p.argmax()), posterior.rest >= 0.5, (unlearned or 0.0) >= 0.5, blind, facing is not None)
        return cls((*sides, posterior.repetitions, posterior.score), distributions)


class SendOnChange:
    """Decides whether a posterior differs enough from the last one sent; heartbeat_s: longest time without sending."""

    def __init__(self, heartbeat_s: float, directed: bool = True) -> None:
        self._heartbeat_ns, self._directed = heartbeat_s * SECOND_NS, directed
        self._sent: tuple[int, Summary] | None = None

    def forget(self) -> None:
        """Send the next posterior in any case."""
        self._sent = None

    def should_send(self, posterior: Posterior, captured_ns: int) -> bool:
        """Whether to send the posterior of the frame captured then; if so, it counts as sent."""
        summary = Summary.of(posterior, self._directed)
        if self._sent is not None:
            sent_ns, last = self._sent
            if 0 <= captured_ns - sent_ns < self._heartbeat_ns and distance(summary, last) <= MAX_CHANGE:
                return False
        self._sent = captured_ns, summary
        return True


def distance(one: Summary, other: Summary) -> float:
    """Largest total variation distance of the distributions, 0 to 1; infinite if a discrete part differs."""
    if one.discrete != other.discrete or one.distributions.keys() != other.distributions.keys():
        return float("inf")
    return max(float(np.abs(p - other.distributions[name]).sum()) / 2 for name, p in one.distributions.items())


def _binary(probability: float) -> Floats:
    return np.array([probability, 1.0 - probability])
