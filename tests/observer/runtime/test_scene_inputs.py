"""Source and tracker of an observer's section of the scene file."""

import threading

import cv2
import numpy as np
import pytest

from common.config import read_scene
from common.errors import BadInput, LabanmeshError
from observer.foreign import MeshTracks, PipedTracks, frame_of_line
from observer.motion.archive import MotionArchive, Recording
from observer.motion.archive_file import write_archive
from observer.rendering.virtual_camera import VirtualCamera
from observer.runtime.scene_inputs import PLAYBACK_START, open_inputs
from observer.tracking.camshift import CamshiftTracker
from observer.tracks import BODY_PARTS, WHOLE_BODY, State

STANDING = np.array([[-0.3, 0.9, 0], [0.3, 0.9, 0], [0, 1.65, 0]], np.float32)


def recording(frames):
    return Recording(np.repeat(STANDING[None], frames, axis=0), 10.0, "bowing", "1", "1")


@pytest.fixture
def opened(tmp_path):
    write_archive(tmp_path / "m.npz", MotionArchive(BODY_PARTS, (recording(2), recording(3))))

    def read(extra="", source="m.npz", environment=None):
        (tmp_path / "s.toml").write_text(f'scene = "d"\n[observers.cam1]\nsource = "{source}"\n{extra}')
        return open_inputs(read_scene(tmp_path / "s.toml", {}), "cam1", environment=environment or {})

    return read


def test_the_scene_names_the_recording(opened):
    inputs = opened("recording = 1\nspeed = 0\nloop = true")
    one = inputs.source
    assert [len(recording.positions) for recording in one.recordings] == [3]
    assert (one.speed, one.loop, one.start_ns, one.rate_hz, one.body_parts) == (0, True, None, 10, BODY_PARTS)
    assert inputs.length == 3 and inputs.at_own_rate
    assert len(opened('recording = "all"').source.recordings) == 2
    assert opened(environment={PLAYBACK_START: "123"}).source.start_ns == 123


def test_recorded_motion_can_be_sampled_at_another_rate(opened):
    assert opened("rate_hz = 30").source.rate_hz == 30


def test_a_picture_tracker_gets_a_virtual_camera(opened):
    inputs = opened('tracker = "camshift"\nspeed = 0\nsize_px = [320, 240]')
    assert isinstance(inputs.source, VirtualCamera) and isinstance(inputs.tracker.tracker, CamshiftTracker)
    assert not inputs.at_own_rate
    frames = list(inputs.source.frames(threading.Event()))
    assert [frame.content.shape for frame in frames] == [(240, 320, 3)] * 2
    assert inputs.tracker.update(frames[0]).centres.shape == (3, 2)


FEET = (*BODY_PARTS, "left_foot", "right_foot")


def test_parts_that_a_tracker_does_not_find_are_never_seen_or_refused(tmp_path, caplog):
    write_archive(tmp_path / "m.npz", MotionArchive(BODY_PARTS, (recording(2),)))
    (tmp_path / "s.toml").write_text(
        'scene = "d"\n[observers.cam1]\nsource = "m.npz"\ntracker = "camshift"\nspeed = 0\nsize_px = [320, 240]\n'
    )
    scene = read_scene(tmp_path / "s.toml", {})
    inputs = open_inputs(scene, "cam1", FEET, fewer_parts=True)
    tracks = inputs.tracker.update(next(inputs.source.frames(threading.Event())))
    assert inputs.tracker.body_parts == FEET and tracks.states[3:] == (State.MISSING,) * 2
    assert "cam1: judges without left_foot, right_foot" in caplog.text
    for parts, fewer_parts in ((FEET, False), (FEET[3:], True)):
        with pytest.raises(BadInput, match="'left_foot': the model reads it, the tracker finds left_hand"):
            open_inputs(scene, "cam1", parts, fewer_parts=fewer_parts)


def test_mirrored_pictures_are_turned_back(opened):
    words = 'tracker = "camshift"\nspeed = 0\n'
    plain = next(opened(words).source.frames(threading.Event())).content
    turned = next(opened(words + "mirrored = true").source.frames(threading.Event())).content
    assert np.array_equal(plain[:, ::-1], turned) and turned.flags.c_contiguous


def test_a_mediapipe_that_does_not_start_is_replaced_with_one_line(opened, monkeypatch, caplog, tmp_path):
    def broken(path, smooth):
        raise LabanmeshError("mediapipe cannot start: libEGL.so.1 is missing")

    (tmp_path / "film").mkdir()
    cv2.imwrite(str(tmp_path / "film/1.png"), np.zeros((48, 64, 3), np.uint8))
    monkeypatch.setattr("common.tracker_choice.mediapipe_lacks", lambda: "")
    monkeypatch.setattr("observer.tracking.mediapipe_pose.open_people", broken)
    caplog.set_level("INFO")
    assert isinstance(opened(source="film").tracker.tracker, CamshiftTracker)
    (line,) = caplog.messages
    assert line == "cam1: tracker camshift: mediapipe cannot start: libEGL.so.1 is missing"
    with pytest.raises(LabanmeshError, match="libEGL"):
        opened('tracker = "mediapipe"', source="film")


@pytest.mark.parametrize(("source", "kind"), [("-", PipedTracks), ("zenoh:tracks/cam1", MeshTracks)])
def test_tracks_of_other_programs(opened, source, kind):
    inputs = opened(source=source)
    assert isinstance(inputs.source, kind) and inputs.tracker.body_parts == BODY_PARTS


def test_other_programs_send_the_whole_body_where_several_people_are_judged(tmp_path):
    (tmp_path / "s.toml").write_text('scene = "d"\n[people]\nmost = 2\n[observers.cam1]\nsource = "zenoh:tracks"\n')
    for wanted, parts in ((None, WHOLE_BODY), (("racket", "head"), ("racket", "head"))):
        inputs = open_inputs(read_scene(tmp_path / "s.toml", {}), "cam1", wanted)
        assert inputs.tracker.body_parts == parts and set(WHOLE_BODY) <= set(inputs.tracker.every_part)


def test_a_phone_sends_the_whole_body_under_a_key_of_its_own(tmp_path):
    (tmp_path / "s.toml").write_text('scene = "d"\n[observers.cam1]\nsource = "phone"\n')
    inputs = open_inputs(read_scene(tmp_path / "s.toml", {}), "cam1", None)
    assert inputs.source.key == "laban/d/observer/cam1/@tracks" and inputs.tracker.body_parts == WHOLE_BODY
    assert "labanmesh phone" in inputs.source.lines.way_out


def test_other_programs_may_send_any_part_that_the_model_reads(tmp_path):
    (tmp_path / "s.toml").write_text('scene = "d"\n[observers.cam1]\nsource = "zenoh:tracks"\n')
    inputs = open_inputs(read_scene(tmp_path / "s.toml", {}), "cam1", (*FEET, "racket"))
    line = b'{"parts": {"racket": [1, 2], "left_foot": [3, 4, 0.9], "nose": [5, 6]}}'
    tracks = inputs.tracker.update(frame_of_line(line, inputs.source.body_parts, 1))
    seen = dict(zip(inputs.tracker.body_parts, tracks.visible.tolist(), strict=True))
    assert seen == {**dict.fromkeys(FEET, False), "left_foot": True, "racket": True}


@pytest.mark.parametrize(
    ("extra", "source", "environment", "line"),
    [
        ("recording = 2", "m.npz", {}, r"observers\.cam1\.recording = 2: .*m\.npz has recordings 0 to 1"),
        ("", "m.npz", {PLAYBACK_START: "soon"}, r"LABANMESH_PLAYBACK_START_NS = 'soon': nanoseconds"),
        ("", "m.npz", {PLAYBACK_START: "9" * 5000}, r"LABANMESH_PLAYBACK_START_NS = '9{40}': nanoseconds"),
        ("", "m.npz", {PLAYBACK_START: str(2**63 - 1)}, r"= '\d{19}': \d+ days from now; nanoseconds"),
        ('tracker = "camshfit"', "m.npz", {}, r"observers\.cam1\.tracker = 'camshfit': .* did you mean camshift"),
        ('tracker = "foreign"', "m.npz", {}, r"reads tracks, but the source provides positions; use projected"),
        ('tracker = "projected"', "0", {}, r"reads positions, but the source provides pictures; use camshift"),
        ("mirrored = true", "m.npz", {}, r"cam1\.mirrored: only pictures can be mirrored back"),
        ("", "zenoh:a/*", {}, r"zenoh:KEY is expected"),
        ("", "gone.mp4", {}, r"gone\.mp4: no such file or folder; a source is a webcam"),
        ('view = "gone.toml"', "m.npz", {}, r"gone\.toml"),
        ('skin = "gone.npz"\ntracker = "camshift"', "m.npz", {}, r"gone\.npz"),
    ],
)
def test_invalid_inputs_are_rejected_in_one_line(opened, extra, source, environment, line):
    with pytest.raises(BadInput, match=line) as caught:
        opened(extra, source, environment)
    assert "\n" not in str(caught.value)
