"""What a model learns about the durations and the repetitions of its movements, keeps, shows, and counts."""

from dataclasses import replace

import numpy as np
import pytest

from common.errors import BadInput
from common.message_types import MovementTimes
from common.vocabulary import Vocabulary
from observer.learning.descriptions import describe_periods
from observer.learning.editing import add_movements, remove_movements
from observer.learning.learn import learn_view
from observer.model.base import Onset
from observer.model.model_file import read_model, write_model
from observer.motion.archive import MotionArchive, Span
from observer.runtime.pipeline import Observer
from observer.tracks import BODY_PARTS, Frame
from studies.performer import perform, perform_continuously
from tests.observer.performances import DOOR, PassThrough, view_tracks

LABELS = ("point", "byebye", "ok")


def learned(archive, labels=LABELS, **options):
    small = {"kernels": 84.0}
    return learn_view(archive, DOOR, Vocabulary(labels), parameters=small, calibrate=False, **options)


@pytest.fixture(scope="module")
def takes():
    return perform(("1",), (*LABELS, "shake"), trials=3)


@pytest.fixture(scope="module")
def model(takes):
    return learned(takes)


def test_waving_is_periodic_and_pointing_is_not(model, takes):
    movements = model.header.vocabulary.movements
    assert list(model.header.vocabulary.periods) == ["byebye"]
    assert movements["byebye"].period_s == pytest.approx(0.43, abs=0.1)
    shortest = min(len(take.positions) / take.rate_hz for take in takes.recordings if take.label == "point")
    assert movements["point"] == MovementTimes(shortest_s=round(shortest, 3))
    assert describe_periods(model.header) == ["repeated: byebye every 0.5 s; any other movement is a new one each time"]


def test_the_model_file_keeps_it_and_editing_learns_it_again(model, takes, tmp_path):
    write_model(tmp_path / "a.model", model)
    again = read_model(tmp_path / "a.model")
    assert again.header.vocabulary.movements == model.header.vocabulary.movements
    assert again.oscillations.keys() == model.oscillations.keys() == {1}
    larger = add_movements(again, takes, DOOR, labels=("shake",)).model.header.vocabulary
    assert list(larger.periods) == ["byebye", "shake"]
    smaller = remove_movements(model, ("byebye",)).header
    assert smaller.vocabulary.movements.keys() == {"point", "ok"} and describe_periods(smaller) == []


def test_a_duration_out_of_range_is_a_damaged_file(model, tmp_path):
    vocabulary = replace(model.header.vocabulary, movements={"ok": MovementTimes.model_construct(period_s=-1.0)})
    model = type(model).from_arrays(replace(model.header, vocabulary=vocabulary), model.arrays())
    write_model(tmp_path / "a.model", model)
    with pytest.raises(BadInput, match=r"damaged model file .*period_s.*learn it again"):
        read_model(tmp_path / "a.model")


def test_the_rest_between_two_takes_is_known_from_continuous_recordings():
    rate_hz = 15.0
    stream = perform_continuously("1", ("point", "ok", "ok", "point", "point", "ok"), rate_hz)
    spans = stream.spans
    movements = learned(MotionArchive(BODY_PARTS, (stream,)), ("point", "ok")).header.vocabulary.movements
    assert movements["ok"].rest_s == pytest.approx((spans[2].start - spans[1].end) / rate_hz, abs=1e-3)
    assert movements["point"].rest_s == pytest.approx((spans[4].start - spans[3].end) / rate_hz, abs=1e-3)
    assert movements["ok"].period_s is None


def test_spans_that_touch_are_repetitions_of_one_movement():
    (recording,) = perform(("1",), ("point",), trials=1).recordings
    count, length = 5, len(recording.positions)
    spans = tuple(Span(n * length, (n + 1) * length, "point") for n in range(count))
    positions = np.tile(recording.positions, (count, 1, 1))
    squats = replace(recording, positions=positions, label="", spans=spans)
    single = perform(("1",), ("ok",), trials=2).recordings
    movements = learned(MotionArchive(BODY_PARTS, (squats, *single)), ("point", "ok")).header.vocabulary.movements
    length_s = length / recording.rate_hz
    assert movements["point"].period_s == pytest.approx(length_s, abs=0.1)
    assert movements["point"].shortest_s == pytest.approx(length_s, abs=1e-3) and movements["point"].rest_s is None


def waving(turns_s, rate_hz=15.0):
    """Person 2 waves for so many seconds; the raised hand and what follows are those of a recording."""
    (take,) = perform(("2",), ("byebye",), trials=1).recordings
    middle, cycle = len(take.positions) // 2, round(0.43 * rate_hz)
    repeated = np.tile(take.positions[middle : middle + cycle], (round(turns_s / 0.43), 1, 1))
    positions = np.concatenate([take.positions[:middle], repeated, take.positions[middle:]])
    return MotionArchive(BODY_PARTS, (replace(take, positions=positions),)).recordings[0]


def repetitions_in(model, recording):
    observer = Observer(PassThrough(), model, Onset())
    tracks = view_tracks(DOOR, recording, BODY_PARTS, BODY_PARTS)
    at_s = (n / recording.rate_hz for n in range(len(tracks)))
    return [
        observer.step(Frame(round(s * 1e9), each.centres)).repetitions for s, each in zip(at_s, tracks, strict=True)
    ]


def test_an_observer_counts_what_is_repeated_and_nothing_else(model):
    shorter, longer = repetitions_in(model, waving(0.0))[-1], repetitions_in(model, waving(4.3))[-1]
    assert shorter >= 2 and longer - shorter == pytest.approx(10, abs=1)
    (point,) = perform(("2",), ("point",), trials=1).recordings
    assert repetitions_in(model, point)[-1] is None
    assert set(repetitions_in(remove_movements(model, ("byebye",)), waving(0.0))) == {None}
