"""What all scenes of one fusion service share."""

from collections.abc import Callable
from dataclasses import dataclass

from common.link import Link, Publisher
from common.notify import Notifier


@dataclass(frozen=True, slots=True)
class Service:
    """One process that fuses scenes.

    own: its id. session: random per process, to notice a second process of the same id. clock: Unix epoch in ns.
    ticks: monotonic seconds. shared: whether scenes that name no standby services are shared by all services. polled:
    whether messages wait until the step that takes them (many scenes) instead of being received by a thread for each
    subscription. wake: called when the loop has work. ask_clocks_s: seconds between two readings of a clock.
    put: sends a judgement, now or with those of other scenes. supervisor: receives the state of the scene, if there is
    only one.
    """

    own: str
    session: str
    link: Link
    clock: Callable[[], int]
    ticks: Callable[[], float]
    shared: bool
    polled: bool
    wake: Callable[[], None]
    ask_clocks_s: float
    put: Callable[[Publisher, bytes], None]
    supervisor: Notifier
