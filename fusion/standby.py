"""What a fusion service asks of others: messages of other services, a handover, the vocabulary of the observers."""

import logging
from collections.abc import Iterable, Iterator, Mapping

from pydantic import ValidationError

from common.config import Scene
from common.errors import LabanmeshError
from common.inbox import Arrival, Inbox, Presence
from common.link import Link
from common.message_checks import check_vocabulary, require_fits
from common.message_types import MovementTimes
from common.messages import JudgementMessage, VerdictMessage, VocabularyMessage
from common.vocabulary import Vocabulary, agreed_times
from common.wire import BadMessage, decode_from
from common.zenoh_settings import MAX_MESSAGE_BYTES
from fusion.checkpoint import Checkpoint
from fusion.service import Service

log = logging.getLogger("labanmesh.fusion")
ANSWER_TIMEOUT_S = 1.0
"""A process that does not answer for this long is assumed to do so no more, and an owner to publish no more."""
TIMES_EVERY_S = 10.0
"""Observers learn from more takes seldom; which durations they know then is asked so often, or with the clocks."""
DECODE_EVERY_S = 1.0
"""A listener that only keeps the last messages decodes one judgement per second; the others count as heartbeats."""


class StandbyListener:
    """Receives the judgements and verdicts that other services publish in one scene, and keeps the last of each person.

    It asks the owner for its last judgements first: an owner that ends a moment later may publish no other one. Where
    several people are judged it decodes all messages: whose one is stands in it.
    """

    def __init__(self, scene: Scene, link: Link) -> None:
        self._scene = scene
        self._session = link.sub_session(polled=True)
        self._inbox = self._session.inbox(scene.keys.judgement, scene.keys.verdict, remote=True)
        self._answers = Inbox()
        self._session.request(scene.keys.judgement, self._answers.put, ANSWER_TIMEOUT_S)
        self._judgements: dict[str | None, bytes] = {}
        self._verdicts: dict[str | None, bytes] = {}
        self._decoded_s = float("-inf")
        self._warned = False
        self.foreign: JudgementMessage | None = None
        """The newest message in another vocabulary, if the newest message is one."""

    def messages(
        self, now_s: float, vocabulary: Vocabulary | None, *, every: bool
    ) -> Iterator[JudgementMessage | None]:
        """The messages since the last call in order of arrival; None stands for one that is not decoded.

        vocabulary: of the scene, once it is known; a message in another one cannot be used. every: decode all of them;
        otherwise one judgement per second.
        """
        self._session.poll()
        for arrival in self._answers.take(0):
            message = self._decode(arrival, vocabulary)
            # What has been published since is newer.
            if message is not None and message.person not in self._judgements:
                yield self._keep(message, arrival.payload)
        every = every or self._scene.people.most > 1
        for arrival in self._inbox.take(0):
            if arrival.key != self._scene.keys.verdict and not every and now_s - self._decoded_s < DECODE_EVERY_S:
                self._judgements[None] = arrival.payload
                yield None
                continue
            message = self._decode(arrival, vocabulary)
            if message is not None:
                self._decoded_s = now_s
                self._keep(message, arrival.payload)
            yield message

    def _decode(self, arrival: Arrival, vocabulary: Vocabulary | None) -> JudgementMessage | None:
        """The message; None if it cannot be used."""
        kind = VerdictMessage if arrival.key == self._scene.keys.verdict else JudgementMessage
        try:
            message = decode_from(arrival.key, kind, arrival.payload)
            self.foreign = None
            if vocabulary is not None and message.vocabulary.hash != vocabulary.digest:
                self.foreign = message
                return None
            if vocabulary is not None:
                check_vocabulary(message, vocabulary)
        except BadMessage as error:
            if not self._warned:
                log.warning("%s: cannot be used: %s", arrival.key, error)
            self._warned = True
            return None
        return message

    def _keep(self, message: JudgementMessage, payload: bytes) -> JudgementMessage:
        last = self._verdicts if isinstance(message, VerdictMessage) else self._judgements
        # Names can be invented.
        if message.person is None or message.person in self._scene.people.ids:
            last[message.person] = payload
        return message

    def checkpoint(self) -> Checkpoint | None:
        """The last published messages; None before the first one, or if they cannot be decoded."""
        try:
            return Checkpoint.of_people(map(self._checkpoint, dict.fromkeys((*self._judgements, *self._verdicts))))
        except BadMessage as error:
            log.warning("%s: the last messages of the owner cannot be used: %s", self._scene.scene, error)
            return None

    def _checkpoint(self, person: str | None) -> Checkpoint | None:
        """Of one person, or of the only one; raises BadMessage."""
        keys, judgement, verdict = self._scene.keys, self._judgements.get(person), self._verdicts.get(person)
        decided = None if verdict is None else decode_from(keys.verdict, VerdictMessage, verdict)
        judged: JudgementMessage | None = decided
        if judgement is not None:
            judged = decode_from(keys.judgement, JudgementMessage, judgement)
        return None if judged is None else Checkpoint(judgement=judged, verdict=decided)

    def close(self) -> None:
        """End the subscriptions."""
        self._session.close()


class HandoverRequest:
    """A request to the service `owner` to hand a scene over to `own`; `finished`: it has answered, or will not."""

    def __init__(self, scene: Scene, link: Link, own: str, owner: str) -> None:
        self.finished = False
        self._scene = scene.scene
        self._answers: list[bytes] = []
        self._session = link.sub_session(polled=True)

        def finish() -> None:
            self.finished = True

        key = scene.keys.fusion_handover(owner)
        self._session.request(
            key,
            lambda _, payload: self._answers.append(payload),
            ANSWER_TIMEOUT_S,
            finish,
            own.encode(),
            MAX_MESSAGE_BYTES,
        )

    def poll(self) -> None:
        """Receive an answer that has arrived."""
        self._session.poll()

    def checkpoint(self) -> Checkpoint | None:
        """The checkpoint in the answer; None without an answer, or if the owner had published nothing."""
        for payload in filter(None, self._answers):
            try:
                return Checkpoint.model_validate_json(payload)
            except ValidationError as error:
                log.warning("%s: the answer to a handover request cannot be used: %s", self._scene, str(error)[:100])
        return None

    def close(self) -> None:
        """Stop waiting for an answer."""
        self._session.close()


class VocabularyLookup:
    """Asks the observers of a scene for their vocabulary when one of them appears, and again from time to time."""

    def __init__(self, scene: Scene, service: Service, present: Presence | None = None) -> None:
        """present: the observers that are there, if the caller knows them already."""
        self._scene, self._ticks = scene, service.ticks
        self._times_every_s = max(TIMES_EVERY_S, service.ask_clocks_s)
        self._session = service.link.sub_session(polled=True)
        self._present = present or self._session.presence(
            scene.keys.observer_alive(), map(scene.keys.observer_alive, scene.roster)
        )
        self._asked: frozenset[str] = frozenset()
        self._asked_s = float("-inf")
        self._payloads: list[bytes] = []
        self._is_complete = False
        self._wanted: str | None = None
        self._times: Mapping[str, MovementTimes] | None = None

    def poll(self, digest: str | None = None) -> Vocabulary | None:
        """Ask if it is due; returns the vocabulary of the first usable answer, or None.

        It does not wait for more answers, so that a film of one second is not over before fusion begins. digest: the
        hash that is wanted; None: any."""
        self._session.poll()
        payloads = self._payloads.copy()
        self._payloads.clear()
        for vocabulary, _ in self._usable(payloads, digest):
            return vocabulary
        # Another one is asked for at once.
        self._ask(ANSWER_TIMEOUT_S if digest == self._wanted else 0.0)
        self._wanted = digest
        return None

    def times(self, digest: str) -> Mapping[str, MovementTimes] | None:
        """The durations that the observers with the vocabulary `digest` agree on; None until all have answered."""
        self._session.poll()
        if self._is_complete:
            answers = [vocabulary for vocabulary, fusion in self._usable(self._payloads, digest) if fusion is None]
            self._times, self._is_complete = agreed_times(answers) if answers else self._times, False
        self._ask(self._times_every_s)
        return self._times

    def _usable(self, payloads: Iterable[bytes], digest: str | None) -> Iterator[tuple[Vocabulary, str | None]]:
        """The vocabularies in these answers, each with the fusion service that has sent it."""
        for payload in payloads:
            try:
                message = decode_from(self._scene.keys.vocabulary, VocabularyMessage, payload)
                if digest in (None, message.hash):
                    require_fits(self._scene, message.vocabulary)
                    yield message.vocabulary, message.fusion
            except LabanmeshError as error:
                log.warning("a vocabulary that cannot be used: %s", error)

    def _ask(self, every_s: float) -> None:
        present = self._present.alive
        self._asked &= present
        if present == self._asked and self._ticks() - self._asked_s < every_s:
            return
        self._asked_s, self._asked = self._ticks(), present
        payloads = self._payloads = list[bytes]()
        self._is_complete = False

        def finish() -> None:
            self._is_complete = self._payloads is payloads

        self._session.request(
            self._scene.keys.vocabulary, lambda _, payload: payloads.append(payload), ANSWER_TIMEOUT_S, finish
        )

    def close(self) -> None:
        """Stop asking."""
        self._session.close()
