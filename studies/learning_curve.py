"""Learning curves: accuracy against the number of people, and of recordings of each, on the same test people.

Seeded; every point is an evaluation of its own.
"""

import itertools
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from statistics import mean
from typing import Any, Literal

import numpy as np

from common.errors import BadInput
from common.text import plural
from observer.motion.archive import MotionArchive, Recording
from studies.evaluate import EvaluationResult, EvaluationSettings, Progress, evaluate
from studies.metrics import accuracy, expected_calibration_error
from studies.trials import Split, splits, with_labels

DRAWS = 3
"""Random choices of people, or of recordings, per point; there is only one choice of all of them."""
MOST_JUDGED = 100
"""Test recordings per point, drawn evenly by movement: enough for a curve, and quick."""

Recordings = tuple[Recording, ...]


@dataclass(frozen=True, slots=True)
class TrainingChoice:
    """The training recordings of one evaluation, with `n` people, or `n` recordings of each person and movement."""

    kind: Literal["people", "recordings"]
    n: int
    recordings: Recordings


def learning_curve(
    archive: MotionArchive, settings: EvaluationSettings, progress: Progress = lambda *_: None
) -> dict[str, Any]:
    """`people` and `recordings`: lists of points, each with `n`, the mean accuracy and the calibration error.

    Raises BadInput with leave_one_subject_out, where the parts do not share their training people.
    """
    if settings.leave_one_subject_out:
        raise BadInput("--learning-curve --leave-one-subject-out: omit one of the two; name --train-subjects")
    whole = with_labels(archive, settings.labels)
    split = next(splits(whole, settings.train_subjects, settings.test_subjects, leave_one_out=False))
    rng = np.random.default_rng(settings.seed)
    test = _drawn_evenly(split.test, rng)
    choices = list(_by_people(split, settings.labels, rng))
    people = max(choice.n for choice in choices)
    choices += _by_recordings(split, rng)
    results: dict[frozenset[int], EvaluationResult] = {}
    by_n: dict[str, dict[int, list[EvaluationResult]]] = {"people": {}, "recordings": {}}
    for done, choice in enumerate(choices, 1):
        # All people with all their recordings are on both curves.
        key = frozenset(map(id, choice.recordings))
        if key not in results:
            results[key] = _evaluated(MotionArchive(archive.body_parts, choice.recordings), test, settings)
        by_n[choice.kind].setdefault(choice.n, []).append(results[key])
        progress("learning curve", done, len(choices))
    points = {kind: [_point(n, each) for n, each in sorted(curve.items())] for kind, curve in by_n.items()}
    return {**points, "n_people": people, "n_judged": len(test)}


def as_table(curve: dict[str, Any]) -> str:
    """The two curves as tables for people."""
    recordings = f"recordings of each of {plural(curve['n_people'], 'person', 'people')}"
    titles = {"people": "people learned from, with all their recordings", "recordings": recordings}
    return "\n\n".join("\n".join(_table(title, curve[kind])) for kind, title in titles.items())


def _table(title: str, points: Sequence[dict[str, Any]]) -> Iterator[str]:
    names = [*points[0]["per_view"], "fused"]
    yield f"accuracy at the end by {title}; means over up to {DRAWS} choices, least and most of the fused:"
    yield f"{'':>4}" + "".join(f"{name:>8}" for name in names) + f"{'least':>8}{'most':>8}{'ece':>8}{'examples':>10}"
    for point in points:
        values = [*point["per_view"].values(), *(point[name] for name in ("accuracy", "least", "most", "ece"))]
        yield f"{point['n']:>4}" + "".join(f"{value:>8.3f}" for value in values) + f"{point['examples']:>10.0f}"


def _drawn_evenly(test: Recordings, rng: np.random.Generator) -> Recordings:
    """At most MOST_JUDGED, about equally many per movement: movements differ more than people do."""
    count: Counter[str] = Counter()
    order: list[tuple[int, int]] = []
    for k in rng.permutation(len(test)).tolist():
        count[test[k].label] += 1
        order.append((count[test[k].label], k))
    return tuple(test[k] for k in sorted(k for _, k in sorted(order)[:MOST_JUDGED]))


def _evaluated(train: MotionArchive, test: Recordings, settings: EvaluationSettings) -> EvaluationResult:
    archive = MotionArchive(train.body_parts, train.recordings + test)
    learned = tuple(dict.fromkeys(r.subject for r in train.recordings))
    judged = tuple(dict.fromkeys(r.subject for r in test))
    return evaluate(archive, replace(settings, train_subjects=learned, test_subjects=judged))


def _point(n: int, results: Sequence[EvaluationResult]) -> dict[str, Any]:
    truth = results[0].truth
    ends = [result.at_end() for result in results]
    fused = [accuracy(p, truth) for _, p in ends]
    names = [view.name for view in results[0].settings.views]
    return {
        "n": n,
        "draws": len(results),
        "examples": mean(result.n_train for result in results),
        "accuracy": mean(fused),
        "least": min(fused),
        "most": max(fused),
        "ece": mean(expected_calibration_error(p, truth) for _, p in ends),
        "per_view": {name: mean(accuracy(views[:, v], truth) for views, _ in ends) for v, name in enumerate(names)},
    }


def _by_people(split: Split, labels: Sequence[str], rng: np.random.Generator) -> Iterator[TrainingChoice]:
    """The first 1, 2, ... people, and random others; only groups that together show every movement."""
    people = list(dict.fromkeys(r.subject for r in split.train.recordings))
    shown = {s: {r.label for r in split.train.recordings if r.subject == s} for s in people}
    for n in range(1, len(people) + 1):
        groups = [g for g in itertools.combinations(people, n) if set().union(*(shown[s] for s in g)) >= set(labels)]
        first, others = groups[:1], groups[1:]
        drawn = [others[k] for k in sorted(rng.permutation(len(others))[: DRAWS - 1])]
        for group in [*first, *drawn]:
            yield TrainingChoice("people", n, tuple(r for r in split.train.recordings if r.subject in group))


def _by_recordings(split: Split, rng: np.random.Generator) -> Iterator[TrainingChoice]:
    """The first 1, 2, ... recordings of each person and movement, and random others."""
    recordings = split.train.recordings
    most = max(Counter((r.subject, r.label) for r in recordings).values())
    for n in range(1, most + 1):
        for draw in range(DRAWS if n < most else 1):
            order = rng.permutation(len(recordings)).tolist() if draw else range(len(recordings))
            count: Counter[tuple[str, str]] = Counter()
            chosen = set()
            for k in order:
                pair = (recordings[k].subject, recordings[k].label)
                count[pair] += 1
                if count[pair] <= n:
                    chosen.add(k)
            yield TrainingChoice("recordings", n, tuple(r for k, r in enumerate(recordings) if k in chosen))
