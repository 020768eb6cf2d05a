"""Judging a capture anew from its posteriors, on a clock made of their arrivals. Pure.

1. Each lot of arrivals is a step, and `step_hz` a second without any, as the fusion service does it; when exactly a
   service would have stepped nobody knows, so two of them may decide a few milliseconds apart. This here always says
   the same of the same capture.
"""

from collections.abc import Callable, Iterable, Iterator, Mapping
from typing import TYPE_CHECKING

from common.capture_file import APPEARED, CaptureRecord
from common.clock_skew import ClockReading
from common.keys import SceneKeys, observer_of
from common.messages import PosteriorMessage, StatusMessage
from common.vocabulary import Vocabulary
from common.wire import BadMessage, decode
from fusion.engine.engine import EngineOutput, FusionEngine
from studies.rejudging import Change, labels_of

if TYPE_CHECKING:
    from common.config import Scene

SECOND_NS = 1_000_000_000
LOT_NS = 2_000_000
"""What arrives within this time is one lot: about as long as the referee takes for a step."""
UNDER_WAY_NS = 500_000_000
"""A status that is dated further from its arrival than this was said by a clock that is wrong."""


def from_posteriors(
    records: Iterable[CaptureRecord], scene: "Scene", labels: Mapping[str, tuple[str, ...]], change: Change
) -> Iterator[EngineOutput]:
    """The captured posteriors as the referee would judge them that hears them when the capture did."""
    vocabulary = scene.named_vocabulary or Vocabulary(_only(labels), scene.vocabulary_name)
    observers = change.remaining(scene.roster)
    conduct = change.conduct(scene.fusion, len(observers))
    referee = FusionEngine(scene.scene, list(observers), vocabulary, conduct)
    ear = _Ear(scene.keys, referee)
    # Longer silence than this changes nothing any more.
    quiet_ns = round((conduct.drop_s + 2 * conduct.hold_s + 1) * SECOND_NS)
    for lot, now_ns in _lots(records, ear.concerns, round(SECOND_NS / conduct.step_hz), quiet_ns):
        for record in lot:
            ear.hear(record, now_ns)
        yield referee.judge(now_ns)


class _Ear:
    """From captured bytes to the referee, as the fusion service does it."""

    def __init__(self, keys: SceneKeys, referee: FusionEngine) -> None:
        self._keys, self._referee = keys, referee
        self._alive: frozenset[str] = frozenset()

    def concerns(self, record: CaptureRecord) -> bool:
        """Whether this is something that an observer said, or he himself."""
        below = f"{self._keys.root}/observer/"
        return (
            record.kind != "answer" and record.key.startswith(below) and record.key.count("/") == below.count("/") + 1
        )

    def hear(self, record: CaptureRecord, now_ns: int) -> None:
        """One record; a bad one is counted and dropped."""
        observer, what = observer_of(record.key), record.key.rsplit("/", 1)[-1]
        try:
            if record.kind == "token":
                ids = frozenset({observer})
                self._alive = self._alive | ids if record.payload == APPEARED else self._alive - ids
                self._referee.present(self._alive)
            elif what == "posterior":
                self._hear_posterior(observer, decode(PosteriorMessage, record.payload), now_ns)
            elif what == "status":
                self._read_clock(observer, decode(StatusMessage, record.payload), record.arrived_ns)
        except BadMessage as error:
            self._referee.reject(observer, error.reason)

    def _hear_posterior(self, observer: str, message: PosteriorMessage, now_ns: int) -> None:
        if message.is_of(self._keys.scene, observer):
            self._referee.hear(observer, message, now_ns)
        else:
            self._referee.reject(observer, "wrong_key")

    def _read_clock(self, observer: str, status: StatusMessage, arrived_ns: int) -> None:
        # Nobody was asked: how long a status was under way is not known, so only a plainly wrong clock is one.
        if status.at_ns is not None and abs(status.at_ns - arrived_ns) > UNDER_WAY_NS:
            self._referee.read_clock(observer, ClockReading(arrived_ns, status.at_ns, arrived_ns))


def _lots(
    records: Iterable[CaptureRecord], concerns: Callable[[CaptureRecord], bool], step_ns: int, quiet_ns: int
) -> Iterator[tuple[list[CaptureRecord], int]]:
    """What is heard in each step, and when that is (rule 3)."""
    lot: list[CaptureRecord] = []
    last_ns: int | None = None
    for record in records:
        now_ns = record.arrived_ns
        if lot and not 0 <= now_ns - lot[0].arrived_ns <= LOT_NS:
            last_ns = lot[-1].arrived_ns
            yield lot, last_ns
            lot = []
        if not lot and last_ns is not None:
            for idle_ns in range(last_ns + step_ns, min(now_ns, last_ns + quiet_ns), step_ns):
                last_ns = idle_ns
                yield [], idle_ns
        if concerns(record):
            lot.append(record)
    if lot:
        yield lot, lot[-1].arrived_ns


def _only(labels: Mapping[str, tuple[str, ...]]) -> tuple[str, ...]:
    return labels_of(next(iter(labels), "unknown"), labels)
