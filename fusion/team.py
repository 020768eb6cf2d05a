"""Several fusion services of one scene, as one of them sees it: who leads, what it said, and saying it oneself.

1. A verdict is said before the judgement that it came from: whoever takes over in between knows of it.
2. What is decided while nobody leads is kept, and said by who leads next.
"""

import logging
from collections.abc import Sequence

from common.config import Scene
from common.keys import SceneKeys
from common.link import Arrival, Link
from common.messages import JudgementMessage, VerdictMessage
from common.subsession import SubSession
from common.wire import BadMessage, decode, encode
from fusion.leadership import STEPS_MISSED, Leadership
from fusion.memory_file import Memory
from fusion.referee_like import EngineLike, EngineOutputLike

log = logging.getLogger("labanmesh.fusion")
VERDICTS_KEPT = 10
"""So many of the last verdicts are told to who comes late."""


class Team:
    """The fusion services of one scene, as one of them sees it: who leads, and what the leader says."""

    def __init__(self, scene: Scene, referee: EngineLike, voice: "Voice", link: Link) -> None:
        self._scene, self._referee, self._voice = scene, referee, voice
        self._own = scene.fusion.id
        patience_s = max(scene.fusion.takeover_s, STEPS_MISSED / scene.fusion.step_hz)
        self._leadership = Leadership(self._own, frozenset(scene.services), patience_s)
        # Alone there is nobody to listen to, and one's own words cost time.
        spoken = (scene.keys.verdict, scene.keys.judgement) if scene.fusion.standby else ()
        self._inbox = link.inbox(*spoken)
        self._withheld: list[VerdictMessage] = []
        self._told: str | None = None
        self.news: str | None = None
        """What the status has to say anew; None when nothing has changed."""

    def leads(self, alive: frozenset[str], now_ns: int) -> bool:
        """Whether to speak now; before that, all that the leader has said is taken over."""
        for arrival in self._inbox.take(0):
            self._hear(arrival, now_ns)
        # After its last words, so that they do not bring back a leader who has gone.
        self._leadership.present(alive, now_ns)
        leads = self._leadership.leads(now_ns)
        leader = self._leadership.leader
        told = "" if leader == self._own else f"standing by for {leader or 'who leads'}"
        self.news = told if told != self._told else None
        if self.news is not None and self._scene.fusion.standby:
            log.info("%s", told or "leading")
        self._told = told
        return leads and leader == self._own

    def pass_on(self, ruling: EngineOutputLike, leads: bool) -> Sequence[VerdictMessage]:
        """Say it, or keep its verdicts: until it is known that the leader is dead, nobody else may have said them.

        Returns the verdicts that were said.
        """
        self._withheld += ruling.verdicts
        if not leads:
            return ()
        self._voice.say(self._withheld, ruling.judgement)
        said, self._withheld = self._withheld, []
        return said

    def _hear(self, arrival: Arrival, now_ns: int) -> None:
        kind = VerdictMessage if arrival.key == self._scene.keys.verdict else JudgementMessage
        try:
            said = decode(kind, arrival.payload)
        except BadMessage as error:
            log.warning("%s: cannot be used: %s", arrival.key, error)
            return
        if said.fusion != self._own and self._leadership.heard(said.fusion, now_ns):
            # From here on we are where the leader is: what it has not said we shall find again.
            self._withheld.clear()
            self._referee.continue_from(said)
            self._voice.note(said, arrival.payload)


class Voice:
    """Says rulings on the mesh and repeats the last ones to who asks."""

    def __init__(
        self, link: SubSession, keys: SceneKeys, vocabulary: bytes, referee: EngineLike, memory: Memory | None = None
    ) -> None:
        self._judgement = link.publisher(keys.judgement)
        self._verdict = link.publisher(keys.verdict)
        self._memory, self._referee = memory, referee
        self._last: bytes | None = None
        self._verdicts: tuple[bytes, ...] = ()
        self._newest: VerdictMessage | None = None
        link.answer(keys.judgement, lambda: self._last)
        link.answer(keys.verdict, lambda: self._verdicts)
        link.answer(keys.vocabulary, lambda: vocabulary)

    def say(self, verdicts: Sequence[VerdictMessage], judgement: JudgementMessage) -> None:
        """What was decided, then the judgement."""
        for verdict in verdicts:
            self.note(verdict, encode(verdict))
            self._verdict.put(self._verdicts[-1])
            _log(verdict)
        self.note(judgement, encode(judgement))
        self._judgement.put(self._last or b"")

    def note(self, said: JudgementMessage, payload: bytes) -> None:
        """Something was said, here or by the service that leads: it is what who asks is told."""
        if isinstance(said, VerdictMessage):
            self._verdicts = (*self._verdicts, payload)[-VERDICTS_KEPT:]
            self._newest = said
            return
        self._last = payload
        if self._memory is not None:
            self._memory.keep(said, self._newest, self._referee.reliability)

    def recall(self, scene: str, now_ns: int) -> None:
        """Go on from what was kept before a restart."""
        if self._memory is None:
            return
        self._referee.reliability = self._memory.lessons(scene)
        found = self._memory.recall(scene, now_ns)
        if found is None:
            return
        for said in (found.verdict, found.judgement):
            if said is not None:
                self._referee.continue_from(said)
                self.note(said, encode(said))


def _log(verdict: VerdictMessage) -> None:
    k, n = verdict.agreement.k, verdict.agreement.n
    stage = "decided" if verdict.ended_ns is None else "ended"
    about = {
        "verdict": verdict.id,
        "label": verdict.label,
        "agree": k,
        "heard": n,
        "ended": verdict.ended_ns is not None,
    }
    log.info("verdict %s: %s, %d of %d agree, %s", verdict.id, verdict.label, k, n, stage, extra=about)
