"""A movement that is farther from every learned take than these are from each other is something else."""

from dataclasses import replace

import numpy as np
import pytest

from common.vocabulary import Vocabulary
from observer.geometry.views import this_camera
from observer.learning.learn import learn_view
from observer.model.base import Example, Onset
from observer.model.model_file import read_model, write_model
from observer.model.nearest_take import MOST_TAKES, USUAL_DISTANCE, NearestTakes, NearestTakeWatch
from observer.motion.archive import MotionArchive, Recording, TracksCamera
from observer.tracks import Tracks

FRAMES = 24


def trace(direction, frames=FRAMES, noise=0.0, seed=0):
    """Two parts; the first goes one body size away in that direction and back; the body stands still."""
    way = np.sin(np.linspace(0, np.pi, frames))[:, None] * direction
    rows = np.concatenate([way, np.ones((frames, 2)), np.zeros((frames, 2)), np.ones((frames, 1))], axis=1)
    rows[:, :4] += np.random.default_rng(seed).normal(0, noise, (frames, 4))
    return rows


UP, ASIDE, DIAGONAL = (np.array(each) for each in ((0.0, 1.0), (1.0, 0.0), (0.7, -0.7)))


@pytest.fixture(scope="module")
def takes():
    examples = [
        Example((), movement, features=trace(direction, frames, 0.03, 10 * movement + frames))
        for movement, direction in enumerate((UP, ASIDE))
        for frames in (18, 24, 30)
    ]
    return NearestTakes.of(examples, 2)


def relative(takes, rows, movement):
    return NearestTakeWatch(takes, rows.astype(np.float32)).relative_distances[movement]


def test_another_take_is_near_whatever_its_tempo_and_another_movement_is_far(takes):
    assert (takes.scales > 0).all()
    for frames in (14, 24, 40):
        assert relative(takes, trace(UP, frames, 0.03, 99), 0) < 1.5
        assert relative(takes, trace(DIAGONAL, frames, 0.03, 98), 0) > 3
        assert relative(takes, trace(ASIDE, frames, 0.03, 97), 0) > 3


def test_a_movement_in_progress_is_near_too(takes):
    assert relative(takes, trace(UP, FRAMES, 0.03, 99)[:15], 0) < 1.5
    early = NearestTakeWatch(takes, trace(UP, FRAMES)[:2].astype(np.float32)).relative_distances
    assert np.isfinite(early).all(), "of a take only its first 40 % can be skipped"


def test_the_distance_is_that_of_dynamic_time_warping(takes):
    """Oracle: the recurrence, cell by cell (Sakoe and Chiba 1978, symmetric form)."""
    rows = trace(DIAGONAL, 20, 0.1, 5).astype(np.float32)
    watch = NearestTakeWatch(takes, rows)
    start = rows[:, :-3] + np.tile(rows[:, -3:-1] - rows[0, -3:-1], 2)
    for k, length in enumerate(takes.lengths):
        take = takes.paths[k, :length]
        cost = np.sqrt(((start[:, None] - take[None]) ** 2).mean(axis=2))
        total = np.full((len(rows) + 1, length + 1), np.inf)
        total[0, 0] = 0
        for i in range(1, len(rows) + 1):
            for j in range(1, length + 1):
                c = cost[i - 1, j - 1]
                total[i, j] = min(total[i - 1, j] + c, total[i, j - 1] + c, total[i - 1, j - 1] + 2 * c)
        means = [total[-1, j] / (len(rows) + j) for j in range(1, length + 1) if j >= 0.4 * length]
        assert watch.distances[k] == pytest.approx(min(means), rel=1e-4)


def test_single_takes_are_compared_and_turned_people_are_not():
    examples = [Example((), 0, features=trace(UP)), Example((), 1, features=trace(ASIDE))]
    assert NearestTakes.of(examples, 2).scales == pytest.approx([USUAL_DISTANCE] * 2)
    assert NearestTakes.of([replace(e, facing=1) for e in examples * 2], 2) is None


def test_of_many_takes_as_many_of_each_movement_are_compared_evenly_from_their_order():
    numbers = {0: 4 * MOST_TAKES, 1: 2 * MOST_TAKES}
    examples = [
        Example((), movement, features=trace(direction * (2 + n / numbers[movement])))
        for movement, direction in enumerate((UP, ASIDE))
        for n in range(numbers[movement])
    ]
    takes = NearestTakes.of(examples, 2, np.ones(2))
    assert len(takes.lengths) == MOST_TAKES and np.bincount(takes.movements).tolist() == [40, 20]
    sizes = np.abs(takes.paths).max(axis=(1, 2))
    for movement in (0, 1):
        own = sizes[takes.movements == movement]
        assert own.min() < 2.1 and own.max() > 2.8, "from the first to the last"


def shown(direction, seed):
    rest = np.tile([[-40.0, 0.0], [40.0, 0.0], [0.0, -120.0]], (45, 1, 1))
    rest[15:35, 1] += 100 * trace(direction, 20)[:, :2] * (1, -1)
    return rest + np.random.default_rng(seed).normal(0, 1, rest.shape)


def learned(people=("anna", "ben")):
    takes = [
        Recording(shown(direction, n).astype(np.float32), 15.0, label, people[n % len(people)], str(n))
        for label, direction in (("up", UP), ("aside", ASIDE))
        for n in range(3)
    ]
    archive = MotionArchive(("left_hand", "right_hand", "head"), tuple(takes), TracksCamera("sofa"))
    return learn_view(archive, this_camera("sofa"), Vocabulary(("up", "aside")), parameters={"kernels": 84.0})


def watched(model, direction, frames=36):
    watch = model.watch(Onset())
    for centres in shown(direction, 9)[:frames]:
        watch.update(Tracks(centres))
    return watch


def test_a_model_of_few_takes_names_its_movements_and_nothing_else(tmp_path):
    model = learned()
    write_model(tmp_path / "sofa.model", model)
    for one in (model, read_model(tmp_path / "sofa.model")):
        for movement, direction in enumerate((UP, ASIDE)):
            watch = watched(one, direction)
            assert (1 - watch.unlearned.sum()) * watch.p[movement] > 0.7
        assert watched(one, -UP).unlearned.sum() > 0.6
    assert model.header.provenance["right"] == model.header.provenance["tried"] == "6"


def test_a_scale_is_the_mean_distance_shrunk_to_that_of_all_movements_and_this_to_the_usual_one():
    """Leave one take out: the distance to the nearest other take of the movement."""
    examples = [
        Example((), movement, features=trace(direction, 24, noise, 100 * movement + n))
        for movement, (direction, noise) in enumerate(((UP, 0.02), (ASIDE, 0.2)))
        for n in range(3)
    ]
    ones = NearestTakes.of(examples, 2, np.ones(2))
    nearest = [[], []]
    for k, example in enumerate(examples):
        distances = NearestTakeWatch(ones, example.features.astype(np.float32)).distances
        same = [n for n, e in enumerate(examples) if e.movement == example.movement and n != k]
        nearest[example.movement].append(distances[same].min())
    of_all = (np.sum(nearest) + USUAL_DISTANCE) / 7
    expected = [(sum(own) + of_all) / 4 for own in nearest]
    assert NearestTakes.of(examples, 2).scales == pytest.approx(expected)
