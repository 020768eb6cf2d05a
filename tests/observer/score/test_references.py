"""Scores against reference takes: what is typical, what is worse, what is remarked, and what is not scored."""

import numpy as np
import pytest

from common.errors import BadInput
from observer.score.references import ReferenceTake, ReferenceTakes

SIDES = ("shoulder", "elbow", "hand", "hip", "knee", "foot")
PARTS = ("head", "neck", "pelvis", *(f"{side}_{part}" for side in ("left", "right") for part in SIDES))
RATE_HZ = 15.0


def bow(depth=1.0, seed=0, bend=0.0, frames=30):
    """(F, 2 P + 3) trace of arms that rise and sink; bend: degrees by which the left elbow is more bent than it is."""
    rng = np.random.default_rng(seed)
    t = np.linspace(0, 1, frames)
    lift = depth * (1.0 + 0.05 * rng.normal()) * np.sin(np.pi * t) ** 2
    places = np.zeros((frames, len(PARTS), 2))
    for n, part in enumerate(PARTS):
        side = -1.0 if part.startswith("left") else 1.0
        name = part.split("_")[-1]
        places[:, n] = {
            "head": (0, 0.3), "neck": (0, 0), "pelvis": (0, -1), "shoulder": (0.25 * side, 0),
            "hip": (0.15 * side, -1), "knee": (0.15 * side, -1.4), "foot": (0.15 * side, -1.8),
            "elbow": (0.25 * side, 0), "hand": (0.25 * side, 0),
        }[name]  # fmt: skip
        if name in ("elbow", "hand"):
            upper = -np.pi / 2 + lift
            places[:, n] += 0.4 * np.stack([side * np.cos(upper), np.sin(upper)], axis=1)
        if name == "hand":
            lower = upper + 0.5 + np.radians(bend if side < 0 else 0.0)
            places[:, n] += 0.4 * np.stack([side * np.cos(lower), np.sin(lower)], axis=1)
    places += rng.normal(0, 0.004, places.shape)
    trace = np.zeros((frames, 2 * len(PARTS) + 3), np.float32)
    trace[:, :-3], trace[:, -1] = places.reshape(frames, -1), 1.0
    return trace


@pytest.fixture(scope="module")
def references():
    takes = [ReferenceTake(bow(seed=seed, frames=28 + seed % 4), str(seed % 3)) for seed in range(9)]
    return ReferenceTakes(takes, PARTS, RATE_HZ)


def test_what_is_typical_has_ten_and_less_the_worse_it_is(references):
    scores = [references.judge(bow(depth, seed=99)).score for depth in (1.0, 0.8, 0.6, 0.3)]
    assert scores[0] > 8 and scores == sorted(scores, reverse=True) and scores[-1] < 2


def test_the_tempo_counts_little_and_a_pause_is_seen(references):
    assert references.judge(bow(seed=99, frames=40)).score < references.judge(bow(seed=99)).score


def test_the_first_remark_names_the_joint_its_direction_and_how_much(references):
    judged = references.judge(bow(seed=99, bend=25))
    assert judged.remarks[0].joint == "left elbow" and judged.remarks[0].limb == "left arm"
    assert judged.remarks[0].degrees == pytest.approx(-25, abs=8) and "degrees too bent at" in judged.remarks[0].words


@pytest.mark.parametrize("seed", range(50, 60))
def test_unchanged_takes_have_no_remark(references, seed):
    assert not references.judge(bow(seed=seed)).remarks


def test_what_is_hardly_seen_is_not_scored(references):
    seen = [not part.startswith("left") for part in PARTS]
    judged = references.judge(bow(), seen)
    assert judged.score is None and judged.uncertain == "too little is seen: not the left arm, left leg"
    almost = [part != "left_foot" for part in PARTS]
    assert references.judge(bow(), almost).certainty == pytest.approx(0.8)


def test_another_movement_is_not_scored(references):
    other = bow()
    other[:, : len(PARTS)] += np.linspace(0, 3, len(other))[:, None]
    judged = references.judge(other)
    assert judged.score is None and "another movement" in judged.uncertain


@pytest.mark.parametrize("count", [0, 1, 2])
def test_too_few_references_are_refused_in_one_line(count):
    with pytest.raises(BadInput, match="a score needs at least 3"):
        ReferenceTakes([ReferenceTake(bow(seed=n), "a") for n in range(count)], PARTS, RATE_HZ)


def test_takes_of_one_person_are_compared_with_each_other():
    own = ReferenceTakes([ReferenceTake(bow(seed=n), "a") for n in range(5)], PARTS, RATE_HZ)
    assert own.judge(bow(seed=9)).score > 6
