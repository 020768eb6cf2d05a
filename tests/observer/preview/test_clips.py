"""Clips of verdicts: the film that is written, what is deleted, and a full disk. And small pictures."""

import errno
import logging
import os

import cv2
import numpy as np
import pytest

from common import SECOND_NS
from common.clip_name import clip_name
from common.errors import LabanmeshError
from common.inbox import Inbox
from common.keys import SceneKeys
from common.messages import Agreement, StatusMessage, VerdictMessage, VocabularyReference
from common.picture_message import PICTURE_SIDE_PX
from common.vocabulary import Vocabulary
from common.wire import encode
from observer.camera.files import Video
from observer.preview import clip_folder
from observer.preview.clip_folder import DAY_NS, MB, ClipFolder
from observer.preview.clips import PENDING_CLIPS_LIMIT, VerdictClips, motion_jpeg
from observer.preview.shown_pictures import PicturedObserver
from observer.preview.small_picture import Sighting, encode_jpeg, small_picture
from observer.tracking.pose import WHOLE_BODY
from observer.tracks import BODY_PARTS, Frame, PersonTracks, Tracks

START_NS = 1_800_000_000 * SECOND_NS
GENERATOR = np.random.default_rng(0)
NAMES = Vocabulary(("wave", "point"))
VOCABULARY = VocabularyReference(name="", hash=NAMES.digest)
HANDS = Tracks(np.array([[400.0, 300.0], [np.nan, np.nan], [320.0, 90.0]]))


def picture(level):
    return np.full((480, 640, 3), level, np.uint8)


def verdict(number, label="wave", **fields):
    own = {
        "scene": "dojo", "fusion": "fusion", "seq": number, "at_ns": 1, "vocabulary": VOCABULARY,
        "p": [0.5, 0.5], "label": label, "certainty_bits": 0.1, "rule": "log", "votes": {},
        "agreement": Agreement(k=1, n=1), "id": f"f/{number}", "began_ns": 1, "decided_ns": 2,
    }  # fmt: skip
    return encode(VerdictMessage(**{**own, **fields}))


class Stage:
    """Clips that a test feeds: its own clock, 30 pictures a second that grow brighter."""

    def __init__(self, folder):
        self.inbox, self.now_ns, self.number = Inbox(), START_NS, 0
        self.clips = VerdictClips(self.inbox, folder, "sofa", (2.0, 1.0), lambda: NAMES, lambda: self.now_ns)

    def decide(self, payload):
        self.inbox.put(SceneKeys("dojo").verdict, payload)
        # The inbox has stamped it with the real clock.
        self.inbox._arrivals.append(self.inbox._arrivals.pop()._replace(arrived_ns=self.now_ns))

    def play(self, seconds):
        for _ in range(round(30 * seconds)):
            self.now_ns, self.number = self.now_ns + SECOND_NS // 30, self.number + 1
            if self.clips.is_due(self.now_ns):
                self.clips.show(Sighting(picture(self.number), HANDS, BODY_PARTS, self.now_ns), self.now_ns)


@pytest.fixture
def stage(tmp_path):
    return Stage(ClipFolder(tmp_path / "clips", 7.0, 1.0))


def test_a_clip_shows_the_seconds_before_and_after_the_verdict(stage, tmp_path):
    stage.play(4)
    stage.decide(verdict(1))
    stage.play(0.5)
    stage.decide(verdict(1, "point", stage="revised", revises="wave"))
    stage.decide(verdict(2, "abstain", stage="ended", ended_ns=3))
    stage.play(1.5)
    stage.clips.close()
    (path,) = (tmp_path / "clips").iterdir()
    assert path.name == "20270115T080004Z_sofa_point_f-1.avi"
    modes = [each.stat().st_mode & 0o777 for each in (path.parent, path)]
    assert modes == [0o700, 0o600], "nobody else on this machine looks at it"
    video = Video.open(path)
    levels = [float(np.median(each[100:, :100])) for each in video.pictures()]
    assert len(levels) == pytest.approx(30, abs=1) and video.rate_hz == pytest.approx(10, abs=0.3)
    assert levels[0] == pytest.approx(60, abs=5) and levels[-1] == pytest.approx(150, abs=5)


def test_verdicts_of_no_movement_and_floods_make_no_files(stage, tmp_path, caplog):
    stage.play(1)
    for number in range(100):
        stage.decide(verdict(number, f"forged_{number}"))
    for number in range(100, 100 + 2 * PENDING_CLIPS_LIMIT):
        stage.decide(verdict(number))
    stage.play(0.1)
    assert stage.clips.left_out == 100 + PENDING_CLIPS_LIMIT
    stage.clips.close()
    assert all("_wave_" in path.name for path in (tmp_path / "clips").iterdir())
    assert sum("none of its movements" in line for line in caplog.messages) == 1


def test_a_verdict_of_no_fusion_service_makes_no_clip(stage, tmp_path):
    status = StatusMessage(scene="dojo", id="fusion", state="running", session="s1")
    stage.inbox.put(SceneKeys("dojo").fusion_status("fusion"), encode(status))
    stage.play(1)
    for number, session in enumerate(("s0", None, "s1")):
        stage.decide(verdict(number, session=session))
    stage.play(1.2)
    stage.clips.close()
    assert stage.clips.left_out == 2 and [path.stem[-3:] for path in (tmp_path / "clips").iterdir()] == ["f-2"]


def test_a_clip_that_is_not_over_is_written_at_the_end_with_what_there_is(stage, tmp_path):
    stage.play(1)
    stage.decide(verdict(1))
    stage.clips.close()
    (path,) = (tmp_path / "clips").iterdir()
    assert len(list(Video.open(path).pictures())) == 10


def test_a_full_disk_is_one_line_and_the_next_clip_is_written(stage, tmp_path, monkeypatch, caplog):
    def full(path, content, way_out):
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC), str(path))

    with caplog.at_level(logging.WARNING), monkeypatch.context() as patch:
        patch.setattr(clip_folder, "write_file", full)
        for number in (1, 2):
            stage.decide(verdict(number))
            stage.play(1.2)
        stage.clips._writer.close()
    lines = [record.getMessage() for record in caplog.records]
    assert len(lines) == 1 and lines[0].startswith("no clip kept: ") and "no space left on device" in lines[0]
    assert "the observer goes on" in lines[0] and not list((tmp_path / "clips").glob("*"))


def test_clips_that_are_old_or_too_many_are_deleted_and_nothing_else(tmp_path):
    folder = ClipFolder(tmp_path, 2.0, 0.5)
    for age_days in (3, 1, 0.5, 0.1):
        path = tmp_path / clip_name(START_NS - round(age_days * DAY_NS), "sofa", "wave", "id")
        path.write_bytes(bytes(MB // 5))
        os.utime(path, ns=(0, START_NS - round(age_days * DAY_NS)))
    holiday = tmp_path / "holiday.avi"
    holiday.write_bytes(bytes(MB))
    os.utime(holiday, ns=(0, 0))
    assert folder.delete_old(START_NS) == 2 and len(list(tmp_path.iterdir())) == 3
    folder.add(clip_name(START_NS, "sofa", "../../etc", "x" * 200), bytes(MB // 5), START_NS)
    names = sorted(path.name for path in tmp_path.iterdir())
    assert len(names) == 3 and names[-1] == "holiday.avi" and all(len(name) < 160 for name in names)


def test_the_clips_of_one_observer_are_deleted_and_of_one_label_if_that_is_meant(tmp_path):
    folder = ClipFolder(tmp_path, 2.0, 0.5)
    for observer in ("sofa", "sofa_2"):
        for label in ("wave", "two_hand_wave"):
            (tmp_path / clip_name(START_NS, observer, label, "home-1")).write_bytes(b"film")
    (tmp_path / "holiday.avi").write_bytes(b"film")
    assert [folder.delete_of("sofa", label) for label in ("wave", "wave", "two_hand_wave")] == [1, 0, 1]
    assert folder.delete_of("sofa_2") == 2 and [path.name for path in tmp_path.iterdir()] == ["holiday.avi"]


def test_an_odd_number_of_bytes_and_one_picture_make_a_film(tmp_path):
    jpeg = encode_jpeg(picture(100), 80_000)[0]
    (tmp_path / "a.avi").write_bytes(motion_jpeg([jpeg + b"\0" * (1 - len(jpeg) % 2)], (640, 480), 10.0))
    assert len(list(Video.open(tmp_path / "a.avi").pictures())) == 1


@pytest.mark.parametrize("limit", [24_000, 9_600, 3_000])
def test_a_small_picture_fits_whatever_it_shows(limit):
    noise = GENERATOR.integers(0, 256, (720, 1280, 3), np.uint8)
    jpeg, size_px = encode_jpeg(small_picture(Sighting(noise, HANDS, BODY_PARTS, 0), PICTURE_SIDE_PX), limit)
    assert len(jpeg) <= limit and max(size_px) <= PICTURE_SIDE_PX
    read = cv2.imdecode(np.frombuffer(jpeg, np.uint8), cv2.IMREAD_COLOR)
    assert read.shape[:2] == size_px[::-1]


def test_a_small_picture_shows_the_skeleton_and_leaves_the_frame_alone():
    frame = picture(0)
    rows = np.full((len(WHOLE_BODY), 2), np.nan)
    rows[WHOLE_BODY.index("left_shoulder")], rows[WHOLE_BODY.index("left_elbow")] = (320.0, 200.0), (520.0, 400.0)
    small = small_picture(Sighting(frame, Tracks(rows), WHOLE_BODY, 0), 320)
    assert small.shape == (240, 320, 3) and small[150, 210].any() and not frame.any()
    assert not small[150:, :100].any()
    other = PersonTracks(2, rows - [280.0, 0.0], 100.0, 300.0, 300.0)
    two = Tracks(rows, persons=(PersonTracks(1, rows, 400.0, 300.0, 300.0), other))
    both = small_picture(Sighting(frame, two, WHOLE_BODY, 0), 320)
    assert both[150, 210].any() and both[150, 70].any(), "of several people each has a skeleton"


class Outlet:
    """Wants every picture, and remembers their numbers."""

    def __init__(self):
        self.shown, self.fails = [], False

    def is_due(self, now_ns):
        return True

    def show(self, sighting, now_ns):
        if self.fails:
            raise LabanmeshError("the link to the mesh is closed")
        self.shown.append(sighting.captured_ns)


class Skipping:
    """An observer that tracks every third picture, and the tracker that it steps."""

    vocabulary, complaint, body_parts = None, "", BODY_PARTS

    def __init__(self):
        self.tracker, self.all_tracks = self, None

    def step(self, frame):
        if frame.captured_ns % 3 == 0:
            self.all_tracks = Tracks(HANDS.centres)


def test_a_picture_that_was_skipped_is_not_shown_with_the_marks_of_another(caplog):
    observer, outlet, now_ns = Skipping(), Outlet(), [0]
    pictured = PicturedObserver(observer, observer, [outlet], lambda: now_ns[0])
    for number in range(10):
        now_ns[0] = number * SECOND_NS // 10
        pictured.step(Frame(number, picture(number)))
    assert outlet.shown == [0, 3, 6, 9]
    now_ns[0] += SECOND_NS
    pictured.step(Frame(10, picture(10)))
    assert outlet.shown[-1] == 10, "an observer that rests has tracks that are still true"
    outlet.fails = True
    for number in (12, 15):
        pictured.step(Frame(number, picture(number)))
    assert caplog.messages == ["no more pictures: the link to the mesh is closed"]
