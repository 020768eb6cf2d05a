"""The instrument for films: verdicts of tracks in one process, and how they are counted."""

import numpy as np
import pytest

from benchmarks.clips.judging import AFTER_S, ClipResult, ClipVerdict, judge
from benchmarks.clips.report import line, summary
from benchmarks.clips.variants import WIDTH_PX, Variant, variants
from common.config_sections import FusionConfig
from common.vocabulary import ABSTAIN, Vocabulary
from observer.geometry.views import parse_view
from observer.learning.learn import learn_view
from observer.motion.projected import view_tracks
from observer.tracks import BODY_PARTS
from studies.performer import perform, perform_continuously

DOOR = parse_view("door")
MOVEMENTS = ("byebye", "nthrow", "stretch")


@pytest.fixture(scope="module", params=["phase", "stacked"])
def model(request):
    return learn_view(perform(("1", "2"), MOVEMENTS, trials=3), DOOR, Vocabulary(MOVEMENTS), kind=request.param)


def played(model, frames=slice(None)):
    stream = perform_continuously("3", ("byebye",))
    centres = np.array([tracks.centres for tracks in view_tracks(DOOR, stream, BODY_PARTS, BODY_PARTS)])[frames]
    return judge("film", "byebye", centres, stream.rate_hz, model, FusionConfig())


def test_a_movement_in_a_film_gets_one_verdict(model):
    result = played(model)
    assert result.first_is_right and [v.last for v in result.words] == ["byebye"]
    assert 0 < result.verdicts[0].at_s < result.seconds
    assert result.moments[-1].at_s == pytest.approx(result.seconds + AFTER_S, abs=0.2)
    assert line(result).split()[3:5] == ["right", "byebye"]


def test_without_a_person_nothing_is_said(model):
    centres = np.full((40, 3, 2), np.nan)
    assert judge("dark", "", centres, 10.0, model, FusionConfig()).first_is_right


def result(name, label, *labels):
    return ClipResult(name, label, 1.0, tuple(ClipVerdict(label, 1.0, label) for label in labels), ())


def test_the_first_verdict_counts_and_every_name_is_reported():
    results = [
        result("1_1", "wave", "wave", "clap"),
        result("1_2", "clap", ABSTAIN, "clap"),
        result("1_3", "clap", "wave"),
        result("wave", "wave", "wave", "clap"),
        result("stand", "", ABSTAIN),
    ]
    assert [r.first_is_right for r in results] == [True, False, False, True, True]
    clips, wave, stand = summary(results, ("wave", "stand")).splitlines()
    assert clips.startswith("clips: first verdict right 1 of 3, wrong 2, with an abstention 1")
    assert wave.startswith("wave: 2 named") and stand == "stand: 0 named (), 1 in all"


def test_a_variant_is_the_same_film_from_later_on_faster_and_mirrored():
    centres = np.random.default_rng(0).uniform(0, WIDTH_PX, (30, 3, 2))
    shown, rate_hz = Variant(mirrored=True, start_s=1.0, tempo=1.25, scale=2.0).apply(centres, 10.0)
    again, _ = Variant(mirrored=True, start_s=0.0, tempo=1.0, scale=1.0).apply(shown / 2, rate_hz)
    assert rate_hz == 12.5
    np.testing.assert_allclose(again, centres[10:])
    # The left hand of the mirrored person is the right one, as far from the other edge.
    np.testing.assert_allclose(shown[0, 0], 2 * (np.array([WIDTH_PX, 0]) + centres[10, 1] * (-1, 1)))
    assert len(set(variants())) == len(list(variants()))
