"""Publishing for one scene: verdicts and judgements out, and the last ones again for late joiners.

A verdict is published before the judgement that it came from: a service that takes over in between knows the verdict.
"""

import logging
from collections import deque
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace

from common.keys import SceneKeys
from common.messages import JudgementMessage, VerdictMessage
from common.subsession import Publisher, SubSession
from common.wire import encode
from fusion.checkpoint import Checkpoint, CheckpointFile, unfinished
from fusion.engine.engine import FusionEngine
from fusion.reconciliation import SharedMovements

log = logging.getLogger("labanmesh.fusion")
VERDICTS_LIMIT = 10
"""Late joiners receive this many of the last verdicts."""
REPEATS_LIMIT = 5
"""A verdict is sent again this many times at most: where observers publish once a second, each silence is a gap."""
FULL_VOTES_AT_START = 20
"""Judgements published with full votes in any case: subscribers are known only a moment after the start."""
ASK_EVERY = 30
"""Judgements between two questions to Zenoh whether full votes have a subscriber: 70 us among 250 busy scenes."""
PUBLISHED_LIMIT = 128
"""Verdicts that are remembered to have been published."""


def put_now(publisher: Publisher, payload: bytes) -> None:
    """Send now, not with the other scenes of a batch."""
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


@dataclass(frozen=True, slots=True)
class _Sent:
    """A verdict that was sent. at_s: when, of a monotonic clock. repeats: how often it was sent before."""

    at_s: float
    verdict: VerdictMessage
    payload: bytes
    repeats: int = 0


class VerdictPublisher:
    """Publishes the judgements and verdicts on one person while it is the owner's, and keeps the last for queries.

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
        self._judgement_count, self._has_votes_subscriber = 0, False
        # They wait in a queue of their own: a router that is frozen for a moment drops judgements, but no verdict.
        self._verdicts = session.publisher(keys.verdict, priority="high")
        self._vocabularies = session.publisher(keys.vocabulary)
        self._judging: tuple[bytes, int | None] = (b"", None)
        self._engine, self._file = engine, file
        self._last_judgement: JudgementMessage | None = None
        self._last_verdict: VerdictMessage | None = None
        self.judgement_payload: bytes | None = None
        """The newest judgement, ours or the owner's, as it was published."""
        self.verdict_payloads: tuple[bytes, ...] = ()
        """The last verdicts likewise, the newest last."""
        self._published: deque[tuple[str, str, int]] = deque(maxlen=PUBLISHED_LIMIT)
        self.shared = SharedMovements()
        """What this service has published, or an owner that it followed."""
        self._sent: deque[_Sent] = deque(maxlen=VERDICTS_LIMIT)
        self._undelivered: tuple[VerdictMessage, ...] = ()

    def publish(
        self, verdicts: Sequence[VerdictMessage], judgement: JudgementMessage, vocabulary: bytes, now_s: float
    ) -> None:
        """Send the verdicts, then the judgement; before that with full votes, if they have a subscriber.

        vocabulary: the encoded message of it, sent first as often as this service begins to own the scene: observers
        may know other durations of the same movements. now_s: seconds of a monotonic clock.

        A decision is written to the file before it is sent, and an end after: a service that is killed in between ends
        the movement after its restart, perhaps once more, and hubs ignore the second of two equal verdicts.
        """
        if (vocabulary, judgement.epoch) != self._judging:
            self._publish_vocabulary(vocabulary, judgement.epoch)
        ended = max((n for n, verdict in enumerate(verdicts, 1) if verdict.ended_ns is not None), default=0)
        payloads = [self._note(verdict) for verdict in verdicts]
        self._send(verdicts[:ended], payloads[:ended], now_s)
        judgement_payload, has_decision = self._note(judgement), len(verdicts) > ended
        if has_decision:
            self._write()
        self._send(verdicts[ended:], payloads[ended:], now_s)
        self._put_full_votes(judgement)
        self._put(self._judgements, judgement_payload)
        if not has_decision:
            # No listener has to wait for the disk.
            self._write()

    def _put_full_votes(self, judgement: JudgementMessage) -> None:
        if self._judgement_count % ASK_EVERY == 0:
            self._has_votes_subscriber = self._votes.has_subscriber
        if self._has_votes_subscriber or self._judgement_count < FULL_VOTES_AT_START:
            self._votes.put(encode(judgement, full=True))
        self._judgement_count += 1

    def _send(self, verdicts: Sequence[VerdictMessage], payloads: Sequence[bytes], now_s: float) -> None:
        for verdict, payload in zip(verdicts, payloads, strict=True):
            self._verdicts.put(payload)
            self._sent.append(_Sent(now_s, verdict, payload))
            _log(verdict)

    def close(self, verdict: VerdictMessage) -> None:
        """Send the end of the movement in which this service stood down. Late joiners do not receive it."""
        self._verdicts.put(encode(verdict))
        _log(verdict)

    def change_vocabulary(self, verdicts: Sequence[VerdictMessage], vocabulary: bytes, now_s: float) -> None:
        """Send the last verdicts in the old vocabulary, then the new one as an encoded message."""
        self._send(verdicts, [self._note(verdict) for verdict in verdicts], now_s)
        self._publish_vocabulary(vocabulary, self._engine.epoch)

    def _publish_vocabulary(self, vocabulary: bytes, epoch: int | None) -> None:
        self._judging = vocabulary, epoch
        self._vocabularies.put(vocabulary)

    def remember(self, message: JudgementMessage) -> None:
        """Keep the newest message that another service has published, or that the file had.

        That service sends again what may be lost of its movement: an end may have followed what this one has sent.
        """
        movement = message if isinstance(message, VerdictMessage) else message.movement
        if movement is not None and self._sent:
            kept = [sent for sent in self._sent if sent.verdict.id != movement.id]
            self._sent = deque(kept, maxlen=VERDICTS_LIMIT)
        self._note(message)
        if not isinstance(message, VerdictMessage):
            self._write()

    def _note(self, message: JudgementMessage) -> bytes:
        payload = encode(message, self._full_votes)
        self.shared.record(message)
        if isinstance(message, VerdictMessage):
            self.verdict_payloads = (*self.verdict_payloads, payload)[-VERDICTS_LIMIT:]
            self._last_verdict = message
            self._published.append((message.id, message.fusion, message.seq))
            return payload
        self._last_judgement, self.judgement_payload = message, payload
        return payload

    def _write(self) -> None:
        if (
            self._file is None
            or self._last_judgement is None
            or not self._file.is_due(self._last_judgement, self._undelivered)
        ):
            return
        if (checkpoint := self.checkpoint()) is not None:
            self._file.write(checkpoint)

    def knows(self, movement_id: str) -> bool:
        """Whether a verdict on this movement was published lately, by this service or an owner that it followed."""
        return any(movement_id == known for known, _, _ in self._published)

    def has_published(self, verdict: VerdictMessage) -> bool:
        """Whether `verdict` is one of the last ones, sent again by this service or an owner that it followed."""
        return (verdict.id, verdict.fusion, verdict.seq) in self._published

    @property
    def unfinished(self) -> VerdictMessage | None:
        """The verdict on the movement in progress, if it is decided."""
        return unfinished(self._last_judgement, self._last_verdict)

    def repeat(self, judgement: bytes | None) -> None:
        """Send a judgement once more, for a service that did not receive it."""
        if judgement is not None:
            self._judgements.put(judgement)

    def keep_undelivered(self, since_s: float) -> None:
        """Keep the ends that were sent since then in the file, because they may be lost.

        If this service is killed before it has sent them again, it sends them after its restart."""
        ends = tuple(sent.verdict for sent in self._sent_since(since_s) if sent.verdict.ended_ns is not None)
        if ends != self._undelivered:
            self._undelivered = ends
            self._write()

    def _sent_since(self, since_s: float) -> Iterable[_Sent]:
        """The last verdict on each movement that was sent since then."""
        return {sent.verdict.id: sent for sent in self._sent if sent.at_s >= since_s}.values()

    def repeat_verdicts(self, since_s: float, now_s: float) -> None:
        """Send again what was sent since then, of each movement the last; listeners ignore the second of two equal.

        What is sent again now may be lost, too.
        """
        for sent in self._sent_since(since_s):
            if sent.repeats < REPEATS_LIMIT:
                self._verdicts.put(sent.payload)
                self._sent.append(replace(sent, at_s=now_s, repeats=sent.repeats + 1))

    @property
    def at_rest(self) -> bool:
        """Whether no movement was in progress at the last judgement."""
        return self._last_judgement is None or self._last_judgement.movement is None

    def checkpoint(self) -> Checkpoint | None:
        """What another service needs to continue; None before the first judgement."""
        if self._last_judgement is None:
            return None
        return Checkpoint(
            judgement=self._last_judgement,
            verdict=self._last_verdict,
            reliability=self._engine.reliability,
            undelivered=self._undelivered,
        )

    def restore(self, checkpoint: Checkpoint) -> None:
        """Continue where the service that wrote `checkpoint` was."""
        self._engine.reliability = checkpoint.reliability
        messages = [message for message in (checkpoint.verdict, checkpoint.judgement) if message is not None]
        for message in sorted(messages, key=lambda message: message.seq):
            self._engine.continue_from(message)
            self.remember(message)


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
