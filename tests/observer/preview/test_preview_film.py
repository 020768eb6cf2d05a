"""The film of a preview, and the thread that paints it."""

import logging
import threading

import numpy as np
import pytest
from observer_stage import rejected
from processes import SOON_S

from common.errors import LabanmeshError
from common.vocabulary import Vocabulary
from observer.camera.files import Video
from observer.preview.drawing import SIZE
from observer.preview.film import QUEUE_SIZE, Film, FilmPreview
from observer.preview.shown_pictures import PicturedObserver
from observer.preview.sight import Sighting
from observer.runtime.pipeline import Posterior
from observer.tracks import BODY_PARTS, Frame, Tracks

STANDING = np.array([[42.0, 30.0], [18.0, 30.0], [32.0, 9.0]])


def picture(number):
    return np.full((48, 64, 3), 10 * (number % 25), np.uint8)


def sighting(number):
    return Sighting(picture(number), Tracks(STANDING), BODY_PARTS, 0)


def level(painted):
    """The number of a painted picture."""
    return round(float(np.median(painted[250:350, 20:100])) / 10)


class RecordingFilm:
    """A film that records pictures, and draws only after `release` is set."""

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
    with FilmPreview.open(name, 10.0, "door", keep_all=True) as preview:
        for number in range(12):
            preview.show(sighting(number), 0)
        assert (tmp_path / name).read_bytes() == b"earlier"
    assert [p.name for p in tmp_path.iterdir()] == [name]
    video = Video.open(tmp_path / name)
    read = list(video.pictures())
    assert len(read) == 12 and video.size_px == SIZE and video.rate_hz == pytest.approx(10.0)
    assert np.abs(np.diff([float(np.median(p[250:350, 20:100])) for p in read]) - 10).max() < 6


def test_a_film_without_pictures_is_removed(monkeypatch, tmp_path, caplog):
    monkeypatch.chdir(tmp_path)
    with caplog.at_level(logging.WARNING), FilmPreview.open("a.mp4", 10.0, "door"):
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
        ("a.mkv", "FILE.mp4 or FILE.avi is expected"),
        ("window", "FILE.mp4 or FILE.avi is expected; live pictures: picture_hz"),
        ("folder.mp4", "is a folder"),
    ],
)
def test_an_unwritable_target_is_rejected_and_leaves_no_file(monkeypatch, tmp_path, target, message):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "file").write_text("")
    (tmp_path / "folder.mp4").mkdir()
    with rejected(message):
        FilmPreview.open(target, 10.0, "door")
    assert sorted(p.name for p in tmp_path.iterdir()) == ["file", "folder.mp4"]


def test_a_newer_frame_replaces_a_waiting_one():
    outlet = RecordingFilm()
    preview = FilmPreview(outlet, "door")
    preview.show(sighting(1), 0)
    assert outlet.entered.wait(SOON_S)
    for number in range(2, 20):
        preview.show(sighting(number), 0)
    outlet.release.set()
    preview.close()
    assert outlet.drawn == [1, 19] and outlet.closed


def test_the_observer_waits_when_all_frames_are_kept():
    outlet, shown = RecordingFilm(), threading.Semaphore(0)
    preview = FilmPreview(outlet, "door", keep_all=True)
    count = QUEUE_SIZE + 6

    def observe():
        for number in range(count):
            preview.show(sighting(number), 0)
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
    outlet = RecordingFilm(error)
    outlet.release.set()
    preview = FilmPreview(outlet, "door", keep_all)
    with caplog.at_level(logging.WARNING):
        for number in range(QUEUE_SIZE + 20):
            preview.show(sighting(number), 0)
        preview.close()
        preview.close()
    assert outlet.closed and caplog.text.count("preview: ") == 1


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
    film, observer = RecordingFilm(), FakeObserver()
    preview = FilmPreview(film, "door")
    shown, show = [], preview.show
    preview.show = lambda *words: (shown.append(words), show(*words))
    previewed = PicturedObserver(observer, observer, [preview], clock=lambda: 2_500_000_000)
    posterior = previewed.step(Frame(2_000_000_000, content))
    assert posterior.p.tolist() == [0.7, 0.3] and previewed.vocabulary is observer.vocabulary
    ((seen, now_ns),) = shown
    assert seen.picture is (content if content.ndim == 3 else None) and (seen.extent is None) == (content.ndim == 3)
    assert now_ns - seen.captured_ns == 500_000_000 and seen.complaint == "too dark" and seen.posterior.winner == 0
    film.release.set()
    preview.close()
    assert len(film.drawn) == 1
