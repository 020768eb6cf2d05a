"""Size clamp, states and the colours of skin, each alone."""

import cv2
import numpy as np
import pytest

from observer.tracking.head import Head
from observer.tracking.part import COAST_S, Part
from observer.tracking.skin import SATURATIONS, hue_saturation
from observer.tracks import State


@pytest.mark.parametrize(("area", "fits"), [(49, False), (51, True), (199, True), (201, False)])
def test_areas_fit_from_half_to_twice_the_median(area, fits):
    part = Part(10.0)
    part.acquire(np.zeros(2), 100.0, 40.0)
    assert part.fits(area) is fits


def test_a_part_without_measurements_is_unsure_and_then_missing():
    part = Part(10.0)
    part.acquire(np.zeros(2), 100.0, 40.0)
    part.not_measured(COAST_S * 0.9)
    assert part.state is State.UNSURE
    part.not_measured(COAST_S * 0.2)
    assert part.state is State.MISSING
    assert part.filter is None


def test_hues_on_both_sides_of_red_are_neighbours():
    reds = cv2.cvtColor(np.array([[(179, 100, 200), (1, 100, 200)]], np.uint8), cv2.COLOR_HSV2BGR)
    hues = hue_saturation(reds)[0][0] // SATURATIONS
    assert abs(int(hues[0]) - int(hues[1])) <= 1


def test_the_histogram_follows_the_colour_of_the_light_slowly():
    before, after = np.full((80, 80, 3), (105, 140, 200), np.uint8), np.full((80, 80, 3), (90, 170, 200), np.uint8)
    head = Head(None, None)
    assert head.begin(before, (20, 20, 40, 40))
    assert head.skin is not None
    found = [int(head.skin.back_project(after).mean())]
    for _ in range(10):
        head.adapt(after, after, 1, np.array([40.0, 40.0]), 1.0)
        found.append(int(head.skin.back_project(after).mean()))
    assert found[0] < 30
    assert found[-1] > 100
    assert head.skin.back_project(before).mean() > 100
