"""`python -m benchmarks.clips`: verdicts on real pictures, from known tracks or through real processes."""

import os
import sys
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Annotated

import typer

from benchmarks.clips.judging import ClipResult, judge
from benchmarks.clips.material import FOUR, Clip, centres_in, clip_view, gesture_clips, recordings, webcam_clips
from benchmarks.clips.processes import judge_through_processes
from benchmarks.command_line import run_command
from common.config_sections import FusionConfig
from common.errors import BadInput, LabanmeshError
from common.text import named_numbers, split_list
from common.vocabulary import ABSTAIN, Vocabulary
from observer.learning.examples import gather_background
from observer.learning.learn import BLENDS, learn_view
from observer.model.base import MovementModel
from observer.model.registry import DEFAULT_MODEL
from observer.motion.archive import MotionArchive, common_rate, labels_of
from observer.motion.archive_file import read_archive
from observer.motion.importers.florence3d import RATE_HZ
from observer.tracks import BODY_PARTS

TRACKS = Path("build/clips")
"""Default folder of the tracks: a film is tracked once."""
ALL, THE_FOUR = "all", "four"


@dataclass(frozen=True, slots=True)
class Learning:
    """How models are learned from the recordings, without the person in a clip."""

    archive: MotionArchive
    labels: tuple[str, ...]
    kind: str
    parameters: Mapping[str, float]
    background: MotionArchive | None

    def model(self, without: str, view: str) -> MovementModel:
        """A model of everybody but the person `without`."""
        others = tuple(r for r in self.archive.recordings if r.subject != without)
        return learn_view(
            MotionArchive(self.archive.body_parts, others),
            clip_view(view),
            Vocabulary(self.labels),
            kind=self.kind,
            parameters=self.parameters,
            background=self.background,
        )


def clips(
    model: Annotated[str, typer.Option(help="The kind of model.")] = DEFAULT_MODEL,
    parameter: Annotated[list[str] | None, typer.Option(help="NAME=NUMBER of the model; may be repeated.")] = None,
    labels: Annotated[str, typer.Option(help="all nine movements; the four that the clips show; or A,B.")] = ALL,
    background: Annotated[str, typer.Option(help="Archives of something else, separated by commas; or: blends.")] = "",
    view: Annotated[str, typer.Option(help="Of the 16 clips: camera (the known one), or door.")] = "camera",
    rate: Annotated[float, typer.Option(help="Pictures per second at which the 16 clips are played.")] = RATE_HZ,
    fusion: Annotated[list[str] | None, typer.Option(help="NAME=NUMBER of [fusion]; may be repeated.")] = None,
    only: Annotated[str, typer.Option(help="Names of films, separated by commas; default: all 18.")] = "",
    tracks: Annotated[Path, typer.Option(help="Folder of the tracks; those missing are written there.")] = TRACKS,
    processes: Annotated[
        bool, typer.Option("--processes", help="Through real processes that track the films; about 12 s for each.")
    ] = False,
    check: Annotated[
        bool, typer.Option("--check", help="With --processes: fail if the fast way gives other first verdicts.")
    ] = False,
    timeline: Annotated[bool, typer.Option("--timeline", help="Also print each judgement.")] = False,
) -> None:
    """Print the verdicts on 16 clips of Florence 3D Actions, on a person who waves, and on the person standing.

    LABANMESH_DATA names the folder of recordings. Models are learned without the person in the clip.

    Example: python -m benchmarks.clips --tracks build/clips

    Example: python -m benchmarks.clips --model phase --labels four --background blends --timeline
    """
    learning = _learning(_data(), model, named_numbers("--parameter", parameter or []), labels, background)
    config = FusionConfig.model_validate(named_numbers("--fusion", fusion or []))
    tracks.mkdir(parents=True, exist_ok=True)
    results, different = [], []
    for case in _cases(learning, view, rate, split_list("--only", only)):
        result = _played(case, config) if processes else _judged(case, tracks, config)
        results.append(result)
        print(line(result), flush=True)
        if timeline:
            print("\n".join(_timeline(result)))
        if check and first_words(result) != first_words(_judged(case, tracks, config)):
            different.append(result.name)
    print(summary(results))
    if different:
        raise LabanmeshError(f"the fast way gives other verdicts on {', '.join(different)}")


def _data() -> Path:
    place = os.environ.get("LABANMESH_DATA")
    if not place:
        raise BadInput("LABANMESH_DATA is not set: name the folder with the recordings of people")
    return Path(place)


def _learning(data: Path, kind: str, parameters: Mapping[str, float], labels: str, background: str) -> Learning:
    archive = recordings(data)
    chosen = {ALL: labels_of(archive), THE_FOUR: FOUR}.get(labels) or split_list("--labels", labels)
    others = None
    if background == BLENDS:
        others = MotionArchive(archive.body_parts, ())
    elif background:
        archives = [read_archive(Path(name)) for name in split_list("--background", background)]
        others = gather_background(archives, (), BODY_PARTS, common_rate(archive))
    return Learning(archive, chosen, kind, parameters, others)


@dataclass(frozen=True, slots=True)
class Case:
    """A film with its model, and how it is played."""

    clip: Clip
    model: MovementModel
    view: str
    rate_hz: float


def _cases(learning: Learning, view: str, rate_hz: float, only: Sequence[str]) -> Iterator[Case]:
    model: Callable[[str, str], MovementModel] = cache(learning.model)
    for clip in gesture_clips(_data()):
        if not only or clip.name in only:
            yield Case(clip, model(clip.subject, view), view, rate_hz)
    # The camera of the webcam's films is not known; the person faces it.
    for clip in webcam_clips(_data()):
        if not only or clip.name in only:
            yield Case(clip, model("", "door"), "door", RATE_HZ)


def _judged(case: Case, tracks: Path, config: FusionConfig) -> ClipResult:
    centres = centres_in(case.clip, tracks)
    return judge(case.clip.name, case.clip.label, centres, case.rate_hz, case.model, config)


def _played(case: Case, config: FusionConfig) -> ClipResult:
    run = judge_through_processes(case.clip, case.rate_hz, case.view, case.model, config)
    print(f"{run.posteriors} posteriors, at most {run.oldest_s:.2f} s old on arrival", file=sys.stderr)
    return run.result


def first_words(result: ClipResult) -> list[str]:
    """The labels of the verdicts as they were first published."""
    return [verdict.label for verdict in result.verdicts]


def line(result: ClipResult) -> str:
    """One film: truth, verdicts, and the best moment."""
    words = [
        f"{verdict.label} {verdict.at_s:.1f} s" + (f" -> {verdict.last}" if verdict.last != verdict.label else "")
        for verdict in result.verdicts
    ]
    best = result.best
    peak = (
        "never moving" if best is None else f"{best.label} {best.p:.2f} at {best.at_s:.1f} s, none {best.unlearned:.2f}"
    )
    mark = "right" if result.first_is_right else "WRONG" if result.words else "none "
    return (
        f"{result.name:6s} {result.seconds:4.1f} s {mark} {result.label:12s} {', '.join(words) or '-':40s} best: {peak}"
    )


def _timeline(result: ClipResult) -> Iterator[str]:
    for moment in result.moments:
        rest = "-" if moment.rest is None else f"{moment.rest:.2f}"
        yield f"    {moment.at_s:5.2f} s  {moment.label:14s} {moment.p:.2f}  none {moment.unlearned:.2f}  rest {rest}"


def summary(results: Sequence[ClipResult]) -> str:
    """The figures: first verdicts of the gestures, words about the webcam's films."""
    gestures = [result for result in results if result.label and result.name != "wave"]
    right = sum(result.first_is_right for result in gestures)
    wrong = sum(bool(result.words) and not result.first_is_right for result in gestures)
    abstained = sum(any(v.label == ABSTAIN for v in result.verdicts) for result in gestures)
    lines = [f"clips: first verdict right {right} of {len(gestures)}, wrong {wrong}, with an abstention {abstained}"]
    for result in results:
        if result.name in ("wave", "stand"):
            named = [f"{v.label} {v.at_s:.1f} s" for v in result.words]
            lines.append(
                f"{result.name}: {len(result.words)} named ({', '.join(named)}), {len(result.verdicts)} in all"
            )
    return "\n".join(lines)


if __name__ == "__main__":
    sys.exit(run_command(clips, "clips"))
