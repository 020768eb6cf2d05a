"""The paper's tracker (section V.A): skin colour, CAMshift and one Kalman filter per body part."""

from collections.abc import Sequence

import cv2
import numpy as np

from common.errors import BadInput
from observer.tracking.back_projection import SKIN, BackProjection, PixelRect, shrunk, step_for
from observer.tracking.background_model import ForegroundDetector, SkinBackground
from observer.tracking.hands import HandTracker
from observer.tracking.head import DOUBTED_S, LOST_S, WHY_NOT, Box, FaceFinder, HeadTracker, have_cascade, middle
from observer.tracking.kalman import HEAD_ACCELERATION, TrackedPart
from observer.tracking.skin import Picture, SkinHistogram
from observer.tracks import BODY_PARTS, Floats, Frame, State, Tracks

PATIENCE_S = 5.0
"""So long no face may be found before anybody is told; and so long what was told stands."""
DARK = 40.0
"""Mean of a picture, 0 to 255, under which hues are noise."""
COVERED = 0.2
"""Where more of the picture has the colour of a face, either is none, or nothing can be told by colour."""
NARROW_PX = 24.0
"""A hand of a face narrower than this is about a dozen pixels wide."""


def explain_loss(unfound_s: float, brightness: float, covered: float, face_px: float | None) -> str:
    """One line, or "" when all is well.

    unfound_s: for how long no face was found. brightness: the picture's mean, 0 to 255. covered: share of the picture
    in the colour of the face found last, 0 to 1. face_px: its width, None before the first.
    """
    if unfound_s < PATIENCE_S:
        if face_px is not None and face_px < NARROW_PX:
            return f'the face is {face_px:.0f} px wide: nearer, a larger picture, or tracker = "mediapipe"'
        return ""
    lost = f"no face found for {PATIENCE_S:.0f} s"
    if brightness < DARK:
        return f'{lost}: the picture is dark (mean {brightness:.0f} of 255); more light, or tracker = "mediapipe"'
    if covered >= COVERED:
        return f'{lost}: skin colour covers {covered:.0%} of the picture; another wall, or tracker = "mediapipe"'
    return f'{lost}: face the camera, come nearer, or tracker = "mediapipe"'


class TrackingAdvice:
    """Keeps the line while nothing new is to be said."""

    def __init__(self) -> None:
        self.complaint, self._unfound_s, self._stood_s = "", 0.0, PATIENCE_S

    def update(self, followed: bool, face_px: float | None, covered: float, small: Picture, seconds: float) -> None:
        """After each frame; followed: whether there is a head now; small: the picture, of any size."""
        self._unfound_s = 0.0 if followed else self._unfound_s + seconds
        self._stood_s += seconds
        well = followed and (face_px is None or face_px >= NARROW_PX)
        if well:
            self.complaint, self._stood_s = "", PATIENCE_S
        elif self._stood_s >= PATIENCE_S:
            said = explain_loss(self._unfound_s, float(small[::8, ::8].mean()), covered, face_px)
            self.complaint, self._stood_s = said, 0.0 if said else PATIENCE_S


SHORT_SIDE = 240
"""Until a face is found pictures are looked at about so large."""
SIDEWAYS = 0.5
"""A person turned further away than this (cosine) shows one hand before the other: their names are not told."""
REACH = (5.5, 6.0, 1.0)
"""Half width and height of what hands can reach, and how far its middle is below the head, face widths."""


class CamshiftTracker:
    """A `observer.tracks.Tracker` of pictures (H, W, 3) uint8 BGR; centres in px of the picture given.

    skin: a saved histogram, else it is learned from the face. face_region: (x, y, width, height) px of the face in the
    first picture, for an OpenCV without cascade or a face that it does not find. BadInput where there is neither.
    facing: 1 where the person faces the camera, -1 where his back is seen, between from the side
    (`observer.geometry.views.facing`): which hand is which is told by it, and from the side not at all.
    """

    def __init__(self, skin: SkinHistogram | None = None, face_region: Box | None = None, facing: float = 1.0) -> None:
        if face_region is None and skin is None and not have_cascade():
            raise BadInput(WHY_NOT)
        self._head = HeadTracker(FaceFinder() if have_cascade() else None, skin, away=facing < 0)
        self._region = face_region
        self._hands, self._head_part = (
            HandTracker(np.array([-1.0 if facing < 0 else 1.0, 1.0])),
            TrackedPart(HEAD_ACCELERATION),
        )
        self._nameless = abs(facing) < SIDEWAYS
        self._motion, self._backdrop, self._hint = ForegroundDetector(), SkinBackground(), TrackingAdvice()
        self._step: int | None = None
        self._covered = 0.0
        self._before_ns: int | None = None
        self._head_at: Floats | None = None

    @property
    def body_parts(self) -> Sequence[str]:
        """left_hand, right_hand, head: the person's own left and right, who faces an unmirrored camera."""
        return BODY_PARTS

    @property
    def skin(self) -> SkinHistogram | None:
        """The histogram as it is now, to be saved; None until a face taught one."""
        return self._head.skin

    @property
    def complaint(self) -> str:
        """Why little can be made out, and what would help; "" when all is well."""
        return self._hint.complaint

    def update(self, frame: Frame) -> Tracks:
        """Centres (3, 2) px in the newest picture, NaN for a part that is not seen; BadInput for what is no picture."""
        picture = _checked(frame.content)
        seconds = 0.0 if self._before_ns is None else min(max((frame.at_ns - self._before_ns) / 1e9, 0.0), 1.0)
        self._before_ns = frame.at_ns
        self._hands.predict(seconds)
        self._head_part.predict(seconds)
        self._find_head(picture, seconds)
        step = self._step_now(picture)
        small = shrunk(picture, step)
        self._hint.update(self._head_part.filter is not None, self._head.face, self._covered, small, seconds)
        moved, fresh = self._motion.update(small, seconds, self._seen(step))
        skin, face, at = self._head.skin, self._head.face, self._head_at
        if skin is not None and face is not None and at is not None:
            region = _reach(at, face, step, small.shape)
            retina = BackProjection.of(
                small, step, skin, (moved, fresh, self._backdrop.stale(region, small.shape)), region
            )
            at = self._follow_head(retina, at, face, seconds)
            self._hands.follow(retina, at, face, seconds, self._head_part.filter is not None)
            self._learn_backdrop(retina, seconds)
            self._adapt(picture, small, step, seconds)
        return self._tracks()

    def _tracks(self) -> Tracks:
        parts = (*self._hands.parts, self._head_part)
        seen, unsure = (np.array([_centre(part, state) for part in parts]) for state in (State.SEEN, State.UNSURE))
        if self._nameless:
            unsure[:2] = np.where(np.isfinite(seen[:2]), seen[:2], unsure[:2])
            seen[:2] = np.nan
        return Tracks(seen, unsure)

    def _step_now(self, picture: Picture) -> int:
        """Pixels to one that is looked at; kept while it about fits, since the background begins anew with another."""
        if self._head.face is None:
            return max(1, int(min(picture.shape[:2])) // SHORT_SIDE)
        wanted = step_for(self._head.face)
        if self._step is None or abs(wanted - self._step) > 0.4 * self._step:
            self._step = wanted
        return self._step

    def _seen(self, step: int) -> list[tuple[Floats, float]]:
        parts = (*self._hands.parts, self._head_part)
        return [
            (p.filter.centre / step, p.side / step) for p in parts if p.filter is not None and p.state is State.SEEN
        ]

    def _find_head(self, picture: Picture, seconds: float) -> None:
        head = self._head_part
        if self._region is not None:
            marked, self._region = self._region, None
            self._start_head(picture, marked, marked=True)
            return
        box = self._head.look(picture, None if head.filter is None else head.filter.centre, seconds)
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
        if mass > 0.1 * w * h and (marked or self._covered < COVERED):
            self._head_part.acquire(middle(box), mass, float(w))
            self._head_at = middle(box)

    def _follow_head(self, retina: BackProjection, at: Floats, face: float, seconds: float) -> Floats:
        """(2,) px: where it is, or where it was last, `at`."""
        head = self._head_part
        if head.filter is None:
            return at
        wide = min(head.side + 2 * float(np.sqrt(head.filter.variance)), 3 * face)
        found = retina.camshift(head.filter.centre, head.side, wide, self._hands.masks(), head=True)
        if found is not None and head.fits(found.area) and head.expects(found.centre):
            head.measured(found.centre, found.area)
            self._head_at = at = head.filter.centre.copy()
        else:
            head.not_measured(seconds)
        strayed_s = 0.0 if head.filter is None else self._head.strayed_s(head.filter.centre)
        if strayed_s > LOST_S:
            head.lose()
        elif strayed_s > DOUBTED_S and head.state is State.SEEN:
            head.doubt()
        return at

    def _learn_backdrop(self, retina: BackProjection, seconds: float) -> None:
        step = retina.step
        parts = [
            (p.filter.centre / step, p.side / step)
            for p in (*self._hands.parts, self._head_part)
            if p.filter is not None
        ]
        self._backdrop.learn(retina.skin, retina.region, seconds, parts)
        for patch in self._hands.found:
            self._backdrop.clear(patch.centre / step, float(np.sqrt(patch.area)) / step)

    def _adapt(self, picture: Picture, small: Picture, step: int, seconds: float) -> None:
        """Now and then, from a head that is seen and has no hand before it."""
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


def _checked(content: Picture) -> Picture:
    if content.ndim != 3 or content.shape[2] != 3 or content.dtype != np.uint8 or min(content.shape[:2]) < 16:
        raise BadInput(
            f"picture {content.shape} of {content.dtype}: (H, W, 3) of uint8 in the order blue, green, red is expected,"
            " 16 px or more each way"
        )
    return content
