"""Effort in actions that the models have not learned: on generated motion, and on recorded people."""

import json
from dataclasses import replace

import numpy as np
import pytest

from common.errors import BadInput
from observer.geometry.views import parse_view
from observer.motion.archive import MotionArchive, Recording, select
from observer.motion.archive_file import write_archive
from observer.motion.importers import import_recordings
from observer.tracks import BODY_PARTS
from studies.effort import FUSED, as_json, as_text, effort, judge_poles

RATE = 30.0
VIEWS = (parse_view("door"), parse_view("wheel"))


def performed(action, levels, seed):
    """A hand that circles in another plane in each action, quicker when sudden; the head sinks when strong."""
    space, weight, time, flow = levels
    rng = np.random.default_rng(seed)
    t = np.arange(round(60 / 1.8**time)) / RATE * 1.8**time
    circle = {"stir": (0, 2), "wave": (0, 1), "saw": (2, 1)}[action]
    right = np.tile([0.3, 1.1, -0.3], (len(t), 1))
    right[:, circle[0]] += 0.3 * np.sin(4 * t)
    right[:, circle[1]] += 0.3 * np.cos(4 * t)
    left = np.stack([-0.3 + 0 * t, 0.8 + 0 * t, -0.1 - 0.2 * (1 - flow) * np.sin(3 * t)], axis=1)
    head = np.stack([0 * t, 1.7 - 0.03 * weight * t, 0.05 * (1 - space) * np.sin(5 * t)], axis=1)
    positions = np.stack([left, right, head], axis=1) + rng.normal(0, 0.002, (len(t), 3, 3))
    return Recording(positions.astype(np.float32), RATE, action, "1", "_".join(map(str, levels)))


@pytest.fixture(scope="module")
def archive():
    levels = [(w * t, w, t, f) for w in (-1, 1) for t in (-1, 1) for f in (-1, 0, 1)]
    return MotionArchive(
        BODY_PARTS, tuple(performed(a, x, n) for n, a in enumerate(("stir", "wave", "saw")) for x in levels)
    )


@pytest.fixture(scope="module")
def judged(archive):
    return judge_poles(archive, VIEWS)[1.0]


def test_each_view_and_the_fusion_recognise_the_poles(judged):
    figures = as_json({1.0: judged})
    for factor in ("weight", "time"):
        assert {name: by["accuracy"] for name, by in figures["factors"][factor].items()} == {
            name: pytest.approx(1, abs=0.1) for name in ("door", "wheel", FUSED)
        }
    # The door does not see what happens in depth.
    assert figures["factors"]["flow"]["wheel"]["accuracy"] > figures["factors"]["flow"]["door"]["accuracy"]
    assert figures["factors"]["flow"][FUSED]["n"] == 24 and figures["factors"]["time"][FUSED]["n"] == 36
    assert figures["factors"]["flow"][FUSED]["neutral_confidence"] >= 0.5
    assert figures["factors"]["time"][FUSED]["neutral_confidence"] is None


def test_one_action_is_not_enough_and_views_have_names_of_their_own(archive):
    one = MotionArchive(BODY_PARTS, tuple(r for r in archive.recordings if r.label == "wave"))
    with pytest.raises(BadInput, match="1 action only, 'wave'"):
        judge_poles(one, VIEWS)
    with pytest.raises(BadInput, match="its own name"):
        judge_poles(archive, (VIEWS[0], VIEWS[0]))
    unlabelled = MotionArchive(BODY_PARTS, tuple(replace(r, trial="1") for r in archive.recordings))
    with pytest.raises(BadInput, match="-1_0_1_1"):
        judge_poles(unlabelled, VIEWS)


def test_the_command_prints_the_table_and_writes_its_files(archive, tmp_path, capsys):
    write_archive(tmp_path / "e.npz", archive)
    effort(tmp_path / "e.npz", "door,wheel", report=tmp_path / "out", json=tmp_path / "e.json")
    printed = capsys.readouterr().out
    assert "weight: light, strong" in printed and "fused, after this share" in printed
    written = json.loads((tmp_path / "e.json").read_text())
    assert list(written["fused_at"]["time"]) == ["0.2", "0.4", "0.6", "0.8", "1"]
    assert {p.name for p in (tmp_path / "out").iterdir()} == {"effort.txt", "reliability.png"}
    assert (tmp_path / "out" / "reliability.png").read_bytes().startswith(b"\x89PNG")


@pytest.mark.slow
def test_effort_is_recognised_in_an_unlearned_action(data):
    recorded = select(import_recordings("bvh", data / "effort_bvh").archive, (), RATE)
    figures = as_json(judge_poles(recorded, VIEWS))
    print(as_text(figures))
    fused = {factor: by[FUSED] for factor, by in figures["factors"].items()}
    assert all(by["n"] == 72 for by in fused.values())
    assert fused["weight"]["accuracy"] >= 0.9 and fused["time"]["accuracy"] >= 0.9
    assert fused["space"]["accuracy"] >= 0.8 and fused["flow"]["accuracy"] >= 0.8
    # 72 judgements are too few for 15 bins, so mean confidence is compared with accuracy.
    assert all(abs(by["confidence"] - by["accuracy"]) <= 0.06 for by in fused.values())
