"""The paper's three experiments (section V.B) with the paper's own model and rule, beside the paper's tables.

Tables I to III are copied as printed. One inconsistency is theirs: in Table III the row Point sums to 13 trials, in
Tables I and II to 12, so its counts sum to 96 while its last row says 95.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from observer.geometry.views import parse_view
from observer.motion.archive import MotionArchive
from studies.evaluate import EvaluationResult, evaluate
from studies.metrics import beside, confusion_table
from studies.report import as_json
from studies.report_text import resolved_pairs
from studies.settings import EvaluationSettings, Progress

PAPER_MOVEMENTS = ("lunging", "maestro", "stretch", "ok", "point", "byebye", "shake", "nthrow")
"""The paper's eight movements in the order of its tables."""


@dataclass(frozen=True, slots=True)
class PaperTable:
    """One table of the paper, as printed. counts: a row for each true movement, a column for each judged one."""

    title: str
    counts: tuple[tuple[int, ...], ...]
    printed_rate: float

    @property
    def confusion(self) -> NDArray[np.int64]:
        """(8, 8) counts."""
        return np.array(self.counts, dtype=np.int64)


TABLE_I = PaperTable(
    "Table I: Door plane",
    (
        (7, 0, 0, 5, 0, 0, 0, 1),
        (0, 5, 0, 0, 0, 8, 0, 0),
        (0, 0, 12, 0, 0, 0, 1, 0),
        (0, 0, 0, 7, 1, 0, 5, 0),
        (0, 0, 0, 1, 10, 0, 1, 0),
        (0, 0, 0, 0, 0, 13, 0, 0),
        (0, 0, 0, 4, 0, 0, 9, 0),
        (0, 0, 0, 4, 0, 0, 1, 0),
    ),
    0.66,
)
TABLE_II = PaperTable(
    "Table II: learned in the Door plane, seen from 45 degrees",
    (
        (10, 0, 0, 1, 2, 0, 0, 0),
        (0, 1, 0, 0, 0, 12, 0, 0),
        (0, 0, 7, 2, 0, 0, 4, 0),
        (0, 0, 0, 1, 10, 0, 2, 0),
        (0, 0, 0, 2, 10, 0, 0, 0),
        (0, 0, 0, 0, 0, 13, 0, 0),
        (0, 0, 0, 3, 2, 2, 6, 0),
        (0, 0, 0, 0, 0, 0, 5, 0),
    ),
    0.51,
)
TABLE_III = PaperTable(
    "Table III: Door and Wheel planes fused",
    (
        (11, 0, 1, 1, 0, 0, 0, 0),
        (0, 11, 0, 0, 0, 2, 0, 0),
        (0, 0, 12, 0, 1, 0, 0, 0),
        (0, 0, 0, 7, 2, 0, 4, 0),
        (0, 0, 0, 1, 11, 0, 1, 0),
        (0, 0, 0, 0, 0, 13, 0, 0),
        (0, 0, 0, 3, 1, 1, 8, 0),
        (0, 0, 0, 0, 0, 0, 0, 5),
    ),
    0.81,
)


PAPER_MODEL, PAPER_RULE = "frame-table", "inverse_entropy"


@dataclass(frozen=True, slots=True)
class Experiment:
    """One of the three experiments: views, turn of the performer in degrees, and the paper's table."""

    title: str
    views: tuple[str, ...]
    turn: float
    table: PaperTable


EXPERIMENTS = (
    Experiment("1: one camera on the Door plane", ("door",), 0.0, TABLE_I),
    Experiment("2: the same, turned by 45 degrees without relearning", ("door",), 45.0, TABLE_II),
    Experiment("3: Door and Wheel plane fused", ("door", "wheel"), 0.0, TABLE_III),
)


@dataclass(frozen=True, slots=True, eq=False)
class ExperimentResult:
    """An experiment on one set of movements: the trials, and their figures as in the contract's JSON."""

    experiment: Experiment
    result: EvaluationResult
    figures: dict[str, Any]


def run_experiments(
    archive: MotionArchive,
    sets: Mapping[str, Sequence[str]],
    progress: Progress,
) -> dict[str, list[ExperimentResult]]:
    """All three experiments on each set of movements; every other person is learned from, the others are judged."""
    return {name: [_run(archive, name, labels, e, progress) for e in EXPERIMENTS] for name, labels in sets.items()}


def _run(
    archive: MotionArchive,
    name: str,
    labels: Sequence[str],
    experiment: Experiment,
    progress: Progress,
) -> ExperimentResult:
    settings = EvaluationSettings(
        views=tuple(parse_view(view) for view in experiment.views),
        labels=tuple(labels),
        model=PAPER_MODEL,
        rule=PAPER_RULE,
        turn=experiment.turn,
        # The paper's observers are not calibrated.
        calibrated=False,
    )
    title = f"{name}, {experiment.title}"
    result = evaluate(archive, settings, lambda _, done, total: progress(title, done, total))
    return ExperimentResult(experiment, result, as_json(result))


def as_text(results: Mapping[str, Sequence[ExperimentResult]]) -> str:
    """The confusion tables beside the paper's, the resolved pairs, and all rates in one table."""
    parts = []
    for name, three in results.items():
        for result in three:
            ours = confusion_table(np.array(result.figures["confusion"]), result.figures["labels"], f"{name}: ours")
            printed = result.experiment.table
            theirs = confusion_table(printed.confusion, PAPER_MOVEMENTS, f"the paper's {printed.title}")
            parts.append(f"experiment {result.experiment.title}\n\n{beside(ours, theirs)}")
        parts.append(f"{name}, {resolved_pairs(three[-1].figures)}")
    return "\n\n".join([*parts, _rates(results)])


def _rates(results: Mapping[str, Sequence[ExperimentResult]]) -> str:
    """Accuracy by experiment and set, their mean, and the paper's rate."""
    width = max(len(e.title) for e in EXPERIMENTS) + 2
    head = f"{'accuracy':<{width}}" + "".join(f"{name:>8}" for name in results) + f"{'mean':>8}{'paper':>8}"
    rows = []
    for n, experiment in enumerate(EXPERIMENTS):
        rates = [three[n].figures["accuracy"] for three in results.values()]
        cells = "".join(f"{rate:>8.3f}" for rate in [*rates, float(np.mean(rates)), experiment.table.printed_rate])
        rows.append(f"{experiment.title:<{width}}{cells}")
    single = [max(v["accuracy"] for v in three[-1].figures["per_view"].values()) for three in results.values()]
    cells = "".join(f"{rate:>8.3f}" for rate in [*single, float(np.mean(single))])
    rows.append(f"{'   the better of its two views alone':<{width}}{cells}{'':>8}")
    return "\n".join([head, "-" * len(head), *rows])
