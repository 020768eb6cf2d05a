"""The comparison with offline classifiers: their input, the statistics and the table. Classifiers need aeon."""

import dataclasses
import importlib.util
import json
import re

import numpy as np
import pytest

from benchmarks.command_line import run_command
from benchmarks.comparisons.classifiers import __main__ as commands
from benchmarks.comparisons.classifiers.comparison import (
    PEERS,
    PRODUCT,
    Peer,
    PeerOptions,
    compare_peers,
)
from benchmarks.comparisons.classifiers.panels import (
    make_panel,
    view_centres,
)
from benchmarks.comparisons.classifiers.tables import accuracy_interval, peer_rows
from observer.geometry.views import parse_view
from observer.model.rocket import MiniRocket, choose_dilations
from observer.motion.archive_file import write_archive
from observer.tracks import BODY_PARTS
from studies.evaluate import evaluate
from studies.performer import perform
from studies.report import FRACTIONS
from studies.settings import EvaluationSettings
from studies.trials import make_trials

DOOR_WHEEL = (parse_view("door"), parse_view("wheel"))
PHASE = {"model": "phase", "calibrated": False}
"""Settings of tests that are not about our model."""
LABELS = ("ok", "shake")
HEAD = BODY_PARTS.index("head")

with_aeon = pytest.mark.skipif(
    importlib.util.find_spec("aeon") is None, reason="aeon is not installed: make test-peers brings it"
)


@pytest.fixture(scope="module")
def archive():
    return perform(("1", "2"), LABELS, trials=2, seed=3)


def all_trials(archive):
    return make_trials(archive.recordings, onset_known=True, turn=0.0, rng=np.random.default_rng(0))


def shown(archive, fraction, length=12, derived=True):
    some = all_trials(archive)
    return make_panel(
        [view_centres(t.recording, DOOR_WHEEL, archive.body_parts) for t in some], some, fraction, length, derived
    )


@pytest.mark.parametrize("fraction", FRACTIONS[:-1])
def test_nothing_after_the_fraction_is_shown(archive, fraction):
    """Whatever happens later, size, origin and bridge_gaps gaps included, leaves the panel as it was."""
    changed = []
    for recording, trial in zip(archive.recordings, all_trials(archive), strict=True):
        positions = recording.positions.copy()
        positions[trial.frame_at(fraction) + 1 :] = np.random.default_rng(1).normal(0, 5, 3)
        changed.append(dataclasses.replace(recording, positions=positions))
    other = dataclasses.replace(archive, recordings=tuple(changed))
    assert (shown(other, fraction) == shown(archive, fraction)).all()
    assert not (shown(other, 1.0) == shown(archive, 1.0)).all()


def recording_peer(calls):
    """A peer that always says "ok" and records what it is shown."""

    def always_ok(learned, labels, unknown, seed, fast):
        calls.append((len(learned), sorted(labels), len(unknown), seed, learned.tobytes(), learned.shape[1]))
        return np.tile([1.0, 0.0], (len(unknown), 1))

    return Peer(always_ok, 12, True, True)


def test_a_peer_gets_our_trials_and_relearns_for_every_fraction(archive):
    """Other people for training than for test, for each fraction and seed."""
    calls, settings = [], EvaluationSettings(views=DOOR_WHEEL, labels=LABELS, train_subjects=("1",), **PHASE)
    peers = {"MiniRocket": recording_peer(calls)}
    comparison = compare_peers(archive, "both", settings, PeerOptions((0, 1)), peers=peers)
    assert len(calls) == 2 * len(FRACTIONS) and [g[3] for g in calls[:2]] == [0, 1]
    assert {g[:1] + g[2:3] for g in calls} == {(4, 4)} and calls[0][1] == ["ok", "ok", "shake", "shake"]
    assert len({g[4] for g in calls}) == len(FRACTIONS), "each fraction has a panel of its own to learn from"
    assert [c.name for c in comparison.curves] == ["ours, fused", "ours, door", "ours, wheel", "MiniRocket"]
    truth = [j.trial.recording.label == "ok" for j in evaluate(archive, settings).trials]
    assert (comparison.curves[-1].right == np.array([truth] * len(FRACTIONS))).all()
    assert comparison.people == ("2",) * 4
    alone = compare_peers(archive, "both", settings, PeerOptions((0, 1), ours=False), peers=peers)
    assert [c.name for c in alone.curves] == ["MiniRocket"] and alone.people == comparison.people
    assert (alone.curves[0].right == comparison.curves[-1].right).all()
    assert [row.classifier for row in peer_rows([alone])] == ["MiniRocket"]
    each = dataclasses.replace(settings, views=DOOR_WHEEL[:1], train_subjects=(), leave_one_subject_out=True)
    comparison = compare_peers(archive, "both", each, PeerOptions(), peers={})
    assert [c.name for c in comparison.curves] == ["ours, fused"] and comparison.people == ("1",) * 4 + ("2",) * 4


def test_the_interval_of_many_people_is_that_of_independent_trials():
    right = np.random.default_rng(4).random((1, 1000)) < 0.8
    score = accuracy_interval([right.astype(float)], [[str(n) for n in range(1000)]])
    half = 1.96 * np.sqrt(right.mean() * (1 - right.mean()) / 1000)
    # Drawing people and then their one trial is drawing trials.
    assert score.high[0] - score.low[0] == pytest.approx(2 * half, rel=0.1)
    # Trials of few people say less than as many people.
    people = [str(n // 50) for n in range(250)]
    right = np.array([[float(p in "01") for p in people]])
    alone, few = (accuracy_interval([right], [names]) for names in ([str(n) for n in range(250)], people))
    assert few.high[0] - few.low[0] > 4 * (alone.high[0] - alone.low[0])


@with_aeon
@pytest.mark.parametrize("name", PEERS)
def test_a_peer_learns_an_easy_difference(archive, name):
    peer = PEERS[name]
    some = all_trials(archive)
    centres = [view_centres(t.recording, DOOR_WHEEL, archive.body_parts) for t in some]
    whole = make_panel(centres, some, 1.0, peer.length, peer.derived)
    labels = np.array([t.recording.label for t in some])
    predicted = [peer.predict(whole, labels, whole, seed, True) for seed in (0, 0)]
    assert (predicted[0] == labels).all() and (predicted[0] == predicted[1]).all()


@with_aeon
def test_the_command_writes_page_and_json(archive, tmp_path, capsys):
    write_archive(tmp_path / "two.npz", archive)
    page = tmp_path / "page.md"
    page.write_text(f"# A page\n{commands.BEGIN}\n{commands.END}\n", encoding="utf-8")
    asked = [str(tmp_path / "two.npz"), "--train-subjects", "1", "--json", str(tmp_path / "found.json")]
    assert run_command(commands.peers, "peers", [*asked, "--page", str(page)]) == 0
    figures = json.loads((tmp_path / "found.json").read_text(encoding="utf-8"))
    differences = [f"ours, fused − {name}" for name in ("MiniRocket", "1-NN DTW", PRODUCT)]
    assert [row["judged_by"] for row in figures["rows"]][-3:] == differences
    assert re.search(r"\| all 2 \| ours, fused \|", page.read_text(encoding="utf-8"))
    assert "ours, wheel" in capsys.readouterr().out


def rocket_of(fitted, channels, length):
    """Our transform with the parameters that aeon found; aeon's biases are ordered by dilation, kernel, bias."""
    counts, chosen, dilations, biases_per_kernel, biases = fitted
    selected = np.zeros((len(dilations) * 84, channels), bool)
    for row, own in enumerate(np.split(chosen, np.cumsum(counts)[:-1])):
        selected[row, own] = True
    pieces = np.split(biases, np.cumsum(84 * biases_per_kernel)[:-1])
    by_dilation = tuple(np.ascontiguousarray(piece.reshape(84, -1).T) for piece in pieces)
    selected = selected.reshape(len(dilations), 84, channels)
    return MiniRocket(length, dilations.astype(np.int64), selected, by_dilation)


@with_aeon
@pytest.mark.parametrize(("channels", "length", "features"), [(10, 60, 2500), (2, 64, 10_000), (16, 37, 500)])
def test_our_minirocket_has_the_features_of_aeons(channels, length, features):
    from aeon.transformations.collection.convolution_based import MiniRocket as AeonMiniRocket

    windows = np.random.default_rng(6).normal(size=(30, channels, length)).cumsum(axis=2).astype(np.float32)
    aeon = AeonMiniRocket(n_kernels=features, random_state=1).fit(windows[:20])
    ours = rocket_of(aeon.parameters, channels, length)
    theirs = np.asarray(aeon.transform(windows))
    pieces = np.split(theirs, np.cumsum([b.size for b in ours.biases])[:-1], axis=1)
    theirs = np.concatenate([p.reshape(30, 84, -1).swapaxes(1, 2).reshape(30, -1) for p in pieces], axis=1)
    # Sums in another order round differently, so that a convolution equal to a bias may count or not.
    differ = np.abs(ours.transform(windows) - theirs) > 1e-5
    assert differ.mean() < 1e-3 and differ[20:].mean() < 1e-4
    dilations, counts = choose_dilations(length, features)
    assert (dilations == aeon.parameters[2]).all() and (counts == aeon.parameters[3]).all()
