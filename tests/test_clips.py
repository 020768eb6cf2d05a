"""The instrument for films: verdicts of tracks in one process, and how they are counted."""

import numpy as np
import pytest

from benchmarks.clips.judging import AFTER_S, ClipResult, ClipVerdict, judge
from benchmarks.clips.report import line, summary
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
