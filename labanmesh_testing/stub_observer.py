"""An observer without a camera: it publishes the posteriors that a test prescribes."""

import secrets
import threading
import time
from collections.abc import Sequence

from common.errors import BadInput
from common.keys import SceneKeys
from common.link import Link
from common.messages import PosteriorMessage, VocabularyHash
from common.text import nearest
from common.vocabulary import Vocabulary
from common.wire import encode

Ballot = tuple[str | None, float] | tuple[str | None, float, float]
"""Label (None: the person rests), seconds, and the probability of the label."""
SURE_P = 0.97
"""The probability of a label where the script gives none: that of a learned model in the middle of a clear movement."""
RESTS, MOVES = 0.97, 0.03
"""The probability that the person rests, while they do and while they move."""


class StubObserver:
    """Votes by a script; before and after it the person rests. It is present on the mesh until `leave`."""

    def __init__(self, name: str, keys: SceneKeys, vocabulary: Vocabulary, link: Link) -> None:
        self.name = name
        self._scene, self._vocabulary, self._link = keys.scene, vocabulary, link
        self._reference = VocabularyHash(name=vocabulary.name, hash=vocabulary.digest)
        self._session, self._seq = secrets.token_hex(4), 0
        self._script: list[tuple[float, str | None, float]] = []
        self._lock = threading.Lock()
        self._gone = False
        link.announce(keys.observer_alive(name))
        self._publisher = link.publisher(keys.posterior(name))

    def votes(self, script: Sequence[Ballot]) -> None:
        """Vote by `script` from now on, instead of by an earlier one; returns at once.

        Raises BadInput for a label that the scene does not have, and for a probability that is not above chance.
        """
        end_s, entries = time.monotonic(), []
        for label, seconds, *given in script:
            end_s += seconds
            p = given[0] if given else SURE_P
            self._check(label, p)
            entries.append((end_s, label, p))
        self._script = entries

    def publish(self, label: str | None, p: float = SURE_P, at_ns: int | None = None) -> None:
        """Publish one posterior: `p` for the label, the rest for all others. at_ns: when it was captured, else now."""
        now_ns = time.time_ns()
        with self._lock:
            if self._gone:
                return
            message = PosteriorMessage(
                v=1,
                scene=self._scene,
                observer=self.name,
                seq=self._seq,
                session=self._session,
                captured_ns=now_ns if at_ns is None else at_ns,
                sent_ns=now_ns,
                vocabulary=self._reference,
                p=self._distribution(label, p),
                rest=RESTS if label is None else MOVES,
                frames=self._seq + 1,
            )
            self._publisher.put(encode(message))
            self._seq += 1

    def publish_due(self) -> None:
        """Publish what the script says about now; called by the scene at the rate of its cameras."""
        now_s = time.monotonic()
        label, p = next(((label, p) for end_s, label, p in self._script if now_s < end_s), (None, SURE_P))
        self.publish(label, p)

    def leave(self) -> None:
        """Leave the mesh, as a process that ends: it publishes nothing more, and its liveliness token disappears."""
        with self._lock:
            self._gone = True
        self._link.close()

    def _distribution(self, label: str | None, p: float) -> list[float]:
        size = self._vocabulary.size
        if label is None:
            return [1 / size] * size
        return [p if each == label else (1 - p) / (size - 1) for each in self._vocabulary.labels]

    def _check(self, label: str | None, p: float) -> None:
        if label is not None and label not in self._vocabulary.labels:
            known = nearest(label, self._vocabulary.labels)
            raise BadInput(f"{self.name}: {label!r}: not a label of this scene; {known}")
        if not 1 / self._vocabulary.size < p <= 1:
            raise BadInput(f"{self.name}: probability {p:g}: between chance (1 / {self._vocabulary.size}) and 1")
