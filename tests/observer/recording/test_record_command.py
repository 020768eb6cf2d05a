"""`labanmesh camera record`: positions from several cameras, output and errors."""

import math
import threading

import numpy as np
import pytest
from observer_stage import rejected
from performances import PassThrough

from common import SECOND_NS
from common.errors import BadInput
from observer.geometry.camera_file import CameraModel, write_camera
from observer.geometry.projection import LensDistortion, pinhole_matrix, project
from observer.motion.archive import MotionArchive, Recording, streams_in
from observer.motion.archive_file import read_archive, write_archive
from observer.recording.capture import RecordingCamera, read_cameras
from observer.recording.commands import record
from observer.recording.new_recording import NothingRecorded, build_recording
from observer.tracks import BODY_PARTS, Frame

CAMERAS = [pinhole_matrix(math.radians(yaw), 0.15, 3.0, 700, (640, 360), (0, 0.9, 0)) for yaw in (-50, 0, 45)]


def recorded(tracks, rate_hz=30.0, label="wave", subject="anna", trial="1", **options):
    empty = Recording(np.zeros((0, 3, 3), np.float32), rate_hz, label, subject, trial)
    return build_recording(tracks, BODY_PARTS, empty, **options)


def waving(seconds=2.0, rate_hz=30.0):
    t = np.arange(round(seconds * rate_hz)) / rate_hz
    rest = np.tile([[-0.25, 0.8, 0.0], [0.25, 1.3, -0.2], [0.0, 1.65, 0.0]], (len(t), 1, 1))
    rest[:, 1, 0] += 0.25 * np.sin(2 * np.pi * 1.5 * t)
    return rest


def camera_of(name, matrix, centres, rate_hz, late_ns=0, motion=True):
    at = [round(i * SECOND_NS / rate_hz) + late_ns for i in range(len(centres))]
    frames = [Frame(t, c, t if motion else None) for t, c in zip(at, centres, strict=True)]
    return RecordingCamera(name, iter(frames), PassThrough(), matrix)


def cameras_of(positions, rate_hz, matrices, spoil=lambda camera, centres: centres, late_ns=0, motion=True):
    """Cameras with exact centres, changed by `spoil`."""
    return [
        camera_of(f"cam{n}", H, spoil(n, project(H, positions)), rate_hz, n * late_ns, motion)
        for n, H in enumerate(matrices)
    ]


def tracks_of(*args, **options):
    return read_cameras(cameras_of(*args, **options), threading.Event())


def test_exact_tracks_give_exact_positions():
    made, lines = recorded(tracks_of(waving(), 30, CAMERAS))
    np.testing.assert_allclose(made.positions, waving(), atol=1e-4)
    assert len(lines) == 1 and "all parts in 100%" in lines[0] and "0.0 px" in lines[0]


def test_cameras_of_different_rates_and_phases_are_resampled():
    fast = tracks_of(waving(2, 60), 60, CAMERAS[:2], late_ns=7_000_000)
    slow = tracks_of(waving(2, 25), 25, CAMERAS[2:])
    made, _ = recorded([*fast, *slow], rate_hz=20.0)
    expected = waving(2, 20)[: len(made.positions)]
    # The clock starts 7 ms late, in which a hand at 2.4 m/s moves 17 mm; interpolation cuts 12 mm off its curve.
    assert np.nanmax(np.linalg.norm(made.positions - expected, axis=-1)) < 0.03
    assert np.isfinite(made.positions).all()


def test_a_wrong_camera_is_outvoted_and_named():
    cameras = [*CAMERAS, pinhole_matrix(math.radians(100), 0.1, 3.0, 700, (640, 360), (0, 0.9, 0))]
    tracks = tracks_of(waving(), 30, cameras, lambda camera, centres: centres + ([90, -60] if camera == 1 else 0))
    made, lines = recorded(tracks)
    np.testing.assert_allclose(made.positions, waving(), atol=1e-3)
    assert lines[1] == ("cam1: rejected in 100% of what it saw; check its calibration and its tracker")
    assert len(lines) == 2


def test_parts_seen_by_one_camera_are_unknown_except_in_short_gaps():
    def spoil(camera, centres):
        if camera:
            centres[20:23, 0] = centres[30:45, 1] = np.nan
        return centres

    made, lines = recorded(tracks_of(waving(), 30, CAMERAS, spoil))
    unknown = np.isnan(made.positions).any(axis=-1)
    assert unknown[:, 1].sum() == 15 and not unknown[:, [0, 2]].any()
    assert "right_hand 75%" in lines[0]


def test_a_momentary_tracking_error_is_repaired():
    wrong = waving()
    wrong[25, 0] += [0.5, 0.4, 0.0]
    made, _ = recorded(tracks_of(wrong, 30, CAMERAS))
    np.testing.assert_allclose(made.positions[:, 0], waving()[:, 0], atol=1e-4)


def test_idle_ends_are_trimmed_and_the_room_is_rotated():
    still = np.tile(waving()[:1], (60, 1, 1))
    positions = np.concatenate([still, waving(), still])
    room = positions[..., [2, 0, 1]] * [-1, -1, 1]  # x forward, y left, z up
    matrices = [H @ np.array([[0, -1, 0, 0], [0, 0, 1, 0], [-1, 0, 0, 0], [0, 0, 0, 1.0]]) for H in CAMERAS]
    made, _ = recorded(tracks_of(room, 30, matrices), up="z", front="x", trim=True)
    assert 60 < len(made.positions) < 90
    count = len(made.positions)
    off = [np.abs(made.positions - positions[n : n + count]).max() for n in range(len(positions) - count)]
    assert min(off) < 1e-4
    assert 45 < int(np.argmin(off)) <= 56


def test_the_time_limit_does_not_wait_for_a_silent_live_camera():
    stop = threading.Event()
    live = cameras_of(waving(5), 30, CAMERAS[:2], motion=False)
    nothing = (Frame(0, np.zeros((3, 2))) for _ in range(1) if not stop.wait(20))
    hanging = RecordingCamera("cam9", nothing, PassThrough(), CAMERAS[0])
    seen = read_cameras([*live, hanging], stop, seconds=1.0)
    assert stop.is_set()
    assert 29 <= len(seen[0].at_ns) <= 31 or 29 <= len(seen[1].at_ns) <= 31
    assert len(seen[2].at_ns) == 0


def seen_in_turn(camera, centres):
    """No two cameras see the person at one moment."""
    return np.where((np.arange(len(centres)) // 12 % 3 == camera)[:, None, None], centres, np.nan)


@pytest.mark.parametrize(
    ("spoil", "cause", "remedy"),
    [
        (lambda camera, centres: centres * np.nan, "no camera saw any part. ", 'tracker = "mediapipe"'),
        (seen_in_turn, "no part was seen by two cameras at one moment. ", "Stand where at least two cameras see"),
        (lambda camera, centres: centres + 300 * camera**2, "no two agree where they are. ", "Calibrate the cameras"),
    ],
)
def test_why_nothing_was_recorded(spoil, cause, remedy):
    with pytest.raises(NothingRecorded, match="nothing was recorded: ") as caught:
        recorded(tracks_of(waving(), 30, CAMERAS, spoil))
    line = str(caught.value)
    assert cause in line and remedy in line and "\n" not in line
    cameras, twice = caught.value.lines[: len(CAMERAS)], caught.value.lines[len(CAMERAS)]
    assert all(line.startswith(f"cam{n}: 60 pictures; saw left_hand in ") for n, line in enumerate(cameras))
    assert twice.startswith("two cameras at one moment: left_hand in ") and twice.endswith(" of 60 instants")


def test_a_recording_with_holes_says_what_each_camera_saw():
    def spoil(camera, centres):
        centres[10:50, 1] = np.nan if camera else centres[10:50, 1]
        return centres

    made, lines = recorded(tracks_of(waving(), 30, CAMERAS, spoil))
    assert np.isfinite(made.positions).any()
    assert "cam1: 60 pictures; saw left_hand in 60, right_hand in 20, head in 60" in lines


def test_a_failing_camera_stops_all_and_raises():
    stop = threading.Event()

    def endless():
        n = 0
        while not stop.is_set():
            yield Frame(n * 1000, np.zeros((3, 2)))
            n += 1

    def broken():
        yield Frame(0, np.zeros((3, 2)))
        raise BadInput("cam1: the file is empty")

    with rejected("the file is empty"):
        read_cameras(
            [
                RecordingCamera("cam0", endless(), PassThrough(), CAMERAS[0]),
                RecordingCamera("cam1", broken(), PassThrough(), CAMERAS[0]),
            ],
            stop,
        )


@pytest.fixture
def run(command):
    return command(record)


@pytest.fixture
def dojo(tmp_path):
    """A scene of three cameras with lenses, and one without a camera file, that look at a recording."""
    motion = Recording(waving().astype(np.float32), 30.0, "", "anna", "1")
    write_archive(tmp_path / "motion.npz", MotionArchive(BODY_PARTS, (motion,)))
    lines = ['scene = "dojo"']
    for n, H in enumerate(CAMERAS):
        K = np.array([[700.0, 0, 640], [0, 700, 360], [0, 0, 1]])
        write_camera(
            tmp_path / f"cam{n}.toml", CameraModel(f"cam{n}", H, (1280, 720), lens=LensDistortion(K, np.zeros(5)))
        )
        # Recording ignores speed and loop, which are for `observe`.
        lines += [f"[observers.cam{n}]", 'source = "motion.npz"', f'view = "cam{n}.toml"', "speed = 0.01\nloop = true"]
    lines += ["[observers.door]", 'source = "motion.npz"', 'view = "door"']
    (tmp_path / "scene.toml").write_text("\n".join(lines))
    return tmp_path


def test_each_recording_extends_the_archive(run, dojo):
    words = ["scene.toml", "-o", "mine.npz", "--label", "wave", "--subject", "anna"]
    output = run(*words) + run(*words, "--seconds", 1, "--observers", "cam0,cam2")
    assert "recording wave by anna, trial 1, with cam0, cam1, cam2" in output
    assert "recording wave by anna, trial 2, with cam0, cam2" in output
    assert "all parts in 100% of 60 instants" in output and "now 2 recordings" in output
    first, second = read_archive(dojo / "mine.npz").recordings
    np.testing.assert_allclose(first.positions, waving(), atol=1e-4)
    assert (first.trial, second.trial, first.rate_hz) == ("1", "2", 30.0)
    assert 30 <= len(second.positions) <= 31


def test_all_parts_that_the_cameras_find_are_recorded(run, dojo):
    feet = ("left_foot", "right_foot")
    whole = np.concatenate([waving(), waving()[:, :2] - [0, 0.7, 0]], axis=1).astype(np.float32)
    write_archive(dojo / "motion.npz", MotionArchive((*BODY_PARTS, *feet), (Recording(whole, 30.0, "", "anna", "1"),)))
    output = run("scene.toml", "-o", "mine.npz", "--label", "wave", "--subject", "anna")
    assert "hands and head in 100% of 60 instants" in output and "head 100%, 2 others 100% to 100%" in output
    archive = read_archive(dojo / "mine.npz")
    assert archive.body_parts == (*BODY_PARTS, *feet)
    np.testing.assert_allclose(archive.recordings[0].positions, whole, atol=1e-4)
    # An archive keeps the parts that it has.
    write_archive(dojo / "old.npz", MotionArchive(BODY_PARTS, (Recording(whole[:, :3], 30.0, "wave", "anna", "1"),)))
    run("scene.toml", "-o", "old.npz", "--label", "wave", "--subject", "anna")
    assert [r.positions.shape[1] for r in read_archive(dojo / "old.npz").recordings] == [3, 3]
    wider = MotionArchive((*BODY_PARTS, "nose"), (Recording(whole[:, :4], 30.0, "wave", "anna", "1"),))
    write_archive(dojo / "nose.npz", wider)
    with rejected(
        "nose.npz: contains left_hand, right_hand, head, nose, but this records left_hand, right_hand, head;"
    ):
        run("scene.toml", "-o", "nose.npz", "--label", "wave", "--subject", "anna")


def test_other_motion_is_recorded_without_a_label(run, dojo):
    output = run("scene.toml", "-o", "life.npz", "--other-motion", "--subject", "anna")
    assert "recording other motion by anna, trial 1" in output
    (stream,) = streams_in(read_archive(dojo / "life.npz"), unlabelled=True)
    assert (stream.label, stream.spans) == ("", ()) and len(stream.positions) == len(waving())


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ("--label Wave --subject a", "--label 'Wave'"),
        ("--subject a", "--label: name the movement, or give --other-motion"),
        ("--subject a --label wave --other-motion", "--label: name the movement, or give --other-motion"),
        ("--label wave --subject a --observers door", "observers.door.view = 'door'"),
        ("--label wave --subject a --observers cam1", "1 observer with a camera file as view (cam1)"),
        ("--label wave --subject a --observers cam7", "known: cam0"),
        ("--label wave --subject a --up z --front z", "--front 'z'"),
        ("--label wave --subject a --up w", "--up 'w'"),
        ("--label wave --subject a --rate 25", "--rate 30"),
        ("--label wave --subject anna --trial 1", "has trial 1"),
    ],
)
def test_bad_input_is_rejected_with_one_line_and_the_archive_stays(run, dojo, arguments, message):
    whole = Recording(waving().astype(np.float32), 30.0, "wave", "anna", "1")
    write_archive(dojo / "mine.npz", MotionArchive(BODY_PARTS, (whole,)))
    before = (dojo / "mine.npz").read_bytes()
    with rejected(message):
        run("scene.toml", "-o", "mine.npz", *arguments.split())
    assert (dojo / "mine.npz").read_bytes() == before
