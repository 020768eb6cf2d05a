"""What is heard of a mesh in a few seconds, put in order by who said it. Pure: times are passed in.

What was told on asking may be old, so judgements and posteriors count only when they come by themselves.
"""

from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass, field

from common.keys import SceneKeys, observer_of
from common.messages import JudgementMessage, PosteriorMessage, StatusMessage
from common.wire import BadMessage, decode

SECOND_NS = 1_000_000_000
STRANGERS_LIMIT = 64
"""So many processes are told apart; who invents names for itself cannot fill a page."""


@dataclass(slots=True)
class Said:
    """What one process said. skew_s: its clock minus ours, by the quickest of its messages; None before any said it.

    posteriors: how many were good; hashes: of their vocabularies; turns: how often one session was followed by another,
    or a sequence number by a lower one: once is a restart. bad: messages that cannot be used, by reason.
    """

    status: StatusMessage | None = None
    status_ns: int = 0
    skew_s: float | None = None
    posteriors: int = 0
    judgements: int = 0
    hashes: set[str] = field(default_factory=set)
    turns: int = 0
    bad: Counter[str] = field(default_factory=Counter)
    last: tuple[str, int] | None = None

    def numbered(self, session: str, seq: int) -> None:
        """One more message with a number."""
        if self.last is not None:
            self.turns += session != self.last[0] or seq < self.last[1]
        self.last = session, seq

    @property
    def frame_age_s(self) -> float | None:
        """Age of the newest frame when the status was said, by the speaker's own clock where it says what that is."""
        if self.status is None or self.status.last_frame_ns is None:
            return None
        said_ns = self.status_ns if self.status.at_ns is None else self.status.at_ns
        return (said_ns - self.status.last_frame_ns) / SECOND_NS


@dataclass(slots=True)
class Heard:
    """A scene's mesh as it was heard; alive_*: whose liveliness tokens are there."""

    keys: SceneKeys
    observers: dict[str, Said] = field(default_factory=dict)
    fusions: dict[str, Said] = field(default_factory=dict)
    alive_observers: frozenset[str] = frozenset()
    alive_fusions: frozenset[str] = frozenset()
    listened_s: float = 0.0
    unnamed: Counter[str] = field(default_factory=Counter)

    @property
    def silent(self) -> bool:
        """Whether nobody of the scene is there at all."""
        return not (self.alive_observers or self.alive_fusions or self.observers or self.fusions)

    def hear(self, key: str, payload: bytes, now_ns: int, *, asked: bool = False) -> None:
        """One message that came at `now_ns`; asked: it is an answer. Never raises, whatever the bytes."""
        who = observer_of(key) if key.count("/") > 1 else ""
        if key == self.keys.judgement:
            if not asked:
                self._judgement(payload)
        elif key == self.keys.posterior(who):
            self._posterior(self._of(self.observers, who), payload)
        elif key == self.keys.observer_status(who):
            self._status(self._of(self.observers, who), payload, now_ns)
        elif key == self.keys.fusion_status(who):
            self._status(self._of(self.fusions, who), payload, now_ns)

    def _of(self, who: dict[str, Said], name: str) -> Said:
        if name not in who and len(who) >= STRANGERS_LIMIT:
            return Said()
        return who.setdefault(name, Said())

    def _judgement(self, payload: bytes) -> None:
        try:
            judgement = decode(JudgementMessage, payload, size_limit=1 << 20)
        except BadMessage as bad:
            self.unnamed[bad.reason] += 1
            return
        said = self._of(self.fusions, judgement.fusion)
        said.judgements += 1
        said.hashes.add(judgement.vocabulary.hash)
        said.numbered("", judgement.seq)

    def _posterior(self, said: Said, payload: bytes) -> None:
        try:
            posterior = decode(PosteriorMessage, payload)
        except BadMessage as bad:
            said.bad[bad.reason] += 1
            return
        said.posteriors += 1
        said.hashes.add(posterior.vocabulary.hash)
        said.numbered(posterior.session, posterior.seq)

    def _status(self, said: Said, payload: bytes, now_ns: int) -> None:
        try:
            status = decode(StatusMessage, payload)
        except BadMessage as bad:
            said.bad[bad.reason] += 1
            return
        said.status, said.status_ns = status, now_ns
        if status.at_ns is not None:
            skew_s = (status.at_ns - now_ns) / SECOND_NS
            # The way here only makes a clock seem slower: the greatest is the nearest to the truth.
            said.skew_s = skew_s if said.skew_s is None else max(said.skew_s, skew_s)


def judged_hash(heard: Mapping[str, Said]) -> str:
    """The vocabulary in which the fusion services judge; "" before any did."""
    return next((digest for said in heard.values() for digest in sorted(said.hashes)), "")
