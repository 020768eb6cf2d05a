"""The paper's tracker (section V.A): skin colour, CAMshift and one Kalman filter per body part."""

from collections.abc import Sequence

import cv2
import numpy as np

from common.errors import BadInput
from observer.tracking.back_projection import (
    SKIN,
    BackProjection,
    ForegroundDetector,
    PixelRect,
    SkinBackground,
    shrunk,
    step_for,
)
from observer.tracking.hands import HandTracker
from observer.tracking.head import DOUBTED_S, LOST_S, NO_CASCADE, Box, FaceFinder, HeadTracker, have_cascade, middle
from observer.tracking.kalman import HEAD_ACCELERATION, TrackedPart
from observer.tracking.skin import Picture, SkinHistogram
from observer.tracks import BODY_PARTS, Floats, Frame, State, Tracks, require_picture

ADVISE_AFTER_S = 5.0
"""Time without a face before advice is given, and least time for which an advice stands."""
DARK = 40.0
"""Mean of a picture (0 to 255) below which hues are noise."""
COVERED_SHARE = 0.2
"""If more of the picture has the colour of a face, the face is false or colour is no cue in this room."""
NARROW_PX = 24.0
"""With a face narrower than this, a hand is about a dozen pixels wide."""


def explain_loss(lost_s: float, brightness: float, covered: float, face_px: float | None) -> str:
    """Why the tracker does not suit the picture and what would help, in one line; "" when it suits.

    lost_s: time without a face. brightness: mean of the picture, 0 to 255. covered: share of the picture in the colour
    of the last face, 0 to 1. face_px: its width, None before the first.
    """
    if lost_s < ADVISE_AFTER_S:
        if face_px is not None and face_px < NARROW_PX:
            return f'the face is only {face_px:.0f} px wide: come nearer, use larger pictures, or tracker = "mediapipe"'
        return ""
    lost = f"no face found for {ADVISE_AFTER_S:.0f} s"
    if brightness < DARK:
        return f'{lost}: the picture is dark (mean {brightness:.0f} of 255); add light, or use tracker = "mediapipe"'
    if covered >= COVERED_SHARE:
        share = f"skin colour covers {covered:.0%} of the picture"
        return f'{lost}: {share}; change the background, or use tracker = "mediapipe"'
    return f'{lost}: face the camera, come nearer, or use tracker = "mediapipe"'


class TrackingAdvice:
    """Holds the current advice in `complaint`, and changes it at most every ADVISE_AFTER_S."""

    def __init__(self) -> None:
        self.complaint, self._lost_s, self._stood_s = "", 0.0, ADVISE_AFTER_S

    def update(self, followed: bool, face_px: float | None, covered: float, small: Picture, seconds: float) -> None:
        """Process one frame. followed: whether a head is tracked. small: the picture, of any size."""
        self._lost_s = 0.0 if followed else self._lost_s + seconds
        self._stood_s += seconds
        if followed and (face_px is None or face_px >= NARROW_PX):
            self.complaint, self._stood_s = "", ADVISE_AFTER_S
        elif self._stood_s >= ADVISE_AFTER_S:
            self.complaint = explain_loss(self._lost_s, float(small[::8, ::8].mean()), covered, face_px)
            self._stood_s = 0.0 if self.complaint else ADVISE_AFTER_S


PICTURE_LEAST_PX = 16
"""Least width and height of a picture."""
SEARCH_SIDE_PX = 240
"""Until a face is found, pictures are reduced to about this shorter side, px."""
SIDEWAYS = 0.5
"""Cosine of the turn beyond which one hand hides the other: then left and right are not distinguished."""
REACH = (5.5, 6.0, 1.0)
"""Half width and half height of the region that hands reach, and how far its middle is below the head, face widths."""


class CamshiftTracker:
    """A `Tracker` of pictures (H, W, 3) uint8 BGR; centres in px of the picture.

    skin: a saved histogram; None learns it from the face. face_region: (x, y, width, height) px of the face in the
    first picture, for an OpenCV without cascade or a face that it does not find. facing: 1 for a person who faces the
    camera, -1 for one seen from behind, between from the side (`observer.geometry.views.facing`); it decides which
    hand is which, and from the side they stay unnamed. Raises BadInput without cascade, skin and face region.
    """

    body_parts: Sequence[str] = BODY_PARTS
    """left_hand, right_hand, head: left and right of the person, seen by a camera that does not mirror."""

    def __init__(self, skin: SkinHistogram | None = None, face_region: Box | None = None, facing: float = 1.0) -> None:
        if face_region is None and skin is None and not have_cascade():
            raise BadInput(NO_CASCADE)
        self._head = HeadTracker(FaceFinder() if have_cascade() else None, skin, away=facing < 0)
        self._region = face_region
        self._hands = HandTracker(np.array([-1.0 if facing < 0 else 1.0, 1.0]))
        self._head_part = TrackedPart(HEAD_ACCELERATION)
        self._unnamed = abs(facing) < SIDEWAYS
        self._foreground, self._background, self._advice = ForegroundDetector(), SkinBackground(), TrackingAdvice()
        self._step: int | None = None
        self._covered = 0.0
        self._before_ns: int | None = None
        self._head_at: Floats | None = None

    @property
    def skin(self) -> SkinHistogram | None:
        """The current histogram, e.g. to be saved; None until it was learned from a face."""
        return self._head.skin

    @property
    def complaint(self) -> str:
        """Why the tracker finds little, and what would help; "" when all is well."""
        return self._advice.complaint

    def update(self, frame: Frame) -> Tracks:
        """Centres (3, 2) px in the newest picture, NaN for a part not seen; BadInput for a wrong shape or type."""
        picture = require_picture(frame.content, PICTURE_LEAST_PX)
        seconds = 0.0 if self._before_ns is None else min(max((frame.at_ns - self._before_ns) / 1e9, 0.0), 1.0)
        self._before_ns = frame.at_ns
        self._hands.predict(seconds)
        self._head_part.predict(seconds)
        self._find_head(picture, seconds)
        step = self._current_step(picture)
        small = shrunk(picture, step)
        self._advice.update(self._head_part.filter is not None, self._head.face, self._covered, small, seconds)
        masks = self._foreground.update(small, seconds, self._places(step, seen=True))
        skin, face, head = self._head.skin, self._head.face, self._head_at
        if skin is not None and face is not None and head is not None:
            region = _reach(head, face, step, small.shape)
            background = self._background.mask(region, small.shape)
            image = BackProjection.of(small, step, skin, (*masks, background), region)
            head = self._follow_head(image, head, face, seconds)
            self._hands.follow(image, head, face, seconds, self._head_part.filter is not None)
            self._learn_background(image, seconds)
            self._adapt(picture, small, step, seconds)
        return self._tracks()

    def _tracks(self) -> Tracks:
        parts = (*self._hands.parts, self._head_part)
        centres, guesses = (np.array([_centre(part, state) for part in parts]) for state in (State.SEEN, State.UNSURE))
        if self._unnamed:
            guesses[:2] = np.where(np.isfinite(centres[:2]), centres[:2], guesses[:2])
            centres[:2] = np.nan
        return Tracks(centres, guesses)

    def _current_step(self, picture: Picture) -> int:
        """The reduction of the picture; kept while it about fits, since a new one starts the background over."""
        if self._head.face is None:
            return max(1, int(min(picture.shape[:2])) // SEARCH_SIDE_PX)
        wanted = step_for(self._head.face)
        if self._step is None or abs(wanted - self._step) > 0.4 * self._step:
            self._step = wanted
        return self._step

    def _places(self, step: int, *, seen: bool) -> list[tuple[Floats, float]]:
        """Centre and side of the parts that are followed, or only of those that are seen, px of the reduced picture."""
        parts = ((p, p.filter) for p in (*self._hands.parts, self._head_part) if p.state is State.SEEN or not seen)
        return [(known.centre / step, part.side / step) for part, known in parts if known is not None]

    def _find_head(self, picture: Picture, seconds: float) -> None:
        head = self._head_part
        if self._region is not None:
            marked, self._region = self._region, None
            self._start_head(picture, marked, marked=True)
            return
        box = self._head.search(picture, None if head.filter is None else head.filter.centre, seconds)
        if box is None:
            return
        if head.filter is None:
            self._start_head(picture, box)
        else:
            self._head.widen(box[2])
            self._head.confirm(box)
            head.filter.correct(middle(box))

    def _start_head(self, picture: Picture, box: Box, marked: bool = False) -> None:
        if not self._head.begin(picture, box) or self._head.skin is None:
            return
        x, y, w, h = (max(n, 0) for n in box)
        back = self._head.skin.back_project(picture)
        mass = float(back[y : y + h, x : x + w].sum()) / 255
        self._covered = cv2.countNonZero(cv2.threshold(back, SKIN, 255, cv2.THRESH_BINARY)[1]) / back.size
        if mass > 0.1 * w * h and (marked or self._covered < COVERED_SHARE):
            self._head_part.acquire(middle(box), mass, float(w))
            self._head_at = middle(box)

    def _follow_head(self, image: BackProjection, last: Floats, face: float, seconds: float) -> Floats:
        """(2,) px: the head's centre, or `last` while it is not measured."""
        head = self._head_part
        if head.filter is None:
            return last
        wide = min(head.side + 2 * float(np.sqrt(head.filter.variance)), 3 * face)
        patch = image.camshift(head.filter.centre, head.side, wide, self._hands.masks(), head=True)
        if patch is not None and head.fits(patch.area) and head.expects(patch.centre):
            head.measured(patch.centre, patch.area)
            self._head_at = last = head.filter.centre.copy()
        else:
            head.not_measured(seconds)
        strayed_s = 0.0 if head.filter is None else self._head.strayed_s(head.filter.centre)
        if strayed_s > LOST_S:
            head.lose()
        elif strayed_s > DOUBTED_S and head.state is State.SEEN:
            head.doubt()
        return last

    def _learn_background(self, image: BackProjection, seconds: float) -> None:
        step = image.step
        self._background.learn(image.skin, image.region, seconds, self._places(step, seen=False))
        for patch in self._hands.acquired:
            self._background.clear(patch.centre / step, float(np.sqrt(patch.area)) / step)

    def _adapt(self, picture: Picture, small: Picture, step: int, seconds: float) -> None:
        """Adapt the skin histogram from a head that is seen and has no hand in front of it."""
        head, face = self._head_part, float(self._head.face or 0)
        if head.filter is None or head.state is not State.SEEN:
            return
        hands = [part.filter.centre for part in self._hands.parts if part.filter is not None]
        if all(np.linalg.norm(hand - head.filter.centre) > 1.5 * face for hand in hands):
            self._head.adapt(picture, small, step, head.filter.centre, seconds)


def _centre(part: TrackedPart, state: State) -> Floats:
    return part.filter.centre if part.filter is not None and part.state is state else np.full(2, np.nan)


def _reach(head: Floats, face: float, step: int, shape: tuple[int, ...]) -> PixelRect:
    width, height, below = (share * face / step for share in REACH)
    return PixelRect.around(head / step + (0.0, below), (width, height), shape)
