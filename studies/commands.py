"""The verbs `evaluate`, `paper` and `demo`, and the options that they share."""

import json as json_text
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from common.errors import BadInput
from common.progress import ProgressBar
from common.text import named_numbers, one_of, split_list

if TYPE_CHECKING:
    from observer.motion.archive import MotionArchive
    from studies.evaluate import Answer, Question

Archive = Annotated[Path, typer.Argument(help="The motion archive (.npz).")]
Views = Annotated[str, typer.Option(help="door, wheel, table, yaw:DEG[,pitch:DEG], camera files; by commas.")]
Labels = Annotated[str, typer.Option(help="Movements to tell apart, or AS1, AS2, AS3; by commas; all.")]
LabelSets = Annotated[
    list[str] | None, typer.Option(help="Movements by commas, or a set as AS1; repeat for several sets; all.")
]
TrainSubjects = Annotated[str, typer.Option(help="People to learn from; every other one.")]
TestSubjects = Annotated[str, typer.Option(help="People to judge; those not learned from.")]
LeaveOneOut = Annotated[bool, typer.Option("--leave-one-subject-out", help="Judge each in turn.")]
Model = Annotated[str, typer.Option(help="phase, phase-symbols or frame-table.")]
RuleName = Annotated[str, typer.Option(help="Name of the fusion rule.")]
Parameters = Annotated[
    list[str] | None, typer.Option(help="NAME=NUMBER of the model instead of its default; may be repeated.")
]
Turn = Annotated[str, typer.Option(help="Degrees the performer is turned in test, or random.")]
Faults = Annotated[list[str] | None, typer.Option(help="VIEW=wrong|noise|silent|late|hidden; may be repeated.")]
Facings = Annotated[
    int, typer.Option(min=0, help="Directions that the model knows; 1 for a known turn, 12 for a random one.")
]
Temperature = Annotated[float, typer.Option(min=0.1, help="Of the fused belief: [fusion] temperature.")]
Uncalibrated = Annotated[bool, typer.Option("--uncalibrated", help="Observers as sure as their evidence.")]
Unlearned = Annotated[
    str, typer.Option(help="With --stream: movements shown without having been learned, by commas; or others.")
]
BackgroundLabels = Annotated[
    str,
    typer.Option(
        help="Movements learned as something else, by commas; a number: so many of --unlearned, shown no more; "
        "blends: none, mixtures of those learned alone."
    ),
]
BodyParts = Annotated[str, typer.Option(help="Parts to use, by commas; all of the archive's.")]
OnsetKind = Annotated[str, typer.Option(help="known: as cut out. unknown: idle around it, any tempo.")]
Stream = Annotated[bool, typer.Option("--stream", help="Judge continuously too: spotting in a stream.")]
LearningCurve = Annotated[
    bool, typer.Option("--learning-curve", help="Also from fewer people, and fewer recordings of each.")
]
Through = Annotated[
    str, typer.Option(help="process; mesh: over real Zenoh sessions; pixels: filmed and tracked by camshift.")
]
Background = Annotated[str, typer.Option(help="With pixels: plain, cluttered or skin_toned.")]
Seed = Annotated[int, typer.Option(min=0, help="Seeds all chance.")]
ReportFolder = Annotated[Path | None, typer.Option(help="Folder for tables and figures.")]
JsonFile = Annotated[Path | None, typer.Option(help="File for the figures as JSON.")]


FACINGS = 12
"""Every 30 degrees: fewer lose up to 2 points between two directions, more cost time (docs/design/model.md)."""


def evaluate(
    archive: Archive,
    views: Views,
    labels: Labels = "",
    train_subjects: TrainSubjects = "",
    test_subjects: TestSubjects = "",
    leave_one_subject_out: LeaveOneOut = False,
    model: Model = "phase",
    rule: RuleName = "robust_inverse_entropy",
    parameter: Parameters = None,
    turn: Turn = "0",
    fault: Faults = None,
    facings: Facings = 0,
    temperature: Temperature = 1.0,
    uncalibrated: Uncalibrated = False,
    unlearned: Unlearned = "",
    background_labels: BackgroundLabels = "",
    body_parts: BodyParts = "",
    onset: OnsetKind = "known",
    stream: Stream = False,
    learning_curve: LearningCurve = False,
    through: Through = "process",
    background: Background = "plain",
    seed: Seed = 0,
    report: ReportFolder = None,
    json: JsonFile = None,
) -> None:
    """How well the system judges people whom it has not learned from: accuracy, confusion, earliness, calibration.

    Example: labanmesh evaluate msr.npz --views door,wheel --train-subjects 1,3,5,7,9 --test-subjects 2,4,6,8,10

    Example: labanmesh evaluate msr.npz --views door --labels AS1 --stream --unlearned others --background-labels 6

    Example: labanmesh evaluate msr.npz --views door --turn 45 --model frame-table --rule inverse_entropy --report out
    """
    from observer.geometry.views import parse_view, split_views
    from observer.motion.archive_file import read_archive
    from observer.motion.transforms import labels_of
    from studies.evaluate import Question
    from studies.faults import fault_named
    from studies.trials import labels_in, strangers

    whole = read_archive(archive)
    seen = tuple(parse_view(view) for view in split_views(views))
    learned = labels_in(labels) or labels_of(whole)
    given, turned = named_numbers("--parameter", parameter or []), _turn(turn)
    shown, other = strangers(unlearned, background_labels, learned, labels_of(whole), seed)
    question = Question(
        views=seen,
        labels=learned,
        train_subjects=split_list("--train-subjects", train_subjects),
        test_subjects=split_list("--test-subjects", test_subjects),
        leave_one_subject_out=leave_one_subject_out,
        model=model,
        parameters=_with_facings(given, facings, model, turned),
        rule=rule,
        turn=turned,
        faults=dict(fault_named(text, [view.name for view in seen]) for text in fault or []),
        body_parts=split_list("--body-parts", body_parts),
        onset_known=one_of("--onset", onset, ("known", "unknown")) == "known",
        temperature=temperature,
        calibrated=not uncalibrated,
        unlearned=shown,
        background=other,
        seed=seed,
    )
    one_of("--through", through, ("process", "mesh", "pixels"))
    if learning_curve and other:
        raise BadInput("--learning-curve: learns from ever fewer people; of --background-labels it takes blends alone")
    written = _evaluated(whole, question, through, background, stream, report, json, learning_curve)
    if written:
        print("\nwritten:", *written, sep="\n  ")


def _evaluated(
    archive: "MotionArchive",
    question: "Question",
    through: str,
    background: str,
    stream: bool,
    report: Path | None,
    json: Path | None,
    curve: bool = False,
) -> list[Path]:
    """Evaluate with progress, tell the result, write what was asked for; returns the files."""
    from studies.evaluate import evaluate as ask
    from studies.learning_curve import learning_curve
    from studies.report import as_json, draw_learning_curve, write_report
    from studies.stream import judge_stream
    from studies.through import fused_over_mesh

    with ProgressBar() as bar:
        # First, so that what it refuses is refused at once.
        learned = {"learning_curve": learning_curve(archive, question, bar)} if curve else {}
        if through == "pixels":
            archive, answer, joints = _from_pixels(archive, question, background, bar)
            found = as_json(answer) | {"background": background, "joints": as_json(joints)}
        else:
            answer = ask(archive, question, bar)
            found = as_json(answer)
        # Reliability is drawn before and after calibration.
        raw = ask(archive, replace(question, calibrated=False), bar) if report and question.calibrated else None
        if through == "mesh":
            found["mesh"] = fused_over_mesh(answer, bar)
        if stream:
            found["stream"] = judge_stream(archive, question, bar)
    found |= learned
    _tell(found)
    written = write_report(answer, found, report, raw) if report else []
    if report and curve:
        written.append(draw_learning_curve(found["learning_curve"], report / "learning-curve.png"))
    if json:
        _write(json, json_text.dumps(found, indent=1) + "\n")
        written.append(json)
    return written


def _tell(found: dict[str, Any]) -> None:
    """What a person reads of it."""
    from studies.learning_curve import as_table
    from studies.report import as_text, resolved_pairs

    print(as_text(found))
    if "learning_curve" in found:
        print(f"\n{as_table(found['learning_curve'])}")
    if "joints" in found:
        joints = found["joints"]["accuracy"]
        lost = f"{100 * (joints - found['accuracy']):.1f} points are lost"
        print(f"\nfrom pixels, {found['background']} background; from the joints it is {joints:.3f}: {lost}")
    if len(found["views"]) > 1:
        print(f"\n{resolved_pairs(found)}")


def _from_pixels(
    archive: "MotionArchive", question: "Question", background: str, bar: ProgressBar
) -> tuple["MotionArchive", "Answer", "Answer"]:
    """The archive at a camera's rate, and what is judged of it from pictures and from the joints."""
    from observer.motion.transforms import select
    from observer.rendering.scenery import Scenery
    from studies.evaluate import evaluate as ask
    from studies.through import RATE_HZ, Filming, evaluate_pixels

    filming = Filming(Scenery(background=background))
    sampled = select(archive, rate_hz=RATE_HZ)
    return sampled, evaluate_pixels(sampled, question, filming, bar), ask(sampled, question, bar)


def paper(
    archive: Archive,
    labels: LabelSets = None,
    train_subjects: TrainSubjects = "",
    test_subjects: TestSubjects = "",
    report: Annotated[Path | None, typer.Option(help="Folder for the text and the figures.")] = None,
) -> None:
    """The paper's three experiments with the paper's own model and rule, confusion tables beside the paper's.

    Example: labanmesh paper msr.npz --labels AS1 --labels AS2 --labels AS3 --report out
    """
    from observer.motion.archive_file import read_archive
    from observer.motion.transforms import labels_of
    from studies.experiments import run_experiments, told
    from studies.report import write_report
    from studies.trials import labels_in

    whole = read_archive(archive)
    sets = {text: labels_in(text) for text in labels or []} or {"all": labels_of(whole)}
    with ProgressBar() as bar:
        outcomes = run_experiments(
            whole,
            sets,
            split_list("--train-subjects", train_subjects),
            split_list("--test-subjects", test_subjects),
            bar,
        )
    text = told(outcomes)
    print(text)
    if report:
        for name, three in outcomes.items():
            write_report(three[-1].answer, three[-1].found, report / name.replace(",", "-"))
        _write(report / "experiments.txt", text + "\n")
        print(f"\nwritten: {report}/experiments.txt and the figures of experiment 3 in folders beside it")


def _with_facings(parameters: dict[str, float], facings: int, model: str, turn: float | None) -> dict[str, float]:
    """The model's parameters; only `phase` knows facings, and needs them where the turn is not known."""
    wanted = facings or (FACINGS if turn is None and model == "phase" else 0)
    return {**({"facings": float(wanted)} if wanted else {}), **parameters}


def _turn(text: str) -> float | None:
    if text == "random":
        return None
    try:
        return float(text)
    except ValueError:
        raise BadInput(f"--turn {text!r}: degrees or 'random' are expected") from None


def _write(path: Path, text: str) -> None:
    try:
        path.write_text(text, encoding="utf-8")
    except OSError as error:
        raise BadInput(f"{path}: {error.strerror}") from None
