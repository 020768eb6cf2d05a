"""The people around the one who is followed: where they are, and whether they can be told from that one. Pure.

Lengths are in heights, see `observer.tracking.people.Body`.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

from observer.tracking.people import Body, distinct

STEP, SPEED = 0.25, 1.5
"""From one picture to the next the hips move by less than STEP, plus SPEED for each second in between: 2.5 m/s."""
GROWTH = 1.6
"""Heights that differ more are not of the same person."""
NEAR, MERGED, HIDDEN, OWN = 1.5, 0.4, 0.6, 0.22
"""Distances from which another person is watched closely; at which two people are taken for one, while the followed one
is seen and while that one is hidden; and at which somebody found is the followed person."""
ALONE_S, COMPANY_S, STIRRED_S, NEAR_S = 3.0, 0.5, 0.2, 0.1
"""Time between two searches for others: with nobody else, with somebody, when something moves beside the followed
person or that person has moved, and with somebody near."""
MOVED_HEIGHTS = 0.4
"""Distance from the place of the last search from which the followed person has moved."""
OTHER_S = 1.5
"""Others who are not found again for so long are gone."""


@dataclass(frozen=True, slots=True)
class OtherPerson:
    """Somebody who is not followed. du, dv: px per second. sightings: how often found."""

    body: Body
    ms: int
    du: float = 0.0
    dv: float = 0.0
    sightings: int = 1

    def at(self, ms: int) -> Body:
        """Where they are at that time if they go on."""
        gone_s = (ms - self.ms) / 1000
        return replace(self.body, u=self.body.u + self.du * gone_s, v=self.body.v + self.dv * gone_s)

    def reach(self, ms: int) -> float:
        """How far from `at` they can be, px."""
        return (STEP + SPEED * (ms - self.ms) / 1000) * self.body.height

    def found(self, body: Body, ms: int) -> "OtherPerson":
        """The same person, found again."""
        gone_s = max(ms - self.ms, 1) / 1000
        du, dv = (body.u - self.body.u) / gone_s, (body.v - self.body.v) / gone_s
        return OtherPerson(body, ms, du, dv, self.sightings + 1)


class Company:
    """The people around the followed person, as far as searches find them."""

    def __init__(self, people: Sequence[OtherPerson] = ()) -> None:
        self.people = list(people)
        self._looked: tuple[int, Body] | None = None

    def is_due(self, followed: Body, stirred: bool, ms: int) -> bool:
        """Whether it is time to look around. stirred: something moves beside the followed person."""
        if self._looked is None:
            return True
        looked_ms, place = self._looked
        stirred = stirred or place.distance(followed) > MOVED_HEIGHTS * followed.height
        near = any(one.at(ms).distance(followed) < NEAR * followed.height for one in self.people)
        pause_s = NEAR_S if near else STIRRED_S if stirred else COMPANY_S if self.people else ALONE_S
        return ms - looked_ms >= 1000 * pause_s

    def update(self, followed: Body, bodies: Sequence[Body], ms: int) -> None:
        """Take in the bodies that a search found; the nearest one is the followed person's, if it is near enough."""
        self._looked = ms, followed
        rest = sorted(distinct(bodies), key=followed.distance)
        if rest and rest[0].distance(followed) < OWN * followed.height:
            rest = rest[1:]
        # What appears too near is a limb of the followed person that is not covered: others were seen as they came.
        strangers = [b for b in self.strangers(rest, ms) if b.distance(followed) >= MERGED * followed.height]
        self.people += [OtherPerson(body, ms) for body in strangers]

    def strangers(self, bodies: Sequence[Body], ms: int) -> list[Body]:
        """The bodies that belong to none of the known others; the others are updated with theirs."""
        known = [one for one in self.people if ms - one.ms <= 1000 * OTHER_S]
        again, strangers = [], []
        for body in bodies:
            same = min(known, key=lambda one: one.at(ms).distance(body), default=None)
            if same is not None and same.at(ms).distance(body) < same.reach(ms):
                known.remove(same)
                again.append(same.found(body, ms))
            else:
                strangers.append(body)
        self.people = again + known
        return strangers

    def is_other(self, body: Body, followed: Body, ms: int) -> bool:
        """Whether one of them is nearer to `body` than the followed person is."""
        return any(one.at(ms).distance(body) < followed.distance(body) for one in self.people)

    def merges_with(self, followed: Body, visible: bool, ms: int) -> bool:
        """Whether one who was found twice is too near and too alike to be told from the followed person.

        visible: whether the followed person is seen now.
        """
        return any(
            one.sightings > 1
            and one.at(ms).distance(followed) < (MERGED if visible else HIDDEN) * followed.height
            and one.body.resembles(followed, GROWTH)
            for one in self.people
        )
