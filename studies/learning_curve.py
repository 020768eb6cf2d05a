"""How good the judges get with more people to learn from, and with more recordings of each: the same people are judged.

Seeded; every point is an evaluation of its own, through the observers and the rule.
"""

import itertools
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from statistics import mean
from typing import Any

import numpy as np

from common.errors import BadInput
from observer.motion.archive import MotionArchive, Recording
from studies.evaluate import Answer, Question, at_end, evaluate
from studies.metrics import accuracy, expected_calibration_error
from studies.trials import Split, splits, with_labels

DRAWS = 3
"""Choices of people, or of recordings, that a point is the mean of; of all there is one alone."""
MOST_JUDGED = 100
"""Recordings that each point is judged by, drawn evenly by movement: enough for a curve, quick enough to wait for."""

Progress = Callable[[str, int, int], None]
Recordings = tuple[Recording, ...]


def learning_curve(archive: MotionArchive, question: Question, progress: Progress = lambda *_: None) -> dict[str, Any]:
    """`people` and `recordings`: a list of points each, `n` with its mean accuracy and calibration error.

    Raises BadInput where people are left out in turn: there the training people are not the same in each part.
    """
    if question.leave_one_subject_out:
        raise BadInput("--learning-curve --leave-one-subject-out: leave out one of the two; name --train-subjects")
    whole = with_labels(archive, question.labels)
    split = next(splits(whole, question.train_subjects, question.test_subjects, leave_one_out=False))
    rng = np.random.default_rng(question.seed)
    test = _some(split.test, rng)
    plan = [("people", *point) for point in _by_people(split, question.labels, rng)]
    everybody = max(n for _, n, _ in plan)
    plan += [("recordings", *point) for point in _by_recordings(split, rng)]
    answers: dict[frozenset[int], Answer] = {}
    found: dict[str, dict[int, list[Answer]]] = {"people": {}, "recordings": {}}
    for done, (kind, n, choice) in enumerate(plan):
        # All people with all their recordings are on both curves.
        key = frozenset(map(id, choice))
        if key not in answers:
            answers[key] = _asked(MotionArchive(archive.body_parts, choice), test, question)
        found[kind].setdefault(n, []).append(answers[key])
        progress("learning curve", done + 1, len(plan))
    points = {kind: [_point(n, each) for n, each in sorted(by_n.items())] for kind, by_n in found.items()}
    return {**points, "n_people": everybody, "n_judged": len(test)}


def as_table(curve: dict[str, Any]) -> str:
    """The two tables that a person reads."""
    people = f"recordings of each of {curve['n_people']} people"
    titles = {"people": "people learned from, all their recordings", "recordings": people}
    return "\n\n".join("\n".join(_table(title, curve[kind])) for kind, title in titles.items())


def _table(title: str, points: Sequence[dict[str, Any]]) -> Iterator[str]:
    names = [*points[0]["per_view"], "fused"]
    yield f"right at the end, by {title}; mean of up to {DRAWS} choices, least and most of them fused:"
    yield f"{'':>4}" + "".join(f"{name:>8}" for name in names) + f"{'least':>8}{'most':>8}{'ece':>8}{'examples':>10}"
    for point in points:
        values = [*point["per_view"].values(), *(point[name] for name in ("accuracy", "least", "most", "ece"))]
        yield f"{point['n']:>4}" + "".join(f"{value:>8.3f}" for value in values) + f"{point['examples']:>10.0f}"


def _some(test: Recordings, rng: np.random.Generator) -> Recordings:
    """At most MOST_JUDGED, of each movement about as many: movements differ more than people do."""
    turn: Counter[str] = Counter()
    turns: list[tuple[int, int]] = []
    for k in rng.permutation(len(test)).tolist():
        turn[test[k].label] += 1
        turns.append((turn[test[k].label], k))
    return tuple(test[k] for k in sorted(k for _, k in sorted(turns)[:MOST_JUDGED]))


def _asked(train: MotionArchive, test: Recordings, question: Question) -> Answer:
    archive = MotionArchive(train.body_parts, train.recordings + test)
    learned = tuple(dict.fromkeys(r.subject for r in train.recordings))
    judged = tuple(dict.fromkeys(r.subject for r in test))
    return evaluate(archive, replace(question, train_subjects=learned, test_subjects=judged))


def _point(n: int, answers: Sequence[Answer]) -> dict[str, Any]:
    truth = np.array([judged.truth for judged in answers[0].judged])
    ends = [at_end(answer.judged) for answer in answers]
    fused = [accuracy(p, truth) for _, p in ends]
    names = [view.name for view in answers[0].question.views]
    return {
        "n": n,
        "draws": len(answers),
        "examples": mean(answer.n_train for answer in answers),
        "accuracy": mean(fused),
        "least": min(fused),
        "most": max(fused),
        "ece": mean(expected_calibration_error(p, truth) for _, p in ends),
        "per_view": {name: mean(accuracy(views[:, v], truth) for views, _ in ends) for v, name in enumerate(names)},
    }


def _by_people(split: Split, labels: Sequence[str], rng: np.random.Generator) -> Iterator[tuple[int, Recordings]]:
    """The first 1, 2, ... people, and others; only who together show every movement."""
    people = list(dict.fromkeys(r.subject for r in split.train.recordings))
    shown = {s: {r.label for r in split.train.recordings if r.subject == s} for s in people}
    for n in range(1, len(people) + 1):
        groups = [g for g in itertools.combinations(people, n) if set().union(*(shown[s] for s in g)) >= set(labels)]
        first, others = groups[:1], groups[1:]
        drawn = [others[k] for k in sorted(rng.permutation(len(others))[: DRAWS - 1])]
        for group in [*first, *drawn]:
            yield n, tuple(r for r in split.train.recordings if r.subject in group)


def _by_recordings(split: Split, rng: np.random.Generator) -> Iterator[tuple[int, Recordings]]:
    """Of each person the first 1, 2, ... recordings of each movement, and others."""
    given = split.train.recordings
    most = max(Counter((r.subject, r.label) for r in given).values())
    for n in range(1, most + 1):
        for draw in range(DRAWS if n < most else 1):
            order = rng.permutation(len(given)).tolist() if draw else range(len(given))
            taken: Counter[tuple[str, str]] = Counter()
            chosen = set()
            for k in order:
                who = (given[k].subject, given[k].label)
                taken[who] += 1
                if taken[who] <= n:
                    chosen.add(k)
            yield n, tuple(r for k, r in enumerate(given) if k in chosen)
