"""The verb `evaluate`, and `evaluate --paper`, with their options."""

import json
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from common.command_options import takes_options
from common.errors import BadInput
from common.progress import ProgressBar
from common.text import named_numbers, one_of, split_list
from observer.learning.learn_options import Facing, ModelKind, Parameters, Place, Texts

if TYPE_CHECKING:
    from observer.motion.archive import MotionArchive
    from studies.evaluated_archives import EvaluatedArchives
    from studies.settings import EvaluationSettings

LabelSets = Annotated[Texts, typer.Option(help="Movements separated by commas, or a set as AS1; repeat for more sets.")]
BodyParts = Annotated[str, typer.Option(help="Parts to use, separated by commas; default: all that are recorded.")]
TrainSubjects = Annotated[str, typer.Option(help="People to learn from; default: every other one.")]
TestSubjects = Annotated[str, typer.Option(help="People to judge; default: those not learned from.")]
LeaveOneSubjectOut = Annotated[
    bool, typer.Option("--leave-one-subject-out", help="Judge each person by models of all others.")
]
JsonFile = Annotated[Path | None, typer.Option(help="File for the figures as JSON.")]


@dataclass(frozen=True, slots=True)
class EvaluateOptions:
    """The options of `labanmesh evaluate`, as they were typed."""

    archive: Annotated[Path | None, typer.Argument(help="The motion archive (.npz); none with --sensor.")] = None
    views: Annotated[
        str, typer.Option(help="door, wheel, table, yaw:DEG[,pitch:DEG] or camera files, separated by commas.")
    ] = ""
    place: Place = ""
    facing: Facing = None
    sensor: Annotated[
        Texts,
        typer.Option(
            help="NAME=FILE.npz or NAME=FILE.npz@VIEW in place of ARCHIVE --views: a sensor that recorded the same "
            "performances, by default seen from the door; two or more."
        ),
    ] = None
    labels: Annotated[str, typer.Option(help="Movements, or AS1, AS2, AS3; separated by commas; default: all.")] = ""
    train_subjects: TrainSubjects = ""
    test_subjects: TestSubjects = ""
    leave_one_subject_out: LeaveOneSubjectOut = False
    model: ModelKind = "stacked"
    rule: Annotated[str, typer.Option(help="The fusion rule.")] = "guarded_product"
    parameter: Parameters = None
    turn: Annotated[str, typer.Option(help="Degrees by which the performer is turned in test, or random.")] = "0"
    fault: Annotated[Texts, typer.Option(help="VIEW=wrong|noise|silent|late; may be repeated.")] = None
    uncalibrated: Annotated[
        bool, typer.Option("--uncalibrated", help="Observers do not scale their certainty by how often they are right.")
    ] = False
    unlearned: Annotated[
        str, typer.Option(help="With --stream: movements shown but not learned, separated by commas; or others.")
    ] = ""
    background_labels: Annotated[
        str,
        typer.Option(
            help="Movements learned as `something else`, separated by commas; a number: that many of --unlearned, "
            "then not shown."
        ),
    ] = ""
    body_parts: BodyParts = ""
    onset: Annotated[str, typer.Option(help="known: as cut out. unknown: with rest around, any tempo.")] = "known"
    stream: Annotated[bool, typer.Option("--stream", help="Also judge continuous streams.")] = False
    background: Annotated[
        str, typer.Option(help="Archives (.npz) to learn `something else` from, separated by commas.")
    ] = ""
    background_subjects: Annotated[
        str, typer.Option(help="The people of these archives to learn from; default: all.")
    ] = ""
    other_motion: Annotated[
        list[Path] | None,
        typer.Option(
            help="An archive in which no learned movement happens, to count false verdicts; people of --background "
            "in the same file are left out; may be repeated."
        ),
    ] = None
    jobs: Annotated[int, typer.Option(min=0, max=1024, help="Processes to share the work; 0: one per core.")] = 0
    seed: Annotated[int, typer.Option(min=0, max=2**63 - 1, help="Seed of all random choices.")] = 0
    report: Annotated[Path | None, typer.Option(help="Folder for tables and figures.")] = None
    json: JsonFile = None
    # The command line runs other commands with these two (labanmesh.py:OTHER_FORMS); here they are for --help.
    paper: Annotated[
        bool, typer.Option("--paper", help="Repeat the paper's three experiments instead: evaluate --paper --help.")
    ] = False
    effort: Annotated[
        bool, typer.Option("--effort", help="Evaluate Effort instead of movements: evaluate --effort --help.")
    ] = False


DEFAULT_FACINGS = 12.0
"""One per 30 degrees: fewer lose up to 2 points between two facings, more cost time (docs/design/model.md)."""


@takes_options
def evaluate(options: EvaluateOptions) -> None:
    """Judge people whom the models have not learned from: accuracy, confusion, earliness, calibration.

    Example: labanmesh evaluate msr.npz --views door,wheel --train-subjects 1,3,5,7,9 --test-subjects 2,4,6,8,10

    Example: labanmesh evaluate msr.npz --views door --labels AS1 --stream --unlearned others --background-labels 6

    Example: labanmesh evaluate msr.npz --views cameras/cam1.toml,cameras/cam2.toml --place 0.2,1.5 --facing -30

    Example: labanmesh evaluate --sensor left=a.npz --sensor right=b.npz --leave-one-subject-out --rule product

    Example: labanmesh evaluate msr.npz --views door --other-motion story.npz --background story.npz \
    --background-subjects a
    """
    # Begins before the imports, which take a moment.
    with ProgressBar("reading the recordings"):
        whole, settings = _input(options)
    written = _evaluate(whole, settings, options)
    if written:
        print("\nwritten:", *written, sep="\n  ")


def _evaluate(whole: "MotionArchive", settings: "EvaluationSettings", options: EvaluateOptions) -> list[Path]:
    """Evaluate with progress, print the result, write the files that are asked for; returns the files.

    Each model is learned once, and judges all that is asked for.
    """
    from common.parallel import cores
    from studies.evaluate import require_fits, results_of
    from studies.observing import observe_folds
    from studies.output_files import require_writable, write_text
    from studies.report import as_json, draw_streams, prepare_report, write_report
    from studies.report_text import as_text, resolved_pairs
    from studies.stream import judge_observed

    report, jobs, streams = options.report, options.jobs or cores(), options.stream or bool(settings.other_motion)
    if report:
        prepare_report(report)
    if options.json:
        require_writable(options.json, "--json")
    require_fits(settings)
    with ProgressBar() as bar:
        folds = observe_folds(whole, settings, bar, jobs, streams=streams)
        judged = judge_observed(folds, settings, bar, jobs) if streams else None
        result = results_of(folds, settings)
    figures = as_json(result) | ({"stream": judged.as_json()} if judged else {})
    print(as_text(figures))
    if len(settings.views) > 1:
        print(f"\n{resolved_pairs(figures)}")
    written = write_report(result, figures, report) if report else []
    if report and judged:
        written += draw_streams(judged, report)
    if options.json:
        written.append(write_text(options.json, json.dumps(figures, indent=1) + "\n", "--json"))
    return written


def _input(options: EvaluateOptions) -> "tuple[MotionArchive, EvaluationSettings]":
    """The recordings and what to do with them; raises BadInput for options that do not fit."""
    from observer.geometry.placement import parse_place, placement_of
    from studies.evaluated_archives import BackgroundArchives, read_archives

    background = BackgroundArchives.parse(options.background, options.background_subjects)
    parts = split_list("--body-parts", options.body_parts)
    placement = placement_of(parse_place(options.place), options.facing)
    archives = read_archives(
        options.archive, options.views, options.sensor or [], parts, background, options.other_motion or [], placement
    )
    settings = _settings(options, archives)
    is_turned, has_facings = settings.turn != 0, settings.parameters.get("facings", 1) > 1
    for option, is_set in (("--turn", is_turned), ("--parameter facings", has_facings)):
        if is_set and any(view.is_this_camera for view in settings.views):
            raise BadInput(f"{option}: needs positions in 3-D, and the archive holds 2-D tracks; omit it")
    for option, is_set in (("--turn", is_turned), ("--onset unknown", not settings.onset_known)):
        if is_set and settings.sensors:
            raise BadInput(f"--sensor {option}: sensors are judged on what they recorded; omit {option}")
    return archives.whole, settings


def _settings(options: EvaluateOptions, archives: "EvaluatedArchives") -> "EvaluationSettings":
    """The settings of the evaluation; raises BadInput for values that are none."""
    from observer.motion.archive import labels_of
    from observer.motion.label_sets import labels_in
    from observer.motion.sensors import require_shared_labels
    from studies.faults import parse_fault
    from studies.settings import EvaluationSettings
    from studies.trials import unlearned_and_background

    known = labels_of(archives.whole)
    learned = labels_in(options.labels) or known
    if archives.sensors:
        names = [view.name for view in archives.views]
        require_shared_labels(learned, dict(zip(names, archives.sensors, strict=True)))
    turn_deg = _turn(options.turn)
    unlearned, background = unlearned_and_background(
        options.unlearned, options.background_labels, learned, known, options.seed
    )
    return EvaluationSettings(
        views=archives.views,
        labels=learned,
        train_subjects=split_list("--train-subjects", options.train_subjects),
        test_subjects=split_list("--test-subjects", options.test_subjects),
        leave_one_subject_out=options.leave_one_subject_out,
        model=options.model,
        parameters=_parameters(options, turn_deg),
        rule=options.rule,
        turn=turn_deg,
        faults=dict(parse_fault(text, [view.name for view in archives.views]) for text in options.fault or []),
        body_parts=archives.body_parts,
        onset_known=one_of("--onset", options.onset, ("known", "unknown")) == "known",
        calibrated=not options.uncalibrated,
        unlearned=unlearned,
        background=background,
        seed=options.seed,
        sensors=archives.sensors,
        background_archive=archives.background,
        other_motion=archives.other_motion,
    )


def paper(
    archive: Annotated[Path, typer.Argument(help="The motion archive (.npz).")],
    labels: LabelSets = None,
    report: Annotated[Path | None, typer.Option(help="Folder for the text and the figures.")] = None,
    of_paper: Annotated[bool, typer.Option("--paper", show_default=False, help="This experiment.")] = True,
) -> None:
    """Run the paper's three experiments with the paper's model and rule; print its confusion tables beside ours.

    Example: labanmesh evaluate --paper msr.npz --labels AS1 --labels AS2 --labels AS3 --report out
    """
    from observer.motion.archive import labels_of
    from observer.motion.archive_file import read_archive
    from observer.motion.label_sets import labels_in
    from observer.tracks import BODY_PARTS
    from studies.experiments import as_text, run_experiments
    from studies.output_files import write_text
    from studies.report import prepare_report, write_report
    from studies.sensors import with_parts

    whole = with_parts(read_archive(archive), BODY_PARTS)
    sets = {text: labels_in(text) for text in labels or []} or {"all": labels_of(whole)}
    if report:
        prepare_report(report)
    with ProgressBar() as bar:
        results = run_experiments(whole, sets, bar)
    text = as_text(results)
    print(text)
    if report:
        for name, three in results.items():
            write_report(three[-1].result, three[-1].figures, report / name.replace(",", "-"))
        write_text(report / "experiments.txt", text + "\n", "--report")
        print(f"\nwritten: {report}/experiments.txt, and the figures of experiment 3 in one folder per set")


def _parameters(options: EvaluateOptions, turn_deg: float | None) -> dict[str, float]:
    """The model's parameters; a model that knows facings needs them when the turn is random."""
    from observer.model.registry import MODELS

    parameters = named_numbers("--parameter", options.parameter or [])
    knows_facings = options.model in MODELS and "facings" in MODELS[options.model].PARAMETERS
    return ({"facings": DEFAULT_FACINGS} if turn_deg is None and knows_facings else {}) | parameters


def _turn(text: str) -> float | None:
    if text == "random":
        return None
    try:
        return float(text)
    except ValueError:
        raise BadInput(f"--turn {text!r}: expected a number of degrees, or random") from None
