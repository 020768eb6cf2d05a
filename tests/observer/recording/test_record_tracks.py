"""`labanmesh camera record --tracks`: one camera, no calibration, no pictures kept; a failure loses nothing."""

from dataclasses import replace

import numpy as np
import pytest

from observer.geometry.views import parse_view
from observer.motion.archive import MotionArchive, Recording, TracksCamera
from observer.motion.archive_file import read_archive, write_archive
from observer.motion.projected import projected
from studies.performer import perform_continuously

ROOM = """
scene = "room"

[observers.sofa]
source = "person.npz"
view = "yaw:30"

[observers.shelf]
source = "person.npz"
view = "wheel"

[observers.nobody]
source = "empty.npz"
"""


@pytest.fixture
def room(tmp_path, monkeypatch):
    stream = perform_continuously("1", ("ok", "shake"), seed=2)
    write_archive(tmp_path / "person.npz", MotionArchive(("left_hand", "right_hand", "head"), (stream,)))
    unseen = np.full((30, 3, 3), np.nan, np.float32)
    unseen[0, 0] = 0
    empty = Recording(unseen, 15.0, "", "1", "1")
    write_archive(tmp_path / "empty.npz", MotionArchive(("left_hand", "right_hand", "head"), (empty,)))
    (tmp_path / "room.toml").write_text(ROOM)
    monkeypatch.chdir(tmp_path)
    return tmp_path


def record(run, *words):
    return run("camera", "record", "room.toml", "--tracks", "--subject", "anna", *words)


def test_tracks_of_one_camera_are_added_take_by_take(run, room):
    wanted = ("--observers", "sofa", "-o", "sofa.npz")
    status, out, _ = record(run, *wanted, "--label", "wave", "--seconds", "3")
    assert status == 0 and "recording wave by anna with sofa (trial 1), for 3 s" in out
    assert "sofa.npz: added 3.1 s of wave, trial 1 (left_hand 100%" in out and "now 1 recording" in out
    record(run, *wanted, "--label", "wave", "--trim", "--seconds", "3")
    status, out, _ = record(run, *wanted, "--other-motion")
    assert status == 0 and "of other motion, trial 1" in out and "now 3 recordings" in out
    archive = read_archive(room / "sofa.npz")
    assert archive.camera == TracksCamera("sofa")
    assert [(r.label, r.subject, r.trial) for r in archive.recordings][:2] == [("wave", "anna", t) for t in "12"]
    seen = projected(read_archive(room / "person.npz"), parse_view("yaw:30"), archive.camera).recordings[0]
    np.testing.assert_allclose(archive.recordings[2].positions, seen.positions, atol=1e-4)
    assert len(archive.recordings[1].positions) < len(archive.recordings[0].positions)


def test_all_parts_that_the_tracker_finds_are_recorded(run, room):
    wanted = ("--observers", "sofa", "-o", "sofa.npz", "--label", "wave", "--seconds", "2")
    record(run, *wanted, "--body-parts", "left_hand,right_hand,head")
    person = read_archive(room / "person.npz")
    stream = person.recordings[0]
    whole = replace(stream, positions=np.concatenate([stream.positions, stream.positions[:, :1] - 0.5], axis=1))
    write_archive(room / "person.npz", MotionArchive((*person.body_parts, "left_foot"), (whole,)))
    status, out, _ = record(run, *wanted, "--trim")
    assert status == 0 and "head 100%, 1 other 100% to 100%); now 2 recordings" in out
    archive = read_archive(room / "sofa.npz")
    assert archive.body_parts == (*person.body_parts, "left_foot")
    assert [bool(np.isfinite(r.positions[:, 3]).all()) for r in archive.recordings] == [False, True]
    status, _, err = record(run, *wanted, "--body-parts", "head")
    assert status == 2 and "sofa.npz: contains left_hand, right_hand, head, left_foot, but this records head;" in err


def test_all_observers_record_the_same_take_each_into_its_own_file(run, room):
    both = ("--observers", "sofa,shelf", "-o", "takes")
    status, out, _ = record(run, *both, "--label", "wave", "--rate", "10", "--seconds", "2")
    assert status == 0 and "takes/sofa.npz: added" in out and "takes/shelf.npz: added" in out
    for name in ("sofa", "shelf"):
        (take,) = read_archive(room / "takes" / f"{name}.npz").recordings
        assert take.rate_hz == 10 and take.positions.shape == (21, 3, 2)


def test_a_camera_that_sees_nobody_says_so_and_the_others_takes_are_kept(run, room):
    words = ("--observers", "nobody,sofa", "-o", "takes", "--body-parts", "right_hand,head", "--seconds", "2")
    status, out, err = record(run, *words, "--label", "wave")
    assert status == 2 and "nobody: nobody was seen" in err
    assert "takes/sofa.npz: added" in out and not (room / "takes" / "nobody.npz").exists()
    assert read_archive(room / "takes" / "sofa.npz").body_parts == ("right_hand", "head")


@pytest.mark.parametrize(
    ("words", "error"),
    [
        ("-o person.npz --observers sofa --label wave", "holds positions in 3-D, not tracks of one camera"),
        ("-o sofa.npz --observers sofa", "--label: name the movement, or give --other-motion"),
        ("-o sofa.npz --observers sofa --label wave --gate 5", "--tracks: is about one camera at a time"),
        ("-o sofa.npz --observers sofa --label wave --body-parts head,nose", "'nose'"),
        ("-o sofa.npz --observers chair --label wave", "chair"),
        ("-o sofa.npz --observers sofa --label Wave", "--label 'Wave': lower case"),
        ("-o person.npz/x --label wave", "cannot make the folder person.npz/x"),
    ],
)
def test_what_cannot_be_recorded_is_one_line(run, room, words, error):
    status, _, err = record(run, *words.split())
    assert status == 2 and err.count("\n") == 1 and error in err


def test_positions_in_space_are_not_added_to_tracks(run, room):
    record(run, "--observers", "sofa", "-o", "sofa.npz", "--label", "wave", "--seconds", "2")
    status, _, err = run("camera", "record", "room.toml", "-o", "sofa.npz", "--subject", "anna", "--label", "wave")
    assert status == 2 and "sofa.npz: holds 2-D tracks; give --tracks" in err
