"""Recorded pictures as sources: every picture when it is due, and one clear line for unreadable files."""

import logging
import os
import subprocess
import sys
import threading

import cv2
import numpy as np
import pytest
from camera_stage import numbered
from observer_stage import WaitingClock, rejected

from common import SECOND_NS
from common.errors import BadInput
from observer.camera.files import RecordedPictures, Video
from observer.camera.live import LiveCamera
from observer.camera.opening import open_pictures

START_NS = 1_000 * SECOND_NS


def numbers(frames):
    return [round(float(frame.content.mean()) / 10) for frame in frames]


def captured_s(frames):
    return [(frame.captured_ns - START_NS) / SECOND_NS for frame in frames]


def write_pictures(folder, names, size_px=(64, 48)):
    folder.mkdir(exist_ok=True)
    for i, name in enumerate(names):
        assert cv2.imwrite(str(folder / name), numbered(i, size_px))
    return folder


def rejection(text, folder, **arguments):
    with pytest.raises(BadInput) as caught:
        list(open_pictures(text, folder, speed=0, **arguments).frames(threading.Event()))
    assert "\n" not in str(caught.value)
    return str(caught.value)


def played(source, clock, **arguments):
    options = {"speed": source.speed, "loop": source.loop, "start_ns": source.start_ns, **arguments}
    return RecordedPictures(source.played, source.rate_hz, source.size_px, source.count, clock=clock, **options)


@pytest.mark.parametrize("speed", [0.5, 1.0, 4.0])
def test_a_video_is_played_whole_at_its_own_rate_and_speed_from_a_common_start(video, speed):
    source = open_pictures("clip.avi", video.parent, speed=speed, start_ns=START_NS + SECOND_NS)
    clock = WaitingClock()
    assert (source.rate_hz, source.size_px, source.count, source.body_parts) == (25.0, (64, 48), 12, ())
    frames = list(played(source, clock).frames(clock))
    assert numbers(frames) == list(range(12)) and len(clock.waits) == 12
    assert captured_s(frames) == pytest.approx([1 + i / 25 / speed for i in range(12)])
    assert frames[0].content.shape == (48, 64, 3) and frames[0].content.dtype == np.uint8


def test_the_last_picture_of_a_film_is_found_again_if_it_was_skipped_before_the_end_was_known(video):
    every = list(Video.open(video).pictures())
    (only,) = Video.open(video).played(lambda number: True)
    assert only.number == len(every) - 1 and only.last and (only.picture == every[-1]).all()


def test_a_film_that_is_played_slowly_shows_each_picture_for_longer(video):
    clock = WaitingClock()
    frames = list(played(open_pictures("clip.avi", video.parent, speed=0.1), clock).frames(clock))
    assert max(np.diff(captured_s(frames))) < 0.15
    assert len([frame for frame in frames if not frame.repeated]) == 12


def test_a_rate_replaces_the_videos_own(video):
    assert open_pictures("clip.avi", video.parent, rate_hz=10).rate_hz == 10
    assert "0 pictures per second" in rejection("clip.avi", video.parent, rate_hz=0.0)


def test_a_loop_keeps_its_rate_until_stopped(video):
    clock = WaitingClock(stopped_after=30)
    frames = list(played(open_pictures("clip.avi", video.parent, loop=True), clock).frames(clock))
    assert numbers(frames) == [i % 12 for i in range(30)]
    assert captured_s(frames) == pytest.approx([i / 25 for i in range(30)])


def test_pictures_are_sorted_by_number(tmp_path):
    write_pictures(tmp_path / "p", ["a2.png", "a10.png", "a11.PNG", "b1.bmp"])
    (tmp_path / "p" / "notes.txt").write_text("not a picture")
    (tmp_path / "p" / "._a1.png").write_bytes(b"left by a Mac")
    source = open_pictures("p/", tmp_path, speed=0, rate_hz=5)
    assert (source.rate_hz, source.count) == (5, 4)
    assert numbers(source.frames(threading.Event())) == [0, 1, 2, 3]
    assert numbers(open_pictures("p/a10.png", tmp_path, speed=0).frames(threading.Event())) == [1]


def test_files_that_are_not_videos(tmp_path, video):
    (tmp_path / "empty.mp4").touch()
    (tmp_path / "text.mp4").write_text("no video " * 100)
    whole = video.read_bytes()
    (tmp_path / "codec.avi").write_bytes(whole.replace(b"MJPG", b"QQQQ"))
    (tmp_path / "head.avi").write_bytes(whole[:300])
    assert "empty.mp4: the file is empty" in rejection("empty.mp4", tmp_path)
    assert "text.mp4: not a video; known:" in rejection("text.mp4", tmp_path)
    for name in ("codec.avi", "head.avi"):
        assert f"{name}: AVI file, but no picture can be read: unknown codec" in rejection(name, tmp_path)
    assert "gone.mp4: no such file or folder; a source is a webcam" in rejection("gone.mp4", tmp_path)
    assert "'': no such file" in rejection("", tmp_path)


def test_folders_without_usable_pictures(tmp_path):
    (tmp_path / "none").mkdir()
    assert "none: no pictures in this folder" in rejection("none", tmp_path)
    folder = write_pictures(tmp_path / "p", ["1.png", "2.png"])
    (folder / "3.png").touch()
    assert "3.png: the file is empty" in rejection("p", tmp_path)
    (folder / "3.png").write_bytes(b"\x89PNG is not enough")
    assert "3.png: not a readable picture" in rejection("p", tmp_path)
    write_pictures(folder, ["3.png"], (32, 48))
    assert "3.png: 32x48 px, but 1.png has 64x48" in rejection("p", tmp_path)


def test_another_size_than_expected_is_rejected(tmp_path, video):
    assert "clip.avi: 64x48 px, but 640x480 is expected" in rejection("clip.avi", video.parent, size_px=(640, 480))
    assert open_pictures("clip.avi", video.parent, size_px=(64, 48)).size_px == (64, 48)


def test_a_file_that_is_emptied_after_opening_is_rejected_when_played(tmp_path, video):
    copy = tmp_path / "clip.avi"
    copy.write_bytes(video.read_bytes())
    source = open_pictures("clip.avi", tmp_path, speed=0)
    copy.write_bytes(b"")
    with rejected("the file is empty"):
        list(source.frames(threading.Event()))


def test_a_picture_that_changes_its_size_after_opening_is_rejected_when_played(tmp_path):
    folder = write_pictures(tmp_path / "p", ["1.png", "2.png", "3.png"])
    frames = open_pictures("p", tmp_path, speed=0).frames(threading.Event())
    next(frames)
    assert cv2.imwrite(str(folder / "3.png"), np.zeros((8, 8, 3), np.uint8))
    with rejected("3.png: 8x8 px, but 1.png has 64x48"):
        list(frames)


def test_a_truncated_video_is_played_as_far_as_it_goes_with_a_warning(tmp_path, video, caplog):
    whole = video.read_bytes()
    (tmp_path / "cut.avi").write_bytes(whole[: len(whole) * 4 // 5])
    source = open_pictures("cut.avi", tmp_path, speed=0)
    with caplog.at_level(logging.WARNING, "labanmesh.observer"):
        played_numbers = numbers(source.frames(threading.Event()))
    assert played_numbers == list(range(len(played_numbers))) and 0 < len(played_numbers) < 12
    assert f"ends after {len(played_numbers)} of 12 pictures" in caplog.text


def test_an_address_is_not_opened_early_and_shows_no_password(tmp_path):
    line = rejection("ftp://me:s3cret@host/clip.mp4", tmp_path)
    assert line == "ftp://host/...: unknown kind of address; known: rtsp://, rtsps://, http://, https://"
    assert rejection("me:s3cret@host/1", tmp_path).startswith(
        "...@host/...: an address without its scheme; write rtsp://"
    )
    source = open_pictures("rtsp://me:s3cret@host/1", tmp_path, size_px=(640, 480))
    assert isinstance(source, LiveCamera) and source.name == "rtsp://host/..." and source.rate_hz == 30
    assert open_pictures("rtsp://me:s3cret@host/1", tmp_path, show_path=True).name == "rtsp://host/1"
    assert "s3cret" not in repr(source)
    assert open_pictures("0", tmp_path, rate_hz=15).name == "camera 0"
    assert open_pictures("/dev/video7", tmp_path).name == "/dev/video7"


def test_opencv_and_ffmpeg_write_nothing_to_stderr(tmp_path, video):
    (tmp_path / "text.mp4").write_text("no video " * 100)
    (tmp_path / "codec.avi").write_bytes(video.read_bytes().replace(b"MJPG", b"QQQQ"))
    code = """if True:
        import sys, pathlib
        from common.errors import BadInput
        from observer.camera.base import CameraFault
        from observer.camera.capture import connect
        from observer.camera.opening import open_pictures
        for text in ("text.mp4", "codec.avi"):
            try: open_pictures(text, pathlib.Path(sys.argv[1]))
            except BadInput: print(text)
        for text in ("rtsp://me:s3cret@127.0.0.1:9/1", "93", "/dev/video93"):
            try: connect(text, 30)
            except CameraFault as fault: print(fault)"""
    environment = {k: v for k, v in os.environ.items() if not k.startswith("OPENCV_")}
    ran = subprocess.run(
        [sys.executable, "-c", code, str(tmp_path)], capture_output=True, text=True, check=True, env=environment
    )
    assert ran.stderr == "" and "s3cret" not in ran.stdout
    assert [line.split(":")[0] for line in ran.stdout.splitlines()] == [
        "text.mp4",
        "codec.avi",
        "does not answer, or sends no video",
        "there is no /dev/video93",
        "there is no /dev/video93",
    ]
