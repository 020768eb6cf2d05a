"""Scores of UI-PRMD: correct repetitions against incorrect ones, by the correct ones of other people; and remarks."""

import sys
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from benchmarks.command_line import markdown_table, recordings_folder, run_command
from common.progress import ProgressBar
from fusion.score_pool import JudgedScore, pooled_score
from observer.geometry.views import parse_view
from observer.motion.archive import Recording
from observer.motion.archive_file import read_archive
from observer.score.limbs import JOINTS, joints_of
from observer.score.references import JudgeScore, ReferenceTakes
from observer.tracks import Floats
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
"""Takes of each person and exercise in which joints are bent, each joint once."""


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


def scores(exercises: int = 10, first: int = 0, remarks: bool = True) -> None:
    """Print how well scores tell correct from incorrect repetitions, and how often remarks name the bent limb.

    LABANMESH_DATA names the folder of recordings. remarks: try them too, which takes as long again.

    Example: python -m benchmarks.scores --exercises 2 --no-remarks
    """
    archive = read_archive(recordings_folder() / "ui_prmd" / "repetitions.npz")
    parts, labels = archive.body_parts, sorted({each.label for each in archive.recordings})[first : first + exercises]
    judged, remarked = list[_Judged](), dict[str, list[tuple[bool, bool]]]()
    with ProgressBar() as bar:
        for n, label in enumerate(labels):
            bar("exercises", n, len(labels))
            own = [each for each in archive.recordings if each.label == label and len(each.positions) >= 10]
            sides = {
                view: [(shown_takes(parse_view(view), each, parts), each.subject) for each in own if _is_correct(each)]
                for view in VIEWS
            }
            for person in sorted({each.subject for each in own}):
                known = {
                    view: learned_references([each for each in sides[view] if each[1] != person], parts)
                    for view in VIEWS
                }
                performed = [each for each in own if each.subject == person]
                judged += [_Judged(label, _is_correct(each), _scores(known, each, parts)) for each in performed]
                if not remarks:
                    continue
                _remark("of others", known, [e for e in performed if _is_correct(e)][:1], parts, remarked)
                _remark_by_own(performed, parts, remarked)
    print(
        "\n".join([*_by_exercise(judged, labels), "", *_together(judged), "", *(_remarks(remarked) if remarks else ())])
    )


def _is_correct(recording: Recording) -> bool:
    return not recording.trial.endswith("_inc")


def _scores(known: Mapping[str, ReferenceTakes], recording: Recording, parts: tuple[str, ...]) -> dict[str, JudgeScore]:
    performed = {view: SeenPerformance.of(parse_view(view), recording, parts) for view in known}
    return {view: known[view].judge(each.trace, each.seen) for view, each in performed.items()}


def _remark_by_own(
    performed: Sequence[Recording], parts: tuple[str, ...], remarked: dict[str, list[tuple[bool, bool]]]
) -> None:
    """The person's own takes are the references: what somebody who trains with a teacher, or alone, does."""
    own = [each for each in performed if _is_correct(each)]
    known = {view: references_of(parse_view(view), own[PER_PERSON:], parts) for view in VIEWS}
    _remark("of the same person", known, own[:PER_PERSON], parts, remarked)


def _remark(
    name: str,
    known: Mapping[str, ReferenceTakes],
    takes: Sequence[Recording],
    parts: tuple[str, ...],
    remarked: dict[str, list[tuple[bool, bool]]],
) -> None:
    """Note whether unchanged takes have no remark, and whether the first remark names the limb of a bent joint."""
    for take in takes[:PER_PERSON]:
        is_remarked = bool(agreed_remarks(_scores(known, take, parts)))
        remarked.setdefault(f"{name}, unchanged", []).append((not is_remarked, is_remarked))
        for joint in joints_of(parts):
            remarks = agreed_remarks(_scores(known, bent(take, joint.name, parts), parts))
            right = bool(remarks) and remarks[0].limb == joint.limb
            remarked.setdefault(f"{name}, {joint.name.split()[1]}", []).append((right, bool(remarks)))


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
