"""Our observers beside offline classifiers on the same tracks: `python -m benchmarks.comparisons.classifiers`."""

import importlib.util
import json as json_text
import sys
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Annotated

import typer

from benchmarks.command_line import read_page, replace_table, run_command
from benchmarks.comparisons.classifiers.comparison import PEERS, PeerOptions
from benchmarks.comparisons.classifiers.tasks import (
    TASKS,
    VIEWS,
    AccuracyTask,
    StreamTask,
    Table,
    Task,
    sets_of,
    tasks_of,
)
from common.command_options import takes_options
from common.errors import BadInput, LabanmeshError
from common.parallel import cores
from common.progress import ProgressBar
from common.text import split_list
from observer.geometry.views import split_views
from observer.motion.archive import MotionArchive, labels_of
from observer.motion.archive_file import read_archive
from observer.motion.label_sets import labels_in
from observer.motion.projected import view_of
from studies.commands import BodyParts, JsonFile, LabelSets, LeaveOneSubjectOut, TestSubjects, TrainSubjects
from studies.evaluated_archives import chosen_parts
from studies.output_files import write_text
from studies.sensors import performances, read_sensors
from studies.settings import EvaluationSettings

BEGIN = "<!-- peers: from here to the end mark, `make peers` writes -->"
END = "<!-- peers: end -->"
SEEDS = 3


@dataclass(frozen=True, slots=True)
class PeersOptions:
    """As typed on the command line."""

    archive: Annotated[
        Path | None, typer.Argument(help="The motion archive (.npz); default: all tables, from LABANMESH_DATA.")
    ] = None
    views: Annotated[
        str, typer.Option(help="door, wheel, table, yaw:DEG[,pitch:DEG]; separated by commas; default: door,wheel.")
    ] = ""
    labels: LabelSets = None
    train_subjects: TrainSubjects = ""
    test_subjects: TestSubjects = ""
    leave_one_subject_out: LeaveOneSubjectOut = False
    body_parts: BodyParts = ""
    sensor: Annotated[
        list[str] | None,
        typer.Option(metavar="NAME=FILE[@VIEW]", help="In place of an archive, for each sensor its own; repeatable."),
    ] = None
    stream: Annotated[bool, typer.Option("--stream", help="Spot movements in the archive's continuous recordings.")] = (
        False
    )
    table: Annotated[
        list[str] | None, typer.Option(help=f"Without an archive, which table: {', '.join(TASKS)}; repeatable.")
    ] = None
    fast: Annotated[bool, typer.Option("--fast", help="One seed, a tenth of the kernels: a first look.")] = False
    peers_only: Annotated[
        bool, typer.Option("--peers-only", help="Leave our observers out, whose learning takes most of the time.")
    ] = False
    jobs: Annotated[int, typer.Option(min=0, help="Processes; 0: one for each processor core.")] = 0
    page: Annotated[Path | None, typer.Option(help="A markdown page whose tables are replaced.")] = None
    json: JsonFile = None


@takes_options
def peers(options: PeersOptions) -> None:
    """Compare our observers with MiniRocket and 1-NN DTW, which know the segment and relearn for every fraction.

    Example: python -m benchmarks.comparisons.classifiers msr.npz --views door,wheel --labels AS1

    Example: python -m benchmarks.comparisons.classifiers florence.npz --leave-one-subject-out

    Example: python -m benchmarks.comparisons.classifiers --sensor left=a.npz --sensor right=b.npz

    Example: python -m benchmarks.comparisons.classifiers karate.npz --stream --leave-one-subject-out
    """
    text = _page_text(options)
    with ProgressBar("reading the recordings"):
        tasks = _tasks(options)
    seeds = range(1 if options.fast else SEEDS)
    tables = _tables(tasks, PeerOptions(seeds, options.fast, options.jobs or cores(), not options.peers_only))
    written = []
    if options.page:
        written.append(write_text(options.page, replace_table(text, _markdown(tables), BEGIN, END), "--page"))
    if options.json:
        figures = [{"title": one.title, "protocol": one.protocol, **one.figures} for one in tables]
        whole = figures[0] | ({"tables": figures} if len(figures) > 1 else {})
        written.append(write_text(options.json, json_text.dumps(whole, indent=1) + "\n", "--json"))
    if written:
        print("\nwritten:", *written, sep="\n  ")


def _page_text(options: PeersOptions) -> str:
    """The page as it is; "" without one. Raises BadInput for options whose figures are not for a page."""
    page = options.page
    unfit = {"--fast": options.fast, "--table": bool(options.table), "--peers-only": options.peers_only}
    for option in (option for option, is_set in unfit.items() if page and is_set):
        why = "too rough for a page" if option == "--fast" else "not all that a page shows"
        raise BadInput(f"--page {page}: figures of {option} are {why}; omit one of the two")
    return read_page(page, BEGIN, END)


def _tables(tasks: Sequence[Task], options: PeerOptions) -> list[Table]:
    """Each table is printed as soon as it is there."""
    if importlib.util.find_spec("aeon") is None:
        raise LabanmeshError("aeon is not installed; pip install 'labanmesh[peers]'")
    tables = []
    for task in tasks:
        with ProgressBar() as bar:
            tables.append(task.run(options, bar))
        print(_markdown(tables[-1:]), flush=True)
    return tables


def _markdown(tables: Sequence[Table]) -> str:
    return "\n\n".join(f"### {one.title}\n\n{one.protocol}\n\n{one.markdown}" for one in tables)


def _tasks(options: PeersOptions) -> list[Task]:
    """What the options ask for: the tables of LABANMESH_DATA, or one table of the archive or the sensors."""
    path, sensors, names = options.archive, options.sensor or [], options.table or []
    unknown = [name for name in names if name not in TASKS]
    if unknown:
        raise BadInput(f"--table {unknown[0]}: known are {', '.join(TASKS)}")
    settings = _settings(options)
    if path is None and not sensors:
        people = settings.train_subjects or settings.test_subjects or settings.leave_one_subject_out
        if options.stream or options.labels or people:
            raise BadInput("no archive is named: the tables of LABANMESH_DATA have fixed people and movements")
        return tasks_of(names or tuple(TASKS))
    if names or (path and sensors) or (options.stream and sensors):
        raise BadInput("name one of these: ARCHIVE with or without --stream, --sensor, --table")
    if path:
        whole = read_archive(path)
        views = split_views(options.views) if options.views else ("",) if whole.camera else VIEWS
        settings = replace(settings, views=tuple(view_of(whole, view) for view in views))
    else:
        seen_from, archives = read_sensors(sensors, read_archive)
        whole, settings = performances(archives), replace(settings, views=seen_from, sensors=archives)
    parts = chosen_parts(settings.body_parts, whole.body_parts)
    settings = replace(settings, labels=labels_of(whole), body_parts=parts)
    return [_task(whole, settings, options.labels or [], options.stream, path.name if path else "Several sensors")]


def _settings(options: PeersOptions) -> EvaluationSettings:
    """Of an evaluation of all movements, which are not known yet, and neither are the views."""
    return EvaluationSettings(
        views=(),
        labels=(),
        train_subjects=split_list("--train-subjects", options.train_subjects),
        test_subjects=split_list("--test-subjects", options.test_subjects),
        leave_one_subject_out=options.leave_one_subject_out,
        body_parts=split_list("--body-parts", options.body_parts),
    )


def _task(whole: MotionArchive, settings: EvaluationSettings, labels: list[str], stream: bool, title: str) -> Task:
    sets = {text: replace(settings, labels=labels_in(text) or settings.labels) for text in labels} or sets_of(settings)
    people = "One person left out at a time." if settings.leave_one_subject_out else "Other people than those learned."
    if stream:
        return StreamTask(title, people, whole, sets)
    return AccuracyTask(title, people, whole, sets, {} if settings.sensors else PEERS)


if __name__ == "__main__":
    sys.exit(run_command(peers, "comparisons.classifiers"))
