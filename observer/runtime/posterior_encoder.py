"""Which posteriors an observer sends, and the messages that carry them. Pure.

Rules of `SendOnChange`:

1. A posterior is sent at once if the most probable movement, the side of 0.5 of rest or of `unlearned`, or whether any
   body part is seen differs from the last one sent.
2. It is sent if one of its distributions has moved by more than MAX_CHANGE since then: movements (with their facings,
   where these are sent), rest, `unlearned`, and each facet. Receivers are therefore never further off than that.
3. It is sent after `heartbeat_s` at the latest, so that no receiver takes the observer for silent or the posterior for
   stale.
"""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from common import SECOND_NS
from common.messages import Facing, PosteriorMessage, VocabularyHash
from common.probability import encode_facing
from common.vocabulary import Vocabulary
from observer.runtime.pipeline import Posterior
from observer.tracks import Floats

MAX_CHANGE = 0.01
"""Total variation distance. Half of the largest value that changed no label of a verdict on the training subjects
1, 3, 5, 7, 9 of MSR Action3D, each observed with models of the others."""


class PosteriorEncoder:
    """Makes an observer's numbered messages; each start of the observer has a new session.

    directed: whether the observer's direction is known, so that others can use its facings. The message leaves out the
    scene and the observer, which the key contains, and `visible` if all parts are seen.
    """

    def __init__(self, vocabulary: Vocabulary, session: str, directed: bool = True) -> None:
        self._session, self._directed = session, directed
        self._vocabulary = VocabularyHash(hash=vocabulary.digest)
        self.seq = 0

    def encode(self, posterior: Posterior, captured_ns: int, now_ns: int) -> PosteriorMessage:
        """The posterior of the frame captured at `captured_ns` as a message, which clamps round-off."""
        facing = posterior.facing if self._directed else None
        message = PosteriorMessage(
            v=2,
            seq=self.seq,
            session=self._session,
            captured_ns=captured_ns,
            sent_ns=now_ns,
            vocabulary=self._vocabulary,
            p=posterior.p.tolist(),
            rest=posterior.rest,
            unlearned=posterior.unlearned,
            frames=posterior.frames,
            visible={} if all(posterior.visible.values()) else dict(posterior.visible),
            facing=None if facing is None else Facing(surprise=encode_facing(facing).tolist()),
            facets={name: p.tolist() for name, p in posterior.facets.items()} or None,
        )
        self.seq += 1
        return message


@dataclass(frozen=True, slots=True)
class Summary:
    """The parts of a posterior that are compared.

    discrete: what must not change at all. distributions: what may change by MAX_CHANGE, by name.
    """

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
        discrete = (int(p.argmax()), posterior.rest >= 0.5, (unlearned or 0.0) >= 0.5, blind, facing is not None)
        return cls(discrete, distributions)


class SendOnChange:
    """Decides whether a posterior differs enough from the last one sent; heartbeat_s: longest time without sending."""

    def __init__(self, heartbeat_s: float, directed: bool = True, max_change: float = MAX_CHANGE) -> None:
        self._heartbeat_ns, self._directed, self._max_change = heartbeat_s * SECOND_NS, directed, max_change
        self._sent: tuple[int, Summary] | None = None

    def should_send(self, posterior: Posterior, captured_ns: int) -> bool:
        """Whether to send the posterior of the frame captured then; if so, it counts as sent."""
        summary = Summary.of(posterior, self._directed)
        if self._sent is not None:
            sent_ns, last = self._sent
            if 0 <= captured_ns - sent_ns < self._heartbeat_ns and distance(summary, last) <= self._max_change:
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
