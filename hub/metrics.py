"""Prometheus metrics of a hub: the messages that it receives and rejects, and its connection to a broker."""

from collections import Counter as Tally
from collections.abc import Iterable
from typing import TYPE_CHECKING

from common import SECOND_NS
from common.messages import StatusMessage
from common.metrics import Metrics
from hub.scene_state import MESSAGE_KINDS, SceneMessage, SceneState

if TYPE_CHECKING:
    from prometheus_client import Metric

KIND_OF = {message_type: kind for kind, message_type in MESSAGE_KINDS.items()}


class HubMetrics(Metrics):
    """Metrics of one hub (`mqtt`, `dashboard`), which may serve several scenes."""

    def __init__(self, hub: str) -> None:
        super().__init__("hub", {"hub": hub})
        self._messages: Tally[tuple[str, str]] = Tally()
        self._states: dict[str, SceneState] = {}
        self._connected: bool | None = None
        self._connections = 0

    def record(self, state: SceneState, message: SceneMessage | None) -> None:
        """Record the scene after `message`, or after a look into the inbox."""
        self._states[state.scene] = state
        if message is not None:
            self._messages[state.scene, KIND_OF[type(message)]] += 1

    def record_connection(self, connected: bool) -> None:
        """Record whether the hub reaches its broker."""
        self._connections += connected and not self._connected
        self._connected = connected

    def collect_own(self, status: StatusMessage | None) -> "Iterable[Metric]":
        """All metrics as of now; works on copies, because the loop goes on meanwhile."""
        messages = [(names, float(count)) for names, count in dict(self._messages).items()]
        yield self.total("messages_heard", "Messages received.", messages, "scene", "kind")
        states = dict(self._states)
        rejected = [((scene,), float(state.rejected)) for scene, state in states.items()]
        yield self.total("messages_rejected", "Messages that could not be used.", rejected, "scene")
        dropped = [((scene,), float(state.dropped)) for scene, state in states.items()]
        yield self.total("messages_dropped", "Messages lost to a full queue.", dropped, "scene")
        skipped = [((scene,), float(state.skipped)) for scene, state in states.items()]
        yield self.total("judgements_skipped", "Judgements left out, as a newer one was there.", skipped, "scene")
        newest = [((scene,), state.received_ns / SECOND_NS or None) for scene, state in states.items()]
        yield self.gauge("last_judgement_timestamp_seconds", "When a judgement last arrived.", newest, "scene")
        if self._connected is not None:
            yield self.gauge("connected", "1 while the hub reaches its broker.", [((), float(self._connected))])
            yield self.total("connections", "Connections to the broker.", [((), float(self._connections))])
