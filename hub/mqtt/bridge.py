"""One scene on its way to the broker: which messages are due, given what was received and published. Pure.

1. States are retained and published when they change, paced by states.py; events are not retained and not paced.
2. After a new connection, and when Home Assistant has restarted, everything is published again: discovery, then states.
3. An event waits until the broker has confirmed it: `next_event` returns it, `confirm_event` goes on. It is sent again
   only on a new connection: listeners cannot tell a copy from another event.
4. A facet that no observer has reported has no entity.
5. What belongs to a movement follows the vocabulary: it is published as soon as the movement is known, and removed by
   an empty retained message when the vocabulary has it no more, also what an earlier hub has left at the broker.
"""

from collections import deque
from collections.abc import Collection, Iterable, Sequence
from typing import TYPE_CHECKING

from common import SECOND_NS
from common.config_hub import EVERY_MOVEMENT
from common.errors import BadInput
from common.messages import StatusMessage, VerdictMessage
from hub.anticipation import Anticipation, EarlyWord
from hub.mqtt.counters import Counters
from hub.mqtt.entities import Topics, discovery
from hub.mqtt.events import EVENT_S, Publication, VerdictEvents, early_event, last_event_state, last_verdict_state
from hub.mqtt.states import RetainedState, SceneSnapshot, reported_facets, retained_states
from hub.scene_state import VERDICTS_WAIT_LIMIT, SceneState

if TYPE_CHECKING:
    from common.config import Scene


class SceneBridge:
    """What is due for one scene, whose hub shows under the topic `bridge` whether it is connected.

    Times are seconds of a clock that only advances.
    """

    def __init__(self, scene: "Scene", bridge: str) -> None:
        self._scene, self._wanted_movements, self.left_out = scene, scene.hub.mqtt.movements, 0
        self.topics = topics_of(scene, bridge)
        self._anticipation = Anticipation(scene.hub.certainty)
        self._facets: frozenset[str] = frozenset()
        self._labels: tuple[str, ...] = ()
        self._discovery: dict[str, str] = {}
        self._of_movements: frozenset[str] = frozenset()
        self._published: dict[str, tuple[RetainedState, float]] = {}
        self._status: dict[str, tuple[StatusMessage, float]] = {}
        self._verdict_events = VerdictEvents(self.topics)
        self.counters = Counters(self.topics)
        self._received: deque[tuple[VerdictMessage, bool, float]] = deque()
        """Whether each answers a query, and when it was received."""
        self._events: deque[tuple[Publication, float]] = deque()
        """Those that wait for the broker, and since when."""
        self._recalled = False
        self._recalled_ns: int | None = None

    def receive(self, verdict: VerdictMessage, now_s: float, answered: bool = False) -> None:
        """Take a verdict; `answered`: it answers a query, and may be long past."""
        self._add_early(self._anticipation.update(verdict, now_s), now_s)
        self._received.append((verdict, answered, now_s))
        if not answered:
            self.counters.take(verdict)
        if len(self._received) > VERDICTS_WAIT_LIMIT:
            self._verdict_events.remember(self._received.popleft()[0])
            self.left_out += 1

    def recall(self, said_ns: int | None) -> None:
        """Continue from the last verdict of an earlier hub, by the fusion machine's clock; only the first call counts.

        Until it is called no verdict becomes an event.
        """
        if not self._recalled:
            self._recalled, self._recalled_ns = True, said_ns

    def note_left(self, topic: str, payload: object = b"") -> None:
        """Note that the broker has a retained message under `topic`, left there by an earlier hub."""
        self.counters.recall(topic, payload)
        if self.topics.is_of_movement(topic):
            self._of_movements |= {topic}

    def forget(self) -> None:
        """Publish all states again: the other side may have lost them."""
        self._published.clear()

    def due_states(self, state: SceneState, tokens: frozenset[str], now_s: float) -> list[Publication]:
        """The states that are due now."""
        self._take_verdicts(state, now_s)
        snapshot = SceneSnapshot(state, tokens, self._status_ages(state, now_s), 1 / self._scene.fusion.step_hz)
        judged = state.judgement if snapshot.judged else None
        words = self._anticipation.expire(now_s) if judged is None else self._anticipation.update(judged, now_s)
        self._add_early(words, now_s)
        self._events.extend((event, now_s) for event in self.counters.follow(state))
        wanted = {topic: RetainedState(payload) for topic, payload in self._entities(state).items()}
        wanted |= self.counters.retained(self._scene.hub.mqtt.area)
        wanted |= retained_states(self.topics, snapshot, self._scene.roster, self._movements, self._facets)
        wanted |= self._removals(wanted)
        if self._verdict_events.last is not None:
            wanted[self.topics.of("last_verdict")] = RetainedState(last_verdict_state(self._verdict_events.last))
        if (event := last_event_state(self._verdict_events.last, state.fall)) is not None:
            wanted[self.topics.of("last_event")] = RetainedState(event)
        due = [topic for topic, retained in wanted.items() if self._is_due(topic, retained, now_s)]
        self._published |= {topic: (wanted[topic], now_s) for topic in due}
        return [Publication(topic, wanted[topic].payload) for topic in due]

    def next_event(self, now_s: float) -> Publication | None:
        """The oldest event that the broker has not confirmed, if there is one."""
        while self._events and now_s - self._events[0][1] > EVENT_S:
            self._events.popleft()
            self.left_out += 1
        return self._events[0][0] if self._events else None

    def confirm_event(self) -> None:
        """Note that the broker has the event that `next_event` returned."""
        self._events.popleft()

    def _is_due(self, topic: str, wanted: RetainedState, now_s: float) -> bool:
        if topic not in self._published:
            return True
        published, at_s = self._published[topic]
        if wanted.repeat_s and now_s - at_s >= wanted.repeat_s:
            return True
        changed = wanted.payload != published.payload
        return changed and (wanted.urgent != published.urgent or now_s - at_s >= wanted.pace_s)

    def _entities(self, state: SceneState) -> dict[str, str]:
        # An entity stays when the vocabulary is unknown for a moment or a facet is not reported.
        labels, facets = state.labels or self._labels, self._facets | reported_facets(state.judgement)
        if labels != self._labels or facets != self._facets or not self._discovery:
            self._labels, self._facets = labels, facets
            self._discovery = discovery(self.topics, self._scene, labels, self._movements, facets)
        return self._discovery

    @property
    def _movements(self) -> tuple[str, ...]:
        if EVERY_MOVEMENT in self._wanted_movements:
            return self._labels
        return tuple(label for label in self._wanted_movements if not self._labels or label in self._labels)

    def unknown_movements(self, labels: Sequence[str]) -> list[str]:
        """Movements that shall have a binary sensor and that are not among `labels`, if these are known."""
        return sorted(set(self._wanted_movements) - {EVERY_MOVEMENT} - set(labels)) if labels else []

    def _removals(self, wanted: Collection[str]) -> dict[str, RetainedState]:
        """An empty message for whatever was published for a movement that the vocabulary has no more.

        They stay due on every new connection, because a broker may come back with an old state.
        """
        self._of_movements |= frozenset(filter(self.topics.is_of_movement, wanted))
        if not self._labels:
            return {}
        return {topic: RetainedState("") for topic in self._of_movements if topic not in wanted}

    def _add_early(self, words: Iterable[EarlyWord], now_s: float) -> None:
        self._events.extend((early_event(self.topics, word), now_s) for word in words)

    def _status_ages(self, state: SceneState, now_s: float) -> dict[str, float]:
        for observer, status in state.observer_status.items():
            if observer in self._scene.roster and self._status.get(observer, (None, 0.0))[0] is not status:
                self._status[observer] = (status, now_s)
        return {observer: now_s - at_s for observer, (_, at_s) in self._status.items()}

    def _take_verdicts(self, state: SceneState, now_s: float) -> None:
        if self._recalled and self._recalled_ns is None and state.judgement is not None:
            # There was no earlier hub: this one knows everything from here on.
            self._recalled_ns = state.judgement.at_ns
        while self._recalled and self._received:
            verdict, answered, at_s = self._received.popleft()
            if answered and not self._was_missed(verdict, state):
                self._verdict_events.remember(verdict)
                continue
            self._events.extend((event, at_s) for event in self._verdict_events.update(verdict))

    def _was_missed(self, verdict: VerdictMessage, state: SceneState) -> bool:
        """Whether it was published a moment ago while no hub received it; by the fusion machine's clock."""
        if self._recalled_ns is None or verdict.at_ns <= self._recalled_ns:
            return False
        newest_ns = max([each.at_ns for each in (*state.verdicts, *filter(None, [state.judgement]))], default=0)
        return newest_ns - verdict.at_ns <= EVENT_S * SECOND_NS


def topics_of(scene: "Scene", bridge: str) -> Topics:
    """The topics and ids of `scene`, whose hub shows under `bridge` whether it is connected."""
    return Topics(scene.scene, bridge, scene.hub.mqtt.topics, scene.hub.mqtt.discovery)


def require_one_broker(scenes: "Sequence[Scene]") -> None:
    """Raises BadInput when the scenes of one hub use different brokers, or two of them have the same name."""
    own = {"movements": (), "area": ""}
    first = scenes[0]
    for scene in scenes[1:]:
        if scene.hub.mqtt.model_copy(update=own) != first.hub.mqtt.model_copy(update=own):
            raise BadInput(
                f"{scene.scene}: its [hub.mqtt] differs from that of {first.scene}; start a hub for each broker"
            )
    names = [scene.scene for scene in scenes]
    twice = sorted({name for name in names if names.count(name) > 1})
    if twice:
        raise BadInput(f"scene {twice[0]!r}: two of the scene files have this name; each scene needs its own")
