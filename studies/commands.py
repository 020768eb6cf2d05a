"""The verb `evaluate`, and `evaluate --paper`, with their options."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from common.command_options import takes_options
from common.errors import BadInput
from common.progress import ProgressBar
from common.text import named_numbers, one_of, split_list
from studies.evaluate_options import EvaluateOptions, LabelSets, TestSubjects, TrainSubjects

if TYPE_CHECKING:
    from observer.motion.archive import MotionArchive
    from studies.evaluate import EvaluationSettings
    from studies.evaluated_archives import EvaluatedArchives
    from studies.run_evaluation import EvaluationTasks

DEFAULT_FACINGS = 12
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
        whole, settings, tasks = _input(options)
    from studies.run_evaluation import run_evaluation

    written = run_evaluation(whole, settings, tasks)
    if written:
        print("\nwritten:", *written, sep="\n  ")


def _input(options: EvaluateOptions) -> "tuple[MotionArchive, EvaluationSettings, EvaluationTasks]":
    """The recordings and what to do with them; raises BadInput for options that do not fit."""
    from observer.geometry.placement import parse_place, placement_of
    from studies.evaluated_archives import BackgroundArchives, read_archives
    from studies.run_evaluation import EvaluationTasks, require_compatible

    background = BackgroundArchives.parse(options.background, options.background_subjects)
    parts = split_list("--body-parts", options.body_parts)
    placement = placement_of(parse_place(options.place), options.facing)
    archives = read_archives(
        options.archive, options.views, options.sensor or [], parts, background, options.other_motion or [], placement
    )
    settings = _settings(options, archives)
    tasks = EvaluationTasks(options.stream, options.learning_curve, options.jobs, options.report, options.json)
    require_compatible(settings, tasks)
    return archives.whole, settings, tasks


def _settings(options: EvaluateOptions, archives: "EvaluatedArchives") -> "EvaluationSettings":
    """The settings of the evaluation; raises BadInput for values that are none."""
    from observer.motion.archive import labels_of
    from observer.motion.sensors import require_shared_labels
    from studies.evaluate import EvaluationSettings
    from studies.faults import parse_fault
    from studies.trials import labels_in, unlearned_and_background

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
    train_subjects: TrainSubjects = "",
    test_subjects: TestSubjects = "",
    report: Annotated[Path | None, typer.Option(help="Folder for the text and the figures.")] = None,
    of_paper: Annotated[bool, typer.Option("--paper", show_default=False, help="This experiment.")] = True,
) -> None:
    """Run the paper's three experiments with the paper's model and rule; print its confusion tables beside ours.

    Example: labanmesh evaluate --paper msr.npz --labels AS1 --labels AS2 --labels AS3 --report out
    """
    from observer.motion.archive import labels_of
    from observer.motion.archive_file import read_archive
    from observer.tracks import BODY_PARTS
    from studies.experiments import as_text, run_experiments
    from studies.output_files import write_text
    from studies.report import prepare_report, write_report
    from studies.sensors import with_parts
    from studies.trials import labels_in

    whole = with_parts(read_archive(archive), BODY_PARTS)
    sets = {text: labels_in(text) for text in labels or []} or {"all": labels_of(whole)}
    train, test = split_list("--train-subjects", train_subjects), split_list("--test-subjects", test_subjects)
    if report:
        prepare_report(report)
    with ProgressBar() as bar:
        results = run_experiments(whole, sets, train, test, bar)
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
    count = options.facings or (DEFAULT_FACINGS if turn_deg is None and knows_facings else 0)
    return {**({"facings": float(count)} if count else {}), **parameters}


def _turn(text: str) -> float | None:
    if text == "random":
        return None
    try:
        return float(text)
    except ValueError:
        raise BadInput(f"--turn {text!r}: expected a number of degrees, or random") from None
