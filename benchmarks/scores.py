"""Scores of UI-PRMD: correct repetitions against incorrect ones, by the correct ones of other people; and remarks."""

import sys
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cache

import numpy as np

from benchmarks.command_line import markdown_table, recordings_folder, run_command
from common.parallel import cores, run_parts
from common.progress import ProgressBar
from fusion.score_pool import JudgedScore, pooled_score
from observer.geometry.views import parse_view
from observer.motion.archive import Recording
from observer.motion.archive_file import read_archive
from observer.score.comparison import JOINTS, Alignment, joints_of, places_of
from observer.score.references import JudgeScore, ReferenceTakes, Remark
from observer.tracks import Floats, Floats32, Integers
from studies.scoring.judging import (
    SeenPerformance,
    agreed_remarks,
    learned_references,
    references_of,
    shown_takes,
)

VIEWS = ("door", "wheel", "yaw:45", "yaw:315")
BENT_DEGREES = 20.0
LIES = (0.0, 10.0)
DISTAL = {"elbow": ("hand",), "knee": ("foot",), "shoulder": ("elbow", "hand"), "hip": ("knee", "foot")}
"""The parts that turn with a joint."""
PER_PERSON = 2
"""Takes of each person and exercise in which joints are bent, each joint once, by other takes of the same person."""


@dataclass(frozen=True, slots=True)
class _Judged:
    label: str
    is_correct: bool
    scores: Mapping[str, JudgeScore]

    def pooled(self, lie: float | None = None, liar: str = "") -> float:
        """The referee's score. lie: what the view `liar` says."""
        known = {
            name: JudgedScore(each.score, each.certainty)
            for name, each in self.scores.items()
            if each.score is not None
        }
        if lie is not None:
            known[liar] = JudgedScore(lie)
        return pooled_score(known) or 0.0

    def of(self, view: str) -> float:
        """What one view says."""
        return self.scores[view].score or 0.0


def scores(exercises: int = 10, first: int = 0, remarks: bool = True, jobs: int = 0) -> None:
    """Print how well scores tell correct from incorrect repetitions, and how often remarks name the bent limb.

    LABANMESH_DATA names the folder of recordings. remarks: try them too, which takes as long again. jobs: processes; 0:
    one for each processor core.

    Example: python -m benchmarks.scores --exercises 2 --no-remarks
    """
    archive = read_archive(recordings_folder() / "ui_prmd" / "repetitions.npz")
    labels = sorted({each.label for each in archive.recordings})[first : first + exercises]
    shown = {label: [e for e in archive.recordings if e.label == label and len(e.positions) >= 10] for label in labels}
    tries = {label: [*_tries(own, archive.body_parts)] if remarks else [] for label, own in shown.items()}
    parts = [_ExerciseView(view, shown[label], tries[label], archive.body_parts) for label in labels for view in VIEWS]
    with ProgressBar() as bar:
        results = run_parts(_judged_by, parts, jobs or cores(), lambda n, total: bar("exercises, by view", n, total))
    judged, remarked = list[_Judged](), dict[str, list[tuple[bool, bool]]]()
    for n, label in enumerate(labels):
        by_view = dict(zip(VIEWS, results[n * len(VIEWS) :], strict=False))
        for place, each in enumerate(shown[label]):
            judged.append(_Judged(label, _is_correct(each), {view: own[0][place] for view, own in by_view.items()}))
        for place, trial in enumerate(tries[label]):
            trial.note(agreed_remarks({view: own[1][place] for view, own in by_view.items()}), remarked)
    print(
        "\n".join([*_by_exercise(judged, labels), "", *_together(judged), "", *(_remarks(remarked) if remarks else ())])
    )


def _is_correct(recording: Recording) -> bool:
    return not recording.trial.endswith("_inc")


@dataclass(frozen=True, slots=True)
class _Try:
    """A correct take of which remarks are wanted. limb: of the joint that is bent in it; "": unchanged.

    name: of the row of the table. references: other takes of the person; empty: those of other people.
    """

    name: str
    limb: str
    take: Recording
    references: Sequence[Recording] = ()

    def note(self, remarks: Sequence[Remark], remarked: dict[str, list[tuple[bool, bool]]]) -> None:
        """Note whether it is right: no remark on an unchanged take, and the limb of a bent joint in the first one."""
        right = bool(remarks) and remarks[0].limb == self.limb if self.limb else not remarks
        remarked.setdefault(self.name, []).append((right, bool(remarks)))


def _tries(performed: Sequence[Recording], parts: tuple[str, ...]) -> Iterator[_Try]:
    """By the person's own takes, what somebody who trains with a teacher, or alone, does; and by those of others."""
    for person in sorted({each.subject for each in performed}):
        own = [each for each in performed if each.subject == person and _is_correct(each)]
        for name, takes, references in (
            ("of others", own[:1], ()),
            ("of the same person", own[:PER_PERSON], own[PER_PERSON:]),
        ):
            for take in takes:
                yield _Try(f"{name}, unchanged", "", take, references)
                for joint in joints_of(parts):
                    changed = bent(take, joint.name, parts)
                    yield _Try(f"{name}, {joint.name.split()[1]}", joint.limb, changed, references)


@dataclass(frozen=True, slots=True)
class _ExerciseView:
    """One exercise as one view sees it."""

    view: str
    shown: Sequence[Recording]
    tries: Sequence[_Try]
    body_parts: tuple[str, ...]


class AlignmentPart(Alignment):
    """An alignment beside some of its takes, (N,) their indices."""

    def __init__(self, alignment: Alignment, takes: Sequence[int]) -> None:
        self._alignment, self._takes = alignment, takes
        self.distances = alignment.distances[list(takes)]

    def path(self, take: int) -> Integers:
        """As that of the alignment."""
        return self._alignment.path(self._takes[take])


class SharedAlignments:
    """Aligns takes with each other once, whichever of them are left out afterwards."""

    def __init__(self, takes: Sequence[Floats32]) -> None:
        self._takes, self._place = takes, {take.tobytes(): n for n, take in enumerate(takes)}
        self._known: dict[int, Alignment] = {}

    def __call__(self, performance: Floats32, takes: Sequence[Floats32]) -> Alignment:
        own = self._place.get(performance.tobytes())
        if own is None:
            return Alignment(performance, takes)
        if own not in self._known:
            self._known[own] = Alignment(performance, self._takes)
        return AlignmentPart(self._known[own], [self._place[take.tobytes()] for take in takes])


def _judged_by(part: _ExerciseView) -> tuple[list[JudgeScore], list[JudgeScore]]:
    """What a view says of each performance, and of each try, by the takes of other people."""
    view, parts = parse_view(part.view), part.body_parts
    sides = [(shown_takes(view, each, parts), each.subject) for each in part.shown if _is_correct(each)]
    align = SharedAlignments([places_of(each.trace) for own, _ in sides for each in own])
    people = sorted({each.subject for each in part.shown})
    of_others = {who: learned_references([e for e in sides if e[1] != who], parts, align) for who in people}

    def judged(take: Recording, known: ReferenceTakes) -> JudgeScore:
        seen = SeenPerformance.of(view, take, parts)
        return replace(known.judge(seen.trace, seen.seen), band=None)

    @cache
    def own(person: str) -> ReferenceTakes:
        return references_of(
            view, next(e for e in part.tries if e.take.subject == person and e.references).references, parts
        )

    scored = [judged(each, of_others[each.subject]) for each in part.shown]
    tried = [judged(e.take, own(e.take.subject) if e.references else of_others[e.take.subject]) for e in part.tries]
    return scored, tried


def bent(recording: Recording, joint: str, body_parts: Sequence[str], degrees: float = BENT_DEGREES) -> Recording:
    """The recording in which a joint (`left knee`) is so many degrees more bent throughout; 3-D positions."""
    side, name = joint.split()
    first, middle, last = next(each.parts for each in joints_of(body_parts) if each.name == joint)
    positions = recording.positions.astype(np.float64)
    axes = np.cross(positions[:, last] - positions[:, middle], positions[:, first] - positions[:, middle])
    axes /= np.maximum(np.linalg.norm(axes, axis=1, keepdims=True), 1e-9)
    # The axis turns the last part toward the first; at shoulder and hip it is the first that turns.
    turn = degrees if JOINTS[name][2] in DISTAL[name] else -degrees
    changed = recording.positions.copy()
    for part in DISTAL[name]:
        n = list(body_parts).index(f"{side}_{part}")
        changed[:, n] = positions[:, middle] + _turned(positions[:, n] - positions[:, middle], axes, turn)
    return replace(recording, positions=changed)


def _turned(vectors: Floats, axes: Floats, degrees: float) -> Floats:
    """(F, 3) vectors turned about unit axes (F, 3): Rodrigues' formula."""
    cosine, sine = np.cos(np.radians(degrees)), np.sin(np.radians(degrees))
    along = (axes * vectors).sum(axis=1, keepdims=True)
    result: Floats = vectors * cosine + np.cross(axes, vectors) * sine + axes * along * (1 - cosine)
    return result


def _auc(correct: Sequence[float], incorrect: Sequence[float]) -> float:
    better = np.array(correct)[:, None] - np.array(incorrect)[None]
    return float((better > 0).mean() + (better == 0).mean() / 2)


def _areas(judged: Sequence[_Judged], view: str = "") -> float:
    value = [(each.pooled() if not view else each.of(view), each.is_correct) for each in judged]
    return _auc([score for score, good in value if good], [score for score, good in value if not good])


def _by_exercise(judged: Sequence[_Judged], labels: Sequence[str]) -> Iterator[str]:
    rows, areas = [], []
    for label in labels:
        own = [each for each in judged if each.label == label]
        of_views = [_areas(own, view) for view in VIEWS]
        areas.append([*of_views, _areas(own)])
        medians = [np.median([e.pooled() for e in own if e.is_correct == good]) for good in (True, False)]
        rows.append([label, *(f"{area:.2f}" for area in areas[-1]), *(f"{each:.1f}" for each in medians)])
    rows.append(["mean", *(f"{each:.3f}" for each in np.mean(areas, axis=0)), "", ""])
    yield markdown_table(("exercise", *VIEWS, "referee", "correct, median", "incorrect, median"), rows)


def _together(judged: Sequence[_Judged]) -> Iterator[str]:
    spread = [np.std([each.of(view) for view in VIEWS]) for each in judged]
    yield f"four views of a performance differ by {np.mean(spread):.2f} points (mean standard deviation)"
    moved = [abs(each.pooled(lie, liar) - each.pooled()) for each in judged for liar in VIEWS for lie in LIES]
    shares = f"{np.median(moved):.2f} (median), {np.mean(moved):.2f} (mean), {np.quantile(moved, 0.9):.2f} (9 of 10)"
    yield f"one liar among four, who says 0 or 10, moves the score by {shares}"


def _remarks(remarked: Mapping[str, Sequence[tuple[bool, bool]]]) -> Iterator[str]:
    rows = []
    for name, results in remarked.items():
        rows.append(
            [
                name,
                str(len(results)),
                f"{np.mean([right for right, _ in results]):.0%}",
                f"{np.mean([any_remark for _, any_remark in results]):.0%}",
            ]
        )
    for who in ("of others", "of the same person"):
        own = [
            each
            for name, results in remarked.items()
            if name.startswith(who) and "unchanged" not in name
            for each in results
        ]
        rows.append(
            [
                f"{who}, all joints",
                str(len(own)),
                f"{np.mean([right for right, _ in own]):.0%}",
                f"{np.mean([any_remark for _, any_remark in own]):.0%}",
            ]
        )
    yield markdown_table(("references", "takes", "right", "any remark"), rows)


if __name__ == "__main__":
    sys.exit(run_command(scores, "scores"))
