"""Takes out of films: each is tracked as fast as that goes, and cut where a lesson would cut it.

A take begins when the person begins to move and ends when they stand still again. A film without rest is one take.
"""

from collections.abc import Iterable
from dataclasses import dataclass, replace
from pathlib import Path
from threading import Event

from common.config import Scene
from common.errors import BadInput
from common.files import expand_home
from common.teaching_messages import TeachRequest
from common.tracker_choice import content_of
from observer.camera.base import kind_of
from observer.prepared_tracks import PreparedTracker
from observer.recording.own_tracks import RECORDING_HZ, TracksRecorder, trimmed, watched_parts
from observer.runtime.scene_inputs import ObserverInputs, open_inputs
from observer.teaching.take_recorder import SHORTEST_S, TakeRecorder
from observer.teaching.take_watch import LONGEST_TAKE_S
from observer.teaching.takes_file import TakesFile
from observer.tracks import Frame

NOTHING_LABEL = "nothing"
"""The label of films of ordinary life: something else than any movement."""


@dataclass(frozen=True, slots=True)
class TaughtFilm:
    """A film of a movement, done once or several times; label "": of ordinary life."""

    label: str
    path: Path

    @classmethod
    def parse(cls, text: str) -> "TaughtFilm":
        """`LABEL=FILM`; raises BadInput for another form, and for what is no film."""
        label, equals, name = text.partition("=")
        if not (label and equals and name):
            raise BadInput(f"--film {text!r}: LABEL=FILM is expected, e.g. --film wave=wave.mp4")
        path = expand_home(name)
        if kind_of(name) != "path" or not path.exists():
            raise BadInput(f"--film {text}: there is no film {name}; name a video file, or a folder of pictures")
        if content_of(name) != "pictures":
            raise BadInput(f"--film {text}: a film is expected; labanmesh learn learns from a motion archive")
        return cls("" if label == NOTHING_LABEL else label, path.absolute())


def open_film(scene: Scene, observer: str, film: TaughtFilm) -> ObserverInputs:
    """The film as the source of the observer, whose tracker, view and other settings are those of the scene.

    Raises BadInput as `open_inputs` does.
    """
    played = {"source": str(film.path), "speed": 0.0, "loop": False, "rate_hz": None, "size_px": None}
    section = scene.observer(observer).model_copy(update=played)
    whole = scene.model_copy(update={"observers": {**scene.observers, observer: section}})
    return open_inputs(whole, observer, None)


def add_takes(film: TaughtFilm, inputs: ObserverInputs, takes: TakesFile, person: str, stop: Event) -> list[float]:
    """Add all takes of a film, or what it shows of ordinary life; returns their seconds.

    Raises BadInput if there is none, KeyboardInterrupt if `stop` is set.
    """
    before = len(takes.recordings)
    recorder = TracksRecorder(inputs.tracker.every_part, RECORDING_HZ, float("inf"))
    recording = TakeRecorder(recorder, takes)
    step = max(1, int(inputs.source.rate_hz // RECORDING_HZ))
    for number, frame in enumerate(inputs.source.frames(stop)):
        if number % step == 0 and _track(frame, inputs.tracker, recorder, recording) and recording.current is None:
            recording.begin(_request(film.label, takes, person), pictures=True)
    if stop.is_set():
        raise KeyboardInterrupt
    current = recording.current
    if current is not None and (current.watch is None or current.watch.phase == "moving"):
        recording.end()
    added = takes.recordings[before:]
    if not added and film.label:
        return [_whole(film, recorder, takes, person)]
    if not added:
        complaint = f" ({inputs.tracker.complaint})" if inputs.tracker.complaint else ""
        raise BadInput(f"{film.path.name}: nobody was seen in it{complaint}")
    return [len(take.positions) / take.rate_hz for take in added]


def _track(frame: Frame, tracker: PreparedTracker, recorder: TracksRecorder, recording: TakeRecorder) -> bool:
    tracker.update(frame)
    tracks = tracker.every_track
    if tracks is None:
        return False
    recorder.update(frame, tracks)
    recording.step(frame.at_ns, tracks)
    return True


def _request(label: str, takes: TakesFile, person: str) -> TeachRequest:
    take = takes.free_take(label) if label else 1
    return TeachRequest(command="begin", teacher="film", label=label, take=take, person=person)


def _whole(film: TaughtFilm, recorder: TracksRecorder, takes: TakesFile, person: str) -> float:
    """Add a short film whole, in which the person moves from its first picture on; its seconds."""
    name, parts = film.path.name, recorder.body_parts
    first_ns, last_ns = recorder.oldest_ns or 0, recorder.newest_ns or 0
    try:
        film_take = recorder.cut(first_ns, last_ns, label=film.label, subject=person)
    except BadInput as fault:
        raise BadInput(f"{name}: {fault}") from None
    take = trimmed(film_take, parts, watched_parts(parts))
    seconds = len(take.positions) / take.rate_hz
    if take is film_take or not SHORTEST_S <= seconds <= LONGEST_TAKE_S:
        raise BadInput(f"{name}: shows no {film.label}: nobody moves and then stands still in it")
    takes.add(replace(take, trial=str(takes.free_take(film.label))))
    return seconds


def labels_of(films: Iterable[TaughtFilm]) -> list[str]:
    """The movements, in the order of their first films."""
    return list(dict.fromkeys(film.label for film in films if film.label))
