"""One scene before its referee: what came is heard, who is alive and how late they have it is looked at, he judges."""

from collections.abc import Callable

from common.clock_skew import QUERY_EVERY_S, ClockQuerier
from common.config import Scene
from common.inbox import Arrival
from common.keys import observer_of
from common.status import ProcessStatus
from common.subsession import SubSession
from fusion.ear import Ear
from fusion.referee_like import EngineLike, EngineOutputLike


class Desk:
    """The referee of one scene and what he hears of the mesh.

    wake: called when a clock has answered. ask_s: how often the clocks are asked.
    """

    def __init__(
        self,
        scene: Scene,
        referee: EngineLike,
        link: SubSession,
        clock: Callable[[], int],
        wake: Callable[[], None] = lambda: None,
        ask_s: float = QUERY_EVERY_S,
    ) -> None:
        self._scene, self._referee, self._clock = scene, referee, clock
        self.health = ProcessStatus(scene.scene, scene.fusion.id)
        self._ear = Ear(scene.scene, referee, self.health, clock)
        self._presence = link.presence(scene.keys.observer_alive())
        self._asker = ClockQuerier(link, scene.keys.observer_status(), clock, wake, ask_s)

    def hear(self, arrival: Arrival) -> None:
        """One posterior; a bad one is counted and dropped."""
        self._ear.hear(arrival)

    def look(self) -> None:
        """Who is alive, and what time they have; after what they said, so that it does not bring back who has gone."""
        if self._asker.ask_if_due():
            self.health.set_observers(self._ear.accounts(self._scene.roster))
        for observer, reading in self._asker.readings():
            self._referee.record_clock(observer, reading)
        self._referee.set_present(frozenset(observer_of(key) for key in self._presence.alive))

    def judge(self) -> EngineOutputLike | None:
        """What the judges together believe now; None while there is nothing to judge."""
        return self._referee.step(self._clock())
