"""Which of several fusion services judges which of many scenes. Pure.

1. Rendezvous hashing (Thaler and Ravishankar, 1998): every service has a weight in every scene, a hash of both names,
   and the heaviest of those alive judges. Who comes takes only what it is heaviest in, who goes leaves only that: no
   other scene moves, and everybody finds the same without a word.
2. Who has become the heaviest asks who judges to hand over, and judges from what that one answers; who hands over is
   silent from then on. Where nobody answers nobody judges: it begins at once.
3. Who judges goes on until it is asked, however many heavier ones it sees: they may not be ready.
4. The second heaviest hears what is judged, so that it can go on with the same movement when the first dies.
5. Who did not get to a step for long (stopped, swapped out) asks again before it goes on: another may judge by now.
"""

import hashlib
from collections.abc import Iterable
from enum import Enum


def ranked(scene: str, services: Iterable[str]) -> tuple[str, ...]:
    """The services by their weight in the scene, the heaviest first; the same in every process."""
    return tuple(sorted(set(services), key=lambda service: _weight(scene, service), reverse=True))


class Duty(Enum):
    """What a service does for a scene."""

    NONE = "none"
    SECOND = "second"
    TAKING = "taking"
    JUDGING = "judging"


class Share:
    """The service `own` and one scene."""

    def __init__(self, own: str, scene: str) -> None:
        self._own, self._scene = own, scene
        self._rank: tuple[str, ...] = (own,)
        self.duty = Duty.NONE

    def present(self, alive: Iterable[str]) -> Duty:
        """Who is alive in the scene now, oneself or not; the duty that follows."""
        self._rank = ranked(self._scene, {self._own, *alive})
        # Who is about to take over has perhaps been answered already: it goes through with it, and is asked then.
        if self.duty in (Duty.NONE, Duty.SECOND):
            self._settle()
        return self.duty

    def took_over(self) -> None:
        """Who judged has handed over, or nobody judges: begin."""
        if self.duty is Duty.TAKING:
            self.duty = Duty.JUDGING

    def handed_over(self) -> None:
        """Another has asked for the scene and was answered: it judges now (rule 2)."""
        self.duty = Duty.SECOND

    def doubtful(self) -> None:
        """Rule 5."""
        if self.duty is Duty.JUDGING:
            self._settle()

    def _settle(self) -> None:
        place = self._rank.index(self._own)
        self.duty = Duty.TAKING if place == 0 else Duty.SECOND if place == 1 else Duty.NONE


def _weight(scene: str, service: str) -> bytes:
    # A space is in no name, so no two pairs are hashed alike.
    return hashlib.blake2b(f"{scene} {service}".encode(), digest_size=16).digest()
