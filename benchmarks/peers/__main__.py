"""`python -m benchmarks.peers`: our observers beside offline classifiers on the same tracks, as a table."""

import importlib.util
import json as json_text
import os
import sys
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import typer
from numpy.typing import NDArray

from benchmarks.command_line import markdown_table, read_page, replace_table, run_command
from benchmarks.peers.comparison import PEERS, PeerComparison, compare_peers
from common.errors import BadInput, LabanmeshError
from common.progress import ProgressBar
from common.text import split_list
from observer.geometry.views import parse_view, split_views
from observer.motion.archive import MotionArchive, labels_of
from observer.motion.archive_file import read_archive
from observer.motion.importers import import_recordings
from observer.tracks import Floats
from studies.commands import LabelSets, TestSubjects, TrainSubjects
from studies.evaluate import EvaluationSettings
from studies.report import FRACTIONS, write_text
from studies.trials import SUBSETS, labels_in

DRAWS = 2000
COVERAGE = 0.95
BEGIN = "<!-- peers: from here to the end mark, `make peers` writes -->"
END = "<!-- peers: end -->"
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
    labels: LabelSets = None,
    train_subjects: TrainSubjects = "",
    test_subjects: TestSubjects = "",
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


@dataclass(frozen=True, slots=True, eq=False)
class AccuracyInterval:
    """mean (F+1,): accuracy at each fraction, then the area under the curve; low, high (F+1,): 95 % of the draws."""

    mean: Floats
    low: Floats
    high: Floats


@dataclass(frozen=True, slots=True, eq=False)
class PeerRow:
    """One row of the table; `difference`: the interval is of one classifier's accuracy minus another's."""

    movements: str
    classifier: str
    interval: AccuracyInterval
    difference: bool = False


def accuracy_interval(rights: Sequence[Floats], people: Sequence[Sequence[str]], seed: int = 0) -> AccuracyInterval:
    """The mean over one or several sets of trials, each (F, N) with the names of the N trials' people.

    Also for the difference of two curves. The interval is a bootstrap in two stages: people are drawn with
    replacement, the same for every set, then as many trials of each person as there are. It is rough for few people.
    """
    known = sorted({person for names in people for person in names})
    rng = np.random.default_rng(seed)
    drawn = rng.multinomial(len(known), np.full(len(known), 1 / len(known)), size=DRAWS)
    sets = [
        _with_area(right @ _weights(names, known, drawn, rng).T) for right, names in zip(rights, people, strict=True)
    ]
    # A draw without a person of a set has no accuracy for that set.
    low, high = np.nanquantile(np.mean(sets, axis=0), [(1 - COVERAGE) / 2, (1 + COVERAGE) / 2], axis=1)
    mean = np.mean([_with_area(right.mean(axis=1)) for right in rights], axis=0)
    return AccuracyInterval(mean, low, high)


def _weights(names: Sequence[str], known: Sequence[str], drawn: NDArray[np.int64], rng: np.random.Generator) -> Floats:
    """(DRAWS, N) shares of the trials in each draw, NaN where no person of this set was drawn."""
    counts = np.zeros((len(drawn), len(names)))
    for person, times in zip(known, drawn.T, strict=True):
        own = [n for n, name in enumerate(names) if name == person]
        if own:
            counts[:, own] = rng.multinomial(times * len(own), np.full(len(own), 1 / len(own)))
    total = counts.sum(axis=1, keepdims=True)
    shares: Floats = np.where(total > 0, counts / np.maximum(total, 1), np.nan)
    return shares


def _with_area(accuracies: Floats) -> Floats:
    """(F, ...) -> (F+1, ...): the mean over the fractions is last."""
    return np.concatenate([accuracies, accuracies.mean(axis=0, keepdims=True)])


def peer_rows(comparisons: Sequence[PeerComparison]) -> list[PeerRow]:
    """By set of movements one row per curve and one per difference to a peer; then the mean of the subsets."""
    rows = [row for comparison in comparisons for row in _rows(comparison.movements, [comparison])]
    subsets = [comparison for comparison in comparisons if comparison.movements in SUBSETS]
    if len(subsets) > 1:
        rows += _rows(f"mean of {', '.join(comparison.movements for comparison in subsets)}", subsets)
    return rows


def _rows(movements: str, comparisons: Sequence[PeerComparison]) -> list[PeerRow]:
    people = [comparison.people for comparison in comparisons]
    curves = list(zip(*(comparison.curves for comparison in comparisons), strict=True))
    rows = [
        PeerRow(movements, same[0].name, accuracy_interval([curve.right for curve in same], people)) for same in curves
    ]
    ours = curves[0]
    for theirs in curves:
        if theirs[0].name in PEERS:
            differences = [mine.right - other.right for mine, other in zip(ours, theirs, strict=True)]
            name = f"{ours[0].name} − {theirs[0].name}"
            rows.append(PeerRow(movements, name, accuracy_interval(differences, people), difference=True))
    return rows


def as_markdown(rows: Sequence[PeerRow], fractions: Sequence[float]) -> str:
    """Accuracy after each fraction and the area under the curve, with the 95 % interval in brackets."""
    head = ["movements", "judged by", *(f"{fraction:.0%}" for fraction in fractions), "area"]
    before = ["", *(row.movements for row in rows)]
    cells = [
        ["" if row.movements == last else row.movements, row.classifier, *_cells(row)]
        for row, last in zip(rows, before, strict=False)
    ]
    return markdown_table(head, cells, left=2)


def _cells(row: PeerRow) -> list[str]:
    sign, interval = "+" if row.difference else "", row.interval
    return [
        f"{mean:{sign}.3f} ({low:{sign}.2f} to {high:{sign}.2f})"
        for mean, low, high in zip(interval.mean, interval.low, interval.high, strict=True)
    ]


def as_json(rows: Sequence[PeerRow], fractions: Sequence[float]) -> list[dict[str, Any]]:
    """One object per row; `accuracy_at` as in the contract, each figure with its interval [low, high]."""
    names = [*map(str, fractions), "area"]
    return [
        {
            "movements": row.movements,
            "judged_by": row.classifier,
            "accuracy_at": dict(zip(names[:-1], row.interval.mean[:-1].tolist(), strict=True)),
            "area": float(row.interval.mean[-1]),
            "interval": dict(zip(names, np.column_stack([row.interval.low, row.interval.high]).tolist(), strict=True)),
        }
        for row in rows
    ]


if __name__ == "__main__":
    sys.exit(run_command(peers, "peers"))
