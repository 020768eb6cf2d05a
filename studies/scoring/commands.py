"""The verb `labanmesh score`: performances in an archive, scored against reference takes by views as judges."""

import json
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any

import typer

from common.errors import BadInput
from common.progress import ProgressBar
from common.text import plural, split_list
from observer.motion.archive import Recording, movements_in
from observer.motion.archive_file import read_archive
from observer.motion.label_sets import labels_in
from studies.output_files import make_folder
from studies.scoring.judging import Judges, ScoredPerformance, score_figure
from studies.sensors import key_of

DEFAULT_VIEWS = "door,wheel,yaw:45,yaw:315"


def score(
    performances: Annotated[Path, typer.Argument(help="The motion archive with the performances to score.")],
    references: Annotated[
        Path | None, typer.Option(help="The archive with the reference takes; by default those of other people in it.")
    ] = None,
    label: Annotated[str, typer.Option(help="Only these movements, e.g. squat,lunge.")] = "",
    subjects: Annotated[str, typer.Option(help="Score only these people, e.g. 3,4.")] = "",
    trials: Annotated[str, typer.Option(help="Score only these trials, e.g. 1,2.")] = "",
    reference_trials: Annotated[str, typer.Option(help="Only these trials show how it should be done.")] = "",
    views: Annotated[str, typer.Option(help="The judges' views, or camera files.")] = DEFAULT_VIEWS,
    report: Annotated[Path | None, typer.Option(help="A folder for a figure of each performance.")] = None,
    as_json: Annotated[bool, typer.Option("--json", help="Each performance as a line of JSON.")] = False,
) -> None:
    """Score performances from 0 to 10 against takes that show how it should be done.

    10 is typical of these, 5 about their worst. Each view is a judge, as at a Kata competition: of four and more the
    highest and the lowest score are dropped. What cannot be scored is said, in one line.

    Example: labanmesh score mine.npz --references teacher.npz --label squat
    """
    texts = {"subjects": subjects, "trials": trials, "reference-trials": reference_trials}
    choice = _Choice(labels_in(label, "--label"), *(split_list(f"--{name}", text) for name, text in texts.items()))
    _score(performances, references, choice, views, report, as_json)


def _score(
    performances: Path, references: Path | None, choice: "_Choice", views: str, report: Path | None, as_json: bool
) -> None:
    """Score each performance of the choice, and show it."""
    archive = read_archive(performances)
    is_same = references is None or references.resolve() == performances.resolve()
    shown = archive if references is None or is_same else read_archive(references)
    if shown.body_parts != archive.body_parts:
        raise BadInput(f"{references}: other body parts than {performances}; record or import both in the same way")
    performed = [each for each in movements_in(archive) if choice.is_performance(each.label, each.subject, each.trial)]
    if not performed:
        raise BadInput(f"{performances}: no recording of {choice}")
    takes = [each for each in movements_in(shown) if not choice.references or each.trial in choice.references]
    if report is not None:
        make_folder(report, "--report")
    judges = Judges(views, archive.body_parts)
    with ProgressBar() as bar:
        for n, each in enumerate(performed):
            bar("scoring", n, len(performed))
            alike = [take for take in takes if take.label == each.label]
            # A take is no reference for itself.
            others = [take for take in alike if not (is_same and key_of(take) == key_of(each))]
            own = [take for take in others if references is not None or take.subject != each.subject]
            _show(each, judges.judge(each, own), report, as_json)


def _show(performance: Recording, judged: ScoredPerformance, report: Path | None, as_json: bool) -> None:
    """Print one result, and draw its figure into `report`."""
    label, subject, trial = performance.label, performance.subject, performance.trial
    words, fields = f"{label}, person {subject}, trial {trial}", judged.as_fields()
    if as_json:
        print(json.dumps({"label": label, "subject": subject, "trial": trial, **fields}), flush=True)
    else:
        print("\n".join(lines_of(words, fields)), flush=True)
    if report is not None and (best := judged.figure_of()) is not None:
        name = f"{label}-{subject}-{trial}.svg".replace("/", "_")
        (report / name).write_text(score_figure(words, best, judged.remarks), encoding="utf-8")


@dataclass(frozen=True, slots=True)
class _Choice:
    labels: Sequence[str]
    subjects: Sequence[str]
    trials: Sequence[str]
    references: Sequence[str]

    def is_performance(self, label: str, subject: str, trial: str) -> bool:
        pairs = ((self.labels, label), (self.subjects, subject), (self.trials, trial))
        return all(not wanted or value in wanted for wanted, value in pairs)

    def __str__(self) -> str:
        wanted = [", ".join(each) for each in (self.labels, self.subjects, self.trials) if each]
        return "; ".join(wanted) or "a movement"


def lines_of(words: str, fields: Mapping[str, Any]) -> Iterator[str]:
    """The lines for people: the score with the judges' scores, then the remarks; or why there is no score."""
    if fields["score"] is None:
        yield f"{words}: not scored, {fields['uncertain']}"
        return
    judges = ", ".join(f"{view} {each}" for view, each in fields["judges"].items())
    yield f"{words}: {fields['score']:.1f} of 10 ({judges}; {plural(fields['references'], 'reference take')})"
    yield from (f"  {each['words']}" for each in fields["remarks"])
