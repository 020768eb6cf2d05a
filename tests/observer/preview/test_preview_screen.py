"""Outputs of previews: films, single pictures and windows; and the thread that paints them."""

import logging
import threading
from types import SimpleNamespace

import cv2
import numpy as np
import pytest
from observer_stage import rejected
from processes import SOON_S

from common.errors import LabanmeshError
from common.vocabulary import Vocabulary
from observer.camera.files import PictureFolder, Video
from observer.preview import film, screen
from observer.preview.drawing import SIZE
from observer.preview.film import Film, Window, why_no_window
from observer.preview.screen import FALLBACK, QUEUE_SIZE, PreviewingObserver, PreviewThread, open_preview
from observer.preview.sight import PreviewHistory
from observer.runtime.pipeline import Posterior
from observer.tracks import BODY_PARTS, Frame, Tracks

STANDING = np.array([[42.0, 30.0], [18.0, 30.0], [32.0, 9.0]])
HISTORY = PreviewHistory(BODY_PARTS, 5.0)
SHOWN = HISTORY.add(Tracks(STANDING))


def picture(number):
    return np.full((48, 64, 3), 10 * (number % 25), np.uint8)


def level(painted):
    """The number of a painted picture."""
    return round(float(np.median(painted[250:350, 20:100])) / 10)


class RecordingOutlet:
    """An outlet that records pictures, and draws only after `release` is set."""

    def __init__(self, fails=None):
        self.drawn, self.closed, self.fails = [], False, fails
        self.release, self.entered = threading.Event(), threading.Event()

    def draw(self, painted, shown_ns):
        self.entered.set()
        assert self.release.wait(SOON_S)
        if self.fails:
            raise self.fails
        self.drawn.append(level(painted))

    def close(self):
        self.closed = True


@pytest.mark.parametrize("name", ["a.mp4", "a.avi"])
def test_a_film_has_all_pictures_and_replaces_another_when_it_is_complete(monkeypatch, tmp_path, name):
    monkeypatch.chdir(tmp_path)
    (tmp_path / name).write_bytes(b"earlier")
    with open_preview(name, 10.0, keep_all=True) as preview:
        for number in range(12):
            preview.show(picture(number), SHOWN)
        assert (tmp_path / name).read_bytes() == b"earlier"
    assert [p.name for p in tmp_path.iterdir()] == [name]
    video = Video.open(tmp_path / name)
    read = list(video.pictures())
    assert len(read) == 12 and video.size_px == SIZE and video.rate_hz == pytest.approx(10.0)
    assert np.abs(np.diff([float(np.median(p[250:350, 20:100])) for p in read]) - 10).max() < 6


def test_a_film_without_pictures_is_removed(monkeypatch, tmp_path, caplog):
    monkeypatch.chdir(tmp_path)
    with caplog.at_level(logging.WARNING), open_preview("a.mp4", 10.0):
        pass
    assert not list(tmp_path.iterdir()) and "no picture was shown" in caplog.text


class Counting(Film):
    """Counts how often each picture is written."""

    def __init__(self, path, rate_hz):
        super().__init__(path, rate_hz, keep_all=False)
        self.times = []

    def draw(self, painted, shown_ns):
        before = self._written
        super().draw(painted, shown_ns)
        self.times.append(self._written - before)


def test_a_film_keeps_real_time(tmp_path):
    counting = Counting(tmp_path / "a.avi", 10.0)
    painted = np.zeros((SIZE[1], SIZE[0], 3), np.uint8)
    for at_s in (0.0, 0.1, 0.4, 0.41, 0.5, 100.0, 100.1):
        counting.draw(painted, 5_000_000_000 + round(at_s * 1e9))
    counting.close()
    assert counting.times == [1, 1, 3, 0, 1, 20, 1]  # the long silence is cut to 2 s


@pytest.mark.parametrize(
    ("target", "message"),
    [
        ("none/a.mp4", "none/a.mp4: No such file"),
        ("none/a.png", "a.png: No such file"),
        ("a.mkv", "known: window, FILE.mp4"),
        ("", "known: window, FILE.mp4"),
        ("file/pictures", "cannot write"),
        ("a-%s-%d.png", "one number is expected"),
        ("a-%q.png", "one number is expected"),
        ("folder.mp4", "is a folder"),
    ],
)
def test_an_unwritable_target_is_rejected_and_leaves_no_file(monkeypatch, tmp_path, target, message):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "file").write_text("")
    (tmp_path / "folder.mp4").mkdir()
    with rejected(message):
        open_preview(target, 10.0)
    assert sorted(p.name for p in tmp_path.iterdir()) == ["file", "folder.mp4"]


@pytest.mark.parametrize(
    ("target", "names"),
    [
        ("pictures", ["pictures/000000.png", "pictures/000001.png", "pictures/000002.png"]),
        ("f-%02d.jpg", ["f-00.jpg", "f-01.jpg", "f-02.jpg"]),
        ("newest.png", ["newest.png"]),
    ],
)
def test_stills_are_separate_files(monkeypatch, tmp_path, target, names):
    monkeypatch.chdir(tmp_path)
    with open_preview(target, 10.0, keep_all=True) as preview:
        for number in range(3):
            preview.show(picture(number + 1), SHOWN)
    files = sorted(p for p in tmp_path.rglob("*") if p.is_file())
    assert [str(p.relative_to(tmp_path)) for p in files] == names
    newest = list(PictureFolder.open(files[-1]).pictures())[-1]
    assert (newest.shape[1], newest.shape[0]) == SIZE and level(newest) == 3


def test_a_newer_frame_replaces_a_waiting_one():
    outlet = RecordingOutlet()
    preview = PreviewThread(outlet, keep_all=False)
    preview.show(picture(1), SHOWN)
    assert outlet.entered.wait(SOON_S)
    for number in range(2, 20):
        preview.show(picture(number), SHOWN)
    outlet.release.set()
    preview.close()
    assert outlet.drawn == [1, 19] and outlet.closed


def test_the_observer_waits_when_all_frames_are_kept():
    outlet, shown = RecordingOutlet(), threading.Semaphore(0)
    preview = PreviewThread(outlet, keep_all=True)
    count = QUEUE_SIZE + 6

    def observe():
        for number in range(count):
            preview.show(picture(number), SHOWN)
            shown.release()

    observing = threading.Thread(target=observe)
    observing.start()
    for _ in range(QUEUE_SIZE + 1):  # one is being drawn, the others wait
        assert shown.acquire(timeout=SOON_S)
    assert not shown.acquire(timeout=0.05)
    outlet.release.set()
    observing.join(SOON_S)
    preview.close()
    assert outlet.drawn == list(range(count))


@pytest.mark.parametrize("keep_all", [False, True])
@pytest.mark.parametrize("error", [LabanmeshError("disk: full"), OSError(28, "No space left on device")])
def test_an_error_is_logged_once_and_does_not_stop_the_observer(caplog, keep_all, error):
    outlet = RecordingOutlet(error)
    outlet.release.set()
    preview = PreviewThread(outlet, keep_all)
    with caplog.at_level(logging.WARNING):
        for number in range(QUEUE_SIZE + 20):
            preview.show(picture(number), SHOWN)
        preview.close()
        preview.close()
    assert outlet.closed and caplog.text.count("preview: ") == 1


@pytest.mark.parametrize(
    ("environment", "platform", "built", "message"),
    [
        ({}, "linux", "QT5", "there is no display"),
        ({"DISPLAY": ":0"}, "linux", "QT5", ""),
        ({"WAYLAND_DISPLAY": "wayland-0"}, "linux", "QT5", ""),
        ({"DISPLAY": ":0"}, "linux", "NONE", "without windows"),
        ({}, "win32", "WIN32UI", ""),
        ({}, "darwin", "COCOA", "main thread"),
    ],
)
def test_reasons_for_no_window(monkeypatch, environment, platform, built, message):
    monkeypatch.setattr(cv2, "getBuildInformation", lambda: f"\n  GUI:                 {built}\n")
    reason = why_no_window(environment, platform)
    assert message in reason and bool(message) == bool(reason)


def test_a_film_is_written_when_no_window_can_be_opened(monkeypatch, tmp_path, caplog):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(screen, "why_no_window", lambda: "there is no display")
    with caplog.at_level(logging.WARNING), open_preview("window", 10.0) as preview:
        preview.show(picture(1), SHOWN)
    assert Video.open(tmp_path / FALLBACK).size_px == SIZE
    assert (tmp_path / FALLBACK).stat().st_mode & 0o777 == 0o600, "nobody has asked for this film of a person"
    assert "cannot open a window: there is no display" in caplog.text and str(FALLBACK) in caplog.text


def fake_window(monkeypatch, visible, key):
    calls = []
    monkeypatch.setattr(screen, "why_no_window", lambda: "")
    for name in ("namedWindow", "resizeWindow", "imshow", "destroyWindow"):
        monkeypatch.setattr(film.cv2, name, lambda *words, name=name: calls.append(name))
    monkeypatch.setattr(film.cv2, "getWindowProperty", lambda *_: visible)
    monkeypatch.setattr(film.cv2, "waitKey", lambda _: key)
    return calls


def test_a_window_opens_once_and_is_closed_at_the_end(monkeypatch):
    calls = fake_window(monkeypatch, 1.0, -1)
    window = Window("door")
    for _ in range(3):
        window.draw(picture(1), 0)
    window.close()
    assert calls == ["namedWindow", "resizeWindow", "imshow", "imshow", "imshow", "destroyWindow"]


@pytest.mark.parametrize(("visible", "key"), [(0.0, -1), (1.0, ord("q"))])
def test_closing_the_window_ends_only_the_preview(monkeypatch, caplog, visible, key):
    fake_window(monkeypatch, visible, key)
    with caplog.at_level(logging.WARNING), open_preview("window", 10.0) as preview:
        while preview._thread.is_alive():
            preview.show(picture(1), SHOWN)
    assert "the observer continues" in caplog.text


class FakeObserver:
    """An observer and its tracker in one."""

    vocabulary, complaint, leans_on = Vocabulary(("ok", "shake")), "too dark", None
    body_parts, all_tracks = BODY_PARTS, None

    @property
    def tracker(self):
        return self

    def step(self, frame):
        self.all_tracks = Tracks(STANDING)
        return Posterior(np.array([0.7, 0.3]), 0.1, 1, {})


@pytest.mark.parametrize("content", [picture(3), np.zeros((3, 3))])
def test_a_previewed_observer_behaves_as_without(content):
    arguments, observer = [], FakeObserver()
    preview = SimpleNamespace(show=lambda *words: arguments.append(words))
    history = PreviewHistory(BODY_PARTS, 5.0, "door")
    previewed = PreviewingObserver(observer, observer, preview, history, clock=lambda: 2_500_000_000)
    posterior = previewed.step(Frame(2_000_000_000, content))
    assert posterior.p.tolist() == [0.7, 0.3] and previewed.vocabulary is observer.vocabulary
    ((shown, frame),) = arguments
    assert shown is (content if content.ndim == 3 else None)
    assert frame.age_s == 0.5 and frame.complaint == "too dark" and frame.posterior.winner == 0
