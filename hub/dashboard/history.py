"""What the page shows of a scene over time: live, or at any moment of a capture.

Its times are the fusion machine's, so that judgements and verdicts share one time line however wrong this clock is.
Of a capture, posteriors are left out (judgements carry them), judgements and statuses are thinned the more the longer
it is, and verdicts are all kept.
"""

import math
from bisect import bisect_left, bisect_right
from collections import defaultdict
from collections.abc import Iterable
from dataclasses import dataclass, replace

from common import MINUTE_NS, SECOND_NS
from common.arrival import APPEARED, CaptureRecord
from common.config import Scene
from common.keys import observer_of
from common.messages import JudgementMessage, VerdictMessage, VocabularyMessage
from common.same_movement import with_verdict
from common.wire import BadMessage
from hub.anticipation import probability
from hub.scene_state import SceneMessage, SceneState, is_waiting
from hub.session import decode_for_hub

POINT_EVERY_NS = SECOND_NS // 5
MINUTE_POINTS = 300
LOG_LIMIT = 100
"""How many verdicts the page lists; `labanmesh capture` keeps all."""
JUDGEMENTS_LIMIT = 40_000
"""About 60 MB; captures longer than an hour are thinned further."""
STATUSES_LIMIT = 4_000
JUDGEMENT_EVERY_NS = SECOND_NS // 10
STATUS_EVERY_NS = SECOND_NS
KNOWN_LIMIT = 1024
"""Observers that have had a token; beyond it those that the scene does not name are forgotten when they go."""


@dataclass(frozen=True, slots=True)
class MinutePoint:
    """One moment of the last minute: the label, the probability of the likeliest answer, the entropy in bits."""

    at_ns: int
    label: str
    p: float
    entropy: float


@dataclass(frozen=True, slots=True)
class SceneHistory:
    """All that the page shows at one moment. verdicts: newest first.

    known_observers: those that have had a liveliness token; present: those that have one now.
    """

    state: SceneState
    verdicts: tuple[VerdictMessage, ...] = ()
    minute: tuple[MinutePoint, ...] = ()
    known_observers: frozenset[str] = frozenset()
    present: frozenset[str] = frozenset()

    @property
    def now_ns(self) -> int:
        """The fusion machine's time, from its last judgement and the time since then; ours before the first."""
        judgement, silence_s = self.state.judgement, self.state.silence_s
        if judgement is None or not math.isfinite(silence_s):
            return self.state.now_ns
        return judgement.at_ns + int(silence_s * SECOND_NS)

    @property
    def gone(self) -> frozenset[str]:
        """Observers whose process was present and has gone."""
        return self.known_observers - self.present

    def update(self, state: SceneState, message: SceneMessage | None) -> "SceneHistory":
        """The history after `message` led to `state`; None: only time has passed."""
        match message:
            case VerdictMessage():
                return replace(self, state=state, verdicts=with_verdict(self.verdicts, message, LOG_LIMIT))
            case JudgementMessage() if not is_waiting(message):
                return replace(self, state=state, minute=_extended(self.minute, minute_point(message)))
            case _:
                return replace(self, state=state)

    def with_presence(self, present: Iterable[str]) -> "SceneHistory":
        """The same with the observers present now; the same object when that has not changed."""
        now = frozenset(present)
        known = self.known_observers | now
        if len(known) > KNOWN_LIMIT:
            known = now | (known & frozenset(self.state.roster))
        return self if now == self.present else replace(self, present=now, known_observers=known)


def minute_point(judgement: JudgementMessage) -> MinutePoint:
    """A judgement as a point of the strip."""
    p = max(probability(judgement), judgement.unlearned or 0.0)
    return MinutePoint(judgement.at_ns, judgement.label, p, judgement.certainty_bits)


def _extended(minute: tuple[MinutePoint, ...], newest: MinutePoint) -> tuple[MinutePoint, ...]:
    """The last minute with the newest point; later points come from before a clock was set back."""
    if minute and 0 <= newest.at_ns - minute[-1].at_ns < POINT_EVERY_NS:
        return minute
    oldest_ns = newest.at_ns - MINUTE_NS
    return (*(point for point in minute if oldest_ns <= point.at_ns < newest.at_ns), newest)


@dataclass(frozen=True, slots=True)
class _TokenChange:
    at_ns: int
    observer: str
    came: bool


class ThinnedRecords:
    """Records by their time, at least `every_ns` apart; that doubles when there are more than `limit`."""

    def __init__(self, every_ns: int, limit: int) -> None:
        self._every_ns, self._limit = every_ns, limit
        self.at_ns: list[int] = []
        self.payloads: list[bytes] = []

    def add(self, at_ns: int, payload: bytes) -> None:
        """Append a record that is not older than the last."""
        if self.at_ns and at_ns - self.at_ns[-1] < self._every_ns:
            return
        self.at_ns.append(at_ns)
        self.payloads.append(payload)
        if len(self.at_ns) > self._limit:
            self.at_ns, self.payloads = self.at_ns[::2], self.payloads[::2]
            self._every_ns *= 2

    def place(self, at_ns: int) -> int | None:
        """The index of the newest record at or before `at_ns`; None when there is none."""
        return bisect_right(self.at_ns, at_ns) - 1 if self.at_ns and self.at_ns[0] <= at_ns else None


class CaptureTimeline:
    """A capture of `scene`, by the capturing machine's clock; `history` is what a hub knew at a moment of it."""

    def __init__(self, scene: Scene, records: Iterable[CaptureRecord]) -> None:
        self._scene, self._keys = scene, scene.keys
        self._judgements = ThinnedRecords(JUDGEMENT_EVERY_NS, JUDGEMENTS_LIMIT)
        self._statuses: dict[str, ThinnedRecords] = defaultdict(lambda: ThinnedRecords(STATUS_EVERY_NS, STATUSES_LIMIT))
        self._verdicts: list[VerdictMessage] = []
        self._verdict_ns: list[int] = []
        self._tokens: list[_TokenChange] = []
        self._vocabularies: dict[str, VocabularyMessage] = {}
        self._marks: dict[str, tuple[int, str]] = {}
        self.began_ns = self.ended_ns = 0
        for record in records:
            # After its clock was set back records would be out of order; time on the time line only advances.
            self.ended_ns = max(self.ended_ns, record.arrived_ns)
            self.began_ns = self.began_ns or self.ended_ns
            self._add(record, self.ended_ns)

    @property
    def span_s(self) -> float:
        """Its length in seconds."""
        return (self.ended_ns - self.began_ns) / SECOND_NS

    @property
    def marks(self) -> list[tuple[float, str]]:
        """When each verdict was first published, in seconds from the beginning, and its label."""
        return [(round((at_ns - self.began_ns) / SECOND_NS, 2), label) for at_ns, label in self._marks.values()]

    def history(self, at_ns: int, with_minute: bool = False) -> SceneHistory:
        """The state at `at_ns`. The minute before it is included only on request, because that takes longer."""
        state = SceneState(self._scene.scene, self._scene.roster, at_ns)
        for key, statuses in self._statuses.items():
            place = statuses.place(at_ns)
            status = None if place is None else self._decode(key, statuses.payloads[place])
            if status is not None:
                state = state.fold(status, at_ns, "fusion" if "/fusion/" in key else "observer")
        place = self._judgements.place(at_ns)
        judgement = None if place is None else self._judgement(place)
        if judgement is not None and place is not None:
            # Several vocabularies may have been answered; the one of the judgement counts.
            vocabulary = self._vocabularies.get(judgement.vocabulary.hash)
            state = replace(state, vocabulary=vocabulary).fold(judgement, self._judgements.at_ns[place])
        history = replace(self._with_tokens(at_ns), state=state)
        for verdict in self.verdicts_between(0, at_ns)[-2 * LOG_LIMIT :]:
            history = history.update(state, verdict)
        return replace(history, minute=self._minute(at_ns)) if with_minute else history

    def verdicts_between(self, after_ns: int, until_ns: int) -> list[VerdictMessage]:
        """Those that arrived after `after_ns`, up to and including `until_ns`."""
        return self._verdicts[bisect_right(self._verdict_ns, after_ns) : bisect_right(self._verdict_ns, until_ns)]

    def _add(self, record: CaptureRecord, at_ns: int) -> None:
        kind = record.key.rsplit("/", 1)[-1]
        if record.kind == "token" and "/observer/" in record.key:
            self._tokens.append(_TokenChange(at_ns, observer_of(record.key), record.payload == APPEARED))
        elif kind == "judgement" and record.kind == "put":
            self._judgements.add(at_ns, record.payload)
        elif kind == "status":
            self._statuses[record.key].add(at_ns, record.payload)
        elif kind in ("verdict", "vocabulary"):
            message = self._decode(record.key, record.payload)
            if isinstance(message, VerdictMessage):
                self._add_verdict(message, at_ns, answered=record.kind == "answer")
            elif isinstance(message, VocabularyMessage):
                self._vocabularies[message.hash] = message

    def _add_verdict(self, verdict: VerdictMessage, at_ns: int, answered: bool) -> None:
        self._verdicts.append(verdict)
        self._verdict_ns.append(at_ns)
        # A verdict that only answers a query was published at an unknown time before.
        if not answered or verdict.id in self._marks:
            first_ns, _ = self._marks.get(verdict.id, (at_ns, ""))
            self._marks[verdict.id] = first_ns, verdict.label

    def _with_tokens(self, at_ns: int) -> SceneHistory:
        history = SceneHistory(SceneState(self._scene.scene))
        present: set[str] = set()
        for change in self._tokens[: bisect_right(self._tokens, at_ns, key=lambda change: change.at_ns)]:
            (present.add if change.came else present.discard)(change.observer)
            history = history.with_presence(present)
        return history

    def _minute(self, at_ns: int) -> tuple[MinutePoint, ...]:
        first = bisect_left(self._judgements.at_ns, at_ns - MINUTE_NS)
        last = bisect_right(self._judgements.at_ns, at_ns)
        step = max(1, (last - first) // MINUTE_POINTS)
        judgements = map(self._judgement, range(first, last, step))
        return tuple(minute_point(each) for each in judgements if each is not None and not is_waiting(each))

    def _judgement(self, place: int) -> JudgementMessage | None:
        message = self._decode(self._keys.judgement, self._judgements.payloads[place])
        return message if isinstance(message, JudgementMessage) else None

    def _decode(self, key: str, payload: bytes) -> SceneMessage | None:
        try:
            return decode_for_hub(self._keys, key, payload)
        except BadMessage:
            return None
