"""From arrived bytes to the referee: what cannot be read, or does not say what its key says, is counted and dropped."""

import logging
from collections.abc import Callable, Sequence

from common.keys import observer_of
from common.link import Arrival
from common.messages import ObserverStatistics, PosteriorMessage
from common.status import ProcessStatus
from common.wire import BadMessage, decode
from fusion.complaints import Complaints
from fusion.referee_like import EngineLike

log = logging.getLogger("labanmesh.fusion")


class Ear:
    """From arrived bytes to the referee, who is told of each message that he gets and of each that he does not."""

    def __init__(self, scene: str, referee: EngineLike, health: ProcessStatus, clock: Callable[[], int]) -> None:
        self._scene, self._referee, self._health, self._clock = scene, referee, health, clock
        self._complaints = Complaints()

    def hear(self, arrival: Arrival) -> None:
        """One message; a bad one is counted and dropped, never raised."""
        observer, now_ns = observer_of(arrival.key), self._clock()
        try:
            message = decode(PosteriorMessage, arrival.payload)
        except BadMessage as error:
            self._refuse(observer, error.reason, error.detail, now_ns)
            return
        if not message.is_of(self._scene, observer):
            said = f"{message.observer} in {message.scene} said under {arrival.key}"
            self._refuse(observer, "wrong_key", said, now_ns)
            return
        reason = self._referee.receive(observer, message, now_ns)
        if reason is None:
            self._health.record_frame(message.captured_ns, now_ns)
        else:
            self._complain(observer, reason, f"seq {message.seq} of session {message.session}", now_ns)

    def accounts(self, roster: Sequence[str]) -> dict[str, ObserverStatistics]:
        """What was noticed of each observer of the scene, and of others who spoke as if they were."""
        rejected = self._complaints.totals
        return {
            observer: ObserverStatistics(skew_s=self._referee.skew_s(observer), rejected=rejected.get(observer, {}))
            for observer in dict.fromkeys((*roster, *rejected))
        }

    def _refuse(self, observer: str, reason: str, detail: str, now_ns: int) -> None:
        self._referee.reject(observer, reason)
        self._complain(observer, reason, detail, now_ns)

    def _complain(self, observer: str, reason: str, detail: str, now_ns: int) -> None:
        line = self._complaints.note(observer, reason, detail, now_ns)
        if line is not None:
            log.warning("%s", line)
