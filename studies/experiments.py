"""The paper's three experiments (section V.B) with the paper's own model and rule, beside the paper's tables."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from observer.geometry.views import parse_view
from observer.motion.archive import MotionArchive
from studies.evaluate import Answer, Question, evaluate
from studies.metrics import beside, confusion_table
from studies.report import as_json, resolved_pairs

MOVEMENTS = ("lunging", "maestro", "stretch", "ok", "point", "byebye", "shake", "nthrow")
"""The paper's eight movements in the order of its tables."""


@dataclass(frozen=True, slots=True)
class PaperTable:
    """One table: `counts` are rows true, columns judged; the other figures are those printed, not computed."""

    title: str
    counts: tuple[tuple[int, ...], ...]
    printed_row_errors: tuple[int, ...]
    printed_errors: int
    printed_rate: float
    printed_trials: int = 95

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
    (6, 8, 1, 6, 2, 0, 4, 5),
    32,
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
    (3, 12, 6, 12, 2, 0, 7, 5),
    47,
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
    (2, 2, 1, 6, 2, 0, 5, 0),
    18,
    0.81,
)


PAPER_MODEL, PAPER_RULE = "frame-table", "inverse_entropy"


@dataclass(frozen=True, slots=True)
class Experiment:
    """One of the three: which views, how far the performer is turned, and the paper's table."""

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
class Outcome:
    """An experiment on one set of movements: the judged trials and the contract's figures."""

    experiment: Experiment
    answer: Answer
    found: dict[str, Any]


def run_experiments(
    archive: MotionArchive,
    sets: Mapping[str, Sequence[str]],
    train_subjects: Sequence[str],
    test_subjects: Sequence[str],
    progress: Callable[[str, int, int], None],
) -> dict[str, list[Outcome]]:
    """All three experiments on each set of movements."""
    return {
        name: [
            _run(archive, labels, e, train_subjects, test_subjects, f"{name}, {e.title}", progress) for e in EXPERIMENTS
        ]
        for name, labels in sets.items()
    }


def _run(
    archive: MotionArchive,
    labels: Sequence[str],
    experiment: Experiment,
    train_subjects: Sequence[str],
    test_subjects: Sequence[str],
    title: str,
    progress: Callable[[str, int, int], None],
) -> Outcome:
    question = Question(
        views=tuple(parse_view(view) for view in experiment.views),
        labels=tuple(labels),
        train_subjects=tuple(train_subjects),
        test_subjects=tuple(test_subjects),
        model=PAPER_MODEL,
        rule=PAPER_RULE,
        turn=experiment.turn,
        # The paper's observers do not ask how far they can be believed.
        calibrated=False,
    )
    answer = evaluate(archive, question, lambda _, done, total: progress(title, done, total))
    return Outcome(experiment, answer, as_json(answer))


def told(outcomes: Mapping[str, Sequence[Outcome]]) -> str:
    """Everything as text: the tables beside the paper's, the pairs resolved, and the rates in one table."""
    parts = []
    for name, three in outcomes.items():
        for outcome in three:
            ours = confusion_table(np.array(outcome.found["confusion"]), outcome.found["labels"], f"{name}: ours")
            theirs = confusion_table(
                outcome.experiment.table.confusion, _papers_labels(), f"the paper's {outcome.experiment.table.title}"
            )
            parts.append(f"experiment {outcome.experiment.title}\n\n{beside(ours, theirs)}")
        parts.append(f"{name}, {resolved_pairs(three[-1].found)}")
    return "\n\n".join([*parts, _rates(outcomes)])


def _papers_labels() -> Sequence[str]:
    from studies.experiments import MOVEMENTS

    return MOVEMENTS


def _rates(outcomes: Mapping[str, Sequence[Outcome]]) -> str:
    """Accuracy by experiment and set, their mean, and the paper's."""
    width = max(len(e.title) for e in EXPERIMENTS) + 2
    head = f"{'right':<{width}}" + "".join(f"{name:>8}" for name in outcomes) + f"{'mean':>8}{'paper':>8}"
    rows = []
    for n, experiment in enumerate(EXPERIMENTS):
        rates = [three[n].found["accuracy"] for three in outcomes.values()]
        cells = "".join(f"{rate:>8.3f}" for rate in [*rates, float(np.mean(rates)), experiment.table.printed_rate])
        rows.append(f"{experiment.title:<{width}}{cells}")
    single = [max(v["accuracy"] for v in three[-1].found["per_view"].values()) for three in outcomes.values()]
    cells = "".join(f"{rate:>8.3f}" for rate in [*single, float(np.mean(single))])
    rows.append(f"{'   the better of its two views alone':<{width}}{cells}{'':>8}")
    return "\n".join([head, "-" * len(head), *rows])
