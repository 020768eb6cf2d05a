"""Publishing for one scene: verdicts and judgements out, and the last ones again for late joiners.

A verdict is published before the judgement that it came from: a service that takes over in between knows the verdict.
"""

import logging
from collections import deque
from collections.abc import Callable, Sequence

from common.keys import SceneKeys
from common.messages import JudgementMessage, VerdictMessage
from common.subsession import Publisher, SubSession
from common.wire import encode
from fusion.checkpoint import Checkpoint, CheckpointFile, unfinished
from fusion.engine.engine import FusionEngine

log = logging.getLogger("labanmesh.fusion")
VERDICTS_KEPT = 10
"""Late joiners receive this many of the last verdicts."""
UNNOTICED_S = 0.5
"""A verdict that was sent so shortly before the link was seen to be down may not have arrived."""
SETTLE_S = 0.3
"""After a router is back all processes that try to reconnect have done so."""
FIRST = 20
"""Judgements that are published with full votes in any case: who subscribes is known only a moment after the start."""
ASK_EVERY = 30
"""After so many judgements Zenoh is asked again who subscribes to full votes: 70 us among 250 busy scenes."""
KNOWN_LIMIT = 64
"""Movements of which it is remembered that they had a verdict."""


def put_now(publisher: Publisher, payload: bytes) -> None:
    """Send at once."""
    publisher.put(payload)


class JudgementBatch:
    """Judgements of many scenes, sent together: each alone would wake the thread that sends, at twice the cost."""

    def __init__(self) -> None:
        self._waiting: list[tuple[Publisher, bytes]] = []

    def put(self, publisher: Publisher, payload: bytes) -> None:
        """Send at the next `flush`."""
        self._waiting.append((publisher, payload))

    def flush(self) -> None:
        """Send everything, in order; raises LabanmeshError if the link is closed."""
        waiting, self._waiting = self._waiting, []
        for publisher, payload in waiting:
            publisher.put(payload)


class VerdictPublisher:
    """Publishes the judgements and verdicts of one scene while it is the owner's, and answers queries for them.

    A standby service passes the owner's messages to `remember`, so that it can answer queries after a takeover.
    full_votes: whether judgements have them under their usual key, too. put: sends a judgement, now or soon; verdicts
    are sent at once.
    """

    def __init__(
        self,
        session: SubSession,
        keys: SceneKeys,
        engine: FusionEngine,
        file: CheckpointFile | None,
        full_votes: bool = False,
        put: Callable[[Publisher, bytes], None] = put_now,
    ) -> None:
        self._judgements, self._votes = session.publisher(keys.judgement), session.publisher(keys.votes)
        self._full_votes, self._put = full_votes, put
        self._judged, self._votes_wanted = 0, False
        self._verdicts = session.publisher(keys.verdict)
        self._vocabularies = session.publisher(keys.vocabulary)
        self._engine, self._file = engine, file
        self._last_judgement: JudgementMessage | None = None
        self._last_verdict: VerdictMessage | None = None
        self._judgement_payload: bytes | None = None
        self._verdict_payloads: tuple[bytes, ...] = ()
        self._known: deque[str] = deque(maxlen=KNOWN_LIMIT)
        self.answers = False
        """Whether queries are answered: by the owner alone."""
        session.answer(keys.judgement, lambda: self._judgement_payload if self.answers else None)
        session.answer(keys.verdict, lambda: self._verdict_payloads if self.answers else None)

    def publish(self, verdicts: Sequence[VerdictMessage], judgement: JudgementMessage) -> None:
        """Send the verdicts, then the judgement; before that with full votes, if anybody wants them.

        The file knows of a first word before it is sent, and of an end after: a service that is killed in between ends
        the movement after its restart, perhaps once more, and hubs ignore the second of two equal words.
        """
        ended = max((n for n, verdict in enumerate(verdicts, 1) if verdict.ended_ns is not None), default=0)
        payloads = [self._note(verdict) for verdict in verdicts]
        self._send(verdicts[:ended], payloads[:ended])
        judgement_payload, has_first_word = self._note(judgement), len(verdicts) > ended
        if has_first_word:
            self._write()
        self._send(verdicts[ended:], payloads[ended:])
        self._put_full_votes(judgement)
        self._put(self._judgements, judgement_payload)
        if not has_first_word:
            # Nobody has to wait for the disk.
            self._write()

    def _put_full_votes(self, judgement: JudgementMessage) -> None:
        if self._judged % ASK_EVERY == 0:
            self._votes_wanted = self._votes.has_subscriber
        if self._votes_wanted or self._judged < FIRST:
            self._votes.put(encode(judgement, full=True))
        self._judged += 1

    def _send(self, verdicts: Sequence[VerdictMessage], payloads: Sequence[bytes]) -> None:
        for verdict, payload in zip(verdicts, payloads, strict=True):
            self._verdicts.put(payload)
            _log(verdict)

    def close(self, verdict: VerdictMessage) -> None:
        """Send the end of a movement after which this service publishes nothing more; it is no owner's last verdict."""
        self._verdicts.put(encode(verdict))
        _log(verdict)

    def change_vocabulary(self, verdicts: Sequence[VerdictMessage], vocabulary: bytes) -> None:
        """Send the last verdicts in the old vocabulary, then the new one as an encoded message."""
        for verdict in verdicts:
            self._verdicts.put(self._note(verdict))
            _log(verdict)
        self._vocabularies.put(vocabulary)

    def remember(self, message: JudgementMessage) -> None:
        """Keep the newest message that another service has published, or that the file had."""
        self._note(message)
        if not isinstance(message, VerdictMessage):
            self._write()

    def _note(self, message: JudgementMessage) -> bytes:
        payload = encode(message, self._full_votes)
        if isinstance(message, VerdictMessage):
            self._verdict_payloads = (*self._verdict_payloads, payload)[-VERDICTS_KEPT:]
            self._last_verdict = message
            self._known.append(message.id)
            return payload
        self._last_judgement, self._judgement_payload = message, payload
        return payload

    def _write(self) -> None:
        if self._file is None or self._last_judgement is None or not self._file.is_due(self._last_judgement):
            return
        if (checkpoint := self.checkpoint()) is not None:
            self._file.write(checkpoint)

    def knows(self, movement_id: str) -> bool:
        """Whether a verdict on this movement was published lately, by this service or an owner that it followed."""
        return movement_id in self._known

    @property
    def unfinished(self) -> VerdictMessage | None:
        """The verdict on the movement in progress, if it is decided."""
        return unfinished(self._last_judgement, self._last_verdict)

    @property
    def judgement_payload(self) -> bytes | None:
        """The newest judgement, ours or the owner's, as it was published."""
        return self._judgement_payload

    def repeat(self, judgement: bytes | None) -> None:
        """Send a judgement once more, for a service that did not hear it."""
        if judgement is not None:
            self._judgements.put(judgement)

    def repeat_verdict(self) -> None:
        """Send the last verdict once more; listeners that have it ignore the second of two equal words."""
        for payload in self._verdict_payloads[-1:]:
            self._verdicts.put(payload)

    @property
    def at_rest(self) -> bool:
        """Whether no movement was in progress at the last judgement."""
        return self._last_judgement is None or self._last_judgement.movement is None

    def checkpoint(self) -> Checkpoint | None:
        """What another service needs to continue; None before the first judgement."""
        if self._last_judgement is None:
            return None
        return Checkpoint(
            judgement=self._last_judgement, verdict=self._last_verdict, reliability=self._engine.reliability
        )

    def restore(self, checkpoint: Checkpoint) -> None:
        """Continue where the service that wrote `checkpoint` was."""
        self._engine.reliability = checkpoint.reliability
        messages = [message for message in (checkpoint.verdict, checkpoint.judgement) if message is not None]
        for message in sorted(messages, key=lambda message: message.seq):
            self._engine.continue_from(message)
            self.remember(message)


class Reachability:
    """Whether listeners receive what is published now: not while the link is down, nor for SETTLE_S after.

    Zenoh drops messages without a connection. Listeners reconnect within the pauses between their attempts.
    """

    def __init__(self) -> None:
        self._down_s: float | None = None
        self._lost_s = self._lost_from_s = float("inf")

    def update(self, connected: bool, now_s: float) -> bool:
        """To be called at every step."""
        if not connected:
            self._lost_s = now_s if self._down_s is None else self._lost_s
            self._down_s = now_s
        elif self._down_s is not None and now_s - self._down_s >= SETTLE_S:
            self._down_s, self._lost_from_s = None, self._lost_s - UNNOTICED_S
        return self._down_s is None

    def was_lost(self, sent_s: float) -> bool:
        """Whether what was sent then may not have arrived; True once after each time without a connection."""
        from_s, self._lost_from_s = self._lost_from_s, float("inf")
        return sent_s >= from_s


def _log(verdict: VerdictMessage) -> None:
    k, n = verdict.agreement.k, verdict.agreement.n
    fields = {
        "verdict": verdict.id, "label": verdict.label, "agree": k, "heard": n, "ended": verdict.ended_ns is not None,
        "stage": verdict.stage,
    }  # fmt: skip
    reasons = {"revises": verdict.revises, "why": verdict.why}
    fields |= {name: value for name, value in reasons.items() if value is not None}
    stage = f"revised from {verdict.revises}" if verdict.stage == "revised" else verdict.stage
    why = f": {verdict.why}" if verdict.why else ""
    log.info("verdict %s: %s, %d of %d agree, %s%s", verdict.id, verdict.label, k, n, stage, why, extra=fields)
