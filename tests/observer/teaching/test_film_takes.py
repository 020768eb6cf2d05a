"""Own movements from films: takes are cut where a lesson would cut them; what is no film, or shows nothing, says so."""

import threading
from pathlib import Path

import numpy as np
import pytest

from common.config import Scene
from common.errors import BadInput
from observer.geometry.views import parse_view
from observer.motion.archive import Recording, TracksCamera
from observer.motion.playback import RecordedMotion
from observer.motion.projected import ProjectedTracker
from observer.runtime.prepared_tracker import PreparedTracker
from observer.runtime.scene_inputs import ObserverInputs
from observer.teaching import commands
from observer.teaching.film_takes import TaughtFilm, add_takes
from observer.teaching.takes_file import TakesFile
from observer.tracks import BODY_PARTS
from studies.performer import perform, perform_continuously

VIEW = parse_view("door")
STANDING = perform(("1",), ("ok",), trials=1).recordings[0].positions[:1]


def inputs(recording):
    """A film that shows the recording, tracked without an error."""
    tracker = PreparedTracker(ProjectedTracker(VIEW, BODY_PARTS, BODY_PARTS), BODY_PARTS)
    return ObserverInputs(RecordedMotion(BODY_PARTS, (recording,), speed=0), tracker, VIEW, False, None, True)


@pytest.fixture
def takes(tmp_path):
    return TakesFile(tmp_path / "takes.npz", BODY_PARTS, TracksCamera("sofa"))


def added(takes, recording, label="byebye"):
    return add_takes(TaughtFilm(label, Path(f"{label}.mp4")), inputs(recording), takes, "anna", threading.Event())


def test_each_movement_between_two_rests_is_a_take(takes):
    shown = perform_continuously("1", ["byebye"] * 3, rate_hz=30.0, seed=1, rest_s=(2.0, 2.5))
    lengths = [(span.end - span.start) / 30 for span in shown.spans]
    assert added(takes, shown) == pytest.approx(lengths, abs=0.8)
    assert len(added(takes, shown)) == 3
    assert takes.takes == {"byebye": [1, 2, 3, 4, 5, 6]} and takes.persons == {"anna": {"byebye": 6}}


def test_a_film_without_rest_is_one_take_and_one_of_ordinary_life_is_something_else(takes):
    (short,) = perform(("1",), ("byebye",), trials=1, rate_hz=30.0).recordings
    assert added(takes, short) == pytest.approx([len(short.positions) / 30], abs=0.5)
    assert sum(added(takes, perform_continuously("1", ["ok"] * 9, rate_hz=15.0, seed=2), "")) > 20
    assert takes.other_s > 20 and list(takes.takes) == ["byebye"]


@pytest.mark.parametrize(
    ("positions", "line"),
    [(np.full((90, 3, 3), np.nan), r"^byebye.mp4: nobody was seen"),
     (np.tile(STANDING, (90, 1, 1)), r"^byebye.mp4: shows no byebye"),
     (np.zeros((1, 3, 3)), r"^byebye.mp4: 1 pictures")],
)  # fmt: skip
def test_a_film_that_shows_no_movement_says_so(takes, positions, line):
    with pytest.raises(BadInput, match=line):
        added(takes, Recording(positions.astype(np.float32), 30.0, "", "1", ""))
    assert not takes.recordings


def test_an_interrupted_film_ends_the_command(takes):
    (short,) = perform(("1",), ("byebye",), trials=1).recordings
    stop = threading.Event()
    stop.set()
    with pytest.raises(KeyboardInterrupt):
        add_takes(TaughtFilm("byebye", Path("byebye.mp4")), inputs(short), takes, "anna", stop)


@pytest.mark.parametrize(
    ("text", "line"),
    [("wave", "LABEL=FILM is expected"), ("=a.mp4", "LABEL=FILM"), ("wave=none.mp4", "there is no film none.mp4"),
     ("wave=rtsp://camera/live", "there is no film"), ("wave=motion.npz", "a film is expected")],
)  # fmt: skip
def test_what_is_no_film_is_one_line(tmp_path, monkeypatch, text, line):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "motion.npz").touch()
    with pytest.raises(BadInput, match=line):
        TaughtFilm.parse(text)


def scene(*observers):
    return Scene.model_validate({"scene": "room", "observers": {name: {"source": "0"} for name in observers}})


def test_the_observer_is_the_only_one_or_named():
    assert commands._chosen(scene("sofa"), "") == "sofa" == commands._chosen(scene("shelf", "sofa"), "sofa")
    with pytest.raises(BadInput, match=r"the scene has sofa, shelf: .* --observer sofa"):
        commands._chosen(scene("sofa", "shelf"), "")
    with pytest.raises(BadInput, match="not in the scene"):
        commands._chosen(scene("sofa"), "shelf")


@pytest.mark.parametrize(
    ("labels", "add", "line"),
    [(["wave"], False, "one movement alone"), (["Wave", "clap"], False, "lower case"), ([], True, "of a movement"),
     (["abstain", "wave"], False, "abstain")],
)  # fmt: skip
def test_labels_are_checked_before_any_film_is_tracked(labels, add, line):
    with pytest.raises(BadInput, match=line):
        commands._require_teachable(scene("sofa"), "sofa", labels, add=add)
