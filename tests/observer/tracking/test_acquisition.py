"""When moving skin is taken for a hand, whatever the rate of the camera."""

import numpy as np
import pytest

from observer.tracking.skin import HandAcquisition, SkinPatch

FACE = 20.0


def first_accepted_s(rate_hz, face_widths_per_s, moved=1.0):
    """Seconds until a patch is accepted that moves at this speed; None if it never is."""
    acquisition = HandAcquisition()
    for n in range(2 * rate_hz):
        centre = np.array([100.0 + face_widths_per_s * FACE * n / rate_hz, 50.0])
        if acquisition.update([SkinPatch(centre, 60.0, moved)], FACE, 1 / rate_hz):
            return n / rate_hz
    return None


@pytest.mark.parametrize(("rate_hz", "pictures"), [(30, 3), (15, 3), (10, 3), (7, 2), (5, 2), (4, 2), (2, 2)])
@pytest.mark.parametrize("speed", [1.0, 10.0])
def test_a_hand_that_moves_is_found_with_the_third_picture_and_with_the_second_if_they_are_rare(
    rate_hz, pictures, speed
):
    assert first_accepted_s(rate_hz, speed) == (pictures - 1) / rate_hz


@pytest.mark.parametrize("rate_hz", [30, 15, 5])
def test_what_leaps_or_does_not_move_is_no_hand(rate_hz):
    leap = 1.5 * max(1.2 * rate_hz, 18.0)
    assert first_accepted_s(rate_hz, leap) is None
    assert first_accepted_s(rate_hz, 0.0, moved=0.1) is None


@pytest.mark.parametrize("rate_hz", [30, 15, 5, 2])
def test_what_is_seen_once_is_no_hand(rate_hz):
    acquisition, seconds = HandAcquisition(), 1 / rate_hz
    patch = SkinPatch(np.array([100.0, 50.0]), 60.0, 1.0)
    assert not any(acquisition.update(shown, FACE, seconds) for shown in ([patch], [], [patch], []))
