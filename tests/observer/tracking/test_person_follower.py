"""Following one of several people, with a model that sees walking circles instead of pictures."""

import math
from dataclasses import dataclass

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from observer_stage import rejected

from observer.tracking.people import Body, Company, FollowRule, Pose, SearchArea, distinct
from observer.tracking.person_follower import APART_S, PersonFollower
from observer.tracking.search_areas import MotionGrid, Sweep, search_levels
from observer.tracks import LOST_S

PICTURE = np.zeros((480, 640, 3), np.uint8)
IDENTITY, NOSE, WRIST = 5, 0, 15


@dataclass(frozen=True)
class Walker:
    """Walks from (u, v), in heights per second, and sways; absent: seconds between which it is not there."""

    u: float
    v: float
    height: float
    speed: float = 0.0
    sway: float = 0.0
    absent: tuple[float, float] = (0.0, 0.0)
    raised_s: float = math.inf

    def at(self, ms):
        seconds = ms / 1000
        away = self.speed * seconds + self.sway * math.sin(2 * seconds)
        return Body(self.u + away * self.height, self.v, self.height)

    def is_there(self, ms):
        return not self.absent[0] <= ms / 1000 < self.absent[1]


class World:
    """A `PersonModel`: a detector with the range of MediaPipe's, and landmarks that name the walker they are of. Where
    two walkers overlap, it finds one and takes that one for either, the later one in the list."""

    def __init__(self, *walkers):
        self.walkers, self.finds, self.poses = walkers, [], 0

    def _there(self, ms):
        return [(n, walker, walker.at(ms)) for n, walker in enumerate(self.walkers) if walker.is_there(ms)]

    def find(self, rgb, area, ms):
        self.finds.append((ms, area))
        bodies = [body for _, _, body in reversed(self._there(ms))]
        inside = [
            body
            for body in bodies
            if area.left <= body.u <= area.left + area.width and area.top <= body.v <= area.top + area.height
            and 0.3 <= body.height / max(area.width, area.height) <= 1.2
        ]  # fmt: skip
        return distinct(inside, 0.25)

    def drawn(self, picture, ms):
        """Grey figures, so that motion is seen."""
        drawn = picture.copy()
        for n, _, body in self._there(ms):
            left, top = (max(round(edge), 0) for edge in (body.outline.left, body.outline.top))
            drawn[top : max(round(body.outline.bottom), 0), left : max(round(body.outline.right), 0)] = 100 + 50 * n
        return drawn

    def pose(self, rgb, body, ms):
        self.poses += 1
        near = [each for each in self._there(ms) if each[2].distance(body) < 0.5 * body.height]
        if not near:
            return None
        nearest = min(near, key=lambda each: each[2].distance(body))
        alike = [each for each in near if each[2].distance(nearest[2]) < 0.2 * body.height]
        number, walker, found = alike[-1]
        landmarks = np.full((33, 3), 0.5)
        landmarks[IDENTITY, 2] = number
        landmarks[WRIST] = 0.5, 0.4 if ms / 1000 >= walker.raised_s else 0.6, 1.0
        return Pose(landmarks, found)

    def restart(self):
        pass

    def close(self):
        pass


def run(world, seconds, rule=None, rate_hz=10, picture=PICTURE):
    """(the walker followed in each picture, None: nobody; the reports with the number of their picture)"""
    reports, who = [], []
    follower = PersonFollower(world, rule, lambda line: reports.append((len(who), line)))
    for n in range(round(seconds * rate_hz)):
        ms = 1 + round(1000 * n / rate_hz)
        landmarks = follower.landmarks(world.drawn(picture, ms), ms)
        who.append(None if landmarks is None else round(landmarks[IDENTITY, 2]))
    return who, reports


def losses(reports):
    return [number for number, line in reports if "lost" in line]


walks = st.tuples(st.floats(-0.3, 0.3), st.floats(0, 0.2))


@settings(max_examples=25, deadline=None)
@given(walks, walks, st.floats(100, 300), st.floats(0.8, 1.25), st.floats(0.6, 2), st.sampled_from([5, 10, 30]))
def test_two_people_who_stay_apart_are_never_confused(one, other, height, ratio, gap, rate_hz):
    walkers = [
        Walker(250 + side * height * gap, 240, tall, side * abs(speed), sway)
        for side, tall, (speed, sway) in ((-0.5, height, one), (0.5, height * ratio, other))
    ]
    apart = [walkers[0].at(ms).distance(walkers[1].at(ms)) / height for ms in range(0, 5000, 50)]
    who, reports = run(World(*walkers), 5, rate_hz=rate_hz)
    if min(apart) > 0.6:
        assert len(set(who) - {None}) == 1
        assert not losses(reports)
        assert who.count(None) <= 0.1 * len(who) + 8


@settings(max_examples=40, deadline=None)
@given(
    st.floats(0.2, 1.2), st.floats(0.2, 1.2), st.floats(0.8, 1.25), st.sampled_from([10, 30]), st.booleans(),
    st.tuples(st.floats(1, 3), st.floats(0, 1.5)),
)  # fmt: skip
def test_people_who_cross_are_kept_or_lost_and_never_mixed(speed, other_speed, ratio, rate_hz, swapped, absent):
    height = 150
    walkers = [
        Walker(160, 240, height, speed, 0, (absent[0], absent[0] + absent[1])),
        Walker(480, 245, height * ratio, -other_speed),
    ]
    returns_ms = 1000 * sum(absent)
    # Nobody appears out of another person.
    assume(walkers[0].at(returns_ms).distance(walkers[1].at(returns_ms)) > 0.6 * height)
    shown = walkers[::-1] if swapped else walkers
    who, reports = run(World(*shown), 6, rate_hz=rate_hz)
    chosen = [number for number, line in reports if "follows" in line]
    for first, last in zip(chosen, [*chosen[1:], len(who)], strict=True):
        ms = 1000 * first / rate_hz
        # Who is chosen while two are one figure may turn out to be either.
        if walkers[0].at(ms).distance(walkers[1].at(ms)) > 0.25 * height:
            assert len(set(who[first:last]) - {None}) == 1, (first, last, reports)


def test_two_who_merge_are_left_alone_for_a_while():
    who, reports = run(World(Walker(160, 240, 150, 0.6), Walker(480, 240, 150, -0.6)), 6)
    number = next(n for n, line in reports if "too near" in line)
    assert set(who[number : number + round(APART_S * 10)]) == {None}
    assert "follows the person" in reports[-1][1]


def test_a_limb_that_is_taken_for_somebody_beside_the_followed_person_is_no_other():
    followed = Body(300.0, 200.0, 300.0)
    company = Company()
    for ms in range(100, 1000, 100):
        company.update(followed, [Body(400.0, 200.0, 280.0)], ms)
    assert not company.merges_with(followed, visible=True, ms=1000)


def test_somebody_who_comes_from_afar_merges_with_the_followed_person():
    followed = Body(300.0, 200.0, 300.0)
    company = Company()
    for ms in range(100, 1000, 100):
        company.update(followed, [Body(600.0 - ms / 4, 200.0, 280.0)], ms)
    assert company.merges_with(followed, visible=True, ms=1000)


def test_the_followed_person_is_lost_after_a_while_and_another_is_chosen_then():
    who, reports = run(World(Walker(160, 240, 200, absent=(2, 9)), Walker(480, 240, 180)), 5)
    assert set(who[:20]) == {0}
    assert set(who[20 : 20 + round(LOST_S * 10)]) == {None}
    assert set(who[-10:]) == {1}
    assert [line.split(":")[0].split(" at ")[0] for _, line in reports] == [
        "follows the person", "the followed person is lost", "follows the person",
    ]  # fmt: skip


def test_a_short_absence_loses_nobody():
    who, reports = run(World(Walker(160, 240, 200, absent=(2, 2.6)), Walker(480, 240, 180)), 5)
    assert set(who) == {0, None}
    assert not losses(reports)


@pytest.mark.parametrize(
    ("rule", "expected"),
    [(FollowRule(), 1), (FollowRule("nearest", (0.2, 0.5)), 0), (FollowRule("nearest", (0.9, 0.5)), 2)],
)
def test_the_rule_chooses(rule, expected):
    world = World(Walker(130, 240, 180), Walker(350, 240, 240), Walker(560, 240, 100))
    who, reports = run(world, 4, rule)
    assert set(who) - {None} == {expected}
    assert str(rule) in reports[0][1]


@pytest.mark.parametrize(("u", "expected"), [(320, 0), (960, 1)])
def test_in_a_wide_picture_the_first_choice_waits_for_no_other_picture(u, expected):
    wide, world = np.zeros((480, 1280, 3), np.uint8), World(Walker(160, 240, 300), Walker(1120, 240, 300))
    who, _ = run(world, 1, FollowRule("nearest", (u / 1280, 0.5)), picture=wide)
    assert set(who) == {expected}


def test_who_raises_a_hand_is_followed_until_gone_whoever_raises_one_later():
    world = World(Walker(130, 240, 260, raised_s=4), Walker(400, 240, 230, raised_s=2))
    who, _ = run(world, 6, FollowRule("raised_hand"))
    assert set(who[:20]) == {None}
    assert set(who[25:]) == {1}


def test_a_larger_person_who_comes_later_is_not_followed():
    who, _ = run(World(Walker(130, 240, 180), Walker(450, 240, 400, absent=(0, 2))), 5)
    assert set(who) == {0}


@settings(max_examples=25, deadline=None)
@given(st.floats(90, 180), st.floats(0, 1), st.floats(0, 1))
def test_a_small_person_anywhere_is_found_within_three_seconds(height, u, v):
    margin = 0.5 * height
    place = margin + u * (640 - 2 * margin), margin + v * (480 - 2 * margin)
    who, _ = run(World(Walker(*place, height)), 3.5)
    assert set(who[-3:]) == {0}


def test_an_empty_room_costs_one_search_a_picture():
    world = World()
    run(world, 6)
    count = [sum(1 for ms, _ in world.finds if ms // 100 == n) for n in range(60)]
    assert max(count[1:]) <= 2
    assert set(count[40:]) == {1}
    assert len({area for ms, area in world.finds if ms > 3000}) > 10


def test_somebody_alone_costs_a_search_in_three_seconds():
    world = World(Walker(320, 240, 300))
    run(world, 10, rate_hz=30)
    assert world.poses == 300
    assert len(world.finds) <= 6


@pytest.mark.parametrize("size", [(1, 1), (3, 200), (9, 7)])
def test_tiny_pictures_show_nobody(size):
    follower = PersonFollower(World())
    for n in range(30):
        assert follower.landmarks(np.zeros((*size, 3), np.uint8), 1 + 100 * n) is None


def test_the_picture_may_change_its_size():
    world = World(Walker(160, 240, 200))
    follower = PersonFollower(world)
    assert follower.landmarks(PICTURE, 1) is not None
    assert follower.landmarks(np.zeros((400, 400, 3), np.uint8), 101) is not None


@pytest.mark.parametrize("rule", [("nearest", None), ("largest", (0.5, 0.5))])
def test_a_mark_belongs_to_nearest(rule):
    with rejected("follow_near"):
        FollowRule(*rule)


def contains(area, left, top, right, bottom):
    return (
        area.left <= left and right <= area.left + area.width and area.top <= top and bottom <= area.top + area.height
    )


@settings(max_examples=60, deadline=None)
@given(st.integers(200, 2000), st.integers(200, 2000), st.floats(0, 1), st.floats(0, 1), st.floats(0, 1))
def test_everybody_of_half_to_a_sixth_of_the_short_side_is_complete_in_a_view_of_the_right_size(width, height, a, b, c):
    short = min(width, height)
    tall = short * (1 / 5.5 + a * (1 / 2 - 1 / 5.5))
    wide = 0.4 * tall
    left, top = b * (width - wide), c * (height - tall)
    shrunk = 0.03 * tall  # of the figure; the detector needs no more
    box = left, top + shrunk, left + wide, top + tall - shrunk
    areas = [area for level in search_levels(width, height) for area in level]
    assert any(
        contains(area, *box) and 0.33 <= tall / max(area.width, area.height) <= 1 for area in areas
    ), (width, height, tall)  # fmt: skip


@given(st.integers(64, 2000), st.integers(64, 2000))
@settings(max_examples=40, deadline=None)
def test_views_cover_the_picture_and_lie_in_it(width, height):
    for level in search_levels(width, height):
        for area in level:
            assert contains(SearchArea(0, 0, width, height), area.left, area.top, area.left + area.width,
                            area.top + area.height)  # fmt: skip
        for u, v in ((0, 0), (width - 1, height - 1), (width // 2, height // 2), (0, height - 1)):
            assert any(contains(area, u, v, u + 1, v + 1) for area in level)


def test_squares_in_which_something_moves_come_first():
    grid, sweep = MotionGrid(), Sweep((640, 480))
    moved = PICTURE.copy()
    moved[380:460, 540:600] = 200
    assert grid.update(PICTURE, 1) is None
    motion = grid.update(moved, 101)
    first = [area for _, area in sweep.next(3, motion)]
    assert all(contains(area, 540, 380, 600, 460) for area in first)
    every = first + [area for _, area in sweep.next(100, grid.update(moved, 201))]
    assert sorted(map(str, every)) == sorted(str(area) for level in search_levels(640, 480)[1:] for area in level)
    assert sweep.passes == 1
