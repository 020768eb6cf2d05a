"""The lookup of a scene's vocabulary: the observers are asked for it."""

import logging

from common.config import Scene
from common.errors import LabanmeshError
from common.messages import VocabularyMessage
from common.vocabulary import Vocabulary
from common.wire import decode, require_fits
from fusion.scene_worker import Service

log = logging.getLogger("labanmesh.fusion")
VOCABULARY_TIMEOUT_S = 1.0


class VocabularyLookup:
    """Asks the observers of a scene for their vocabulary; the first usable answer counts.

    It asks when an observer appears, so that a film of a second is not over before fusion begins, and again every
    VOCABULARY_TIMEOUT_S.
    """

    def __init__(self, scene: Scene, service: Service) -> None:
        self._scene, self._ticks = scene, service.ticks
        self._session = service.link.sub_session(polled=True)
        self._present = self._session.presence(
            scene.keys.observer_alive(), map(scene.keys.observer_alive, scene.roster)
        )
        self._asked: frozenset[str] = frozenset()
        self._payloads: list[bytes] = []
        self._asked_s = float("-inf")

    def poll(self, digest: str | None = None) -> Vocabulary | None:
        """The vocabulary, once an observer has answered; asks when it is due. digest: its hash; None: any."""
        self._session.poll()
        payloads, self._payloads = self._payloads, []
        for payload in payloads:
            try:
                vocabulary = decode(VocabularyMessage, payload).vocabulary
                if digest in (None, vocabulary.digest):
                    require_fits(self._scene, vocabulary)
                    return vocabulary
            except LabanmeshError as error:
                log.warning("a vocabulary that cannot be used: %s", error)
        present = self._present.alive
        if present - self._asked or self._ticks() - self._asked_s >= VOCABULARY_TIMEOUT_S:
            self._asked_s, self._asked = self._ticks(), present
            self._session.request(
                self._scene.keys.vocabulary, lambda _, payload: self._payloads.append(payload), VOCABULARY_TIMEOUT_S
            )
        return None

    def close(self) -> None:
        """Stop asking."""
        self._session.close()
