"""Where a person stands and faces: directions across 180 degrees, and the placements that one model fits."""

import numpy as np
import pytest

from observer.geometry.placement import NEAR_DEG, NEAR_M, PersonPlacement, facing_of, unlike


@pytest.mark.parametrize(("right", "facing"), [((1, 0, 0), 0), ((0, 0, -1), 90), ((-1, 0, 0), 180), ((0, 0, 1), -90)])
def test_the_facing_grows_to_the_left_from_minus_z(right, facing):
    assert facing_of(np.array(right, float)) % 360 == facing % 360
    assert facing_of(5 * np.array(right, float) + [0, 3, 0]) % 360 == facing % 360


@pytest.mark.parametrize("start", [0.0, 90.0, 175.0, -175.0, 355.0])
def test_a_model_fits_small_turns_also_across_180_degrees(start):
    own = PersonPlacement(facing_deg=start)
    for turn, differs in ((NEAR_DEG - 1, False), (NEAR_DEG + 1, True), (180.0, True), (360.0, False)):
        for other in (PersonPlacement(facing_deg=start + turn), PersonPlacement(facing_deg=start - turn)):
            assert unlike(own, other) == differs
            assert not unlike(own, other, any_facing=True)


def test_a_model_fits_small_steps_in_any_direction():
    own = PersonPlacement(1.0, -2.0, 1.6)
    for step in np.eye(3):
        near, far = (
            PersonPlacement(*(np.array([1.0, -2.0, 1.6]) + step * size)) for size in (0.9 * NEAR_M, 1.1 * NEAR_M)
        )
        assert not unlike(own, near) and unlike(own, far) and unlike(own, far, any_facing=True)
