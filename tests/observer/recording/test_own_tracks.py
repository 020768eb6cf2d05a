"""An observer's own tracks: cut out of what it saw, kept in a file that is whole at any time."""

from dataclasses import replace

import numpy as np
import pytest

from common import SECOND_NS
from common.errors import BadInput
from observer.motion.archive import TracksCamera
from observer.motion.archive_file import read_archive
from observer.recording.own_tracks import TracksRecorder, moving_frames, trimmed
from observer.teaching.takes_file import TracksFile
from observer.tracks import BODY_PARTS, Frame, Tracks

BEGIN_NS = 1_700_000_000 * SECOND_NS
SOFA = TracksCamera("sofa")
REST = np.array([[280.0, 300.0], [360.0, 300.0], [320.0, 100.0]])


def raising(second):
    """Rest for 2 s, the right hand up and down within 1 s, rest."""
    centres = REST.copy()
    centres[1, 1] -= 200 * np.sin(np.pi * np.clip(second - 2, 0, 1))
    return centres


def recorder_after(seconds, camera_hz=23.0, rate_hz=15.0, memory_s=600.0, shown=raising):
    recorder = TracksRecorder(BODY_PARTS, rate_hz, memory_s)
    for n in range(round(seconds * camera_hz)):
        second = n / camera_hz
        recorder.update(Frame(BEGIN_NS + round(second * SECOND_NS), np.empty(0)), Tracks(shown(second)))
    return recorder


def at(second):
    return BEGIN_NS + round(second * SECOND_NS)


def test_a_take_is_cut_out_at_the_even_rate_and_trimmed_to_its_movement():
    take = recorder_after(5).cut(at(1), at(4.5), label="raise", subject="anna")
    assert take.positions.dtype == np.float32 and take.positions.shape == (53, 3, 2) and take.rate_hz == 15
    np.testing.assert_allclose(take.positions[20], raising(1 + 20 / 15), atol=2)
    begin, end = moving_frames(take, BODY_PARTS)
    assert begin / 15 == pytest.approx(1, abs=0.5) and end / 15 == pytest.approx(2, abs=0.7)
    assert len(trimmed(take, BODY_PARTS).positions) == end - begin
    assert np.isfinite(take.positions).all()


def test_whoever_stands_still_has_not_moved():
    take = recorder_after(4, shown=lambda _: REST).cut(at(0), at(4), label="raise", subject="anna")
    assert moving_frames(take, BODY_PARTS) == (0, 0) and trimmed(take, BODY_PARTS) is take


def test_old_tracks_are_forgotten_and_so_are_those_of_another_clock():
    recorder = recorder_after(5, memory_s=2.0)
    assert recorder.newest_ns - recorder.oldest_ns <= 2 * SECOND_NS
    recorder.update(Frame(at(1), np.empty(0)), Tracks(REST))
    assert recorder.newest_ns == recorder.oldest_ns == at(1)


@pytest.mark.parametrize(
    ("begin", "end", "shown", "reason"),
    [(7, 9, raising, "0 pictures in 2.0 s: is the camera working"), (0, 2, lambda _: REST * np.nan, "nobody was seen")],
)
def test_a_take_without_pictures_or_people_is_refused(begin, end, shown, reason):
    with pytest.raises(BadInput, match=reason):
        recorder_after(3, shown=shown).cut(at(begin), at(end), label="raise", subject="anna")


def added(file, take):
    """The trial of the take that is added."""
    take = file.with_trial(take, file.body_parts)
    file.add(take)
    return take.trial


def test_takes_are_added_and_removed_and_the_file_is_whole_each_time(tmp_path):
    path, recorder = tmp_path / "sofa.npz", recorder_after(5)
    takes = TracksFile(path, BODY_PARTS, SOFA)
    take = recorder.cut(at(1.5), at(3.5), label="raise", subject="anna")
    assert [added(takes, take) for _ in range(3)] == ["1", "2", "3"]
    added(takes, recorder.cut(at(0), at(5), subject="anna"))
    again = TracksFile(path, BODY_PARTS, SOFA)
    assert read_archive(path).camera == SOFA and len(again.recordings) == 4
    again.remove(lambda r: (r.label, r.trial) == ("raise", "2"))
    assert [(r.label, r.trial) for r in read_archive(path).recordings] == [("raise", "1"), ("raise", "3"), ("", "1")]
    assert added(again, take) == "4"
    again.remove(lambda r: r.subject == "anna")
    assert not path.exists() and added(again, take) == "1"


@pytest.mark.parametrize(
    ("camera", "rate_hz", "reason"),
    [
        (TracksCamera("shelf"), 15.0, "holds the tracks of sofa, not of shelf"),
        (SOFA, 30.0, "has a rate of 15 Hz"),
    ],
)
def test_takes_of_another_camera_or_rate_stay_out_of_the_file(tmp_path, camera, rate_hz, reason):
    path, take = tmp_path / "sofa.npz", recorder_after(5).cut(at(1.5), at(3.5), label="raise", subject="anna")
    added(TracksFile(path, BODY_PARTS, SOFA), take)
    with pytest.raises(BadInput, match=reason):
        added(TracksFile(path, BODY_PARTS, camera), replace(take, rate_hz=rate_hz))
    assert len(read_archive(path).recordings) == 1
