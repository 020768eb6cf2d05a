"""The verbs that look at the whole: `evaluate` and `demo`."""

import json as json_text
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from common.errors import BadInput
from common.progress import ProgressBar
from common.text import named_numbers, one_of, split_list
from studies import options

if TYPE_CHECKING:
    from observer.motion.archive import MotionArchive
    from studies.evaluate import Answer, Question

FACINGS = 12
"""Every 30 degrees: fewer lose up to 2 points between two directions, more cost time (docs/design/model.md)."""


def evaluate(
    archive: options.Archive,
    views: options.Views,
    labels: options.Labels = "",
    train_subjects: options.TrainSubjects = "",
    test_subjects: options.TestSubjects = "",
    leave_one_subject_out: options.LeaveOneOut = False,
    model: options.Model = "phase",
    rule: options.RuleName = "robust_inverse_entropy",
    parameter: options.Parameters = None,
    turn: options.Turn = "0",
    fault: options.Faults = None,
    facings: options.Facings = 0,
    temperature: options.Temperature = 1.0,
    uncalibrated: options.Uncalibrated = False,
    unlearned: options.Unlearned = "",
    background_labels: options.BackgroundLabels = "",
    body_parts: options.BodyParts = "",
    onset: options.OnsetKind = "known",
    stream: options.Stream = False,
    learning_curve: options.LearningCurve = False,
    through: options.Through = "process",
    background: options.Background = "plain",
    seed: options.Seed = 0,
    report: options.ReportFolder = None,
    json: options.JsonFile = None,
) -> None:
    """How well the system judges people whom it has not learned from: accuracy, confusion, earliness, calibration.

    Example: labanmesh evaluate msr.npz --views door,wheel --train-subjects 1,3,5,7,9 --test-subjects 2,4,6,8,10

    Example: labanmesh evaluate msr.npz --views door --labels AS1 --stream --unlearned others --background-labels 6

    Example: labanmesh evaluate msr.npz --views door --turn 45 --model frame-table --rule inverse_entropy --report out
    """
    from observer.geometry.views import parse_view, split_views
    from observer.learning import labels_of
    from observer.motion.archive_file import read_archive
    from studies.evaluate import Question
    from studies.faults import fault_named
    from studies.strangers import strangers
    from studies.subsets import labels_in

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
    from studies.answer import as_json
    from studies.evaluate import evaluate as ask
    from studies.learning_curve import learning_curve
    from studies.mesh_run import fused_over_mesh
    from studies.report import draw_learning_curve, write_report
    from studies.stream import judge_stream

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
    from studies.answer import as_text
    from studies.learning_curve import as_table
    from studies.report import resolved_pairs

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
    from observer.learning import prepared
    from observer.rendering.scenery import Scenery
    from studies.evaluate import evaluate as ask
    from studies.pixels import RATE_HZ, Filming, evaluate_pixels

    filming = Filming(Scenery(background=background))
    sampled = prepared(archive, rate_hz=RATE_HZ)
    return sampled, evaluate_pixels(sampled, question, filming, bar), ask(sampled, question, bar)


def demo(
    motion: Annotated[Path | None, typer.Option(help="A motion archive: recorded people instead of ours.")] = None,
    subject: Annotated[str | None, typer.Option(help="Who performs, of the archive; the last one.")] = None,
    output: Annotated[Path, typer.Option(help="Folder for scene, models, log and figures.")] = Path("labanmesh-demo"),
    seed: Annotated[int, typer.Option(min=0, help="Seeds all chance.")] = 0,
    pixels: Annotated[
        bool, typer.Option(help="Track hands and head in pictures of virtual cameras, or be told where they are.")
    ] = True,
) -> None:
    """The whole system on this machine: four observer processes in the corners, one referee, verdicts against truth.

    The performer is synthetic unless --motion names recorded people, and filmed by virtual cameras. Ends by itself.

    Example: labanmesh demo

    Example: labanmesh demo --motion msr.npz --subject 8
    """
    from observer.motion.archive_file import read_archive
    from studies.demo import play
    from studies.demo_report import draw, rows_of, table
    from studies.demo_scene import PREVIEW, recorded_performance, synthetic_performance, write_demo

    if motion is None:
        performance = synthetic_performance(seed)
    else:
        performance = recorded_performance(read_archive(motion), motion.name, subject, seed)
    print(performance.title)
    with ProgressBar() as bar:
        scene = write_demo(performance, output, bar, pixels)
    stream = performance.stream
    length_s = len(stream.positions) / stream.rate_hz
    print(f"five processes start: four observers, one referee; the performance takes {length_s:.0f} s", flush=True)
    heard = play(scene, output / "log.txt", length_s)
    figures = draw(stream, heard, performance.vocabulary.labels, output)
    print(f"\n{performance.title}\n\n{table(rows_of(stream, heard))}\n")
    film = [output / PREVIEW] if pixels else []
    print("written:", *figures, *film, scene, output / "log.txt", sep="\n  ")
    print(f"\nagain, by hand: labanmesh up {scene}, and labanmesh watch {scene} in another terminal")


def paper(
    archive: options.Archive,
    labels: options.LabelSets = None,
    train_subjects: options.TrainSubjects = "",
    test_subjects: options.TestSubjects = "",
    report: Annotated[Path | None, typer.Option(help="Folder for the text and the figures.")] = None,
) -> None:
    """The paper's three experiments with the paper's own model and rule, confusion tables beside the paper's.

    Example: labanmesh paper msr.npz --labels AS1 --labels AS2 --labels AS3 --report out
    """
    from observer.learning import labels_of
    from observer.motion.archive_file import read_archive
    from studies.experiments import run_experiments, told
    from studies.report import write_report
    from studies.subsets import labels_in

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
