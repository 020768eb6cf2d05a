"""A capture that can be looked at from any moment: what a hub would have known then. Pure.

Posteriors are left out: judgements carry what was believed. Judgements and statuses are thinned, the more the longer
the capture is; verdicts are all kept.
"""

from bisect import bisect_left, bisect_right
from collections import defaultdict
from collections.abc import Iterable
from dataclasses import replace
from typing import TYPE_CHECKING, TypeVar

from common.capture_file import APPEARED, CaptureRecord
from common.keys import observer_of
from common.messages import JudgementMessage, Message, StatusMessage, VerdictMessage, VocabularyMessage
from common.wire import BadMessage, decode
from hub.dashboard.chronicle import LOG_LIMIT, MINUTE_NS, Chronicle, point
from hub.scene_state import SceneState

if TYPE_CHECKING:
    from common.config import Scene

JUDGEMENTS_KEPT = 40_000
"""About 60 MB of them; beyond an hour every other one goes, and so on."""
STATUSES_KEPT = 4_000
JUDGEMENT_EVERY_NS = 100_000_000
STATUS_EVERY_NS = 1_000_000_000
M = TypeVar("M", bound=Message)


class Thinned:
    """Payloads by their time, not closer than `every_ns`, which doubles when more than `limit` are kept."""

    def __init__(self, every_ns: int, limit: int) -> None:
        self._every_ns, self._limit = every_ns, limit
        self.at_ns: list[int] = []
        self.payloads: list[bytes] = []

    def add(self, at_ns: int, payload: bytes) -> None:
        """Append one that is not older than the last."""
        if self.at_ns and at_ns - self.at_ns[-1] < self._every_ns:
            return
        self.at_ns.append(at_ns)
        self.payloads.append(payload)
        if len(self.at_ns) > self._limit:
            self.at_ns, self.payloads = self.at_ns[::2], self.payloads[::2]
            self._every_ns *= 2

    def until(self, at_ns: int) -> bytes | None:
        """The newest one at or before `at_ns`."""
        place = bisect_right(self.at_ns, at_ns)
        return self.payloads[place - 1] if place else None


class Tape:
    """What was heard of a scene, by the capturing machine's clock; `chronicle` is what was known at a moment of it."""

    def __init__(self, scene: "Scene", records: Iterable[CaptureRecord]) -> None:
        self._scene = scene
        self._judgements = Thinned(JUDGEMENT_EVERY_NS, JUDGEMENTS_KEPT)
        self._statuses: dict[str, Thinned] = defaultdict(lambda: Thinned(STATUS_EVERY_NS, STATUSES_KEPT))
        self._verdicts: list[tuple[int, VerdictMessage]] = []
        self._tokens: list[tuple[int, str, bool]] = []
        self._vocabularies: dict[str, VocabularyMessage] = {}
        self._moments: dict[str, tuple[int, str]] = {}
        self.began_ns = self.ended_ns = 0
        for record in records:
            # Arrivals of a clock that was set back would be out of order; time on the tape only goes on.
            self.ended_ns = max(self.ended_ns, record.arrived_ns)
            self.began_ns = self.began_ns or self.ended_ns
            self._note(record, self.ended_ns)

    @property
    def span_s(self) -> float:
        """Its length."""
        return (self.ended_ns - self.began_ns) / 1e9

    def chronicle(self, at_ns: int, with_minute: bool = False) -> Chronicle:
        """What was known at `at_ns`; the minute before it only where it is asked for, as it takes longer."""
        state = SceneState(self._scene.scene, self._scene.roster, at_ns)
        for key, statuses in self._statuses.items():
            status = _read(StatusMessage, statuses.until(at_ns))
            if status is not None:
                state = state.fold(status, at_ns, "fusion" if "/fusion/" in key else "observer")
        place = bisect_right(self._judgements.at_ns, at_ns)
        judgement = _read(JudgementMessage, self._judgements.payloads[place - 1]) if place else None
        if judgement is not None:
            # A judge of another vocabulary answers for its own; the referee's is the one that counts.
            spoken = self._vocabularies.get(judgement.vocabulary.hash)
            state = replace(state, vocabulary=spoken).fold(judgement, self._judgements.at_ns[place - 1])
        chronicle = replace(self._with_tokens(at_ns), state=state)
        for verdict in self.verdicts_between(0, at_ns)[-2 * LOG_LIMIT :]:
            chronicle = chronicle.hear(state, verdict)
        return self._with_minute(chronicle, at_ns) if with_minute else chronicle

    def verdicts_between(self, after_ns: int, until_ns: int) -> list[VerdictMessage]:
        """Those that were said later than `after_ns` and not later than `until_ns`."""
        first = bisect_right(self._verdicts, after_ns, key=lambda said: said[0])
        last = bisect_right(self._verdicts, until_ns, key=lambda said: said[0])
        return [verdict for _, verdict in self._verdicts[first:last]]

    @property
    def moments_s(self) -> list[tuple[float, str]]:
        """When each verdict was first said, in seconds from the beginning, and its label: marks of the replay bar."""
        return [(round((at_ns - self.began_ns) / 1e9, 2), label) for at_ns, label in self._moments.values()]

    def _note(self, record: CaptureRecord, at_ns: int) -> None:
        kind = record.key.rsplit("/", 1)[-1]
        if record.kind == "token" and "/observer/" in record.key:
            self._tokens.append((at_ns, observer_of(record.key), record.payload == APPEARED))
        elif kind == "judgement" and record.kind == "put":
            self._judgements.add(at_ns, record.payload)
        elif kind == "status":
            self._statuses[record.key].add(at_ns, record.payload)
        elif kind == "verdict":
            self._note_verdict(_read(VerdictMessage, record.payload), at_ns, answered=record.kind == "answer")
        elif kind == "vocabulary":
            vocabulary = _read(VocabularyMessage, record.payload)
            if vocabulary is not None:
                self._vocabularies[vocabulary.hash] = vocabulary

    def _note_verdict(self, verdict: VerdictMessage | None, at_ns: int, answered: bool) -> None:
        if verdict is None:
            return
        self._verdicts.append((at_ns, verdict))
        # What was only told on asking was said before, nobody knows when.
        if not answered or verdict.id in self._moments:
            self._moments[verdict.id] = self._moments.get(verdict.id, (at_ns, ""))[0], verdict.label

    def _with_tokens(self, at_ns: int) -> Chronicle:
        chronicle = Chronicle(SceneState(self._scene.scene))
        present: set[str] = set()
        for _, name, came in self._tokens[: bisect_right(self._tokens, at_ns, key=lambda token: token[0])]:
            (present.add if came else present.discard)(name)
            chronicle = chronicle.with_presence(present)
        return chronicle

    def _with_minute(self, chronicle: Chronicle, at_ns: int) -> Chronicle:
        first = bisect_left(self._judgements.at_ns, at_ns - MINUTE_NS)
        last = bisect_right(self._judgements.at_ns, at_ns)
        step = max(1, (last - first) // 300)
        read = (_read(JudgementMessage, payload) for payload in self._judgements.payloads[first:last:step])
        return replace(chronicle, minute=tuple(point(each) for each in read if each is not None))


def _read(kind: type[M], payload: bytes | None) -> M | None:
    try:
        return None if payload is None else decode(kind, payload)
    except BadMessage:
        return None
