"""Own movements from films: takes are cut where a lesson would cut them; what is no film, or shows nothing, says so."""

import threading
from contextlib import nullcontext
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from e2e_stage import free_endpoint

from common.config import Scene
from common.errors import BadInput, LabanmeshError
from common.link import Link
from observer.geometry.views import parse_view
from observer.model.model_file import read_model
from observer.motion.archive import Recording, TracksCamera
from observer.motion.playback import RecordedMotion
from observer.motion.projected import ProjectedTracker
from observer.prepared_tracks import PreparedTracker
from observer.runtime.scene_inputs import ObserverInputs
from observer.teaching import commands
from observer.teaching.film_takes import TaughtFilm, add_takes
from observer.teaching.model_learner import ModelLearner
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
     ("wave=~nosuchuser/a.mp4", "no user of this machine"),
     ("wave=rtsp://camera/live", "there is no film"), ("wave=motion.npz", "a film is expected")],
)  # fmt: skip
def test_what_is_no_film_is_one_line(tmp_path, monkeypatch, text, line):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "motion.npz").touch()
    with pytest.raises(BadInput, match=line):
        TaughtFilm.parse(text)


SCENE = """scene = "films"
[mesh]
endpoint = "{endpoint}"
[observers.sofa]
source = "0"
tracker = "camshift"
"""


@pytest.fixture
def teach(tmp_path, monkeypatch):
    """Teaches the scene's observer from "films", each of which shows its movement so often between rests."""
    (file := tmp_path / "scene.toml").write_text(SCENE.format(endpoint=free_endpoint()))
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(commands, "RUNS_S", 0.0)

    def shown(scene, observer, film):
        movements = [film.label or "shake"] * int(film.path.stem[-1])
        return inputs(perform_continuously("1", movements, rate_hz=15.0, seed=1, rest_s=(2.0, 2.5)))

    monkeypatch.setattr("observer.teaching.film_takes.open_film", shown)

    def run(*films, **options):
        for film in films:
            (tmp_path / film.partition("=")[2]).touch()
        commands.teach_from_films(file, list(films), **options)
        return file

    return run


def test_films_teach_as_a_lesson_does_and_more_can_be_added(teach, tmp_path, capsys):
    teach("byebye=three3.mp4", "maestro=two2.mp4", "maestro=one1.mp4", "nothing=life2.mp4")
    shown = capsys.readouterr().out
    assert "three3.mp4: 3 takes of byebye (" in shown and "one1.mp4: 1 take of maestro (" in shown
    assert "sofa: byebye 3 of 3, maestro 3 of 3, of takes that were left out" in shown and "life2.mp4: " in shown
    assert read_model(tmp_path / "sofa.model").header.vocabulary.labels == ("byebye", "maestro")
    teach("stretch=two2.mp4", add=True, person="ben")
    assert read_model(tmp_path / "sofa.model").header.vocabulary.labels == ("byebye", "maestro", "stretch")
    kept = TakesFile(tmp_path / "sofa.tracks.npz", BODY_PARTS, TracksCamera("sofa"))
    assert {label: len(numbers) for label, numbers in kept.takes.items()} == {"byebye": 3, "maestro": 3, "stretch": 2}
    assert set(kept.persons) == {"someone", "ben"} and kept.other_s > 5


def test_what_cannot_be_taught_changes_nothing(teach, tmp_path, monkeypatch):
    monkeypatch.setattr(ModelLearner, "_run", lambda *_: (_ for _ in ()).throw(OSError("disk")))
    with pytest.raises(LabanmeshError, match="disk; nothing has changed"):
        teach("byebye=two2.mp4", "maestro=two2.mp4")
    monkeypatch.setattr(Link, "open", lambda *_, **__: nullcontext(SimpleNamespace(presence=lambda *_: Runs())))
    with pytest.raises(BadInput, match="sofa: runs now"):
        teach("byebye=two2.mp4", "maestro=two2.mp4")
    assert sorted(path.name for path in tmp_path.iterdir()) == ["scene.toml", "two2.mp4"]


class Runs:
    """The presence of an observer that is there."""

    def wait_for(self, count, timeout_s):
        return True


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
