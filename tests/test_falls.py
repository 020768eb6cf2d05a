"""The watch for falls on recorded and on simulated falls, as `python -m benchmarks.falls` measures it."""

import pytest

from benchmarks.falls import RAISED, seen_from, watch, windows
from benchmarks.simulated_falls import DIRECTIONS_DEG, EVERYDAY, everyday, fall
from observer.motion.archive_file import read_archive
from observer.tracks import WHOLE_BODY
from studies.performer.perform import PEOPLE


@pytest.mark.slow
def test_ten_of_eleven_windows_of_falls_and_no_other(data):
    falls, others = windows(read_archive(data / "falls/falls.npz"))
    assert falls.endswith("alarms 10 of 11") and others.endswith("alarms 0 of 38")


@pytest.mark.parametrize("direction", DIRECTIONS_DEG)
def test_four_raised_cameras_see_a_simulated_fall_in_time(direction):
    fallen = fall(PEOPLE[1], direction, slow=bool(direction % 90))
    alarm_s = watch(seen_from(fallen.recording, RAISED), WHOLE_BODY, 30.0).alarm_s()
    assert fallen.begins_s < alarm_s <= fallen.lies_s + 2.0


@pytest.mark.parametrize("what", EVERYDAY)
def test_one_raised_camera_takes_no_everyday_movement_for_a_fall(what):
    for view in RAISED:
        assert watch(seen_from(everyday(PEOPLE[2], what), [view]), WHOLE_BODY, 30.0).alarm_s() is None
