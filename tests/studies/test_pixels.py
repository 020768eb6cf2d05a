"""Judging from pictures: the same code and protocol as from joints, and close to it for a clear performance."""

import numpy as np
import pytest

from observer.geometry.views import parse_view
from observer.motion.transforms import resample
from observer.rendering.scenery import Scenery
from observer.tracking.head import have_cascade
from studies.evaluate import EvaluationSettings, evaluate
from studies.performer import perform
from studies.through import RATE_HZ, Filming, evaluate_pixels, track_pictures
from studies.trials import EvaluationTrial

pytestmark = pytest.mark.skipif(not have_cascade(), reason="this OpenCV has no face cascade")
LABELS = ("byebye", "stretch")


@pytest.fixture(scope="module")
def archive():
    whole = perform()
    kept = [r for r in whole.recordings if r.label in LABELS and r.trial == whole.recordings[0].trial]
    return type(whole)(whole.body_parts, tuple(resample(r, RATE_HZ) for r in kept))


def test_what_is_tracked_has_the_recordings_frames_and_follows_it(archive):
    recording = archive.recordings[0]
    seen = track_pictures(
        EvaluationTrial(recording, 0, len(recording.positions)), parse_view("door"), archive.body_parts, Filming()
    )
    assert len(seen) == len(recording.positions)
    assert np.mean([tracks.visible for tracks in seen]) > 0.7
    again = track_pictures(
        EvaluationTrial(recording, 0, len(recording.positions)), parse_view("door"), archive.body_parts, Filming()
    )
    assert all(np.array_equal(a.centres, b.centres, equal_nan=True) for a, b in zip(seen, again, strict=True))


def test_verdicts_from_pixels_are_those_from_joints_for_two_clear_movements(archive):
    people = sorted({r.subject for r in archive.recordings})
    question = EvaluationSettings((parse_view("door"),), LABELS, tuple(people[:-1]), tuple(people[-1:]))
    told = []
    small = Filming(Scenery(background="cluttered"))
    pixels = evaluate_pixels(archive, question, small, lambda *what: told.append(what))
    joints = evaluate(archive, question)
    assert [j.truth for j in pixels.trials] == [j.truth for j in joints.trials]
    assert [j.views.shape for j in pixels.trials] == [j.views.shape for j in joints.trials]
    assert all(j.fused[-1].argmax() == j.truth for j in pixels.trials)
    assert told[-1][1] == told[-1][2] == len(pixels.trials)
