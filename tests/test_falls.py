"""The watch for falls on recorded and on simulated falls, as `python -m benchmarks.falls` measures it."""

import pytest

from benchmarks.falls import RAISED, seen_from, watch, windows
from benchmarks.simulated_falls import fall
from observer.motion.archive_file import read_archive
from observer.tracks import WHOLE_BODY
from studies.performer.perform import PEOPLE


@pytest.mark.slow
def test_ten_of_eleven_windows_of_falls_and_no_other(data):
    falls, others = windows(read_archive(data / "falls/falls.npz"))
    assert falls.endswith("alarms 10 of 11") and others.endswith("alarms 0 of 38")


@pytest.mark.parametrize("direction", [0, 45])
def test_four_raised_cameras_see_a_simulated_fall_in_time(direction):
    fallen = fall(PEOPLE[1], direction, slow=bool(direction % 90))
    alarm_s = watch(seen_from(fallen.recording, RAISED), WHOLE_BODY, 30.0).alarm_s()
    assert fallen.begins_s < alarm_s <= fallen.lies_s + 2.0
