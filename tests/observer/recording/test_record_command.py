"""`labanmesh record` as a person meets it; and what several cameras make of recorded people."""

import math
import threading

import numpy as np
import pytest
import typer

from common import SECOND_NS
from common.errors import BadInput
from common.vocabulary import Vocabulary
from observer.calibration.formats import read_opencv
from observer.geometry.camera_file import CameraModel, write_camera
from observer.geometry.lens import LensDistortion
from observer.geometry.projection import pinhole_matrix, project
from observer.geometry.views import parse_view
from observer.learning.learn import learn_view
from observer.model.base import Onset
from observer.motion.archive import MotionArchive, Recording
from observer.motion.archive_file import read_archive, write_archive
from observer.motion.importers import import_recordings
from observer.motion.projected import view_tracks
from observer.recording.capture import RecordingCamera, watch
from observer.recording.commands import record
from observer.recording.recorded import RecordingOptions, recorded
from observer.tracks import BODY_PARTS, Frame, Tracks

CAMERAS = [pinhole_matrix(math.radians(yaw), 0.15, 3.0, 700, (640, 360), (0, 0.9, 0)) for yaw in (-50, 0, 45)]


def name(rate_hz=30.0, label="wave", subject="anna", trial="1"):
    return Recording(np.zeros((0, 3, 3), np.float32), rate_hz, label, subject, trial)


def waving(seconds=2.0, rate_hz=30.0):
    t = np.arange(round(seconds * rate_hz)) / rate_hz
    rest = np.tile([[-0.25, 0.8, 0.0], [0.25, 1.3, -0.2], [0.0, 1.65, 0.0]], (len(t), 1, 1))
    rest[:, 1, 0] += 0.25 * np.sin(2 * np.pi * 1.5 * t)
    return rest


class Given:
    """A tracker for frames that hold centres."""

    body_parts = BODY_PARTS

    def update(self, frame):
        return Tracks(frame.content)


def watchers(positions, rate_hz, matrices, spoil=lambda camera, centres: centres, late_ns=0, motion=True):
    """Cameras that see the positions exactly, then spoilt."""
    result = []
    for n, H in enumerate(matrices):
        centres = spoil(n, project(H, positions))
        at = [round(i * SECOND_NS / rate_hz) + n * late_ns for i in range(len(positions))]
        frames = [Frame(t, c, t if motion else None) for t, c in zip(at, centres, strict=True)]
        result.append(RecordingCamera(f"cam{n}", iter(frames), Given(), H))
    return result


def seen_by(*args, **options):
    return watch(watchers(*args, **options), threading.Event())


def test_what_is_seen_exactly_is_found_exactly():
    made, lines = recorded(seen_by(waving(), 30, CAMERAS), BODY_PARTS, name(), RecordingOptions())
    np.testing.assert_allclose(made.positions, waving(), atol=1e-4)
    assert len(lines) == 1 and "all parts in 100%" in lines[0] and "0.0 px" in lines[0]


def test_cameras_that_look_at_other_moments_and_other_rates_agree_on_the_common_clock():
    fast = seen_by(waving(2, 60), 60, CAMERAS[:2], late_ns=7_000_000)
    slow = seen_by(waving(2, 25), 25, CAMERAS[2:])
    made, _ = recorded([*fast, *slow], BODY_PARTS, name(20.0), RecordingOptions())
    expected = waving(2, 20)[: len(made.positions)]
    # The clock begins 7 ms late: a hand at 2.4 m/s is then 17 mm further, and a straight line cuts 12 mm off its curve.
    assert np.nanmax(np.linalg.norm(made.positions - expected, axis=-1)) < 0.03
    assert np.isfinite(made.positions).all()


def test_a_camera_that_is_wrong_is_outvoted_and_named():
    def spoil(camera, centres):
        return centres + ([90, -60] if camera == 1 else 0)

    cameras = [*CAMERAS, pinhole_matrix(math.radians(100), 0.1, 3.0, 700, (640, 360), (0, 0.9, 0))]
    made, lines = recorded(seen_by(waving(), 30, cameras, spoil), BODY_PARTS, name(), RecordingOptions())
    np.testing.assert_allclose(made.positions, waving(), atol=1e-3)
    assert lines[1] == ("cam1: rejected in 100% of what it saw; look at its calibration and at what its tracker finds")
    assert len(lines) == 2


def test_what_one_camera_alone_sees_is_not_known_unless_for_a_moment():
    def spoil(camera, centres):
        if camera:
            centres[20:23, 0] = centres[30:45, 1] = np.nan
        return centres

    made, lines = recorded(seen_by(waving(), 30, CAMERAS, spoil), BODY_PARTS, name(), RecordingOptions())
    unknown = np.isnan(made.positions).any(axis=-1)
    assert unknown[:, 1].sum() == 15 and not unknown[:, [0, 2]].any()
    assert "right_hand 75%" in lines[0]


def test_a_hand_that_is_taken_for_another_for_a_moment_is_put_back():
    wrong = waving()
    wrong[25, 0] += [0.5, 0.4, 0.0]
    made, _ = recorded(seen_by(wrong, 30, CAMERAS), BODY_PARTS, name(), RecordingOptions())
    np.testing.assert_allclose(made.positions[:, 0], waving()[:, 0], atol=1e-4)


def test_idle_ends_are_cut_on_request_and_the_room_is_turned():
    still = np.tile(waving()[:1], (60, 1, 1))
    positions = np.concatenate([still, waving(), still])
    room = positions[..., [2, 0, 1]] * [-1, -1, 1]  # x forward, y left, z up
    matrices = [H @ np.array([[0, -1, 0, 0], [0, 0, 1, 0], [-1, 0, 0, 0], [0, 0, 0, 1.0]]) for H in CAMERAS]
    made, _ = recorded(seen_by(room, 30, matrices), BODY_PARTS, name(), RecordingOptions(up="z", front="x", trim=True))
    assert 60 < len(made.positions) < 90
    count = len(made.positions)
    off = [np.abs(made.positions - positions[n : n + count]).max() for n in range(len(positions) - count)]
    assert min(off) < 1e-4
    assert 45 < int(np.argmin(off)) <= 56


def test_enough_is_enough_for_each_and_a_live_camera_that_delivers_nothing_is_not_waited_for():
    stop = threading.Event()
    live = watchers(waving(5), 30, CAMERAS[:2], motion=False)
    nothing = (Frame(0, np.zeros((3, 2))) for _ in range(1) if not stop.wait(20))
    hanging = RecordingCamera("cam9", nothing, Given(), CAMERAS[0])
    seen = watch([*live, hanging], stop, seconds=1.0)
    assert stop.is_set()
    assert 29 <= len(seen[0].at_ns) <= 31 or 29 <= len(seen[1].at_ns) <= 31
    assert len(seen[2].at_ns) == 0
    with pytest.raises(BadInput, match="nothing was recorded"):
        blind = seen_by(waving(), 30, CAMERAS, lambda n, c: c * np.nan)
        recorded(blind, BODY_PARTS, name(), RecordingOptions())


def test_one_that_fails_stops_all_and_is_heard():
    stop = threading.Event()

    def endless():
        n = 0
        while not stop.is_set():
            yield Frame(n * 1000, np.zeros((3, 2)))
            n += 1

    def broken():
        yield Frame(0, np.zeros((3, 2)))
        raise BadInput("cam1: zero bytes")

    with pytest.raises(BadInput, match="zero bytes"):
        watch(
            [
                RecordingCamera("cam0", endless(), Given(), CAMERAS[0]),
                RecordingCamera("cam1", broken(), Given(), CAMERAS[0]),
            ],
            stop,
        )


@pytest.fixture
def run(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    app = typer.Typer(add_completion=False, pretty_exceptions_enable=False)
    app.command("record")(record)
    command = typer.main.get_command(app)
    return lambda *words: command.main([str(w) for w in words], "labanmesh record", standalone_mode=False)


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
        # Recording neither waits nor begins again, whatever the scene says for `observe`.
        lines += [
            f"[observers.cam{n}]",
            'source = "motion.npz"',
            f'view = "cam{n}.toml"',
            "speed = 0.01",
            "loop = true",
        ]
    lines += ["[observers.door]", 'source = "motion.npz"', 'view = "door"']
    (tmp_path / "scene.toml").write_text("\n".join(lines))
    return tmp_path


def test_a_scene_becomes_an_archive_that_grows(run, dojo, capsys):
    run("scene.toml", "-o", "mine.npz", "--label", "wave", "--subject", "anna")
    run(
        "scene.toml",
        "-o",
        "mine.npz",
        "--label",
        "wave",
        "--subject",
        "anna",
        "--seconds",
        1,
        "--observers",
        "cam0,cam2",
    )
    said = capsys.readouterr().out
    assert "cam0, cam1, cam2 watch wave by anna, trial 1" in said and "cam0, cam2 watch wave by anna, trial 2" in said
    assert "all parts in 100% of 60 instants" in said and "2 recordings in all" in said
    first, second = read_archive(dojo / "mine.npz").recordings
    np.testing.assert_allclose(first.positions, waving(), atol=1e-4)
    assert (first.trial, second.trial, first.rate_hz) == ("1", "2", 30.0)
    assert 30 <= len(second.positions) <= 31


@pytest.mark.parametrize(
    ("words", "says"),
    [
        ("--label Wave --subject a", "--label 'Wave'"),
        ("--label wave --subject a --observers door", "observers.door.view = 'door'"),
        ("--label wave --subject a --observers cam1", "1 observer with a camera file"),
        ("--label wave --subject a --observers cam7", "known: cam0"),
        ("--label wave --subject a --up z --front z", "--front 'z'"),
        ("--label wave --subject a --rate 25", "--rate 30"),
        ("--label wave --subject anna --trial 1", "has trial 1"),
    ],
)
def test_bad_input_is_one_line_and_the_archive_stays(run, dojo, words, says):
    whole = Recording(waving().astype(np.float32), 30.0, "wave", "anna", "1")
    write_archive(dojo / "mine.npz", MotionArchive(BODY_PARTS, (whole,)))
    before = (dojo / "mine.npz").read_bytes()
    with pytest.raises(BadInput) as caught:
        run("scene.toml", "-o", "mine.npz", *words.split())
    assert says in str(caught.value) and "\n" not in str(caught.value)
    assert (dojo / "mine.npz").read_bytes() == before


def test_the_recorded_person_of_pose2sim_with_noise_and_a_camera_that_points_anywhere(data):
    home = data / "pose2sim_single/reference_3d"
    cameras = read_opencv(home / "Pose2Sim_cameras.toml")
    lines = (home / "Pose2Sim_markers.trc").read_text().splitlines()
    markers = lines[3].split("\t")
    columns = [2 + 3 * ((markers.index(m) - 2) // 3) for m in ("LWrist", "RWrist", "Head")]
    rows = [line.split("\t") for line in lines[5:] if line.strip()]
    # The world of the calibration is (Z, X, Y) of the file.
    truth = np.array([[[float(row[c + k]) for k in (2, 0, 1)] for c in columns] for row in rows])
    rng = np.random.default_rng(0)
    sources = []
    for n, camera in enumerate(cameras):
        drawn = camera.pixels(truth) + rng.normal(0, 2, (*truth.shape[:2], 2))
        if n == 2:
            drawn = rng.uniform((0, 0), camera.image_size_px, drawn.shape)
        at = [round(i * SECOND_NS / 60) for i in range(len(truth))]
        frames = [Frame(t, camera.lens.undistorted(c), t) for t, c in zip(at, drawn, strict=True)]
        sources.append(RecordingCamera(camera.name, iter(frames), Given(), camera.matrix))
    made, said = recorded(watch(sources, threading.Event()), BODY_PARTS, name(60.0), RecordingOptions())
    off = np.linalg.norm(made.positions - truth, axis=-1)
    print(f"median {np.nanmedian(off) * 1000:.1f} mm, seen {np.isfinite(off).mean():.1%}; {said}")
    assert np.nanmedian(off) < 0.01  # 3 cm are asked for
    assert np.isfinite(off).mean() > 0.98
    assert any(line.startswith(f"{cameras[2].name}: rejected") for line in said)


def test_a_model_learned_from_what_three_cameras_recorded_judges_as_one_from_the_originals(data):
    whole = import_recordings("msr-action3d", data / "msr_action3d").archive
    labels = ("high_arm_wave", "hand_clap", "forward_kick", "draw_circle")
    few = [r for r in whole.recordings if r.label in labels and r.subject in "123678" and r.trial == "1"]
    assert len(few) == 24
    rng = np.random.default_rng(1)
    matrices = [pinhole_matrix(math.radians(yaw), 0.1, 3.5, 700, (640, 360), (0, 0, 2.6)) for yaw in (-40, 0, 45)]
    again = []
    for one in few:
        noisy = seen_by(one.positions.astype(float), 15, matrices, lambda n, c: c + rng.normal(0, 1, c.shape))
        made, _ = recorded(noisy, BODY_PARTS, name(15.0, one.label, one.subject, one.trial), RecordingOptions())
        again.append(made)
    off = [
        np.linalg.norm(made.positions - one.positions[: len(made.positions)], axis=-1)
        for made, one in zip(again, few, strict=True)
    ]
    print(f"median {np.nanmedian(np.concatenate(off)) * 1000:.1f} mm over {len(few)} recordings")
    assert np.nanmedian(np.concatenate(off)) < 0.01
    right = [judged_right(few, source, labels) for source in (few, again)]
    print(f"right of {sum(r.subject in '678' for r in few)}: learned from originals {right[0]}, recorded {right[1]}")
    assert abs(right[0] - right[1]) <= 2
    assert right[1] > 0.7 * sum(r.subject in "678" for r in few)


def judged_right(originals, learned_from, labels):
    """How many recordings of people 6, 7, 8 a model of people 1, 2, 3 gets right, seen from the door."""
    train = tuple(r for r in learned_from if r.subject in "123")
    view = parse_view("door")
    model = learn_view(MotionArchive(BODY_PARTS, train), view, Vocabulary(labels))
    right = 0
    for one in (r for r in originals if r.subject in "678"):
        observer = model.watch(Onset(known=True, length=len(one.positions)))
        for tracks in view_tracks(view, one, BODY_PARTS, BODY_PARTS):
            observer.update(tracks)
        right += labels[int(observer.p.argmax())] == one.label
    return right
