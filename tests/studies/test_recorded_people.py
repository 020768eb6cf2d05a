"""Results on recorded people: MSR Action3D, odd subjects learned from, even ones judged."""

import numpy as np
import pytest

from observer.geometry.views import parse_view
from observer.motion.archive import labels_of
from observer.motion.importers.msr_action3d import LABELS
from studies.evaluate import EvaluationSettings, evaluate
from studies.experiments import PAPER_MODEL, PAPER_RULE
from studies.over_mesh import fused_over_mesh
from studies.report import as_json
from studies.trials import SUBSETS

ODD, EVEN = ("1", "3", "5", "7", "9"), ("2", "4", "6", "8", "10")
SOME = ("2", "6", "10")
"""Enough people to notice a loss; docs/results has the figures of all."""
pytestmark = pytest.mark.slow


def ask(archive, labels, views="door", test_subjects=EVEN, **changes):
    seen_from = tuple(parse_view(v) for v in views.split(","))
    return evaluate(archive, EvaluationSettings(seen_from, tuple(labels), ODD, test_subjects, **changes))


def figures_of(archive, labels, views="door", **changes):
    return as_json(ask(archive, labels, views, **changes))


def mean_accuracy(archive, **changes):
    return np.mean([figures_of(archive, labels, **changes)["accuracy"] for labels in SUBSETS.values()])


PAPERS = {"model": PAPER_MODEL, "rule": PAPER_RULE, "calibrated": False}


def test_the_papers_model_in_the_door_plane_and_turned_without_relearning(msr):
    straight = mean_accuracy(msr, test_subjects=SOME, **PAPERS)
    turned = mean_accuracy(msr, test_subjects=SOME, turn=45.0, **PAPERS)
    assert straight >= 0.66
    assert turned <= straight - 0.05


def test_the_papers_fusion_beats_the_better_of_its_two_views(msr):
    assert labels_of(msr) == LABELS
    figures = figures_of(msr, LABELS, "door,wheel", **PAPERS)
    assert figures["accuracy"] > max(view["accuracy"] for view in figures["per_view"].values())


@pytest.mark.timeout(300)
def test_the_default_on_all_movements_and_the_same_labels_over_the_mesh(msr):
    # Two people are enough to notice a loss; each takes as long as a quarter of the learning.
    answer = ask(msr, LABELS, "door,wheel", test_subjects=("6", "10"))
    figures = as_json(answer)
    assert (figures["n_train"], figures["n_test"]) == (289, 114)
    assert figures["per_view"]["door"]["accuracy"] >= 0.9
    assert figures["accuracy"] >= 0.93 and figures["accuracy_at"]["0.6"] >= 0.91
    assert figures["ece"] <= 0.06 and max(view["ece"] for view in figures["per_view"].values()) <= 0.09
    over_mesh = fused_over_mesh(answer)
    assert over_mesh["same_labels"] == over_mesh["n"] == 114


def test_the_phase_filter_knows_neither_onset_nor_tempo_and_the_frame_table_is_lost(msr):
    # Calibration does not matter here, and takes as long as all the rest.
    unknown = {"onset_known": False, "test_subjects": SOME[:2]}
    phase = figures_of(msr, SUBSETS["AS1"], "door,wheel", model="phase", calibrated=False, **unknown)
    assert phase["accuracy"] >= 0.83
    assert figures_of(msr, SUBSETS["AS1"], "door,wheel", **unknown, **PAPERS)["accuracy"] <= 0.35
