"""The performer of a rehearsal: it acts when asked, and lives or stands in between; and the scene of its cameras."""

import numpy as np
import pytest

from common.config import read_scene
from common.errors import BadInput
from observer.runtime.scene_inputs import open_inputs
from studies.performer import cameras
from studies.performer.live import LivePerformer
from studies.performer.repertoire import SCORES

RATE_HZ = 15
RIGHT_HAND = 1


def filmed(performer, begin_s, end_s):
    return np.array([performer.positions(n / RATE_HZ) for n in range(round(begin_s * RATE_HZ), round(end_s * RATE_HZ))])


def way(positions):
    """How far the right hand goes from where it was first, metres."""
    return np.linalg.norm(positions[:, RIGHT_HAND] - positions[0, RIGHT_HAND], axis=1)


def test_it_acts_each_request_once_and_differently_and_stands_in_between():
    performer = LivePerformer("1", seed=3)
    assert way(filmed(performer, 0, 5)).max() < 0.05
    performer.act(SCORES["byebye"], 5.0)
    first = filmed(performer, 5, 10)
    assert way(first[:3]).max() < 0.05, "nobody begins with the signal"
    assert way(first).max() > 0.4 and way(first)[-RATE_HZ:].max() < 0.15
    performer.act(SCORES["byebye"], 10.0)
    again = filmed(performer, 10, 15)
    assert way(again).max() > 0.4 and abs(again - first).max() > 0.02
    assert way(filmed(performer, 15, 20)).max() < 0.05


def test_a_request_within_a_movement_waits_for_its_end_and_nothing_jumps():
    performer = LivePerformer("1", seed=4)
    performer.act(SCORES["point"], 0.0)
    before = filmed(performer, 0, 1)
    performer.act(SCORES["stretch"], 1.0)
    after = filmed(performer, 1, 8)
    everything = np.concatenate([before, after])
    assert np.linalg.norm(np.diff(everything, axis=0), axis=2).max() * RATE_HZ < 6.0, "metres a second"
    assert (everything[:, RIGHT_HAND, 1] > everything[:, 2, 1]).any(), "the hand is above the head at last"


def test_ordinary_life_goes_on_until_it_is_ended():
    performer = LivePerformer("1", seed=5)
    performer.live(0.0)
    life = filmed(performer, 0, 30)
    moved = np.linalg.norm(life - life[0], axis=2).max(axis=1) > 0.1
    assert 0.3 < moved.mean() < 0.95
    performer.rest()
    filmed(performer, 30, 35)
    assert np.linalg.norm(np.diff(filmed(performer, 35, 40), axis=0), axis=2).max() < 0.01


def test_its_scene_runs_without_the_lesson_too(tmp_path):
    shown = cameras.performance(["byebye", "point"])
    scene = read_scene(cameras.write_scene(tmp_path / "there", shown), {})
    assert scene.roster == ("door", "shelf") and scene.vocabulary is None
    assert all(open_inputs(scene, name, None).pictures for name in scene.roster)


@pytest.mark.parametrize(
    ("labels", "line"),
    [(["byebye", "juggle"], r"juggle: the performer of a rehearsal cannot act it; known: lunging, maestro, .*nthrow"),
     (["point", "point"], "occurs twice"), (["point"], "at least two")],
)  # fmt: skip
def test_what_it_cannot_act_is_one_line(labels, line):
    with pytest.raises(BadInput, match=line):
        cameras.require_known(labels)
