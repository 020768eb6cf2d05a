"""Follows one person among several, and searches for one while nobody is followed. Pure apart from the model.

The person that is followed changes only after that person is lost. It is lost when it is out of sight for LOST_S, when
two candidates are as likely to be it, and when another person of its size comes so near that the model could take one
for the other: nobody is followed then until APART_S later. Lengths are in heights of the followed person, `Body`.
"""

from collections.abc import Callable, Iterator, Sequence

from observer.tracking.people import (
    GROWTH,
    OTHER_S,
    SPEED,
    STEP,
    Body,
    Company,
    FollowRule,
    OtherPerson,
    PersonModel,
    Pose,
    Rgb,
    SearchArea,
    area_about,
    distinct,
)
from observer.tracking.search_areas import STIRRED, MotionGrid, Sweep
from observer.tracks import LOST_S, Floats, SeenPeople

LONGEST_STEP_S = 0.5
"""A longer time between two pictures counts as this long."""
APART_S = 0.7
"""After two came too near, nobody is followed for so long."""
LOOK_AROUND = 2.6
"""Side of the square around the followed person in which others are searched."""
BESIDE = 0.5
"""Distance to the side of the hips from which motion is not the followed person's own."""
COVERED_HEIGHTS = 0.56
"""Width of the followed person, who is covered while others are searched."""
FIRST, BUSY, IDLE = 9, 2, 1
"""Searches in the first picture, with more where a choice waits for them; while something moves or somebody was just
lost; and in a still room."""
WAITING, TRIED = 3, 2
"""Searches in a later picture while a choice waits for them; candidates whose pose is tried in one picture."""
WHOLE_EVERY = 4
"""Every fourth search for others is one in the whole picture."""
BUSY_PASSES = 2
"""Passes through all areas after which a still room is searched slowly."""

Report = Callable[[str], None]


class PersonFollower:
    """A `PoseModel` that keeps to one person. report: gets a line when a person is chosen or lost."""

    def __init__(self, model: PersonModel, rule: FollowRule | None = None, report: Report = lambda line: None) -> None:
        self._model, self._rule, self._report = model, rule or FollowRule(), report
        self._followed: Body | None = None
        self._seen_ms, self._ms, self._not_before_ms = 0, 0, 0
        self._step_ms = 0.0
        self._company, self._motion = Company(), MotionGrid()
        self._sweep: Sweep | None = None
        self._candidates: list[Body] = []
        self._pending: list[tuple[int, SearchArea]] = []
        self._waiting: list[OtherPerson] = []
        self._pictures, self._looks = 0, 0
        self.choices = 0
        """How often a person was chosen: another number may mean another person."""

    @property
    def people(self) -> SeenPeople:
        """Who is seen, for pictures that are shown."""
        others = self._waiting if self._followed is None else self._company.people
        fresh = tuple(one.body.outline for one in others if self._ms - one.ms <= 1000 * OTHER_S)
        return SeenPeople(None if self._followed is None else self._followed.outline, fresh)

    @property
    def follows(self) -> bool:
        """Whether somebody is followed, seen or not."""
        return self._followed is not None

    def landmarks(self, rgb: Rgb, ms: int) -> Floats | None:
        """As `PoseModel.landmarks`, of the followed person."""
        size = (rgb.shape[1], rgb.shape[0])
        if self._sweep is None or self._sweep.size != size:
            self._sweep, self._followed, self._candidates, self._pending = Sweep(size, self._rule.near), None, [], []
        self._ms, self._step_ms = ms, min(ms - self._ms, 1000 * LONGEST_STEP_S)
        pose = None if self._followed is None else self._follow(self._followed, rgb)
        if self._followed is None and ms >= self._not_before_ms:
            pose = self._search(self._sweep, rgb)
        return None if pose is None else pose.landmarks

    def close(self) -> None:
        """As `PoseModel.close`."""
        self._model.close()

    def _follow(self, followed: Body, rgb: Rgb) -> Pose | None:
        pose = self._model.pose(rgb, followed, self._ms)
        if pose is None or not self._is_same(followed, pose.body):
            pose = self._find_again(followed, rgb)
        if pose is not None:
            self._followed, self._seen_ms = pose.body, self._ms
            if self._company.is_due(pose.body, self._is_stirred(pose.body, rgb), self._ms):
                self._company.update(pose.body, self._others(pose.body, rgb), self._ms)
        if self._followed is not None and self._company.merges_with(self._followed, pose is not None, self._ms):
            self._lose("another person comes too near to tell them apart", APART_S)
        elif self._followed is not None and self._ms - self._seen_ms > 1000 * LOST_S:
            self._lose(f"out of sight for {LOST_S:g} s")
        return pose if self._followed is not None else None

    def _is_stirred(self, body: Body, rgb: Rgb) -> bool:
        """Whether something moves beside the person."""
        motion = self._motion.update(rgb, self._ms)
        area = area_about(body, LOOK_AROUND * body.height, (rgb.shape[1], rgb.shape[0]))
        if motion is None or area is None:
            return False
        around = area.of_grid(motion).sum()
        own = area_about(body, 2 * BESIDE * body.height, (rgb.shape[1], rgb.shape[0]), LOOK_AROUND * body.height)
        return int(around) - (0 if own is None else int(own.of_grid(motion).sum())) >= STIRRED

    def _find_again(self, followed: Body, rgb: Rgb) -> Pose | None:
        """The followed person, if just one of the people about its last place can be it."""
        bodies = distinct(self._found_about(followed, rgb))
        alike = [body for body in self._company.strangers(bodies, self._ms) if self._is_same(followed, body)]
        if len(alike) > 1:
            self._lose("two people are as likely to be it")
        if len(alike) != 1:
            return None
        pose = self._pose_of(alike[0], rgb)
        return pose if pose is not None and self._is_same(followed, pose.body) else None

    def _is_same(self, followed: Body, body: Body) -> bool:
        """Whether the followed person can be at `body`: near its last place, however long it was out of sight."""
        reach = (STEP + SPEED * self._step_ms / 1000) * followed.height
        near = body.distance(followed) <= reach and body.resembles(followed, GROWTH)
        return near and not self._company.is_other(body, followed, self._ms)

    def _others(self, body: Body, rgb: Rgb) -> Sequence[Body]:
        """Who is about the followed person; now and then anywhere in the picture.

        The followed person is covered: beside a person in full view, detectors often miss another.
        """
        self._looks += 1
        size = (rgb.shape[1], rgb.shape[0])
        cover = area_about(body, COVERED_HEIGHTS * body.height, size, 1.2 * body.height)
        if cover is not None:
            rgb = cover.covered(rgb)
        if self._looks % WHOLE_EVERY == 0:
            return self._model.find(rgb, SearchArea(0, 0, rgb.shape[1], rgb.shape[0]), self._ms)
        return self._found_about(body, rgb)

    def _found_about(self, body: Body, rgb: Rgb) -> Sequence[Body]:
        area = area_about(body, LOOK_AROUND * body.height, (rgb.shape[1], rgb.shape[0]))
        return [] if area is None else self._model.find(rgb, area, self._ms)

    def _pose_of(self, body: Body, rgb: Rgb) -> Pose | None:
        """The pose of somebody who was not followed in the previous picture; None if it does not fit."""
        self._model.restart()
        pose = self._model.pose(rgb, body, self._ms)
        fits = pose is not None and pose.body.resembles(body, 2.0) and pose.body.distance(body) < body.height / 2
        return pose if fits else None

    def _search(self, sweep: Sweep, rgb: Rgb) -> Pose | None:
        """Search some areas, and choose when the rule has seen all that it must compare."""
        for level, area in self._areas(sweep, rgb):
            bodies = self._model.find(rgb, area, self._ms)
            self._candidates += bodies
            if bodies and not self._pending and not self._rule.is_met_by(self._candidates, sweep.size):
                # Before a choice: people found only in smaller squares are smaller, and farther from the mark those
                # outside the squares that hold it.
                self._pending = sweep.rest_of(level)
            if self._candidates and not self._pending:
                pose = self._choose(sweep.size, rgb)
                if pose is not None:
                    return pose
        return None

    def _areas(self, sweep: Sweep, rgb: Rgb) -> Iterator[tuple[int, SearchArea]]:
        """What is searched in this picture: what a choice waits for, else the whole picture and some squares."""
        motion = self._motion.update(rgb, self._ms)
        self._pictures += 1
        if self._pending:
            for _ in range(WAITING):
                if self._pending:
                    yield self._pending.pop(0)
            return
        still = motion is not None and motion.sum() < STIRRED
        count = FIRST if self._pictures == 1 else IDLE if still and sweep.passes >= BUSY_PASSES else BUSY
        if count > IDLE or self._pictures % 2:
            yield 0, sweep.whole
            count -= 1
        for _ in range(count):
            if self._pending:
                yield self._pending.pop(0)
            else:
                yield from sweep.next(1, motion)
        # Who is there when an observer begins may be moving already: the first choice waits for no other picture.
        while self._pictures == 1 and self._pending:
            yield self._pending.pop(0)

    def _choose(self, size: tuple[int, int], rgb: Rgb) -> Pose | None:
        candidates, self._candidates = self._rule.ordered(distinct(self._candidates), size), []
        self._waiting = [OtherPerson(body, self._ms) for body in candidates]
        if self._rule.name == "raised_hand":
            # A few in turn, so that a crowd that waits costs no more than a pair.
            start = self._pictures * TRIED % len(candidates)
            candidates = [*candidates[start:], *candidates[:start]]
        for body in candidates[:TRIED]:
            pose = self._pose_of(body, rgb)
            if pose is not None and (self._rule.name != "raised_hand" or pose.hand_is_raised):
                self._begin(pose, size)
                return pose
        return None

    def _begin(self, pose: Pose, size: tuple[int, int]) -> None:
        body, people = pose.body, len(self._waiting)
        self.choices += 1
        self._followed, self._seen_ms = body, self._ms
        others = [one for one in self._waiting if one.body.distance(body) > BESIDE * body.height]
        self._company, self._sweep, self._pictures = Company(others), Sweep(size, self._rule.near), 1
        place = f"{body.u:.0f}, {body.v:.0f} of {size[0]}x{size[1]} px"
        self._report(f"follows the person at {place}, {body.height:.0f} px tall ({self._rule}; {people} seen)")

    def _lose(self, reason: str, pause_s: float = 0.0) -> None:
        self._followed, self._company, self._waiting = None, Company(), []
        self._not_before_ms = self._ms + round(1000 * pause_s)
        self._report(f"the followed person is lost: {reason}")
