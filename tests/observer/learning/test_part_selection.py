"""The body parts that a model of one camera's tracks reads."""

import numpy as np
import pytest

from observer.learning.taught_takes import parts_to_learn
from observer.motion.archive import MotionArchive, Recording, TracksCamera
from observer.tracks import WHOLE_BODY

STANDING = np.array(
    [[280, 300], [360, 300], [320, 100], [270, 240], [370, 240], [290, 180], [350, 180], [320, 160], [320, 320],
     [300, 320], [340, 320], [300, 420], [340, 420], [300, 520], [340, 520]], np.float32,
)  # fmt: skip


def take(label, kick=0.0, feet_seen=1.0, trial="1"):
    """One second; the right foot goes up by `kick` px, and feet are seen only at first."""
    positions = np.repeat(STANDING[None], 15, axis=0) + np.random.default_rng(0).normal(0, 3, (15, 15, 2))
    positions[:, 14, 1] -= kick * np.sin(np.linspace(0, np.pi, 15))
    positions[round(15 * feet_seen) :, 13:] = np.nan
    return Recording(positions.astype(np.float32), 15.0, label, "anna", trial)


@pytest.mark.parametrize(
    ("takes", "read"),
    [
        ([take("wave"), take("point"), take("", kick=200)], WHOLE_BODY),
        ([take("wave"), take("kick", kick=200)], WHOLE_BODY),
        ([take("wave", feet_seen=0.3), take("kick", kick=200)], WHOLE_BODY[:13]),
        ([take("wave", feet_seen=0.6), take("kick", kick=200)], WHOLE_BODY),
        ([take("wave"), take("", feet_seen=0.0)], WHOLE_BODY),
    ],
)
def test_all_parts_that_are_seen_in_half_of_every_movement(takes, read):
    assert parts_to_learn(MotionArchive(WHOLE_BODY, tuple(takes), TracksCamera("sofa"))) == read


def test_parts_of_other_things_are_read_and_all_where_little_is_seen():
    other = ("racket", "left_hand", "right_hand")
    shown = tuple(Recording(np.ones((9, 3, 2), np.float32), 15.0, label, "anna", "1") for label in ("a", "b"))
    assert parts_to_learn(MotionArchive(other, shown, TracksCamera())) == other
    assert parts_to_learn(MotionArchive(("left_foot", "right_foot", "head"), shown, TracksCamera())) != ("head",)
