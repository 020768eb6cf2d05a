"""`python -m benchmarks.peers`: our observers beside offline classifiers on the same tracks, as a table."""

import importlib.util
import json as json_text
import os
import sys
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Annotated, Any

import typer

from benchmarks.command_line import read_page, replace_table, run_command
from benchmarks.peers.comparison import compare_peers
from benchmarks.peers.table import BEGIN, END, as_json, as_markdown, peer_rows
from common.errors import BadInput, LabanmeshError
from common.progress import ProgressBar
from common.text import split_list
from observer.geometry.views import parse_view, split_views
from observer.motion.archive import MotionArchive, labels_of
from observer.motion.archive_file import read_archive
from observer.motion.importers import import_recordings
from studies.evaluate import EvaluationSettings
from studies.report import FRACTIONS, write_text
from studies.trials import SUBSETS, labels_in

SEEDS = 3
RECORDINGS = "msr_action3d/MSRAction3DSkeletonReal3D"
"""The folder in LABANMESH_DATA with the recordings that are used when no archive is named."""


def peers(
    archive: Annotated[
        Path | None, typer.Argument(help="The motion archive (.npz); default: MSR Action3D of LABANMESH_DATA.")
    ] = None,
    views: Annotated[
        str, typer.Option(help="door, wheel, table, yaw:DEG[,pitch:DEG]; separated by commas.")
    ] = "door,wheel",
    labels: Annotated[
        list[str] | None, typer.Option(help="Movements separated by commas, or a set as AS1; repeat for more sets.")
    ] = None,
    train_subjects: Annotated[str, typer.Option(help="People to learn from; default: every other one.")] = "",
    test_subjects: Annotated[str, typer.Option(help="People to judge; default: those not learned from.")] = "",
    leave_one_subject_out: Annotated[
        bool, typer.Option("--leave-one-subject-out", help="Judge each person by models of all others.")
    ] = False,
    fast: Annotated[bool, typer.Option("--fast", help="One seed, a tenth of the kernels: a first look.")] = False,
    page: Annotated[Path | None, typer.Option(help="A markdown page whose table is replaced.")] = None,
    json: Annotated[Path | None, typer.Option(help="File for the figures as JSON.")] = None,
) -> None:
    """Compare our observers with MiniRocket and 1-NN DTW, which know the segment and relearn for every fraction.

    Example: python -m benchmarks.peers msr.npz --views door,wheel --labels AS1

    Example: python -m benchmarks.peers florence.npz --leave-one-subject-out
    """
    if page and fast:
        raise BadInput(f"--page {page}: figures of --fast are too rough for a page; omit one of the two")
    text = read_page(page, BEGIN, END)
    whole = _archive(archive)
    settings = EvaluationSettings(
        views=tuple(parse_view(view) for view in split_views(views)),
        labels=labels_of(whole),
        train_subjects=split_list("--train-subjects", train_subjects),
        test_subjects=split_list("--test-subjects", test_subjects),
        leave_one_subject_out=leave_one_subject_out,
    )
    table, figures = _compared(whole, _sets(settings, labels or []), fast)
    print(table)
    written = []
    if page:
        written.append(write_text(page, replace_table(text, table, BEGIN, END), "--page"))
    if json:
        written.append(write_text(json, json_text.dumps(figures, indent=1) + "\n", "--json"))
    if written:
        print("\nwritten:", *written, sep="\n  ")


def _compared(archive: MotionArchive, sets: Mapping[str, EvaluationSettings], fast: bool) -> tuple[str, dict[str, Any]]:
    """The table in markdown below a line with the settings; and the same as JSON."""
    if importlib.util.find_spec("aeon") is None:
        raise LabanmeshError("aeon is not installed; pip install 'labanmesh[peers]'")
    seeds = range(1 if fast else SEEDS)
    with ProgressBar() as bar:
        sets_compared = [compare_peers(archive, name, settings, seeds, fast, bar) for name, settings in sets.items()]
    rows = peer_rows(sets_compared)
    views = [view.name for view in next(iter(sets.values())).views]
    people = sorted(set(sets_compared[0].people), key=lambda name: (len(name), name))
    figures = {"version": 1, "views": views, "judged": people, "seeds": len(seeds), "fast": fast}
    trials = ", ".join(f"{len(one.people)} of {one.movements}" for one in sets_compared)
    facts = f"Views {', '.join(views)}; people judged: {', '.join(people)}; trials: {trials}; seeds: {len(seeds)}."
    return f"{facts}\n\n{as_markdown(rows, FRACTIONS)}", figures | {"rows": as_json(rows, FRACTIONS)}


def _sets(settings: EvaluationSettings, texts: list[str]) -> dict[str, EvaluationSettings]:
    """By name the requested sets; default: all movements and, where the archive has them, AS1, AS2 and AS3."""
    if texts:
        return {text: replace(settings, labels=labels_in(text) or settings.labels) for text in texts}
    known = settings.labels
    subsets = {name: replace(settings, labels=some) for name, some in SUBSETS.items() if set(some) <= set(known)}
    return {f"all {len(known)}": settings, **subsets}


def _archive(path: Path | None) -> MotionArchive:
    """The named archive, else the recordings of LABANMESH_DATA as they were published."""
    if path:
        return read_archive(path)
    folder = os.environ.get("LABANMESH_DATA")
    if not folder or not (Path(folder) / RECORDINGS).is_dir():
        place = f"LABANMESH_DATA = {folder!r} has no {RECORDINGS}" if folder else "LABANMESH_DATA is not set"
        raise BadInput(f"no archive is named and {place}; set it, or: python -m benchmarks.peers ARCHIVE.npz")
    with ProgressBar() as bar:
        return import_recordings(
            "msr-action3d", Path(folder) / RECORDINGS, progress=lambda done, total: bar("reading", done, total)
        ).archive


if __name__ == "__main__":
    sys.exit(run_command(peers, "peers"))
