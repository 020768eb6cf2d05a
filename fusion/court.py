"""One of many scenes that several fusion processes share: hearing it, taking it, judging it, giving it away.

1. What decides which process judges is in sharing.py; this does what follows on the mesh.
2. Who is asked to hand over answers between two steps, with the movement that goes on and what it learned of its
   judges; from then on it says nothing more.
3. The second hears what is judged and keeps the last of it, unread until it is needed.
4. All that comes waits until the next step: a thread for each scene would cost more than the judging.
"""

import logging
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass

from pydantic import ValidationError

from common.config import Scene
from common.messages import JudgementMessage, VerdictMessage
from common.notify import Notifier
from common.status import StatusPublisher
from common.subsession import SubSession
from common.wire import BadMessage, decode, encode, encode_vocabulary
from fusion.desk import Desk
from fusion.engine.engine import EngineOutput, FusionEngine
from fusion.engine.pooling import PooledPosterior, PoolingCase
from fusion.memory_file import FORGET_S, Remembered
from fusion.sharing import Duty, Share
from fusion.team import Voice

log = logging.getLogger("labanmesh.fusion")
SECOND_NS = 1_000_000_000
ANSWER_S = 1.0
"""Who judges a scene hands it over within this time, or is taken not to judge any more."""
ASK_CLOCKS_S = 60.0
"""A thousand observers asked every second would cost as much as hearing them."""


@dataclass(frozen=True, slots=True)
class Step:
    """The first half of a step: how many posteriors were read, and what is to be pooled; None: nothing is."""

    read: int = 0
    now_ns: int = 0
    case: PoolingCase | None = None


class Court:
    """One scene, as the fusion process `scene.fusion.id` has to do with it. referee: makes a new one."""

    def __init__(
        self, scene: Scene, referee: Callable[[], FusionEngine], link: SubSession, clock: Callable[[], int]
    ) -> None:
        self.scene = scene
        self._new_referee, self._link, self._clock = referee, link, clock
        self._share = Share(scene.fusion.id, scene.scene)
        self._sitting: _Sitting | None = None
        self._gallery: _Gallery | None = None
        self._asking: _Asking | None = None
        self._kept: Remembered | None = None

    @property
    def duty(self) -> Duty:
        """What this process does for the scene now."""
        return self._share.duty

    def present(self, alive: Iterable[str]) -> None:
        """Which fusion services are alive in the scene; takes it, or begins to listen, where that follows."""
        self._share.present(alive)
        self._follow()

    def doubtful(self) -> None:
        """This process was stopped for long: another may judge by now."""
        self._share.doubtful()
        self._follow()

    def step(self) -> Step:
        """Take in what has come; what is to be pooled, if it is ours to judge, for `say`."""
        if self._gallery is not None:
            self._gallery.link.poll()
        sitting = self._sitting
        if sitting is None:
            return Step()
        # Somebody may have asked for the scene: then it is not ours any more.
        sitting.link.poll()
        self._follow()
        if self._sitting is None:
            return Step()
        arrivals = sitting.posteriors.take(0)
        for arrival in arrivals:
            sitting.desk.hear(arrival)
        sitting.desk.look()
        if self.duty is Duty.TAKING and self._asking is not None and self._asking.finished:
            self._begin(sitting, self._asking)
        if self.duty is not Duty.JUDGING:
            return Step(len(arrivals))
        now_ns = self._clock()
        return Step(len(arrivals), now_ns, sitting.referee.pooling_case(now_ns))

    def say(self, step: Step, pooled: PooledPosterior) -> Sequence[VerdictMessage]:
        """VerdictDetector by what the step's case came to, and say it; the verdicts."""
        if self._sitting is None or step.case is None:
            return ()
        return self._sitting.say(self._sitting.referee.output_for(step.case.posteriors, step.now_ns, pooled))

    def tell(self) -> None:
        """Say how the judging is; to be called once a second."""
        if self.duty is Duty.JUDGING and self._sitting is not None:
            self._sitting.board.publish()

    def close(self) -> None:
        """Leave the scene."""
        for part in (self._sitting, self._gallery):
            if part is not None:
                part.link.close()
        self._sitting = self._gallery = None

    def _follow(self) -> None:
        """What the duty asks for is there, and nothing else."""
        if self.duty in (Duty.TAKING, Duty.JUDGING):
            self._sitting = self._sitting or self._sit()
        elif self._sitting is not None:
            self._sitting.link.close()
            self._sitting = None
        if self.duty is Duty.TAKING and self._asking is None and self._sitting is not None:
            self._asking = _Asking(self._sitting.link, self.scene)
        if self.duty is Duty.SECOND:
            self._gallery = self._gallery or _Gallery(self.scene, self._link.sub_session(polled=True))
        elif self.duty is not Duty.TAKING and self._gallery is not None:
            self._gallery.link.close()
            self._gallery = None

    def _sit(self) -> "_Sitting":
        sitting = _Sitting(self.scene, self._new_referee(), self._link.sub_session(polled=True), self._clock)
        sitting.link.answer(self.scene.keys.fusion_handover(self.scene.fusion.id), self._hand_over)
        return sitting

    def _begin(self, sitting: "_Sitting", asking: "_Asking") -> None:
        """VerdictDetector from now on: from what was handed over, else from what the last one said, else afresh."""
        state = asking.handed_over() or self._overheard()
        if state is not None:
            sitting.go_on(state)
        self._asking = self._kept = None
        self._share.took_over()
        self._follow()
        sitting.board.set_state("running")
        log.info("%s: judging%s", self.scene.scene, "" if state is None else ", going on where another was")

    def _overheard(self) -> Remembered | None:
        """What the one before was heard to say, or what was given away and came back; None when that is long ago."""
        heard = self._gallery.last() if self._gallery is not None else None
        known = [state for state in (heard, self._kept) if state is not None]
        latest = max(known, key=lambda state: state.judgement.at_ns, default=None)
        if latest is None or abs(self._clock() - latest.judgement.at_ns) > FORGET_S * SECOND_NS:
            return None
        return latest

    def _hand_over(self) -> bytes | None:
        """Another asks."""
        if self.duty is not Duty.JUDGING or self._sitting is None:
            return None
        self._kept = self._sitting.state()
        self._share.handed_over()
        return b"" if self._kept is None else self._kept.model_dump_json().encode()


class _Sitting:
    """What a scene that is judged here needs; all that it declared goes with its branch."""

    def __init__(self, scene: Scene, referee: FusionEngine, link: SubSession, clock: Callable[[], int]) -> None:
        self.link, self.referee = link, referee
        # By name: Zenoh finds the subscriber of a whole key at once, and tries one after the other those with
        # wildcards; with 250 of them a message costs ten times as much. Only the newest of each observer counts.
        self.posteriors = link.inbox(*map(scene.keys.posterior, scene.roster), ring=1)
        self.desk = Desk(scene, referee, link, clock, ask_s=ASK_CLOCKS_S)
        self._voice = Voice(link, scene.keys, encode_vocabulary(scene.scene, referee.vocabulary), referee)
        # Not entered: a process of many scenes has no thread for each, and is one to its supervisor.
        status = scene.keys.fusion_status(scene.fusion.id)
        self.board = StatusPublisher(link, status, self.desk.health, clock, supervisor=Notifier(""))
        self._last: JudgementMessage | None = None
        self._verdict: VerdictMessage | None = None

    def say(self, ruling: EngineOutput) -> Sequence[VerdictMessage]:
        """Say it; the verdicts."""
        self._voice.say(ruling.verdicts, ruling.judgement)
        self._last = ruling.judgement
        self._verdict = ruling.verdicts[-1] if ruling.verdicts else self._verdict
        return ruling.verdicts

    def state(self) -> Remembered | None:
        """What another needs to go on; None when nothing was judged yet."""
        if self._last is None:
            return None
        return Remembered(judgement=self._last, verdict=self._verdict, lessons=self.referee.reliability)

    def go_on(self, state: Remembered) -> None:
        """Go on where another was."""
        self.referee.reliability = state.lessons
        for said in sorted((m for m in (state.verdict, state.judgement) if m), key=lambda m: m.seq):
            self.referee.continue_from(said)
            self._voice.note(said, encode(said))


class _Gallery:
    """Where the second listens."""

    def __init__(self, scene: Scene, link: SubSession) -> None:
        self.link, self._scene = link, scene.scene
        # One each: only the newest counts.
        self._judgements = link.inbox(scene.keys.judgement, limit=1)
        self._verdicts = link.inbox(scene.keys.verdict, limit=1)

    def last(self) -> Remembered | None:
        """The last that was judged and decided; None when nothing was heard."""
        self.link.poll()
        judgements, verdicts = self._judgements.take(0), self._verdicts.take(0)
        try:
            verdict = decode(VerdictMessage, verdicts[-1].payload) if verdicts else None
            said = decode(JudgementMessage, judgements[-1].payload) if judgements else verdict
        except BadMessage as error:
            log.warning("%s: what was judged before cannot be used: %s", self._scene, error)
            return None
        return None if said is None else Remembered(judgement=said, verdict=verdict)


class _Asking:
    """Asking who judges a scene to hand it over. finished: everybody has answered, or nobody will."""

    def __init__(self, link: SubSession, scene: Scene) -> None:
        self.finished = False
        self._scene = scene.scene
        self._answers: list[bytes] = []

        def finish() -> None:
            self.finished = True

        link.request(scene.keys.fusion_handover(), lambda key, said: self._answers.append(said), ANSWER_S, finish)

    def handed_over(self) -> Remembered | None:
        """With what to go on; None when nobody judged, or nothing was judged yet."""
        for payload in filter(None, self._answers):
            try:
                return Remembered.model_validate_json(payload)
            except ValidationError as error:
                log.warning("%s: what was handed over cannot be used: %s", self._scene, str(error)[:100])
        return None
