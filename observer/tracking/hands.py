"""The two hands from frame to frame: what is measured, whose it is, and where lost ones are found again."""

from collections.abc import Sequence

import numpy as np

from observer.tracking.acquisition import HandAcquisition, RestingHands
from observer.tracking.back_projection import BackProjection, Mask, SkinPatch
from observer.tracking.kalman import GATE, HAND_ACCELERATION, TrackedPart, assign
from observer.tracking.sides import LEFT, RIGHT, HandednessEvidence, name_first, name_second, name_two
from observer.tracks import Floats, State

HAND = (0.06, 0.6)
"""Areas of a new hand, squared face widths."""
HEAD_ELLIPSE = (0.55, 0.75)
"""Half axes of the head, face widths."""
MASK = 0.5
"""Half axis of what hides a hand from the search for the other one, sides of its square."""
GROWN = 1.4
"""New hands are looked for outside an ellipse so much larger: the neck is skin too."""
FURTHEST = 3.0
"""A hand is looked for no further than this from where it was expected, face widths."""
MEETING = 1.6
"""Two hands are together when they are expected nearer than so many of their sides."""
STILL = 0.7
"""A hand slower than this keeps still, face widths a second."""
NEVER = 1e6


class HandTracker:
    """Left and right; lengths in px, `face` is the face's width."""

    def __init__(self, mirror: Floats) -> None:
        """mirror: (2,) by which places are multiplied before sides are named: u is negated for a person's back."""
        self.parts = [TrackedPart(HAND_ACCELERATION), TrackedPart(HAND_ACCELERATION)]
        self.found: list[SkinPatch] = []
        self._acquisition, self._resting, self._doubt, self._mirror = (
            HandAcquisition(),
            RestingHands(),
            HandednessEvidence(),
            mirror,
        )

    def predict(self, seconds: float) -> None:
        """Let time pass."""
        for part in self.parts:
            part.predict(seconds)

    def masks(self, but: int | None = None) -> list[Mask]:
        """Where the hands are, for who looks for something else."""
        return [
            (part.filter.centre, (MASK * part.side, MASK * part.side))
            for row, part in enumerate(self.parts)
            if row != but and part.filter is not None
        ]

    def follow(self, retina: BackProjection, head: Floats, face: float, seconds: float, findable: bool) -> None:
        """One frame; head: (2,) where it was last. findable: it is followed, so that new hands may be named."""
        self.found = []
        pieces = retina.blobs([_ellipse(head, face)], HAND[0] * face**2 / 2, HAND[1] * face**2)
        patches = [*self._measured(retina, head, face), *pieces]
        patches = self._unmerged(_distinct(patches))
        self._assign(patches, face, seconds)
        self._check_names(head, face, seconds)
        if findable:
            self._find_resting(retina, head, face, seconds)
            self._find([p for p in pieces if _outside(p.centre, head, GROWN * face)], head, face)
        else:
            self._acquisition.forget()

    def _measured(self, retina: BackProjection, head: Floats, face: float) -> list[SkinPatch]:
        """Where CAMshift comes to rest from where each hand is expected; hands that meet would pull at each other's."""
        found: list[SkinPatch] = []
        if self._meeting():
            return found
        for row, part in enumerate(self.parts):
            if part.filter is None:
                continue
            wide = min(part.side + 2 * float(np.sqrt(part.filter.variance)), FURTHEST * face)
            masks = [_ellipse(head, face), *self.masks(row)]
            patch = retina.camshift(part.filter.centre, part.side, wide, masks)
            if patch is not None:
                found.append(patch)
        return found

    def _meeting(self) -> bool:
        left, right = self.parts
        if left.filter is None or right.filter is None:
            return False
        return float(np.hypot(*(left.filter.centre - right.filter.centre))) < MEETING * max(left.side, right.side)

    def _unmerged(self, patches: list[SkinPatch]) -> list[SkinPatch]:
        """Where two hands are expected together and one piece of skin is, it is both: neither is measured by it."""
        left, right = (part.filter for part in self.parts)
        if left is None or right is None or not self._meeting():
            return patches
        near = MEETING * max(part.side for part in self.parts)
        middle = (left.centre + right.centre) / 2
        there = [patch for patch in patches if float(np.hypot(*(patch.centre - middle))) < near]
        if len(there) > 1:
            return patches
        self._doubt.merged()
        return [patch for patch in patches if all(patch is not other for other in there)]

    def _assign(self, patches: Sequence[SkinPatch], face: float, seconds: float) -> None:
        known = [part for part in self.parts if part.filter is not None]
        cost = np.array([[_cost(part, patch, face) for patch in patches] for part in known]).reshape(
            len(known), len(patches)
        )
        chosen = assign(cost, GATE)
        if len(known) == 2:
            self._doubt.heard(cost, chosen)
        for part, column in zip(known, chosen, strict=True):
            if column is None:
                part.not_measured(seconds)
            else:
                part.measured(patches[column].centre, patches[column].area)

    def _check_names(self, head: Floats, face: float, seconds: float) -> None:
        left, right = self.parts
        if left.filter is None or right.filter is None:
            return
        places = [self._mirror * kf.centre for kf in (left.filter, right.filter)]
        middle = self._mirror * head
        if left.state is right.state is State.SEEN and self._doubt.exchange(places[0], places[1], face, seconds):
            self.parts.reverse()
            return
        # In doubt, exchanged as it seems, and on the other hand's side of the head: nothing is claimed.
        exchanged = self._doubt.doubtful and places[0][0] < places[1][0]
        for hand, place, outwards in ((left, places[0], 1), (right, places[1], -1)):
            if exchanged and hand.state is State.SEEN and outwards * (place[0] - middle[0]) < 0:
                hand.doubt()

    def _find_resting(self, retina: BackProjection, head: Floats, face: float, seconds: float) -> None:
        missing = [row for row in (LEFT, RIGHT) if self.parts[row].state is State.MISSING]
        if not missing:
            return
        skin = retina.blobs([_ellipse(head, face)], HAND[0] * face**2, HAND[1] * face**2, backdrop=True)
        taken = [part.filter.centre for part in self.parts if part.filter is not None]
        for side, patch in self._resting.update(skin, head, face, seconds).items():
            row = RIGHT if side * self._mirror[0] < 0 else LEFT
            if row in missing and _apart_from(patch.centre, taken, face):
                self._acquire(row, patch, face)

    def _find(self, pieces: Sequence[SkinPatch], head: Floats, face: float) -> None:
        free = [row for row in (LEFT, RIGHT) if self._is_free(row, face)]
        taken = [part.filter.centre for part in self.parts if part.filter is not None and part.state is State.SEEN]
        pieces = [p for p in pieces if _apart_from(p.centre, taken, 0.7 * face)]
        hands = self._acquisition.update(pieces, face)[: max(len(free), 1)]
        if len(hands) == 2:
            for row, index in self._name_two(hands).items():
                self._acquire(row, hands[index], face)
        elif hands and not self._take_over(hands[0], head, face) and free:
            self._name_one(hands[0], free, head, face)

    def _name_two(self, hands: Sequence[SkinPatch]) -> dict[int, int]:
        """As they are expected, while that is known; else by their sides."""
        left, right = (part.filter for part in self.parts)
        if left is None or right is None:
            return name_two([self._mirror * p.centre for p in hands])
        away = [[float(np.hypot(*(kf.centre - p.centre))) for p in hands] for kf in (left, right)]
        first = int(away[0][0] + away[1][1] > away[0][1] + away[1][0])
        return {LEFT: first, RIGHT: 1 - first}

    def _is_free(self, row: int, face: float) -> bool:
        """Not seen, and not just passing behind the other hand, from where its filter will take it."""
        part, other = self.parts[row].filter, self.parts[LEFT + RIGHT - row].filter
        if self.parts[row].lost or part is None or other is None:
            return self.parts[row].state is not State.SEEN
        return self.parts[row].state is not State.SEEN and _apart_from(part.centre, [other.centre], 2 * face)

    def _take_over(self, hand: SkinPatch, head: Floats, face: float) -> bool:
        """What moves is the hand of its side, where the one that was thought to be that hand keeps still."""
        row = name_first(self._mirror * hand.centre, self._mirror * head, 0.6 * face)
        if row is None or self.parts[row].state is not State.SEEN:
            return False
        known = self.parts[row].filter
        if known is None or float(np.hypot(*known.velocity)) > STILL * face:
            return False
        self._acquire(row, hand, face)
        return True

    def _name_one(self, hand: SkinPatch, free: Sequence[int], head: Floats, face: float) -> None:
        place, middle, margin = self._mirror * hand.centre, self._mirror * head, 0.6 * face
        if len(free) == 2:
            row = name_first(place, middle, margin)
        else:
            other = LEFT + RIGHT - free[0]
            known = self.parts[other].filter
            if known is None:
                return
            believe, exchange = name_second(place, self._mirror * known.centre, other, middle, margin)
            if exchange:
                self.parts.reverse()
            row = (other if exchange else free[0]) if believe else None
        if row is not None:
            self._acquire(row, hand, face)

    def _acquire(self, row: int, hand: SkinPatch, face: float) -> None:
        self._doubt.forget()
        self.found.append(hand)
        self.parts[row].acquire(hand.centre, hand.area, face)


def _ellipse(head: Floats, face: float) -> Mask:
    return head, (HEAD_ELLIPSE[0] * face, HEAD_ELLIPSE[1] * face)


def _outside(centre: Floats, head: Floats, face: float) -> bool:
    away = (centre - head) / (HEAD_ELLIPSE[0] * face, HEAD_ELLIPSE[1] * face)
    return bool(away @ away > 1)


def _cost(part: TrackedPart, patch: SkinPatch, face: float) -> float:
    """Squared Mahalanobis distance; beyond any gate where the patch is too large, too small or too far."""
    if part.filter is None or not part.fits(patch.area):
        return NEVER
    away = patch.centre - part.filter.centre
    squared = float(away @ away)
    return squared / part.filter.variance if squared < (FURTHEST * face) ** 2 else NEVER


def _distinct(patches: Sequence[SkinPatch]) -> list[SkinPatch]:
    """Two windows that came to rest on the same skin are one hand: the other is hidden or lost."""
    kept: list[SkinPatch] = []
    for patch in patches:
        if _apart_from(patch.centre, [p.centre for p in kept], 0.7 * float(np.sqrt(patch.area))):
            kept.append(patch)
    return kept


def _apart_from(centre: Floats, others: Sequence[Floats], distance: float) -> bool:
    return all(float(np.hypot(*(centre - other))) > distance for other in others)
