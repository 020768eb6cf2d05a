"""The skin histogram: counting, learning, adaptation and back-projection."""

import cv2
import numpy as np
import pytest

from observer.tracking.head import HeadTracker
from observer.tracking.skin import (
    BURNT,
    DARK,
    HUE_SHIFT,
    HUES,
    PALE,
    SATURATIONS,
    SkinHistogram,
    counts,
    hue_saturation,
)


def test_hues_on_both_sides_of_red_are_adjacent():
    reds = cv2.cvtColor(np.array([[(179, 100, 200), (1, 100, 200)]], np.uint8), cv2.COLOR_HSV2BGR)
    hues = [int(counts(*hue_saturation(red)).nonzero()[0][0]) for red in (reds[:, :1], reds[:, 1:])]
    assert abs(hues[0] - hues[1]) <= 1


def test_every_usable_pixel_of_the_mask_is_counted_at_its_rotated_hue():
    picture = np.random.default_rng(3).integers(0, 256, (40, 60, 3), dtype=np.uint8)
    hsv, usable = hue_saturation(picture)
    bins = np.zeros((HUES, SATURATIONS))
    for hue, saturation, value in hsv[usable > 0].astype(int):
        assert saturation >= PALE and DARK <= value <= BURNT
        bins[(hue + HUE_SHIFT) % 180 * HUES // 180, saturation * SATURATIONS // 256] += 1
    assert (counts(hsv, usable) == bins).all() and bins.sum() > 1000


def test_the_histogram_adapts_slowly_to_the_colour_of_the_light():
    before, after = np.full((80, 80, 3), (105, 140, 200), np.uint8), np.full((80, 80, 3), (90, 170, 200), np.uint8)
    head = HeadTracker(None, None)
    assert head.begin(before, (20, 20, 40, 40))
    assert head.skin is not None
    means = [int(head.skin.back_project(after).mean())]
    for _ in range(10):
        head.adapt(after, after, 1, np.array([40.0, 40.0]), 1.0)
        means.append(int(head.skin.back_project(after).mean()))
    assert means[0] < 30
    assert means[-1] > 100
    assert head.skin.back_project(before).mean() > 100


FACE_BGR, WOOD_BGR = (105, 140, 200), (70, 120, 200)
"""Of one brightness, so that the histograms alone tell them apart."""


def frequencies(**shares):
    """(45, 32) of sum 1: `face` and `wood` are shares of those colours, the remainder is blue."""
    result = np.zeros((HUES, SATURATIONS))
    for colour, share in ((FACE_BGR, shares["face"]), (WOOD_BGR, shares["wood"])):
        result[counts(*hue_saturation(np.full((1, 1, 3), colour, np.uint8))) > 0] = share
    result[10, 5] += 1 - result.sum()
    return result


def likely(skin, colour):
    return int(skin.back_project(np.full((8, 8, 3), colour, np.uint8))[4, 4])


@pytest.mark.parametrize(
    ("rest", "wood_is_skin", "face_is_skin"),
    [
        ({"face": 0.0, "wood": 0.04}, True, True),  # little wood: unchanged
        ({"face": 0.0, "wood": 0.25}, False, True),  # a cupboard of a similar colour
        ({"face": 0.4, "wood": 0.25}, True, True),  # a wall of the face's colour: the face would be lost
    ],
)
def test_the_prior_of_skin_is_lowered_where_that_separates_it_from_the_room(rest, wood_is_skin, face_is_skin):
    wood = 0.04 if rest["wood"] == 0.04 else 0.25
    skin = SkinHistogram(frequencies(face=0.7, wood=wood), frequencies(**rest), np.array([200.0, 10.0]))
    assert (likely(skin, WOOD_BGR) >= 110) is wood_is_skin
    assert (likely(skin, FACE_BGR) >= 110) is face_is_skin
