"""Judging from pictures: the same code and protocol as from joints, and close to it for a clear performance."""

import numpy as np
import pytest

from benchmarks.from_pixels import PICTURE_RATE_HZ, Filming, evaluate_pixels, track_pictures
from observer.geometry.views import parse_view
from observer.motion.archive import resample
from observer.rendering.scenery import Scenery
from observer.tracking.head import have_cascade
from studies.evaluate import EvaluationSettings, evaluate
from studies.performer import PEOPLE, perform
from studies.trials import EvaluationTrial

pytestmark = pytest.mark.skipif(not have_cascade(), reason="this OpenCV has no face cascade")
LABELS = ("byebye", "stretch")


@pytest.fixture(scope="module")
def archive():
    whole = perform(PEOPLE[:3])
    chosen = [r for r in whole.recordings if r.label in LABELS and r.trial == whole.recordings[0].trial]
    return type(whole)(whole.body_parts, tuple(resample(r, PICTURE_RATE_HZ) for r in chosen))


def test_tracks_from_pictures_follow_the_recording(archive):
    recording = archive.recordings[0]
    trial = EvaluationTrial(recording, 0, len(recording.positions))
    tracks, again = (track_pictures(trial, parse_view("door"), archive.body_parts, Filming()) for _ in range(2))
    assert len(tracks) == len(recording.positions)
    assert np.mean([one.visible for one in tracks]) > 0.7
    assert all(np.array_equal(a.centres, b.centres, equal_nan=True) for a, b in zip(tracks, again, strict=True))


def test_verdicts_from_pixels_are_those_from_joints_for_two_clear_movements(archive):
    people = sorted({r.subject for r in archive.recordings})
    views, quick = (parse_view("door"),), {"model": "phase", "calibrated": False}
    settings = EvaluationSettings(views, LABELS, tuple(people[:-1]), tuple(people[-1:]), **quick)
    progress = []
    small = Filming(Scenery(background="cluttered"))
    pixels = evaluate_pixels(archive, settings, small, lambda *step: progress.append(step))
    joints = evaluate(archive, settings)
    assert [j.truth for j in pixels.trials] == [j.truth for j in joints.trials]
    assert [j.views.shape for j in pixels.trials] == [j.views.shape for j in joints.trials]
    assert all(j.fused[-1].argmax() == j.truth for j in pixels.trials)
    assert progress[-1][1] == progress[-1][2] == len(pixels.trials)
