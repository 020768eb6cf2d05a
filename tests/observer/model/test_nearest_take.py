"""A movement that is farther from every learned take than these are from each other is something else."""

from dataclasses import replace

import numpy as np
import pytest

from common.vocabulary import Vocabulary
from observer.geometry.views import this_camera
from observer.learning.learn import learn_view
from observer.model import few_takes
from observer.model.base import Example, Onset
from observer.model.common_gestures import COMMON_GESTURES
from observer.model.few_takes import CALIBRATION, FEW_TAKES, pooled_with_takes, something_else_with_takes
from observer.model.model_file import read_model, write_model
from observer.model.nearest_take import MOST_TAKES, NearestTakes, NearestTakeWatch
from observer.model.posterior_calibration import CAUTIOUS
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


def nats(takes, rows, movement):
    return NearestTakeWatch(takes, rows.astype(np.float32)).nats(movement, 2.0)


def test_another_take_is_near_whatever_its_tempo_and_another_movement_is_far(takes):
    assert (takes.scales > 0).all()
    for frames in (14, 24, 40):
        assert nats(takes, trace(UP, frames, 0.03, 99), 0) < 0.5
        assert nats(takes, trace(DIAGONAL, frames, 0.03, 98), 0) > 2
        assert nats(takes, trace(ASIDE, frames, 0.03, 97), 0) > 2


def test_a_movement_in_progress_is_near_too(takes):
    assert nats(takes, trace(UP, FRAMES, 0.03, 99)[:15], 0) < 0.5


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


def test_too_many_takes_single_ones_and_turned_people_are_not_compared():
    examples = [Example((), 0, features=trace(UP)), Example((), 1, features=trace(ASIDE))]
    assert NearestTakes.of(examples, 2) is None
    assert NearestTakes.of(examples * MOST_TAKES, 2) is None
    assert NearestTakes.of([replace(e, facing=1) for e in examples * 2], 2) is None


def shown(direction, seed):
    rest = np.tile([[-40.0, 0.0], [40.0, 0.0], [0.0, -120.0]], (45, 1, 1))
    rest[15:35, 1] += 100 * trace(direction, 20)[:, :2] * (1, -1)
    return rest + np.random.default_rng(seed).normal(0, 1, rest.shape)


def learned(people=("anna", "ben"), **parameters):
    takes = [
        Recording(shown(direction, n).astype(np.float32), 15.0, label, people[n % len(people)], str(n))
        for label, direction in (("up", UP), ("aside", ASIDE))
        for n in range(3)
    ]
    archive = MotionArchive(("left_hand", "right_hand", "head"), tuple(takes), TracksCamera("sofa"))
    vocabulary, view = Vocabulary(("up", "aside")), this_camera("sofa")
    calibrate = bool(parameters.get(FEW_TAKES, 1))
    parameters = {"kernels": 84.0, COMMON_GESTURES: 0.0, **parameters}
    return learn_view(archive, view, vocabulary, calibrate=calibrate, parameters=parameters)


def watched(model, direction, frames=36):
    watch = model.watch(Onset())
    for centres in shown(direction, 9)[:frames]:
        watch.update(Tracks(centres))
    return watch


def test_earlier_models_know_something_else_by_nearest_weight_and_stay_so_in_their_files(tmp_path):
    models = [learned(few_takes=0.0, nearest_weight=weight) for weight in (0.0, 2.0)]
    write_model(tmp_path / "sofa.model", models[1])
    models.append(read_model(tmp_path / "sofa.model"))
    unlearned = [float(watched(model, -UP).unlearned.sum()) for model in models]
    assert unlearned[0] < unlearned[1] == unlearned[2]


def test_a_model_of_few_takes_names_its_movements_and_nothing_else(tmp_path):
    model = learned()
    write_model(tmp_path / "sofa.model", model)
    for one in (model, read_model(tmp_path / "sofa.model")):
        assert one.header.calibration == CALIBRATION
        for movement, direction in enumerate((UP, ASIDE)):
            watch = watched(one, direction)
            assert (1 - watch.unlearned.sum()) * watch.p[movement] > 0.6
        assert watched(one, -UP).unlearned.sum() > 0.6
    assert model.header.provenance["right"] == model.header.provenance["tried"] == "6"


def test_takes_by_one_person_are_calibrated_cautiously():
    calibration = learned(people=("anna",)).header.calibration
    assert calibration.doubt == pytest.approx(CAUTIOUS.doubt) and calibration.temperature >= CAUTIOUS.temperature


def test_a_person_out_of_sight_is_forgotten():
    watch = watched(learned(), UP)
    before = [*watch.p, float(watch.unlearned.sum())]
    for _ in range(600):
        watch.update(Tracks(np.full((3, 2), np.nan)))
    after = [*watch.p, float(watch.unlearned.sum())]
    assert max(after[:2]) < 0.55 < max(before[:2])
    assert after[2] == pytest.approx(1 / 3, abs=0.05)


@pytest.mark.parametrize("seed", range(5))
def test_the_posterior_of_few_takes_and_something_else_are_the_formulas(seed):
    """Oracle: the formulas of few_takes.py, number by number."""
    rng = np.random.default_rng(seed)
    phase, other = rng.dirichlet(np.full(3, 5.0), 2)
    distances, trailing = rng.uniform(0.5, 5.0, 3), rng.uniform(0.05, 0.95)
    mass = [
        a**few_takes.PHASE * b**few_takes.DISCRIMINATIVE * np.exp(-few_takes.DISTANCE * d)
        for a, b, d in zip(phase, other, distances, strict=True)
    ]
    p = np.array(mass) / sum(mass)
    assert pooled_with_takes(phase, other, distances) == pytest.approx(p)
    entropy = -sum(q * np.log(q) for q in p)
    log_odds = few_takes.OFFSET + few_takes.ELSE_TRAILING * np.log(trailing / (1 - trailing))
    log_odds += few_takes.ELSE_DISTANCE * distances[p.argmax()]
    log_odds += few_takes.ELSE_AGREEMENT * np.log(sum(phase * other)) + few_takes.ELSE_ENTROPY * entropy
    result = something_else_with_takes(phase, other, distances, trailing)
    assert result == pytest.approx(1 / (1 + np.exp(-log_odds)))
    # Farther, less certain, less in agreement, or something else by the trailing windows: each raises it.
    assert min(few_takes.ELSE_DISTANCE, few_takes.ELSE_TRAILING, few_takes.ELSE_ENTROPY) > 0 > few_takes.ELSE_AGREEMENT


def test_a_scale_is_the_mean_of_its_movement_and_of_all_movements():
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
    means = np.mean(nearest, axis=1)
    assert NearestTakes.of(examples, 2).scales == pytest.approx((means + np.mean(nearest)) / 2)


def test_a_movement_that_cannot_be_compared_yet_is_judged_by_the_members():
    near, far = np.array([0.5, 2.0]), np.full(2, np.inf)
    p, other = np.array([0.7, 0.3]), np.array([0.8, 0.2])
    assert pooled_with_takes(p, other, near)[0] > pooled_with_takes(p, other, far)[0] > 0.5
    odds = [something_else_with_takes(p, other, distances, 0.5) for distances in (near, near + 2, far)]
    assert max(odds[0], odds[2]) < odds[1]
