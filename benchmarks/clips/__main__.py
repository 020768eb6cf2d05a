"""`python -m benchmarks.clips`: verdicts on real pictures, from known tracks or through real processes."""

import sys
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from enum import StrEnum
from pathlib import Path
from typing import Annotated

import numpy as np
import typer

from benchmarks.clips.judging import ClipResult, judge
from benchmarks.clips.learning import ALL, Learning, chosen_background, chosen_labels
from benchmarks.clips.material import Clip, centres_in, clip_view, gesture_clips, recordings, webcam_clips
from benchmarks.clips.processes import judge_through_processes
from benchmarks.clips.report import by_movement, line, still_summary, summary
from benchmarks.clips.still import SHARES, frozen_film, frozen_recording
from benchmarks.command_line import recordings_folder, run_command
from common.command_options import takes_options
from common.config_sections import FusionConfig
from common.errors import LabanmeshError
from common.text import named_numbers, split_list
from observer.model.base import MovementModel
from observer.model.registry import DEFAULT_MODEL
from observer.motion.importers.florence3d import FLORENCE_HZ
from observer.motion.projected import view_tracks
from observer.tracks import BODY_PARTS

TRACKS = Path("build/clips")
"""Default folder of the tracks: a film is tracked once."""
EVERY = 5
"""Every fifth recording is also shown frozen."""


class Material(StrEnum):
    """films: 16 clips, a person who waves, and one who stands. recordings: what the clips are cut from, in 3-D, all of
    them. still: people who stand still for 10 s, in films and in recordings."""

    FILMS = "films"
    RECORDINGS = "recordings"
    STILL = "still"


@dataclass(frozen=True, slots=True)
class Playing:
    """How material is shown. view, rate_hz, scale: of the clips. tracks: the folder of tracks."""

    learning: Learning
    config: FusionConfig
    view: str
    rate_hz: float
    tracks: Path
    data: Path
    scale: float = 1.0


@dataclass(frozen=True, slots=True)
class ClipsOptions:
    """As typed on the command line."""

    material: Annotated[Material, typer.Argument(help="What is shown.")] = Material.FILMS
    model: Annotated[str, typer.Option(help="The kind of model.")] = DEFAULT_MODEL
    parameter: Annotated[list[str] | None, typer.Option(help="NAME=NUMBER of the model; may be repeated.")] = None
    labels: Annotated[str, typer.Option(help="all nine movements; the four that the clips show; or A,B.")] = ALL
    background: Annotated[str, typer.Option(help="Archives of something else, separated by commas.")] = ""
    view: Annotated[str, typer.Option(help="Of the 16 clips: camera (the known one), or door.")] = "camera"
    rate: Annotated[float, typer.Option(help="Pictures per second at which the 16 clips are played.")] = FLORENCE_HZ
    fusion: Annotated[list[str] | None, typer.Option(help="NAME=NUMBER of [fusion]; may be repeated.")] = None
    only: Annotated[str, typer.Option(help="Names of films, separated by commas; default: all 18.")] = ""
    tracks: Annotated[Path, typer.Option(help="Folder of the tracks; those missing are written there.")] = TRACKS
    processes: Annotated[
        bool, typer.Option("--processes", help="Films through real processes that track them; about 12 s for each.")
    ] = False
    check: Annotated[
        bool, typer.Option("--check", help="With --processes: fail if the fast way gives other first verdicts.")
    ] = False
    scale: Annotated[float, typer.Option(min=0.1, max=1, help="Of the 16 clips, padded to their former size.")] = 1.0


@takes_options
def clips(options: ClipsOptions) -> None:
    """Print the verdicts on real people, whose models are learned from everybody else.

    LABANMESH_DATA names the folder of recordings. Tracking needs mediapipe (.venv-mediapipe).

    Example: python -m benchmarks.clips --labels four

    Example: python -m benchmarks.clips recordings --model phase

    Example: python -m benchmarks.clips --processes --check

    Example: python -m benchmarks.clips --labels four --scale 0.5
    """
    playing = _playing(options)
    if options.material is Material.FILMS:
        _films(playing, options)
    elif options.material is Material.RECORDINGS:
        print("\n".join(by_movement(list(_recordings(playing)))))
    else:
        for kind, results in (("films", _still_films(playing)), ("recordings", _still_recordings(playing))):
            print(still_summary(kind, [_shown(result) for result in results]))


def _playing(options: ClipsOptions) -> Playing:
    data = recordings_folder()
    archive = recordings(data)
    learning = Learning(
        archive,
        chosen_labels(archive, options.labels),
        options.model,
        named_numbers("--parameter", options.parameter or []),
        chosen_background(archive, options.background),
    )
    options.tracks.mkdir(parents=True, exist_ok=True)
    config = FusionConfig.model_validate(named_numbers("--fusion", options.fusion or []))
    return Playing(learning, config, options.view, options.rate, options.tracks, data, options.scale)


@dataclass(frozen=True, slots=True)
class Case:
    """A film with its model, and how it is played."""

    clip: Clip
    model: MovementModel
    view: str
    rate_hz: float


def _cases(playing: Playing, only: Sequence[str] = ()) -> Iterator[Case]:
    for clip in gesture_clips(playing.data):
        if not only or clip.name in only:
            shown = replace(clip, scale=playing.scale)
            yield Case(shown, playing.learning.model(clip.subject, playing.view), playing.view, playing.rate_hz)
    # The camera of the webcam's films is not known; the person faces it.
    for clip in webcam_clips(playing.data):
        if not only or clip.name in only:
            yield Case(clip, playing.learning.model("", "door"), "door", FLORENCE_HZ)


def _films(playing: Playing, options: ClipsOptions) -> None:
    results, different = [], []
    for case in _cases(playing, split_list("--only", options.only)):
        result = _played(case, playing.config) if options.processes else _judged(case, playing)
        results.append(result)
        print(line(result), flush=True)
        if options.check and first_word(result) != first_word(_judged(case, playing)):
            different.append(result.name)
    print(summary(results, [clip.name for clip in webcam_clips(playing.data)]))
    if different:
        raise LabanmeshError(f"the fast way gives other first verdicts on {', '.join(different)}")


def _judged(case: Case, playing: Playing) -> ClipResult:
    centres = centres_in(case.clip, playing.tracks)
    return judge(case.clip.name, case.clip.label, centres, case.rate_hz, case.model, playing.config)


def _played(case: Case, config: FusionConfig) -> ClipResult:
    run = judge_through_processes(case.clip, case.rate_hz, case.view, case.model, config)
    print(f"{run.posteriors} posteriors, at most {run.oldest_s:.2f} s old on arrival", file=sys.stderr)
    return run.result


def first_word(result: ClipResult) -> str:
    """The label of the first verdict; "" without one."""
    return result.verdicts[0].label if result.verdicts else ""


def _recordings(playing: Playing) -> Iterator[ClipResult]:
    archive, learning = playing.learning.archive, playing.learning
    for subject in sorted({recording.subject for recording in archive.recordings}):
        for recording in archive.recordings:
            if recording.subject == subject and recording.label in learning.labels:
                tracks = view_tracks(clip_view(playing.view), recording, archive.body_parts, BODY_PARTS)
                centres = np.array([instant.centres for instant in tracks])
                model = learning.model(subject, playing.view)
                yield judge(recording.label, recording.label, centres, playing.rate_hz, model, playing.config)


def _still_films(playing: Playing) -> Iterator[ClipResult]:
    for case in _cases(playing):
        for share in SHARES:
            centres = frozen_film(case.clip, share, FLORENCE_HZ, playing.tracks)
            yield judge(f"{case.clip.name} {share:.0%}", "", centres, FLORENCE_HZ, case.model, playing.config)


def _still_recordings(playing: Playing) -> Iterator[ClipResult]:
    for n, recording in enumerate(playing.learning.archive.recordings[::EVERY]):
        model = playing.learning.model(recording.subject, playing.view)
        for share in SHARES:
            centres = frozen_recording(recording, share, playing.view, n)
            yield judge(f"{recording.label} {share:.0%}", "", centres, FLORENCE_HZ, model, playing.config)


def _shown(result: ClipResult) -> ClipResult:
    """The result, which is printed unless it is as wanted: one right verdict for a movement, else none."""
    if [(v.label, v.last) for v in result.verdicts] != [(result.label, result.label)] * bool(result.label):
        print(line(result), flush=True)
    return result


if __name__ == "__main__":
    sys.exit(run_command(clips, "clips"))
