"""The paper's tracker (section V.A): skin colour and CAMshift, one filter a part, and honest about what it loses."""

from collections.abc import Sequence

import cv2
import numpy as np

from common.errors import BadInput
from observer.tracking.acquisition import Acquisition
from observer.tracking.assignment import GATE, assign, squared_distances
from observer.tracking.face import WHY_NOT, Box, FaceFinder, have_cascade
from observer.tracking.head import Head, middle
from observer.tracking.motion import Motion
from observer.tracking.part import HAND_ACCELERATION, HEAD_ACCELERATION, Part
from observer.tracking.patch import Patch
from observer.tracking.sides import HEAD, LEFT, RIGHT, Doubt, name_first, name_second, name_two
from observer.tracking.skin import Picture, Skin
from observer.tracking.window import Region, blobs, camshift, erase
from observer.tracks import BODY_PARTS, Floats, Frame, State, Tracks

SHORT_SIDE_PX = 480
"""Larger pictures are worked on at this size."""
HAND = (0.08, 1.0)
"""Areas of a new hand, squared face widths."""
REACH = (5.0, 5.5)
"""Half width and height about the head within which new hands are looked for, face widths."""
SKIN_TONED = 0.2
"""Share of the surroundings in skin colour that stands still, from which on only what moves counts."""
HEAD_ELLIPSE = (0.55, 0.75)
"""Half axes of the head, face widths."""
FOREGROUND = 0.3
"""Least share of a hand's window that differs from the background: a shelf has skin colour, but was always there."""
HANDS = (LEFT, RIGHT)


class CamshiftTracker:
    """A `observer.tracks.Tracker` of pictures (H, W, 3) uint8 BGR; centres in px of the picture given.

    skin: a saved histogram, else it is learned from the face. face_region: (x, y, width, height) px of the face in the
    first picture, for an OpenCV without cascade or a face that it does not find. BadInput where there is neither.
    """

    def __init__(self, skin: Skin | None = None, face_region: Box | None = None) -> None:
        if face_region is None and not have_cascade():
            raise BadInput(WHY_NOT)
        self._head = Head(FaceFinder() if have_cascade() else None, skin)
        self._region = face_region
        self._parts = (Part(HAND_ACCELERATION), Part(HAND_ACCELERATION), Part(HEAD_ACCELERATION))
        self._motion, self._acquisition = Motion(), Acquisition()
        self._doubt = Doubt()
        self._before_ns: int | None = None
        self._head_at: Floats | None = None
        self._frames = 0

    @property
    def body_parts(self) -> Sequence[str]:
        """left_hand, right_hand, head: the person's own left and right, who faces an unmirrored camera."""
        return BODY_PARTS

    @property
    def skin(self) -> Skin | None:
        """The histogram as it is now, to be saved; None until a face taught one."""
        return self._head.skin

    def update(self, frame: Frame) -> Tracks:
        """Centres (3, 2) px in the newest picture, NaN for a part that is not seen; BadInput for what is no picture."""
        picture, scale = _working(frame.content)
        seconds = 0.0 if self._before_ns is None else min(max((frame.at_ns - self._before_ns) / 1e9, 0.0), 1.0)
        self._before_ns = frame.at_ns
        self._frames += 1
        moved, foreground = self._motion.update(picture, seconds, self._seen())
        for part in self._parts:
            part.predict(seconds)
        self._find_head(picture, scale)
        if self._head.skin is not None and self._head.face:
            self._follow_head(picture, foreground, seconds)
            self._follow_hands(picture, foreground, seconds)
            self._find_hands(picture, foreground, moved)
            self._adapt(picture)
        return Tracks(
            np.array([_centre(part, State.SEEN) for part in self._parts]) / scale,
            np.array([_centre(part, State.UNSURE) for part in self._parts]) / scale,
        )

    def _seen(self) -> list[tuple[Floats, float]]:
        return [(p.filter.centre, p.side) for p in self._parts if p.filter is not None and p.state is State.SEEN]

    def _find_head(self, picture: Picture, scale: float) -> None:
        head = self._parts[HEAD]
        if self._region is not None:
            x, y, w, h = (round(n * scale) for n in self._region)
            self._region = None
            self._start_head(picture, (x, y, w, h))
            return
        box = self._head.look(picture, None if head.filter is None else head.filter.centre)
        if box is None:
            return
        if head.filter is None:
            self._start_head(picture, box)
        else:
            self._head.widen(box[2])
            head.filter.correct(middle(box))

    def _start_head(self, picture: Picture, box: Box) -> None:
        if not self._head.begin(picture, box) or self._head.skin is None:
            return
        x, y, w, h = (max(n, 0) for n in box)
        mass = float(self._head.skin.back_project(picture[y : y + h, x : x + w]).sum()) / 255
        if mass > 0.1 * w * h:
            self._parts[HEAD].acquire(middle(box), mass, float(w))

    def _back(self, picture: Picture, foreground: Picture, region: Region, always_moving: bool) -> Picture:
        """Back-projection of a region; against skin-toned surroundings only of what is foreground."""
        assert self._head.skin is not None  # noqa: S101 - for the type checker: update asks first
        back = self._head.skin.back_project(region.cut(picture))
        if always_moving or float(((back > 110) & (region.cut(foreground) == 0)).mean()) > SKIN_TONED:
            back = cv2.bitwise_and(back, region.cut(foreground))
        return back

    def _mask_others(self, back: Picture, region: Region, but: int, grow: float = 1.0) -> None:
        for row, part in enumerate(self._parts):
            if row == but or part.filter is None:
                continue
            if row == HEAD:
                face = grow * float(self._head.face or 0)
                half = (HEAD_ELLIPSE[0] * face, HEAD_ELLIPSE[1] * face)
            else:
                half = (grow * 0.7 * part.side, grow * 0.7 * part.side)
            erase(back, part.filter.centre - region.origin, half)

    def _look(self, picture: Picture, foreground: Picture, row: int) -> list[Patch]:
        """What may be this part around its predicted place, in px of the picture; CAMshift's first."""
        part, face = self._parts[row], float(self._head.face or 0)
        if part.filter is None:
            return []
        wide = min(part.side + 2 * float(np.sqrt(part.filter.spread.trace() / 2)), 3 * face)
        region = Region.around(part.filter.centre, (wide, wide), picture.shape)
        back = self._back(picture, foreground, region, always_moving=False)
        self._mask_others(back, region, row)
        found = camshift(back, part.filter.centre - region.origin, part.side)
        patches = [] if found is None else [found]
        if row != HEAD:
            patches += blobs(back, region.cut(foreground), 0.5 * part.area, 2 * part.area)
        patches = [Patch(p.centre + region.origin, p.area) for p in patches if part.fits(p.area)]
        return patches if row == HEAD else [p for p in patches if self._may_be_hand(p, foreground)]

    def _may_be_hand(self, patch: Patch, foreground: Picture) -> bool:
        half, face = float(np.sqrt(patch.area)) / 2, float(self._head.face or 0)
        window = Region.around(patch.centre, (half, half), foreground.shape).cut(foreground)
        away = np.zeros(2) if self._head_at is None else np.abs(patch.centre - self._head_at)
        return float((window > 0).mean()) > FOREGROUND and away[0] < REACH[0] * face and away[1] < REACH[1] * face

    def _follow_head(self, picture: Picture, foreground: Picture, seconds: float) -> None:
        head = self._parts[HEAD]
        self._assign((HEAD,), self._look(picture, foreground, HEAD), seconds)
        if head.filter is not None and head.state is State.SEEN:
            self._head_at = head.filter.centre.copy()

    def _follow_hands(self, picture: Picture, foreground: Picture, seconds: float) -> None:
        patches: list[Patch] = []
        for row in HANDS:
            for patch in self._look(picture, foreground, row):
                # Two windows that came to rest on the same skin are one hand: the other is hidden or lost.
                if all(np.linalg.norm(patch.centre - p.centre) > 0.7 * self._parts[row].side for p in patches):
                    patches.append(patch)
        self._assign(HANDS, patches, seconds)
        self._check_names()

    def _check_names(self) -> None:
        left, right = (self._parts[row] for row in HANDS)
        if left.filter is None or right.filter is None or self._head_at is None:
            return
        if left.state is right.state is State.SEEN:
            margin = float(self._head.face or 0)
            if self._doubt.exchange(left.filter.centre, right.filter.centre, self._head_at, margin):
                self._exchange_hands()
        # In doubt, exchanged as it seems, and on the other hand's side of the head: nothing is claimed.
        exchanged = self._doubt.doubtful and left.filter.centre[0] < right.filter.centre[0]
        for hand, centre, outwards in ((left, left.filter.centre, 1), (right, right.filter.centre, -1)):
            if exchanged and hand.state is State.SEEN and outwards * (centre[0] - self._head_at[0]) < 0:
                hand.doubt()

    def _exchange_hands(self) -> None:
        left, right, head = self._parts
        self._parts = (right, left, head)

    def _assign(self, rows: Sequence[int], patches: Sequence[Patch], seconds: float) -> None:
        known = [(row, kf) for row in rows if (kf := self._parts[row].filter) is not None]
        centres = np.array([p.centre for p in patches], dtype=np.float64).reshape(-1, 2)
        cost = squared_distances([(kf.centre, kf.spread) for _, kf in known], centres)
        chosen = assign(cost, GATE)
        if len(known) == 2:
            self._doubt.heard(cost, chosen)
        for (row, _), column in zip(known, chosen, strict=True):
            if column is None:
                self._parts[row].not_measured(seconds)
            else:
                self._parts[row].measured(patches[column].centre, patches[column].area)

    def _find_hands(self, picture: Picture, foreground: Picture, moved: Picture) -> None:
        free = [row for row in HANDS if self._parts[row].filter is None]
        if not free or self._head_at is None or self._parts[HEAD].filter is None:
            self._acquisition.forget()
            return
        face = float(self._head.face or 0)
        region = Region.around(self._head_at, (REACH[0] * face, REACH[1] * face), picture.shape)
        back = self._back(picture, foreground, region, always_moving=True)
        self._mask_others(back, region, -1, grow=1.4)
        found = blobs(back, region.cut(moved), HAND[0] * face**2, HAND[1] * face**2)
        patches = [Patch(p.centre + region.origin, p.area, p.moved) for p in found]
        hands = self._acquisition.update(patches, face)[: len(free)]
        if len(hands) == 2:
            for row, index in name_two([p.centre for p in hands]).items():
                self._parts[row].acquire(hands[index].centre, hands[index].area, face)
        elif hands:
            self._acquire_one(hands[0], free, 0.6 * face)

    def _acquire_one(self, hand: Patch, free: Sequence[int], margin: float) -> None:
        assert self._head_at is not None  # noqa: S101 - for the type checker: the caller asked
        row: int | None = free[0]
        other = LEFT + RIGHT - free[0]
        known = self._parts[other].filter
        if len(free) == 2:
            row = name_first(hand.centre, self._head_at, margin)
        elif known is not None:
            if self._parts[other].state is not State.SEEN:
                return  # the new hand may be the one that is only just hidden
            believe, exchange = name_second(hand.centre, known.centre, other, self._head_at, margin)
            if exchange:
                self._exchange_hands()
            row = (other if exchange else free[0]) if believe else None
        if row is not None:
            self._doubt.forget()
            self._parts[row].acquire(hand.centre, hand.area, float(self._head.face or 0))

    def _adapt(self, picture: Picture) -> None:
        """Now and then, from a head that is seen and has no hand before it."""
        head, face = self._parts[HEAD], float(self._head.face or 0)
        if self._frames % 5 or head.filter is None or head.state is not State.SEEN:
            return
        hands = [kf.centre for row in HANDS if (kf := self._parts[row].filter) is not None]
        if all(np.linalg.norm(hand - head.filter.centre) > 1.5 * face for hand in hands):
            self._head.adapt(picture, head.filter.centre)


def _centre(part: Part, state: State) -> Floats:
    return part.filter.centre if part.filter is not None and part.state is state else np.full(2, np.nan)


def _working(content: Picture) -> tuple[Picture, float]:
    if content.ndim != 3 or content.shape[2] != 3 or content.dtype != np.uint8 or min(content.shape[:2]) < 16:
        raise BadInput(
            f"picture {content.shape} of {content.dtype}: (H, W, 3) of uint8 in the order blue, green, red is expected,"
            " 16 px or more each way"
        )
    scale = min(1.0, SHORT_SIDE_PX / min(content.shape[:2]))
    if scale == 1.0:
        return content, scale
    size = (round(content.shape[1] * scale), round(content.shape[0] * scale))
    return cv2.resize(content, size, interpolation=cv2.INTER_LINEAR), scale
