"""One scene on its way to the broker: which messages are due, from what was heard and what was said. Pure.

1. States are retained and said when they have changed, paced by picture.py; events are not retained and never paced.
2. After a new connection, and when Home Assistant has come back, everything is said again: discovery, then states.
3. An event waits until the broker has taken it: `event` shows the next, `event_taken` goes on.
4. What nobody has ever said of how movements are done has no entity.
"""

import json
from collections import deque
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

from common.messages import StatusMessage, VerdictMessage
from hub.anticipation import NEVER, Anticipation, Word
from hub.mqtt.entities import discovery
from hub.mqtt.facets import facets_state, said_facets
from hub.mqtt.foresight import events_of
from hub.mqtt.names import Names
from hub.mqtt.picture import FAST_S, Saying, View, picture
from hub.mqtt.verdicts import EVENT_S, Herald, remembered
from hub.scene_state import SceneState

WAITING = 1000
"""Verdicts that wait for a broker at most; past it the oldest go, and are counted in `left_out`."""


@dataclass(frozen=True, slots=True)
class Publication:
    """One message for the broker."""

    topic: str
    payload: str
    retain: bool = True


@dataclass(frozen=True, slots=True)
class _Heard:
    verdict: VerdictMessage
    told: bool
    at_s: float


@dataclass(frozen=True, slots=True)
class Due:
    """An event that waits for the broker since `at_s`."""

    publication: Publication
    at_s: float


class SceneBridge:
    """What is due for one scene. Times are seconds of a clock that is never set back.

    movements: those with a binary sensor of their own. step_s: seconds between two judgements at most. certainty: how
    likely a movement must be to be named before it is decided.
    """

    def __init__(
        self,
        names: Names,
        observers: Sequence[str],
        movements: Sequence[str],
        area: str = "",
        step_s: float = 0.1,
        certainty: float = NEVER,
    ) -> None:
        self.names = names
        self.left_out = 0
        self.movements = movements
        self._observers, self._area, self._step_s = observers, area, step_s
        self.certainty = certainty
        self._anticipation = Anticipation(certainty)
        self._facets: frozenset[str] = frozenset()
        self._labels: tuple[str, ...] = ()
        self._discovery: dict[str, str] = {}
        self._said: dict[str, tuple[Saying, float]] = {}
        self._status: dict[str, tuple[StatusMessage, float]] = {}
        self._herald = Herald(names)
        self._heard: deque[_Heard] = deque()
        self._events: deque[Due] = deque()
        self._recalled = False
        self._recalled_ns: int | None = None

    def hear(self, verdict: VerdictMessage, now_s: float, told: bool = False) -> None:
        """A verdict came; `told`: it was said before we listened, and was asked for."""
        self._tell(self._anticipation.hear(verdict, now_s), now_s)
        self._heard.append(_Heard(verdict, told, now_s))
        if len(self._heard) > WAITING:
            self._herald.learn(self._heard.popleft().verdict)
            self.left_out += 1

    def recall(self, said_ns: int | None) -> None:
        """What an earlier hub of this scene said last, by the referee's clock; only the first call counts."""
        if not self._recalled:
            self._recalled, self._recalled_ns = True, said_ns

    def forget(self) -> None:
        """Whoever listens may know nothing: say all states again."""
        self._said.clear()

    def look(self, state: SceneState, tokens: frozenset[str], now_s: float) -> list[Publication]:
        """The states that are due now."""
        self._take_verdicts(state, now_s)
        view = View(state, tokens, self._status_ages(state, now_s), self._step_s)
        self._anticipate(view, now_s)
        wanted = {topic: Saying(payload) for topic, payload in self._entities(state).items()}
        wanted |= picture(self.names, view, self._observers, self.movements)
        if self._facets and state.judgement is not None:
            wanted[self.names.facets] = Saying(json.dumps(facets_state(state.judgement, self._facets)), None, FAST_S)
        if self._herald.last is not None:
            wanted[self.names.last_verdict] = Saying(remembered(self._herald.last))
        due = [topic for topic, saying in wanted.items() if self._is_due(topic, saying, now_s)]
        self._said |= {topic: (wanted[topic], now_s) for topic in due}
        return [Publication(topic, wanted[topic].payload) for topic in due]

    def event(self, now_s: float) -> Publication | None:
        """The event that the broker should take next, if there is one."""
        while self._events and now_s - self._events[0].at_s > EVENT_S:
            self._events.popleft()
            self.left_out += 1
        return self._events[0].publication if self._events else None

    def event_taken(self) -> None:
        """The broker has it."""
        self._events.popleft()

    def _is_due(self, topic: str, wanted: Saying, now_s: float) -> bool:
        if topic not in self._said:
            return True
        said, at_s = self._said[topic]
        if wanted.again_s and now_s - at_s >= wanted.again_s:
            return True
        changed = wanted.payload != said.payload
        return changed and (wanted.urgent != said.urgent or now_s - at_s >= wanted.pace_s)

    def _entities(self, state: SceneState) -> dict[str, str]:
        # A vocabulary that is not known for a moment, or a facet that is not said, takes no entity away.
        labels, facets = state.labels or self._labels, self._facets | said_facets(state.judgement)
        if labels != self._labels or facets != self._facets or not self._discovery:
            self._labels, self._facets = labels, facets
            early = self.certainty < NEVER
            self._discovery = discovery(self.names, self._observers, labels, self.movements, self._area, facets, early)
        return self._discovery

    def _anticipate(self, view: View, now_s: float) -> None:
        judgement = view.state.judgement if view.judged else None
        hear = self._anticipation.hear
        self._tell(self._anticipation.wait(now_s) if judgement is None else hear(judgement, now_s), now_s)

    def _tell(self, words: Iterable[Word], now_s: float) -> None:
        for topic, payload in events_of(self.names, words):
            self._events.append(Due(Publication(topic, payload, retain=False), now_s))

    def _status_ages(self, state: SceneState, now_s: float) -> dict[str, float]:
        for observer, status in state.observer_status.items():
            if observer in self._observers and self._status.get(observer, (None, 0.0))[0] is not status:
                self._status[observer] = (status, now_s)
        return {observer: now_s - at_s for observer, (_, at_s) in self._status.items()}

    def _take_verdicts(self, state: SceneState, now_s: float) -> None:
        while self._recalled and self._heard:
            heard = self._heard.popleft()
            if heard.told and not self._was_missed(heard.verdict, state):
                self._herald.learn(heard.verdict)
                continue
            # Rule 4 of verdicts.py: what waits is as old as it was heard.
            for topic, payload in self._herald.hear(heard.verdict):
                self._events.append(Due(Publication(topic, payload, retain=False), heard.at_s))

    def _was_missed(self, verdict: VerdictMessage, state: SceneState) -> bool:
        """Whether it was said while no hub was there, a moment ago; both by the referee's clock."""
        if self._recalled_ns is None or verdict.at_ns <= self._recalled_ns:
            return False
        newest_ns = max([each.at_ns for each in (*state.verdicts, *filter(None, [state.judgement]))], default=0)
        return newest_ns - verdict.at_ns <= EVENT_S * 1e9
