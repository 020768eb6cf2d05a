"""A scene's messages in order by the processes that publish them, and the findings on each process. Pure.

An answer to a query may be old, so judgements and posteriors count only when they come by themselves.
"""

from collections import Counter
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from typing import TypeVar

from common import SECOND_NS
from common.keys import SceneKeys, observer_of
from common.message_types import CONTRADICTED, OVERLOADED, SAME_ID_REASON, STANDING_BY
from common.messages import AnyMessage, JudgementMessage, PosteriorMessage, StatusMessage
from common.text import plural
from common.wire import BadMessage, decode_from
from deploy.doctor.findings import Finding, error, ok, warning

M = TypeVar("M", bound=AnyMessage)
PROCESSES_LIMIT = 64
"""How many processes are recorded; a program that invents names cannot fill a page."""
OLD_FRAME_S = 2.0
"""A running process that is without a frame for longer reports itself as degraded."""
REJECTION_WAYS_OUT = {
    "wrong_version": "install the same labanmesh on every machine, and start that process again",
    "too_large": "use fewer observers or movements in one scene, or shorter names; other programs must keep to 64 KiB",
    "foreign_vocabulary": "learn its model again from the movements of the others: labanmesh learn",
    "from_the_future": "synchronise its clock (NTP)",
    "repeated": "two routes lead to the same process, or a program replays it: find the process that publishes its key",
    "out_of_order": "its clock was set back, or two processes publish under this id",
    "past_session": "two processes publish under this id: stop one of them",
    "same_id": "two processes publish under this id, and only the one that started last counts: stop one of them",
    "wrong_key": "a program publishes under another process's key: labanmesh secure allows each its own key only",
    "unknown_observer": "name it under [observers.ID] in the scene file, or stop it",
}
"""By reason for which a message is rejected."""
ANY_WAY_OUT = "see that process's log; docs/reference/wire.md defines the messages"
LOOK = "labanmesh camera look SOURCE on its machine shows what its camera delivers"
HEARS_NOBODY = "it hears no observer: correct the findings on observers first"


@dataclass(slots=True)
class ProcessTraffic:
    """The messages of one process. skew_s: its clock minus ours, by its quickest message; None before any.

    contradicted: observers whom the newest judgement hardly relies on, 0 to 1. about_rest: of their rest.
    why: why the newest judgement's movement has no verdict yet; "" without such a movement.
    posteriors: how many were good; hashes: of their vocabularies; turns: how often one session was followed by another,
    or a sequence number by a lower one: once is a restart. bad: messages that cannot be used, by reason.
    """

    status: StatusMessage | None = None
    status_ns: int = 0
    skew_s: float | None = None
    posteriors: int = 0
    contradicted: dict[str, float] = field(default_factory=dict)
    about_rest: dict[str, float] = field(default_factory=dict)
    judgements: int = 0
    why: str = ""
    hashes: set[str] = field(default_factory=set)
    turns: int = 0
    bad: Counter[str] = field(default_factory=Counter)
    last: tuple[str, int] | None = None

    def count_number(self, session: str, seq: int) -> None:
        """Count one more message with a sequence number."""
        if self.last is not None:
            self.turns += session != self.last[0] or seq < self.last[1]
        self.last = session, seq

    @property
    def frame_age_s(self) -> float | None:
        """Age of the newest frame when the status was sent, by the sender's own clock where the status has it."""
        if self.status is None or self.status.last_frame_ns is None:
            return None
        sent_ns = self.status_ns if self.status.at_ns is None else self.status.at_ns
        return (sent_ns - self.status.last_frame_ns) / SECOND_NS


@dataclass(slots=True)
class MeshTraffic:
    """A scene's messages. alive_*: the processes with a liveliness token. bad_judgements: by reason."""

    keys: SceneKeys
    observers: dict[str, ProcessTraffic] = field(default_factory=dict)
    fusions: dict[str, ProcessTraffic] = field(default_factory=dict)
    alive_observers: frozenset[str] = frozenset()
    alive_fusions: frozenset[str] = frozenset()
    listened_s: float = 0.0
    bad_judgements: Counter[str] = field(default_factory=Counter)

    @property
    def silent(self) -> bool:
        """Whether no process of the scene is there at all."""
        return not (self.alive_observers or self.alive_fusions or self.observers or self.fusions)

    def record(self, key: str, payload: bytes, now_ns: int, *, queried: bool = False) -> None:
        """Count one message that arrived at `now_ns`; queried: it answers a query. Never raises, whatever the bytes."""
        name = observer_of(key) if key.count("/") > 1 else ""
        if key == self.keys.judgement:
            if not queried:
                self._judgement(key, payload)
        elif key == self.keys.posterior(name):
            self._posterior(_process(self.observers, name), key, payload)
        elif key == self.keys.observer_status(name):
            self._status(_process(self.observers, name), key, payload, now_ns)
        elif key == self.keys.fusion_status(name):
            self._status(_process(self.fusions, name), key, payload, now_ns)

    def _judgement(self, key: str, payload: bytes) -> None:
        judgement = _decoded(key, JudgementMessage, payload, self.bad_judgements)
        if judgement is not None:
            process = _process(self.fusions, judgement.fusion)
            process.judgements += 1
            process.why = judgement.why or ""
            process.contradicted = _distrusted({name: v.label_reliability for name, v in judgement.votes.items()})
            process.about_rest = _distrusted({name: v.rest_reliability for name, v in judgement.votes.items()})
            process.hashes.add(judgement.vocabulary.hash)
            process.count_number("", judgement.seq)

    def _posterior(self, process: ProcessTraffic, key: str, payload: bytes) -> None:
        posterior = _decoded(key, PosteriorMessage, payload, process.bad)
        if posterior is not None:
            process.posteriors += 1
            process.hashes.add(posterior.vocabulary.hash)
            process.count_number(posterior.session, posterior.seq)

    def _status(self, process: ProcessTraffic, key: str, payload: bytes, now_ns: int) -> None:
        status = _decoded(key, StatusMessage, payload, process.bad)
        if status is None:
            return
        process.status, process.status_ns = status, now_ns
        if status.at_ns is not None:
            skew_s = (status.at_ns - now_ns) / SECOND_NS
            # Transport only makes a clock seem slower: the greatest is the nearest to the truth.
            process.skew_s = skew_s if process.skew_s is None else max(process.skew_s, skew_s)


def _distrusted(trusts: Mapping[str, float | None]) -> dict[str, float]:
    return {name: trust for name, trust in trusts.items() if trust is not None and trust < CONTRADICTED}


def _decoded(key: str, kind: type[M], payload: bytes, bad: Counter[str]) -> M | None:
    try:
        return decode_from(key, kind, payload)
    except BadMessage as fault:
        bad[fault.reason] += 1
        return None


def _process(processes: dict[str, ProcessTraffic], name: str) -> ProcessTraffic:
    if name not in processes and len(processes) >= PROCESSES_LIMIT:
        return ProcessTraffic()
    return processes.setdefault(name, ProcessTraffic())


def check_process(
    name: str, process: ProcessTraffic, version: str, alive: bool, *, is_fusion: bool = False
) -> Iterator[Finding]:
    """State, newest frame and version of one process; `version`: of this labanmesh."""
    yield _state(name, process, alive, HEARS_NOBODY if is_fusion else LOOK)
    other = process.status.version if process.status else ""
    if other and version and other != version:
        what = f"{name}: labanmesh {other}, here it is {version}"
        yield warning(what, "install the same on every machine, and start that process again")
    for reason, count in sorted(process.bad.items()):
        yield rejected(name, reason, count)


def rejected(name: str, reason: str, count: int) -> Finding:
    """The finding on messages that cannot be used, for one reason."""
    what = f"{name}: {plural(count, 'message')} rejected: {reason.replace('_', ' ')}"
    return error(what, REJECTION_WAYS_OUT.get(reason, ANY_WAY_OUT))


def relative_clock(skew_s: float) -> str:
    """`3600 s ahead of`, `0.7 s behind`."""
    size = f"{abs(skew_s):.1f} s" if abs(skew_s) < 10 else f"{abs(skew_s):.0f} s"
    return f"{size} {'ahead of' if skew_s > 0 else 'behind'}"


def _state(name: str, process: ProcessTraffic, alive: bool, no_frames: str) -> Finding:
    status, age_s = process.status, process.frame_age_s
    if status is None:
        return _stateless(name, process, alive)
    what = f"{name}: {status.state}" + (f": {status.reason}" if status.reason else "")
    if status.state == "failed":
        return error(what, "correct the cause, and start it again; its log says more")
    if status.reason == SAME_ID_REASON:
        return error(f"{name}: {status.reason}", "stop one, or give it an id of its own: fuse --id")
    if not alive:
        return warning(f"{what}; this is its last status, it is not alive", "start it again; see its log")
    if status.state == "degraded" and OVERLOADED in what:
        return warning(*what.split("; ", 1))
    if status.state == "degraded":
        return warning(what, no_frames)
    if status.reason.startswith(STANDING_BY):
        return ok(what)
    if status.state in ("starting", "stopping"):
        return warning(what, "run doctor again in a moment; see its log")
    if age_s is not None and age_s > OLD_FRAME_S:
        return warning(f"{what}, and its newest frame is {age_s:.0f} s old", no_frames)
    rate = "" if status.rate_hz is None else f", {status.rate_hz:g} Hz"
    return ok(f"{what}{rate}" + ("" if age_s is None else f", newest frame {age_s:.1f} s old"))


def _stateless(name: str, process: ProcessTraffic, alive: bool) -> Finding:
    if process.bad:
        return warning(f"{name}: is there, and its status cannot be read", "see the next lines")
    if not alive:
        return warning(f"{name}: publishes, and has neither a status nor a liveliness token", ANY_WAY_OUT)
    return warning(f"{name}: alive, and publishes no status", "run doctor again in a moment; see its log")
