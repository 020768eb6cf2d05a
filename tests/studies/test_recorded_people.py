"""Results on recorded people: MSR Action3D, odd subjects learned from, even ones judged."""

import numpy as np
import pytest

from observer.geometry.views import parse_view
from observer.motion.archive import labels_of
from observer.motion.importers import import_recordings
from observer.motion.importers.msr_action3d import LABELS
from studies.evaluate import EvaluationSettings, evaluate
from studies.experiments import PAPER_MODEL, PAPER_RULE
from studies.report import as_json
from studies.through import fused_over_mesh
from studies.trials import SUBSETS

ODD, EVEN = ("1", "3", "5", "7", "9"), ("2", "4", "6", "8", "10")
pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def msr(data):
    return import_recordings("msr-action3d", data / "msr_action3d").archive


def ask(archive, labels, views="door", **given):
    question = EvaluationSettings(tuple(parse_view(v) for v in views.split(",")), tuple(labels), ODD, EVEN, **given)
    return evaluate(archive, question)


def figures_of(archive, labels, views="door", **given):
    return as_json(ask(archive, labels, views, **given))


def mean_accuracy(archive, **given):
    return np.mean([figures_of(archive, labels, **given)["accuracy"] for labels in SUBSETS.values()])


PAPERS = {"model": PAPER_MODEL, "rule": PAPER_RULE, "calibrated": False}


def test_the_papers_model_in_the_door_plane_and_turned_without_relearning(msr):
    straight = mean_accuracy(msr, **PAPERS)
    turned = mean_accuracy(msr, turn=45.0, **PAPERS)
    assert straight >= 0.66
    assert turned <= straight - 0.05


def test_the_papers_fusion_beats_the_better_of_its_two_views(msr):
    assert labels_of(msr) == LABELS
    figures = figures_of(msr, LABELS, "door,wheel", **PAPERS)
    assert figures["accuracy"] > max(view["accuracy"] for view in figures["per_view"].values())


def test_the_default_in_the_door_plane_and_fused_at_the_end_and_when_sixty_percent_were_seen(msr):
    figures = [figures_of(msr, labels, "door,wheel") for labels in SUBSETS.values()]
    assert np.mean([s["per_view"]["door"]["accuracy"] for s in figures]) >= 0.86
    assert np.mean([s["accuracy"] for s in figures]) >= 0.88
    assert np.mean([s["accuracy_at"]["0.6"] for s in figures]) >= 0.86


def test_the_default_on_all_movements_and_the_same_labels_over_the_mesh(msr):
    answer = ask(msr, LABELS, "door,wheel")
    figures = as_json(answer)
    assert (figures["n_train"], figures["n_test"]) == (289, 264)
    assert figures["accuracy"] >= 0.84
    assert figures["accuracy"] > max(view["accuracy"] for view in figures["per_view"].values())
    assert figures["ece"] <= 0.06 and max(view["ece"] for view in figures["per_view"].values()) <= 0.09
    over_mesh = fused_over_mesh(answer)
    assert over_mesh["same_labels"] == over_mesh["n"] == 264


def test_the_default_knows_neither_onset_nor_tempo_and_the_frame_table_is_lost(msr):
    # Calibration does not matter here, and takes as long as all the rest.
    assert figures_of(msr, LABELS, "door,wheel", onset_known=False, calibrated=False)["accuracy"] >= 0.78
    assert figures_of(msr, LABELS, "door,wheel", onset_known=False, **PAPERS)["accuracy"] <= 0.25
