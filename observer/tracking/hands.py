"""The two hands from frame to frame: measurement, assignment, left and right, and reacquisition."""

from collections.abc import Sequence

import numpy as np

from observer.tracking.back_projection import BackProjection, Mask
from observer.tracking.kalman import (
    GATE,
    HAND_ACCELERATION,
    LEFT,
    RIGHT,
    HandednessEvidence,
    TrackedPart,
    assign,
    name_first,
    name_second,
    name_two,
)
from observer.tracking.skin import HandAcquisition, RestingHands, SkinPatch
from observer.tracks import Floats, State

HAND = (0.06, 0.6)
"""Least and largest area of a new hand, squared face widths."""
HEAD_ELLIPSE = (0.55, 0.75)
"""Half axes of the head, face widths."""
MASK = 0.5
"""Half axis of the ellipse that masks a hand in the search for the other one, in sides of its square."""
GROWN = 1.4
"""New hands are searched outside a head ellipse enlarged by this factor: the neck is skin too."""
FURTHEST = 3.0
"""Farthest distance of a hand from its prediction, face widths."""
MEETING = 1.6
"""Two hands meet when their predictions are nearer than this many of their sides."""
STILL = 0.7
"""A hand slower than this is still, face widths per s."""
IMPOSSIBLE = 1e6
"""A cost beyond every gate."""


class HandTracker:
    """The left and the right hand; lengths in px, `face` is the face width."""

    def __init__(self, mirror: Floats) -> None:
        """mirror: (2,) factor applied to centres before sides are named; u is negated for a person seen from behind."""
        self.parts = [TrackedPart(HAND_ACCELERATION), TrackedPart(HAND_ACCELERATION)]
        self.acquired: list[SkinPatch] = []
        self._acquisition, self._resting = HandAcquisition(), RestingHands()
        self._handedness, self._mirror = HandednessEvidence(), mirror

    def predict(self, seconds: float) -> None:
        """Predict where both hands are so many seconds later."""
        for part in self.parts:
            part.predict(seconds)

    def masks(self, but: int | None = None) -> list[Mask]:
        """Ellipses about the hands except `but`, to be ignored in the search for other parts."""
        return [
            (part.filter.centre, (MASK * part.side, MASK * part.side))
            for row, part in enumerate(self.parts)
            if row != but and part.filter is not None
        ]

    def follow(self, image: BackProjection, head: Floats, face: float, seconds: float, findable: bool) -> None:
        """Process one frame. head: (2,) last centre. findable: the head is tracked, so new hands can be named."""
        self.acquired = []
        pieces = image.blobs([_ellipse(head, face)], HAND[0] * face**2 / 2, HAND[1] * face**2)
        patches = [*self._measured(image, head, face), *pieces]
        patches = self._unmerged(_distinct(patches))
        self._assign(patches, face, seconds)
        self._check_names(head, face, seconds)
        if findable:
            self._acquire_resting(image, head, face, seconds)
            self._acquire_moving([p for p in pieces if _outside(p.centre, head, GROWN * face)], head, face, seconds)
        else:
            self._acquisition = HandAcquisition()

    def _measured(self, image: BackProjection, head: Floats, face: float) -> list[SkinPatch]:
        """CAMshift from the prediction of each hand; none when the hands meet, since each would attract the other's."""
        patches: list[SkinPatch] = []
        if self._meeting():
            return patches
        for row, part in enumerate(self.parts):
            if part.filter is None:
                continue
            wide = min(part.side + 2 * float(np.sqrt(part.filter.variance)), FURTHEST * face)
            masks = [_ellipse(head, face), *self.masks(row)]
            patch = image.camshift(part.filter.centre, part.side, wide, masks)
            if patch is not None:
                patches.append(patch)
        return patches

    def _meeting(self) -> bool:
        left, right = self.parts
        if left.filter is None or right.filter is None:
            return False
        return float(np.hypot(*(left.filter.centre - right.filter.centre))) < MEETING * max(left.side, right.side)

    def _unmerged(self, patches: list[SkinPatch]) -> list[SkinPatch]:
        """When the hands meet and only one patch is there, it is both hands and measures neither: drop it."""
        left, right = (part.filter for part in self.parts)
        if left is None or right is None or not self._meeting():
            return patches
        near = MEETING * max(part.side for part in self.parts)
        middle = (left.centre + right.centre) / 2
        merged = [patch for patch in patches if float(np.hypot(*(patch.centre - middle))) < near]
        if len(merged) > 1:
            return patches
        self._handedness.add_merge()
        return [patch for patch in patches if all(patch is not other for other in merged)]

    def _assign(self, patches: Sequence[SkinPatch], face: float, seconds: float) -> None:
        known = [part for part in self.parts if part.filter is not None]
        cost = np.array([[_cost(part, patch, face) for patch in patches] for part in known]).reshape(
            len(known), len(patches)
        )
        columns = assign(cost, GATE)
        if len(known) == 2:
            self._handedness.add_assignment(cost, columns)
        for part, column in zip(known, columns, strict=True):
            if column is None:
                part.not_measured(seconds)
            else:
                part.measured(patches[column].centre, patches[column].area)

    def _check_names(self, head: Floats, face: float, seconds: float) -> None:
        left, right = self.parts
        if left.filter is None or right.filter is None:
            return
        centres = [self._mirror * kf.centre for kf in (left.filter, right.filter)]
        middle = self._mirror * head
        if left.state is right.state is State.SEEN and self._handedness.exchange(centres[0], centres[1], face, seconds):
            self.parts.reverse()
            return
        # Doubtful, apparently exchanged, and on the other hand's side of the head: unsure rather than wrong.
        exchanged = self._handedness.doubtful and centres[0][0] < centres[1][0]
        for hand, centre, outwards in ((left, centres[0], 1), (right, centres[1], -1)):
            if exchanged and hand.state is State.SEEN and outwards * (centre[0] - middle[0]) < 0:
                hand.doubt()

    def _acquire_resting(self, image: BackProjection, head: Floats, face: float, seconds: float) -> None:
        missing = [row for row in (LEFT, RIGHT) if self.parts[row].state is State.MISSING]
        if not missing:
            return
        skin = image.blobs([_ellipse(head, face)], HAND[0] * face**2, HAND[1] * face**2, include_background=True)
        occupied = [part.filter.centre for part in self.parts if part.filter is not None]
        for side, patch in self._resting.update(skin, head, face, seconds).items():
            row = RIGHT if side * self._mirror[0] < 0 else LEFT
            if row in missing and _is_apart(patch.centre, occupied, face):
                self._acquire(row, patch, face)

    def _acquire_moving(self, pieces: Sequence[SkinPatch], head: Floats, face: float, seconds: float) -> None:
        free = [row for row in (LEFT, RIGHT) if self._is_free(row, face)]
        occupied = [p.filter.centre for p in self.parts if p.filter is not None and p.state is State.SEEN]
        pieces = [p for p in pieces if _is_apart(p.centre, occupied, 0.7 * face)]
        hands = self._acquisition.update(pieces, face, seconds)[: max(len(free), 1)]
        if len(hands) == 2:
            for row, index in self._name_two(hands).items():
                self._acquire(row, hands[index], face)
        elif hands and not self._take_over(hands[0], head, face) and free:
            self._name_one(hands[0], free, head, face)

    def _name_two(self, hands: Sequence[SkinPatch]) -> dict[int, int]:
        """By the predictions of the two filters while both exist, else by their sides."""
        left, right = (part.filter for part in self.parts)
        if left is None or right is None:
            return name_two([self._mirror * p.centre for p in hands])
        distances = [[float(np.hypot(*(kf.centre - p.centre))) for p in hands] for kf in (left, right)]
        first = int(distances[0][0] + distances[1][1] > distances[0][1] + distances[1][0])
        return {LEFT: first, RIGHT: 1 - first}

    def _is_free(self, row: int, face: float) -> bool:
        """Whether the hand is not seen and not just passing behind the other hand, where its filter bridges the gap."""
        part, other = self.parts[row].filter, self.parts[LEFT + RIGHT - row].filter
        if self.parts[row].lost or part is None or other is None:
            return self.parts[row].state is not State.SEEN
        return self.parts[row].state is not State.SEEN and _is_apart(part.centre, [other.centre], 2 * face)

    def _take_over(self, hand: SkinPatch, head: Floats, face: float) -> bool:
        """Whether `hand`, which moves, replaces the tracked hand of its side, which is still."""
        row = name_first(self._mirror * hand.centre, self._mirror * head, 0.6 * face)
        if row is None or self.parts[row].state is not State.SEEN:
            return False
        known = self.parts[row].filter
        if known is None or float(np.hypot(*known.velocity)) > STILL * face:
            return False
        self._acquire(row, hand, face)
        return True

    def _name_one(self, hand: SkinPatch, free: Sequence[int], head: Floats, face: float) -> None:
        centre, middle, margin = self._mirror * hand.centre, self._mirror * head, 0.6 * face
        if len(free) == 2:
            row = name_first(centre, middle, margin)
        else:
            other = LEFT + RIGHT - free[0]
            known = self.parts[other].filter
            if known is None:
                return
            accept, exchange = name_second(centre, self._mirror * known.centre, other, middle, margin)
            if exchange:
                self.parts.reverse()
            row = (other if exchange else free[0]) if accept else None
        if row is not None:
            self._acquire(row, hand, face)

    def _acquire(self, row: int, hand: SkinPatch, face: float) -> None:
        self._handedness = HandednessEvidence()
        self.acquired.append(hand)
        self.parts[row].acquire(hand.centre, hand.area, face)


def _ellipse(head: Floats, face: float) -> Mask:
    return head, (HEAD_ELLIPSE[0] * face, HEAD_ELLIPSE[1] * face)


def _outside(centre: Floats, head: Floats, face: float) -> bool:
    offset = (centre - head) / (HEAD_ELLIPSE[0] * face, HEAD_ELLIPSE[1] * face)
    return bool(offset @ offset > 1)


def _cost(part: TrackedPart, patch: SkinPatch, face: float) -> float:
    """Squared Mahalanobis distance; IMPOSSIBLE where the patch is too large, too small or too far."""
    if part.filter is None or not part.fits(patch.area):
        return IMPOSSIBLE
    innovation = patch.centre - part.filter.centre
    squared = float(innovation @ innovation)
    return squared / part.filter.variance if squared < (FURTHEST * face) ** 2 else IMPOSSIBLE


def _distinct(patches: Sequence[SkinPatch]) -> list[SkinPatch]:
    """One patch of those that ended on the same skin: the other hand is hidden or lost."""
    distinct: list[SkinPatch] = []
    for patch in patches:
        if _is_apart(patch.centre, [p.centre for p in distinct], 0.7 * float(np.sqrt(patch.area))):
            distinct.append(patch)
    return distinct


def _is_apart(centre: Floats, others: Sequence[Floats], distance: float) -> bool:
    return all(float(np.hypot(*(centre - other))) > distance for other in others)
