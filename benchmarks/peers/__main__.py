"""The verb `peers`: offline classifiers on the tracks that our judges get, beside our judges, as a table."""

import importlib.util
import json as json_text
import os
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from common.errors import BadInput, LabanmeshError
from common.progress import ProgressBar
from common.text import split_list

if TYPE_CHECKING:
    from observer.motion.archive import MotionArchive
    from studies.evaluate import Question

SEEDS = 3
RECORDINGS = "msr_action3d/MSRAction3DSkeletonReal3D"
"""Where, in the folder that LABANMESH_DATA names, the recordings lie that are taken when no archive is named."""


def peers(
    archive: Annotated[
        Path | None, typer.Argument(help="The motion archive (.npz); by default MSR Action3D of LABANMESH_DATA.")
    ] = None,
    views: Annotated[str, typer.Option(help="door, wheel, table, yaw:DEG[,pitch:DEG]; by commas.")] = "door,wheel",
    labels: Annotated[
        list[str] | None, typer.Option(help="Movements by commas, or a set as AS1; repeat for several sets.")
    ] = None,
    train_subjects: Annotated[str, typer.Option(help="People to learn from; every other one.")] = "",
    test_subjects: Annotated[str, typer.Option(help="People to judge; those not learned from.")] = "",
    leave_one_subject_out: Annotated[bool, typer.Option("--leave-one-subject-out", help="Judge each in turn.")] = False,
    fast: Annotated[bool, typer.Option("--fast", help="One seed, a tenth of the kernels: a first look.")] = False,
    page: Annotated[Path | None, typer.Option(help="A page in markdown whose table is written anew.")] = None,
    json: Annotated[Path | None, typer.Option(help="File for the figures as JSON.")] = None,
) -> None:
    """Our judges beside MiniRocket and 1-NN DTW, which are given the segment and learn anew for every fraction of it.

    Example: python -m benchmarks.peers msr.npz --views door,wheel --labels AS1

    Example: python -m benchmarks.peers florence.npz --leave-one-subject-out
    """
    from benchmarks.peers.table import rewritten
    from observer.geometry.views import parse_view, split_views
    from observer.motion.transforms import labels_of
    from studies.evaluate import Question

    text = _page(page, fast)
    whole = _archive(archive)
    question = Question(
        views=tuple(parse_view(view) for view in split_views(views)),
        labels=labels_of(whole),
        train_subjects=split_list("--train-subjects", train_subjects),
        test_subjects=split_list("--test-subjects", test_subjects),
        leave_one_subject_out=leave_one_subject_out,
    )
    table, found = _compared(whole, _sets(question, labels or []), fast)
    print(table)
    if page:
        _write(page, rewritten(text, table) or text)
    if json:
        _write(json, json_text.dumps(found, indent=1) + "\n")
    written = [str(file) for file in (page, json) if file]
    if written:
        print("\nwritten:", *written, sep="\n  ")


def _compared(archive: "MotionArchive", sets: "dict[str, Question]", fast: bool) -> tuple[str, dict[str, Any]]:
    """The table in markdown with a line above it that says what was asked; and the same as JSON."""
    from benchmarks.peers.comparison import compared
    from benchmarks.peers.table import as_json, as_markdown, rows_of
    from studies.report import FRACTIONS

    seeds = range(1 if fast else SEEDS)
    if importlib.util.find_spec("aeon") is None:
        raise LabanmeshError("aeon is not installed; pip install 'labanmesh[peers]'")
    with ProgressBar() as bar:
        contests = [compared(archive, name, question, seeds, fast, bar) for name, question in sets.items()]
    rows = rows_of(contests)
    views = [view.name for view in next(iter(sets.values())).views]
    people = sorted(set(contests[0].people), key=lambda name: (len(name), name))
    found = {"version": 1, "views": views, "judged": people, "seeds": len(seeds), "fast": fast}
    trials = ", ".join(f"{len(contest.people)} of {contest.movements}" for contest in contests)
    asked = f"Views {', '.join(views)}; people judged: {', '.join(people)}; trials: {trials}; seeds: {len(seeds)}."
    return f"{asked}\n\n{as_markdown(rows, FRACTIONS)}", found | {"rows": as_json(rows, FRACTIONS)}


def _sets(question: "Question", texts: list[str]) -> dict[str, "Question"]:
    """By name: the sets that were asked for; else all movements and, where the archive has them, AS1, AS2 and AS3."""
    from dataclasses import replace

    from studies.trials import SUBSETS, labels_in

    if texts:
        return {text: replace(question, labels=labels_in(text) or question.labels) for text in texts}
    known = question.labels
    there = {name: replace(question, labels=some) for name, some in SUBSETS.items() if set(some) <= set(known)}
    return {f"all {len(known)}": question, **there}


def _archive(path: Path | None) -> "MotionArchive":
    """The archive that was named, else the recordings of LABANMESH_DATA, read as they were published."""
    from observer.motion.archive_file import read_archive
    from observer.motion.importers import import_recordings

    if path:
        return read_archive(path)
    folder = os.environ.get("LABANMESH_DATA")
    if not folder or not (Path(folder) / RECORDINGS).is_dir():
        place = f"LABANMESH_DATA = {folder!r} has no {RECORDINGS}" if folder else "LABANMESH_DATA is not set"
        raise BadInput(f"peers: no archive is named and {place}; set it, or: python -m benchmarks.peers ARCHIVE.npz")
    with ProgressBar() as bar:
        return import_recordings(
            "msr-action3d", Path(folder) / RECORDINGS, progress=lambda done, total: bar("reading", done, total)
        ).archive


def _page(page: Path | None, fast: bool) -> str:
    """The page as it is, looked at before the work and not after it."""
    from benchmarks.peers.table import BEGIN, END, rewritten

    if page is None:
        return ""
    if fast:
        raise BadInput(f"--page {page}: figures of --fast do not belong into a page; leave one of the two out")
    try:
        text = page.read_text(encoding="utf-8")
    except OSError as error:
        raise BadInput(f"--page {page}: cannot be read: {error.strerror}") from None
    if rewritten(text, "") is None:
        raise BadInput(f"--page {page}: the table goes between two lines that are not there: {BEGIN} and {END}")
    return text


def _write(path: Path, text: str) -> None:
    try:
        path.write_text(text, encoding="utf-8")
    except OSError as error:
        raise BadInput(f"{path}: cannot be written: {error.strerror}") from None


if __name__ == "__main__":
    import sys

    from benchmarks.command_line import run_command

    sys.exit(run_command(peers, "peers"))
