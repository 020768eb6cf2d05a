"""The benchmark of scores changes what it says: a joint by so many degrees, and nothing else."""

import numpy as np
import pytest

from benchmarks.scores import SharedAlignments, bent
from observer.geometry.views import parse_view
from observer.motion.archive_file import read_archive
from observer.score.comparison import joints_of, places_of
from studies.performer import perform
from studies.scoring.judging import learned_references, shown_takes


@pytest.mark.parametrize("joint", ["left knee", "right elbow", "left shoulder", "right hip"])
def test_a_bent_joint_is_twenty_degrees_more_bent(data, joint):
    archive = read_archive(data / "ui_prmd" / "repetitions.npz")
    take = archive.recordings[0]
    changed = bent(take, joint, archive.body_parts)
    first, middle, last = next(each.parts for each in joints_of(archive.body_parts) if each.name == joint)

    def angle(positions):
        one, other = positions[:, first] - positions[:, middle], positions[:, last] - positions[:, middle]
        cosine = (one * other).sum(axis=1) / np.linalg.norm(one, axis=1) / np.linalg.norm(other, axis=1)
        return np.degrees(np.arccos(np.clip(cosine, -1, 1)))

    before, after = angle(take.positions.astype(float)), angle(changed.positions.astype(float))
    assert before - after == pytest.approx(np.full(len(before), 20.0), abs=0.1)
    moved = np.abs(changed.positions - take.positions).max(axis=(0, 2)) > 1e-6
    assert 1 <= moved.sum() <= 2 and not moved[middle]


def test_takes_that_are_aligned_once_are_scored_as_if_each_selection_was_aligned_anew():
    archive = perform(people=("1", "2", "3", "4"), movements=("stretch",), trials=2)
    parts, view = archive.body_parts, parse_view("door")
    shown = [(shown_takes(view, each, parts), each.subject) for each in archive.recordings]
    align = SharedAlignments([places_of(each.trace) for own, _ in shown for each in own])
    for person in ("1", "4"):
        others = [each for each in shown if each[1] != person]
        anew, shared = learned_references(others, parts), learned_references(others, parts, align)
        for own, other in zip(anew.spread, shared.spread, strict=True):
            assert other == pytest.approx(own)
        for take, _ in shown[:3]:
            assert shared.judge(take[0].trace).score == pytest.approx(anew.judge(take[0].trace).score)
