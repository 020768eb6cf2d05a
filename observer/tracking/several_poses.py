"""Several people by a pose model: one crop of the picture for each person who is followed, as a tracker.

Each followed person has a copy of the model, which keeps to its own region of the picture and smooths its own
landmarks. Others are searched in the picture in which those who are followed are covered: beside a person in full view,
detectors often miss another. Who is who from picture to picture is decided in person_keeper.py.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

import cv2
import numpy as np

from observer.tracking.people import GROWTH, SPEED, STEP, Body, FollowRule, PersonModel, Pose, Rgb, area_about, distinct
from observer.tracking.person_keeper import Detection, PersonKeeper, seen_people
from observer.tracking.pose import Hand, PoseUse, landmarks_of, read_pose, require_hand
from observer.tracking.search_areas import Sweep
from observer.tracking.sides import SideKeeper
from observer.tracks import WHOLE_BODY, Frame, Tracks, require_picture

SEARCH_S, NEWCOMER_S = 0.3, 1.0
"""Time between two searches while somebody was lost or nobody is followed, and while all are followed who were seen."""
FIRST, SQUARES = 8, 2
"""Squares of the picture that a search looks at beside the whole picture: in the first picture, and later."""
COVERED_WIDTH, TALL_HEIGHTS = 0.5, 1.2
"""Width and height of what covers somebody who is followed, in their height."""
SAME_HEIGHTS = 0.25
"""Two bodies nearer than this, in heights, whose poses agree are one person, found twice."""
SAME_POSE = 0.05
"""Median distance of the landmarks of two poses that agree, in heights."""
POSE_LOST_S = 0.5
"""Who is not found for so long is searched as a new person."""


@dataclass(slots=True)
class _ModelCopy:
    """One copy of the model. body: of the person whom it follows; None: nobody. sides: keeps left and right apart."""

    model: PersonModel
    body: Body | None = None
    seen_ms: int = 0
    sides: SideKeeper = field(default_factory=SideKeeper)


class SeveralPoses(PoseUse):
    """A `Tracker` of pictures (H, W, 3) uint8 BGR that follows up to `most` people. new_model: makes a copy of a model.

    Raises BadInput for an unknown hand, and as new_model does.
    """

    body_parts: Sequence[str] = WHOLE_BODY

    def __init__(self, new_model: Callable[[], PersonModel], name: str, most: int, hand: Hand = "palm") -> None:
        require_hand(hand)
        self._rows = [landmarks_of(part, hand) for part in WHOLE_BODY]
        self._new_model, self.most = new_model, most
        self._followed = followed = [_ModelCopy(new_model())]

        def close_models() -> None:
            for one in followed:
                one.model.close()

        super().__init__(name, close_models)
        self._keeper, self._sweep, self._searched_ms = PersonKeeper(most), Sweep((1, 1)), 0

    def update(self, frame: Frame) -> Tracks:
        """Everybody who is followed; the centres are those of the first."""
        picture = require_picture(frame.content)
        rgb = np.asarray(cv2.cvtColor(picture, cv2.COLOR_BGR2RGB), dtype=np.uint8)
        size = rgb.shape[1], rgb.shape[0]
        if self._sweep.size != size:
            self._sweep = Sweep(size)
        before_ms, self._ms = self._ms, self._after(frame.at_ns)
        poses = [(one, pose) for one in self._followed if (pose := self._pose(one, rgb, before_ms)) is not None]
        poses = _once(poses, size)
        if self._is_due(len(poses)):
            squares = SQUARES if self._searched_ms else FIRST
            poses += self._search(rgb, [pose.body for _, pose in poses], squares)
            if squares == FIRST and 0 < len(poses) < self.most:
                # Again, with those covered who hide others from the detector.
                poses += self._search(rgb, [pose.body for _, pose in poses], squares)
        detections = [self._detection(one, pose, size) for one, pose in poses]
        persons = self._keeper.update(detections, frame.at_ns)
        nobody = np.full((len(self._rows), 2), np.nan)
        self._someone_ms = self._ms if poses else self._someone_ms
        return Tracks(persons[0].centres if persons else nobody, people=seen_people(persons), persons=persons)

    def _pose(self, one: _ModelCopy, rgb: Rgb, before_ms: int) -> Pose | None:
        """The pose of the person whom this copy follows, if it can be that person's."""
        if one.body is None:
            return None
        pose = one.model.pose(rgb, one.body, self._ms)
        reach = (STEP + SPEED * (self._ms - before_ms) / 1000) * one.body.height
        if pose is not None and pose.body.resembles(one.body, GROWTH) and pose.body.distance(one.body) <= reach:
            one.body, one.seen_ms = pose.body, self._ms
            return pose
        if self._ms - one.seen_ms > 1000 * POSE_LOST_S:
            one.body = None
        return None

    def _is_due(self, followed: int) -> bool:
        """Whether to search for somebody else in this picture."""
        if followed >= self.most:
            return False
        lost = followed == 0 or any(one.body is not None and one.seen_ms < self._ms for one in self._followed)
        return self._searched_ms == 0 or self._ms - self._searched_ms >= 1000 * (SEARCH_S if lost else NEWCOMER_S)

    def _search(self, rgb: Rgb, known: Sequence[Body], squares: int) -> list[tuple[_ModelCopy, Pose]]:
        """Who else is in the picture, each with a copy of the model that follows them from now on."""
        self._searched_ms, size = self._ms, (rgb.shape[1], rgb.shape[0])
        covers = [area_about(body, COVERED_WIDTH * body.height, size, TALL_HEIGHTS * body.height) for body in known]
        searched = rgb
        for cover in covers:
            searched = searched if cover is None else cover.covered(searched)
        areas = [self._sweep.whole, *(area for _, area in self._sweep.next(squares, None))]
        bodies = distinct([body for area in areas for body in self._followed[0].model.find(searched, area, self._ms)])
        # Where more people are in the picture than are followed, those in the background are left out.
        largest = FollowRule().ordered(bodies, size)
        return [each for body in largest if (each := self._begin(rgb, body, known)) is not None]

    def _begin(self, rgb: Rgb, body: Body, known: Sequence[Body]) -> tuple[_ModelCopy, Pose] | None:
        if any(body.distance(one) < SAME_HEIGHTS * one.height for one in known):
            return None
        free = [one for one in self._followed if one.body is None or one.seen_ms < self._ms]
        if not free and len(self._followed) >= self.most:
            return None
        one = free[0] if free else _ModelCopy(self._new_model())
        if not free:
            self._followed.append(one)
        one.model.restart()
        pose = one.model.pose(rgb, body, self._ms)
        if pose is None or not pose.body.resembles(body, 2.0) or pose.body.distance(body) > body.height / 2:
            one.body = None
            return None
        # Again about where the landmarks lie, as in every later picture: in a wide picture the detector, which sees the
        # person small, misses the crop by several pixels.
        one.model.restart()
        pose = one.model.pose(rgb, pose.body, self._ms) or pose
        one.body, one.seen_ms, one.sides = pose.body, self._ms, SideKeeper()
        return one, pose

    def _detection(self, one: _ModelCopy, pose: Pose, size: tuple[int, int]) -> Detection:
        landmarks = one.sides.update(pose.landmarks, self._ms, size[0] / size[1])
        return Detection(read_pose(landmarks, size, self._rows).centres, pose.body.u, pose.body.v, pose.body.height)


def _once(poses: Sequence[tuple[_ModelCopy, Pose]], size: tuple[int, int]) -> list[tuple[_ModelCopy, Pose]]:
    """Each person once: of two copies that follow one person the first, the other one follows nobody."""
    result: list[tuple[_ModelCopy, Pose]] = []
    for one, pose in poses:
        if any(_is_one(pose, other, size) for _, other in result):
            one.body = None
        else:
            result.append((one, pose))
    return result


def _is_one(pose: Pose, other: Pose, size: tuple[int, int]) -> bool:
    if pose.body.distance(other.body) > SAME_HEIGHTS * other.body.height:
        return False
    apart = np.linalg.norm((pose.landmarks[:, :2] - other.landmarks[:, :2]) * size, axis=1)
    return bool(np.median(apart) < SAME_POSE * other.body.height)
