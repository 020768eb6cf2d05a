"""What a hub counts for Prometheus: what it heard, what it could not understand, and what it hands on."""

from collections import Counter as Tally
from collections.abc import Iterable
from typing import TYPE_CHECKING

from common.messages import JudgementMessage, Message, StatusMessage, VerdictMessage, VocabularyMessage
from common.metrics import Metrics
from hub.scene_state import SceneState

if TYPE_CHECKING:
    from prometheus_client import Metric

KINDS: dict[type[Message], str] = {
    JudgementMessage: "judgement",
    VerdictMessage: "verdict",
    StatusMessage: "status",
    VocabularyMessage: "vocabulary",
}


class HubMetrics(Metrics):
    """Of one hub (`mqtt`, `dashboard`), which may serve several scenes."""

    def __init__(self, hub: str) -> None:
        super().__init__("hub", {"hub": hub})
        self._heard: Tally[tuple[str, str]] = Tally()
        self._states: dict[str, SceneState] = {}
        self._connected: bool | None = None
        self._connections = 0

    def heard(self, state: SceneState, message: Message | None) -> None:
        """The scene after `message`, or after a look into the inbox."""
        self._states[state.scene] = state
        if message is not None:
            self._heard[state.scene, KINDS[type(message)]] += 1

    def connected(self, now: bool) -> None:
        """Whether what the hub hands on to (a broker) is reached."""
        self._connections += now and not self._connected
        self._connected = now

    def collect_own(self, status: StatusMessage | None) -> "Iterable[Metric]":
        """All of it, as of now. Copies first: the loop goes on meanwhile."""
        heard = [(names, float(count)) for names, count in dict(self._heard).items()]
        yield self.total("messages_heard", "Messages that were heard and understood.", heard, "scene", "kind")
        states = dict(self._states)
        rejected = [((scene,), float(state.rejected)) for scene, state in states.items()]
        yield self.total("messages_rejected", "Messages that could not be understood.", rejected, "scene")
        newest = [((scene,), state.heard_ns / 1e9 or None) for scene, state in states.items()]
        yield self.gauge("last_judgement_timestamp_seconds", "When a judgement was last heard.", newest, "scene")
        if self._connected is not None:
            yield self.gauge("connected", "1 while the hub reaches its broker.", [((), float(self._connected))])
            yield self.total("connections", "How often the broker was reached.", [((), float(self._connections))])
