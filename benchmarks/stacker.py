"""`python -m benchmarks.stacker`: learns the prior of the default model's stacker over many small and large tasks.

A task is what somebody may teach: some movements, people, takes and body parts of a set of recordings. Its members are
learned from these takes, and watch other takes, other people, and other movements. The prior is that of an empirical
Bayes estimate over all tasks (Morris, "Parametric empirical Bayes inference", JASA 78, 1983): its means are linear in
the task (`observer.model.stacker.TASK`), its spreads are those of the tasks around them.
"""

import os
import sys
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Annotated

import numpy as np
import typer
from numpy.typing import NDArray

from benchmarks.command_line import run_command
from common.errors import BadInput
from common.parallel import cores, run_parts
from common.probability import softmax
from common.progress import ProgressBar
from common.vocabulary import Vocabulary
from observer.geometry.views import parse_view
from observer.learning.examples import ExampleView
from observer.learning.learn import learn_view
from observer.model.held_out import STRANGE_SHARE, rows_of_fold, stacker_rows
from observer.model.stacked import Stacked
from observer.model.stacker import (
    CONTEXT,
    EVIDENCE,
    MEMBERS,
    OTHER_CONTEXT,
    TASK,
    ElseLoss,
    Gaussians,
    LabelLoss,
    Stacker,
    StackerPrior,
    StackerRows,
    most_probable,
    task_of,
)
from observer.motion.archive import (
    MotionArchive,
    Recording,
    common_rate,
    labels_of,
    movements_in,
    resample,
    streams_in,
    subjects_in,
)
from observer.motion.archive_file import read_archive
from observer.motion.importers import import_recordings
from observer.tracks import BODY_PARTS, Floats
from studies.sensors import with_parts

MSR_TRAINING = ("1", "3", "5", "7", "9")
MOST_JUDGED, STREAM_S = 48, 30.0
"""Takes of the movements, and seconds of continuous recordings, that each task judges."""
MOST_ROWS = 500
"""Instants of each task: more of one task say little about others."""
MOVEMENTS, PEOPLE, TAKES = (2, 3, 4, 6, 8, 12, 20, 58), (1, 2, 3, 5, 9), (1, 2, 3, 5, 10)
"""Sizes of tasks, up to what a set has."""


@dataclass(frozen=True, slots=True)
class Task:
    """Some takes of a set. takes: recordings to learn from, of each movement and person; continuous: all that a person
    does in a continuous recording; stories: beside one person's storytelling as other motion."""

    name: str
    view: str
    labels: tuple[str, ...]
    people: tuple[str, ...]
    takes: int
    parts: tuple[str, ...]
    seed: int
    continuous: bool = False
    stories: bool = False


def sets_in(folder: Path) -> dict[str, tuple[MotionArchive, tuple[str, ...]]]:
    """The training people of each set, and the views from which it is judged."""
    msr = import_recordings("msr-action3d", folder / "msr_action3d/MSRAction3DSkeletonReal3D").archive
    msr = replace(msr, recordings=tuple(r for r in msr.recordings if r.subject in MSR_TRAINING))
    florence = import_recordings("florence3d", folder / "florence3d").archive
    sets = {"msr": (msr, ("door", "wheel", "yaw:45")), "florence": (florence, ("door", "wheel"))}
    for n in (1, 2, 3):
        sets[f"nw_ucla {n}"] = (read_archive(folder / f"nw_ucla/sensor{n}.npz"), ("door",))
    sets["karate"] = (read_archive(folder / "karate/karate.npz"), ("door", "wheel"))
    sets["kinder_gator"] = (read_archive(folder / "kinder_gator/adults.npz"), ("door", "wheel"))
    return sets


def draw_tasks(sets: dict[str, tuple[MotionArchive, tuple[str, ...]]], count: int) -> list[Task]:
    """As many tasks of each set, of all sizes."""
    tasks = []
    for number in range(count):
        rng = np.random.default_rng([1, number])
        name = list(sets)[number % len(sets)]
        archive, views = sets[name]
        labels, people = labels_of(archive), subjects_in(archive.recordings)
        size = min(int(rng.choice(MOVEMENTS)), len(labels))
        crowd = min(int(rng.choice(PEOPLE)), len(people) - 1)
        takes = int(rng.choice(TAKES))
        # A task larger than this takes as long as ten others.
        while size * crowd * takes > 400:
            takes = max(takes // 2, 1)
            size = size if takes > 1 else max(size // 2, 2)
        parts = (BODY_PARTS, archive.body_parts)[int(rng.random() < 0.6)]
        view = str(rng.choice(list(views)))
        shown = tuple(sorted(rng.choice(labels, size, replace=False).tolist()))
        performers = tuple(sorted(rng.choice(people, crowd, replace=False).tolist()))
        continuous = name == "karate" and rng.random() < 0.7
        stories = parts == BODY_PARTS and rng.random() < 0.5
        tasks.append(Task(name, view, shown, performers, takes, parts, number, continuous, stories))
    return tasks


def rows_of_task(part: tuple[Task, MotionArchive, MotionArchive]) -> tuple[Floats, StackerRows | None]:
    """What members of the task say, and the task as the prior takes it; with the archive of a task and other motion."""
    task, archive, other = part
    learned, rest = _divided(task, archive)
    if task.continuous:
        learned = [r for r in archive.recordings if r.subject in task.people]
        rest = [r for r in rest if r.subject not in task.people]
    own = with_parts(replace(archive, recordings=tuple(learned)), task.parts)
    if set(task.labels) - {r.label for r in movements_in(own)}:
        return np.zeros(len(TASK)), None
    vocabulary, view = Vocabulary(task.labels, "task"), parse_view(task.view)
    stories = [resample(r, common_rate(archive)) for r in other.recordings] if task.parts == BODY_PARTS else []
    learned_stories = [r for r in stories if task.stories and r.subject == stories[0].subject]
    model = learn_view(own, view, vocabulary, body_parts=task.parts, streams=learned_stories, calibrate=False)
    if not isinstance(model, Stacked):
        raise TypeError(f"the default model is {type(model)}; only Stacked has a stacker")
    rng = np.random.default_rng([2, task.seed])
    known = [r for r in rest if r.label in task.labels]
    strange = [r for r in rest if r.label not in task.labels]
    chosen = [known[n] for n in rng.permutation(len(known))[:MOST_JUDGED]]
    chosen += [strange[n] for n in rng.permutation(len(strange))[: round(STRANGE_SHARE * MOST_JUDGED)]]
    seen = ExampleView(view, vocabulary, task.parts)
    background = tuple(sorted({r.label for r in chosen} - set(task.labels)))
    examples = seen.examples(chosen, archive.body_parts, background)
    examples = [Stacked.read(model.header, e) for e in examples]
    others = replace(archive, recordings=tuple(r for r in archive.recordings if r.subject not in task.people))
    streams = seen.streams([*streams_in(others, task.labels, unlabelled=True)], archive.body_parts)
    judged = [r for r in stories if r.subject not in {one.subject for one in learned_stories}]
    streams += seen.streams(judged[task.seed % max(len(judged), 1) :], BODY_PARTS)
    numbers = list(range(len(examples)))
    watched = rows_of_fold(model, examples, numbers, streams, STREAM_S)
    takes = len([r for r in movements_in(own) if r.label in task.labels]) / len(task.labels)
    other_s = float(model.header.provenance.get("other_motion_s", "0"))
    rows = thinned(stacker_rows(watched, struck=False), rng)
    return task_of(takes, len(task.people), len(task.labels), other_s), rows


def thinned(rows: StackerRows | None, rng: np.random.Generator) -> StackerRows | None:
    """At most MOST_ROWS of the rows, which weigh as much as all."""
    if rows is None or len(rows.truth) <= MOST_ROWS:
        return rows
    chosen = rng.permutation(len(rows.truth))[:MOST_ROWS]
    weights = rows.weights[chosen] * (rows.weights.sum() / rows.weights[chosen].sum())
    instants, truth, shown = rows.instants.at(chosen), rows.truth[chosen], rows.shown[chosen]
    return StackerRows(instants, truth, shown, weights, rows.teaches_label[chosen])


def _divided(task: Task, archive: MotionArchive) -> tuple[list[Recording], list[Recording]]:
    """The recordings that are learned, and movements of the others. Of continuous ones those of the people."""
    rng = np.random.default_rng([3, task.seed])
    learned: list[Recording] = []
    rest: list[Recording] = []
    movements = [r for r in movements_in(archive) if r.label]
    for label in sorted({r.label for r in movements}):
        for person in subjects_in(archive.recordings):
            own = [r for r in movements if r.label == label and r.subject == person]
            order = rng.permutation(len(own))
            taken = task.takes if label in task.labels and person in task.people else 0
            learned += [own[n] for n in order[:taken]]
            rest += [own[n] for n in order[taken:]]
    return learned, rest


def learn_prior(tasks: Sequence[tuple[Floats, StackerRows]], sets: Sequence[str]) -> StackerPrior:
    """Means and spreads of the weights over the tasks (task (Z,), rows); sets: the name of each task's recordings."""
    z = np.array([task for task, _ in tasks])
    of_labels: list[LabelLoss | ElseLoss] = []
    for _, rows in tasks:
        known = rows.teaches_label
        of_labels.append(LabelLoss(rows.instants.at(known), rows.truth[known], rows.weights[known]))
    start = np.zeros((len(MEMBERS), len(CONTEXT)))
    start[: len(MEMBERS) - 1, 0] = 1 / (len(MEMBERS) - 1)
    weights = gaussians_over(z, of_labels, np.array(sets), start)
    of_else: list[LabelLoss | ElseLoss] = []
    for task, rows in tasks:
        p, _ = Stacker(weights.at(task), np.zeros((len(EVIDENCE), len(OTHER_CONTEXT)))).judge(rows.instants)
        target = np.where(rows.truth >= 0, 1.0 - rows.shown, 1.0)
        of_else.append(ElseLoss(rows.instants, p, target, rows.weights))
    start = np.zeros((len(EVIDENCE), len(OTHER_CONTEXT)))
    return StackerPrior(weights, gaussians_over(z, of_else, np.array(sets), start))


def gaussians_over(
    tasks: Floats, losses: Sequence[LabelLoss | ElseLoss], sets: NDArray[np.str_], start: Floats
) -> Gaussians:
    """Means linear in the tasks (T, Z), and spreads, by expectation and maximisation.

    A user's recordings are another set: a task's deviation is that from the means of all other sets.
    """
    own, spreads = np.tile(start.ravel(), (len(tasks), 1)), np.full(start.size, START_SPREAD)
    for _ in range(ROUNDS):
        means = {name: _means(tasks[sets != name], own[sets != name], spreads) for name in np.unique(sets)}
        variances = np.zeros(start.size)
        for n, loss in enumerate(losses):
            mean = tasks[n] @ means[sets[n]]
            own[n] = most_probable(loss, mean.reshape(start.shape), spreads.reshape(start.shape)).ravel()
            # Laplace's approximation of what the task leaves uncertain.
            uncertain = np.linalg.inv(curvature(loss, own[n]) + np.diag(1 / spreads**2)).diagonal()
            variances += (own[n] - mean) ** 2 + uncertain
        spreads = np.sqrt(variances / len(tasks))
    return Gaussians(_means(tasks, own, spreads).reshape(-1, *start.shape), spreads.reshape(start.shape))


def curvature(loss: LabelLoss | ElseLoss, weights: Floats) -> Floats:
    """(A, A) the loss's second derivative at the weights (A,)."""
    if isinstance(loss, ElseLoss):
        p = 1 / (1 + np.exp(-np.clip(loss.x @ weights, -30, 30)))
        of_else: Floats = (loss.x.T * (loss.weights * p * (1 - p))) @ loss.x
        return of_else
    p = softmax(np.einsum("a,nam->nm", weights, loss.x, optimize=True)) * loss.weights[:, None]
    mean = np.einsum("nm,nam->na", p, loss.x)
    weighted = (loss.x * p[:, None, :]).transpose(1, 0, 2).reshape(len(weights), -1)
    square = weighted @ loss.x.transpose(0, 2, 1).reshape(-1, len(weights))
    result: Floats = square - (mean.T / loss.weights) @ mean
    return result


def _means(tasks: Floats, own: Floats, spreads: Floats) -> Floats:
    """(Z, A) means from the weights (T, A) that the tasks (T, Z) have: a ridge regression for each weight (A,)."""
    squares, products, ridge = tasks.T @ tasks, tasks.T @ own, RIDGE * np.eye(tasks.shape[1])
    return np.stack(
        [np.linalg.solve(squares + ridge * s**2, product) for s, product in zip(spreads, products.T, strict=True)],
        axis=1,
    )


RIDGE = 1.0
"""Nats for a mean that is sqrt(2) away from 0: what no task shows stays without weight."""
START_SPREAD, ROUNDS = 1.0, 6
"""Wider than any spread is in the end: a weight that no task shows stays free. Later rounds narrow the others by less
than a sixth each, down to what the few sets hardly show."""


def table_of(prior: StackerPrior) -> str:
    """The source text of `observer/model/stacker_prior_table.py`."""
    blocks = []
    for name in ("weights", "other"):
        gaussians: Gaussians = getattr(prior, name)
        for what, values in (("means", gaussians.means), ("spreads", gaussians.spreads)):
            rows = "\n".join(" ".join(f"{v:.3g}" for v in row) for row in values.reshape(-1, values.shape[-1]))
            blocks.append(f'{name.upper()}_{what.upper()} = """\n{rows}\n"""')
    return TABLE_HEAD + "\n".join(blocks) + "\n"


TABLE_HEAD = '"""Numbers of `stacker_prior.py`, written by `python -m benchmarks.stacker`. Do not edit."""\n\n'
TABLE = Path("observer/model/stacker_prior_table.py")


def learn(
    data: Annotated[Path | None, typer.Option(help="The folder of recordings; default: LABANMESH_DATA.")] = None,
    tasks: Annotated[int, typer.Option(min=10, help="How many tasks.")] = 105,
    output: Annotated[Path, typer.Option("-o", "--output", help="The table to write.")] = TABLE,
    jobs: Annotated[int, typer.Option(min=0, help="Processes; 0: one for each processor core.")] = 0,
) -> None:
    """Learn the prior of the stacker's weights over many tasks, and write its table.

    Example: python -m benchmarks.stacker --data recordings
    """
    folder = data or Path(os.environ.get("LABANMESH_DATA") or "recordings")
    if not folder.is_dir():
        raise BadInput(f"{folder}: no such folder of recordings; name it with --data, or set LABANMESH_DATA")
    with ProgressBar("reading the recordings"):
        sets, stories = sets_in(folder), read_archive(folder / "storytelling/storytelling.npz")
    parts = [(task, sets[task.name][0], stories) for task in draw_tasks(sets, tasks)]
    with ProgressBar() as bar:
        rows = run_parts(rows_of_task, parts, jobs or cores(), lambda n, total: bar("tasks", n, total))
    with ProgressBar("the prior"):
        # Sensors of one set show the same performances.
        known = [(part[0].name.split()[0], task, own) for part, (task, own) in zip(parts, rows, strict=True) if own]
        prior = learn_prior([(task, own) for _, task, own in known], [name for name, _, _ in known])
    output.write_text(table_of(prior), encoding="utf-8")
    print(f"{output}: learned over {len(known)} tasks")


if __name__ == "__main__":
    sys.exit(run_command(learn, "stacker"))
