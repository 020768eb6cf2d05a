"""Effort models: evidence, learning and file, with features made by hand."""

import itertools
from dataclasses import replace

import numpy as np
import pytest

from common.errors import BadInput
from common.facets import EFFORT
from common.posterior import check_facet_names
from observer.effort.effort_file import read_effort, require_rate, write_effort
from observer.effort.features import FEATURE_NAMES
from observer.effort.model import (
    FACTOR_COLUMNS,
    FACTORS,
    NU,
    RIDGE,
    SHRINKAGE,
    UNKNOWN_ACTION,
    EffortExample,
    learn_trials,
    levels_of,
    log_odds,
    spread,
)

ACTIONS = ("push", "lift", "turn")


def made(noise=0.3, seed=0, actions=ACTIONS):
    """Trials of all 16 poles: of each factor its own evidence is higher where the level is; actions differ."""
    rng = np.random.default_rng(seed)
    shown = {"weight": "rise_most", "time": "jerk", "space": "head_turning", "flow": "other_share"}
    trials = []
    for number, action in enumerate(actions):
        for levels in itertools.product((-1, 1), repeat=4):
            features = rng.normal(0, noise, len(FEATURE_NAMES))
            features[FEATURE_NAMES.index("lean_last")] += 5 * number
            for factor, level in zip(FACTORS, levels, strict=True):
                features[FEATURE_NAMES.index(shown[factor])] += level
            trials.append(EffortExample(features, levels, action))
    return trials


def recognised(model, trial):
    return [int(model.posterior(trial.features)[f"effort_{factor}"][1] > 0.5) * 2 - 1 for factor in FACTORS]


def test_poles_are_recognised_in_an_unknown_action():
    trials = made()
    right = [
        np.mean([a == b for a, b in zip(recognised(model, t), t.levels, strict=True)])
        for left_out in ACTIONS
        for model in [learn_trials([t for t in trials if t.action != left_out], "door", 30)]
        for t in trials
        if t.action == left_out
    ]
    assert np.mean(right) > 0.9


def test_a_posterior_is_a_facet_in_the_order_of_the_poles():
    trials = made(noise=0.05)
    model = learn_trials(trials, "door", 30)
    low, high = trials[0], trials[15]
    assert low.levels == (-1,) * 4 and high.levels == (1,) * 4
    for facets, pole in ((model.posterior(low.features), 0), (model.posterior(high.features), 1)):
        check_facet_names(facets)
        assert all(abs(sum(p) - 1) < 1e-9 for p in facets.values())
        assert list(facets) == list(EFFORT)
        assert all(p.argmax() == pole for p in facets.values())


def test_the_mixture_is_the_formula():
    model = learn_trials(made(), "door", 30)
    z = np.linspace(-1, 1, len(FEATURE_NAMES))
    q, columns = FACTORS.index("time"), FACTOR_COLUMNS["time"]
    inverse = np.linalg.inv(model.spreads["time"])

    def likelihood(pole):
        examples = model.examples[model.levels[:, q] == pole][:, columns]
        squares = [(z[columns] - e) @ inverse @ (z[columns] - e) for e in examples]
        return np.mean([(1 + s / NU) ** (-(NU + len(columns)) / 2) for s in squares])

    assert log_odds(model, z, "time") == pytest.approx(np.log(likelihood(1) / likelihood(-1)), rel=1e-6)


def test_a_posterior_is_the_tempered_odds_of_standardised_features():
    model = learn_trials(made(), "door", 30)
    features = made(seed=9)[5].features
    for q, factor in enumerate(FACTORS):
        odds = log_odds(model, (features - model.mean) / model.deviation, factor)
        low, high = model.posterior(features)[f"effort_{factor}"]
        assert np.log(high / low) == pytest.approx(model.temper[q] * odds) and low + high == pytest.approx(1)


def test_the_spread_is_the_formula():
    """W: covariances of trials of the same four levels, unbiased and weighted by their number; B: of the actions."""
    rng = np.random.default_rng(5)
    z, actions = rng.normal(0, 1, (9, 2)), ["push", "lift", "turn"] * 3
    levels = np.repeat([[1, 1, 1, 1], [1, -1, 1, 1], [-1, 1, 1, 1]], [4, 4, 1], axis=0)
    centres = np.array([z[[a == name for a in actions]].mean(axis=0) for name in ACTIONS])
    own = z - np.array([centres[ACTIONS.index(a)] for a in actions])
    whole = (np.cov(own[:4].T) + np.cov(own[4:8].T)) / 2 + UNKNOWN_ACTION * np.cov(centres.T)
    expected = (1 - SHRINKAGE) * whole + SHRINKAGE * np.diag(np.diag(whole)) + RIDGE * np.eye(2)
    np.testing.assert_allclose(spread(z, levels, actions), expected)


def test_unknown_features_are_no_evidence():
    model = learn_trials(made(), "door", 30)
    blind = model.posterior(np.full(len(FEATURE_NAMES), np.nan))
    assert all(p.tolist() == [0.5, 0.5] for p in blind.values())
    trial = made()[15]
    partly = trial.features.copy()
    partly[FACTOR_COLUMNS["time"]] = np.nan
    facets = model.posterior(partly)
    assert facets["effort_time"].tolist() == [0.5, 0.5]
    np.testing.assert_allclose(facets["effort_weight"], model.posterior(trial.features)["effort_weight"])
    one = trial.features.copy()
    one[FEATURE_NAMES.index("acceleration")] = np.nan
    assert model.posterior(one)["effort_time"][1] > 0.5


def test_trials_at_one_pole_only_give_even_odds():
    model = learn_trials([t for t in made() if t.levels[2] == 1], "door", 30)
    assert model.posterior(made()[0].features)["effort_time"].tolist() == [0.5, 0.5]


def test_evidence_that_does_not_generalise_gets_a_low_temperature():
    honest = learn_trials(made(), "door", 30)
    # In every action another pole is shown by the same evidence: what one teaches is wrong in the others.
    rng = np.random.default_rng(3)
    mixed = [replace(t, features=rng.normal(0, 1, len(FEATURE_NAMES))) for t in made()]
    misled = learn_trials(mixed, "door", 30)
    assert (misled.temper < honest.temper).all()
    assert np.mean([p.max() for t in made(seed=5) for p in misled.posterior(t.features).values()]) < 0.8


def test_an_effort_model_is_read_as_it_was_written(tmp_path):
    model = replace(learn_trials(made(), "door", 30), provenance={"archive": "x.npz"})
    write_effort(tmp_path / "cam.effort", model)
    again = read_effort(tmp_path / "cam.effort")
    assert (again.view, again.rate_hz, again.body_parts) == (model.view, model.rate_hz, model.body_parts)
    assert again.provenance == {"archive": "x.npz"}
    for trial in made(seed=9)[:4]:
        for facet, p in model.posterior(trial.features).items():
            np.testing.assert_allclose(again.posterior(trial.features)[facet], p, atol=1e-5)
    assert [p.name for p in tmp_path.iterdir()] == ["cam.effort"]


def saved(path, **changed):
    """A good file with some arrays changed, or left out where None."""
    write_effort(path, learn_trials(made(), "door", 30))
    with np.load(path) as file:
        arrays = {name: file[name] for name in file.files} | changed
    with path.open("wb") as file:
        np.savez(file, **{name: a for name, a in arrays.items() if a is not None})


@pytest.mark.parametrize(
    ("changed", "error"),
    [
        ({"header": np.array('{"kind": "phase"}')}, "kind 'phase'"),
        ({"header": np.array('{"kind": "effort", "format": 9}')}, "another version"),
        ({"header": np.array("[]")}, "damaged"),
        ({"header": np.array("[" * 100_000)}, "damaged"),
        ({"examples": None}, "damaged"),
        ({"temper": np.array([1.0, np.nan, 1.0, 1.0])}, "temper"),
        ({"levels": np.zeros((3, 4), np.int8)}, "examples"),
    ],
)
def test_an_invalid_effort_file_is_rejected_in_one_line(tmp_path, changed, error):
    path = tmp_path / "cam.effort"
    saved(path, **changed)
    with pytest.raises(BadInput, match=error) as rejected:
        read_effort(path)
    assert "\n" not in str(rejected.value) and str(path) in str(rejected.value)


def test_missing_files_and_other_formats_are_rejected(tmp_path):
    with pytest.raises(BadInput, match="no such Effort model; make one with labanmesh learn"):
        read_effort(tmp_path / "none.effort")
    (tmp_path / "text.effort").write_text("hello")
    with pytest.raises(BadInput, match="not an Effort model"):
        read_effort(tmp_path / "text.effort")


def test_an_effort_model_of_another_rate_is_rejected(tmp_path):
    model = learn_trials(made(), "door", 30)
    require_rate(tmp_path / "cam.effort", model, 30.0)
    with pytest.raises(BadInput, match=r"learned at 30 Hz, the movement model at 15 Hz: .* --effort --rate 15"):
        require_rate(tmp_path / "cam.effort", model, 15.0)


@pytest.mark.parametrize(
    ("trial", "levels"),
    [("-1_0_1_1", (-1, 0, 1, 1)), ("0_0_0_0.7", (0, 0, 0, 0)), ("1", None), ("2_0_0_0", None), ("1_1_1", None)],
)
def test_the_levels_are_read_from_the_name_of_a_trial(trial, levels):
    assert levels_of(trial) == levels
