"""The verbs `evaluate` and `paper`, with their options."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from common.errors import BadInput
from common.progress import ProgressBar
from common.text import named_numbers, one_of, split_list

if TYPE_CHECKING:
    pass

FACINGS = 12
"""One per 30 degrees: fewer lose up to 2 points between two facings, more cost time (docs/design/model.md)."""

Archive = Annotated[Path, typer.Argument(help="The motion archive (.npz).")]
Labels = Annotated[str, typer.Option(help="Movements, or AS1, AS2, AS3; separated by commas; default: all.")]
LabelSets = Annotated[
    list[str] | None, typer.Option(help="Movements separated by commas, or a set as AS1; repeat for more sets.")
]
TrainSubjects = Annotated[str, typer.Option(help="People to learn from; default: every other one.")]
TestSubjects = Annotated[str, typer.Option(help="People to judge; default: those not learned from.")]


def evaluate(
    archive: Annotated[Path | None, typer.Argument(help="The motion archive (.npz); none with --sensor.")] = None,
    views: Annotated[
        str, typer.Option(help="door, wheel, table, yaw:DEG[,pitch:DEG] or camera files, separated by commas.")
    ] = "",
    sensor: Annotated[
        list[str] | None,
        typer.Option(
            help="NAME=FILE.npz or NAME=FILE.npz@VIEW in place of ARCHIVE --views: a sensor that recorded the same "
            "performances, by default seen from the door; two or more."
        ),
    ] = None,
    labels: Labels = "",
    train_subjects: TrainSubjects = "",
    test_subjects: TestSubjects = "",
    leave_one_subject_out: Annotated[
        bool, typer.Option("--leave-one-subject-out", help="Judge each person by models of all others.")
    ] = False,
    model: Annotated[
        str, typer.Option(help="phase (default), stacked, discriminative, phase-symbols or frame-table.")
    ] = "phase",
    rule: Annotated[str, typer.Option(help="The fusion rule.")] = "guarded_product",
    parameter: Annotated[
        list[str] | None, typer.Option(help="NAME=NUMBER, a parameter of the model; may be repeated.")
    ] = None,
    turn: Annotated[str, typer.Option(help="Degrees by which the performer is turned in test, or random.")] = "0",
    fault: Annotated[
        list[str] | None, typer.Option(help="VIEW=wrong|noise|silent|late|hidden; may be repeated.")
    ] = None,
    room: Annotated[
        list[str] | None,
        typer.Option(
            help="Before each trial the person: walk=METRES walks in, nearer=FACTOR comes nearer, stranger=FACTOR "
            "follows a person of another size, blunder=FACTOR is once seen in a false size; may be repeated."
        ),
    ] = None,
    facings: Annotated[
        int, typer.Option(min=0, help="Facings that the model knows: 1 for a known turn, 12 for a random one.")
    ] = 0,
    temperature: Annotated[
        float, typer.Option(min=0.1, max=1e3, help="Of the fused posterior: [fusion] temperature.")
    ] = 1.0,
    uncalibrated: Annotated[
        bool, typer.Option("--uncalibrated", help="Observers do not scale their certainty by how often they are right.")
    ] = False,
    unlearned: Annotated[
        str, typer.Option(help="With --stream: movements shown but not learned, separated by commas; or others.")
    ] = "",
    background_labels: Annotated[
        str,
        typer.Option(
            help="Movements learned as `something else`, separated by commas; a number: that many of --unlearned, "
            "then not shown; blends: mixtures of the learned ones only."
        ),
    ] = "",
    body_parts: Annotated[
        str, typer.Option(help="Parts to use, separated by commas; default: all of the archive.")
    ] = "",
    onset: Annotated[str, typer.Option(help="known: as cut out. unknown: with rest around, any tempo.")] = "known",
    stream: Annotated[bool, typer.Option("--stream", help="Also judge continuous streams.")] = False,
    learning_curve: Annotated[
        bool, typer.Option("--learning-curve", help="Also learn from fewer people and fewer recordings.")
    ] = False,
    through: Annotated[
        str, typer.Option(help="process; mesh: over real Zenoh sessions; pixels: filmed and tracked by camshift.")
    ] = "process",
    background: Annotated[
        str,
        typer.Option(
            help="Archives (.npz) to learn `something else` from, separated by commas; with --through pixels: plain, "
            "cluttered or skin_toned."
        ),
    ] = "plain",
    background_subjects: Annotated[
        str, typer.Option(help="The people of these archives to learn from; default: all.")
    ] = "",
    other_motion: Annotated[
        list[Path] | None,
        typer.Option(
            help="An archive in which no learned movement happens, to count false verdicts; people of --background "
            "in the same file are left out; may be repeated."
        ),
    ] = None,
    jobs: Annotated[int, typer.Option(min=0, help="Processes to share the work; 0: one per core.")] = 0,
    seed: Annotated[int, typer.Option(min=0, help="Seed of all random choices.")] = 0,
    report: Annotated[Path | None, typer.Option(help="Folder for tables and figures.")] = None,
    json: Annotated[Path | None, typer.Option(help="File for the figures as JSON.")] = None,
) -> None:
    """Judge people whom the models have not learned from: accuracy, confusion, earliness, calibration.

    Example: labanmesh evaluate msr.npz --views door,wheel --train-subjects 1,3,5,7,9 --test-subjects 2,4,6,8,10

    Example: labanmesh evaluate msr.npz --views door --labels AS1 --stream --unlearned others --background-labels 6

    Example: labanmesh evaluate --sensor left=a.npz --sensor right=b.npz --leave-one-subject-out --rule product

    Example: labanmesh evaluate msr.npz --views door --other-motion story.npz --background story.npz \
    --background-subjects a
    """
    from observer.motion.archive import labels_of
    from studies.evaluate import EvaluationSettings
    from studies.evaluated_archives import BackgroundChoice, read_archives
    from studies.faults import parse_fault
    from studies.room import parse_event
    from studies.run_evaluation import EvaluationTasks, require_compatible, run_evaluation
    from studies.trials import labels_in, unlearned_and_background

    one_of("--through", through, ("process", "mesh", "pixels"))
    learned_too = BackgroundChoice.parse(background, background_subjects)
    parts = split_list("--body-parts", body_parts)
    archives = read_archives(archive, views, sensor or [], parts, learned_too, other_motion or [])
    whole, chosen = archives.whole, archives.views
    learned = labels_in(labels) or labels_of(whole)
    turn_deg = _turn(turn)
    shown, other = unlearned_and_background(unlearned, background_labels, learned, labels_of(whole), seed)
    settings = EvaluationSettings(
        views=chosen,
        labels=learned,
        train_subjects=split_list("--train-subjects", train_subjects),
        test_subjects=split_list("--test-subjects", test_subjects),
        leave_one_subject_out=leave_one_subject_out,
        model=model,
        parameters=_with_facings(named_numbers("--parameter", parameter or []), facings, model, turn_deg),
        rule=rule,
        turn=turn_deg,
        faults=dict(parse_fault(text, [view.name for view in chosen]) for text in fault or []),
        body_parts=archives.body_parts,
        onset_known=one_of("--onset", onset, ("known", "unknown")) == "known",
        temperature=temperature,
        calibrated=not uncalibrated,
        unlearned=shown,
        background=other,
        room=tuple(parse_event(text) for text in room or []),
        seed=seed,
        sensors=archives.sensors,
        background_archive=archives.background,
        other_motion=archives.other_motion,
    )
    tasks = EvaluationTasks(through, learned_too.scenery, stream, learning_curve, jobs)
    require_compatible(settings, tasks)
    written = run_evaluation(whole, settings, tasks, report, json)
    if written:
        print("\nwritten:", *written, sep="\n  ")


def paper(
    archive: Archive,
    labels: LabelSets = None,
    train_subjects: TrainSubjects = "",
    test_subjects: TestSubjects = "",
    report: Annotated[Path | None, typer.Option(help="Folder for the text and the figures.")] = None,
) -> None:
    """Run the paper's three experiments with the paper's model and rule; print its confusion tables beside ours.

    Example: labanmesh paper msr.npz --labels AS1 --labels AS2 --labels AS3 --report out
    """
    from observer.motion.archive import labels_of
    from observer.motion.archive_file import read_archive
    from studies.experiments import as_text, run_experiments
    from studies.report import make_folder, write_report, write_text
    from studies.trials import labels_in

    whole = read_archive(archive)
    sets = {text: labels_in(text) for text in labels or []} or {"all": labels_of(whole)}
    train, test = split_list("--train-subjects", train_subjects), split_list("--test-subjects", test_subjects)
    if report:
        make_folder(report, "--report")
    with ProgressBar() as bar:
        results = run_experiments(whole, sets, train, test, bar)
    text = as_text(results)
    print(text)
    if report:
        for name, three in results.items():
            write_report(three[-1].result, three[-1].figures, report / name.replace(",", "-"))
        write_text(report / "experiments.txt", text + "\n", "--report")
        print(f"\nwritten: {report}/experiments.txt, and the figures of experiment 3 in one folder per set")


def _with_facings(parameters: dict[str, float], facings: int, model: str, turn: float | None) -> dict[str, float]:
    """The model's parameters; a model that knows facings needs them when the turn is random."""
    from observer.model.registry import MODELS

    knows_facings = model in MODELS and "facings" in MODELS[model].PARAMETERS
    count = facings or (FACINGS if turn is None and knows_facings else 0)
    return {**({"facings": float(count)} if count else {}), **parameters}


def _turn(text: str) -> float | None:
    if text == "random":
        return None
    try:
        return float(text)
    except ValueError:
        raise BadInput(f"--turn {text!r}: expected a number of degrees, or random") from None
