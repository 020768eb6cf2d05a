"""Streams: what people do between the movements of continuous recordings, and which of it a model may learn."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from performances import DOOR

from common.vocabulary import Vocabulary
from observer.learning.examples import gather_background
from observer.learning.learn import learn_view
from observer.model.base import Stream, StreamSpan
from observer.model.model_file import read_model, write_model
from observer.model.phase import Phase
from observer.model.registry import MODELS
from observer.motion.archive import MotionArchive, Recording, Span, movements_in, resample, streams_in
from observer.motion.projected import ProjectedTracker, frames_of, view_tracks
from observer.tracks import BODY_PARTS
from studies.performer import perform, perform_continuously

WORDS = Vocabulary(("ok", "shake"))
RANDOM = np.random.default_rng(3)


def continuous(labels, rests, subject="1", trial="7"):
    """Movements of 5 frames with `rests` frames of something else before, between and after."""
    spans, start = [], rests[0]
    for label, rest in zip(labels, rests[1:], strict=True):
        spans.append(Span(start, start + 5, label))
        start += 5 + rest
    return Recording(RANDOM.normal(size=(start, 3, 3)).astype(np.float32), 15.0, "", subject, trial, tuple(spans))


recordings = st.lists(st.sampled_from("abc"), max_size=5).flatmap(
    lambda labels: st.builds(
        continuous, st.just(labels), st.lists(st.integers(0, 3), min_size=len(labels) + 1, max_size=len(labels) + 1)
    )
)


@given(recordings.filter(lambda r: len(r.positions) > 0), st.sets(st.sampled_from("abc"), min_size=1))
def test_streams_show_each_chosen_movement_whole_and_nothing_of_the_others(recording, labels):
    whole = MotionArchive(BODY_PARTS, (recording,))
    pieces = MotionArchive(BODY_PARTS, tuple(streams_in(whole, tuple(labels))))
    cut = [(r.label, r.trial, r.positions.tobytes()) for r in movements_in(pieces) if r.label]
    assert cut == [(r.label, r.trial, r.positions.tobytes()) for r in movements_in(whole) if r.label in labels]
    others = sum(s.end - s.start for s in recording.spans if s.label not in labels)
    frames = len(recording.positions) - others if recording.spans else 0
    assert sum(len(r.positions) for r in pieces.recordings) == frames
    assert [r.spans for r in streams_in(pieces, tuple(labels))] == [r.spans for r in pieces.recordings if r.spans]


def test_a_recording_without_label_and_spans_is_a_stream_only_where_asked_for():
    named, unnamed = continuous((), (9,)), replace(continuous((), (9,)), label="bow")
    archive = MotionArchive(BODY_PARTS, (named, unnamed))
    assert not list(streams_in(archive))
    (stream,) = streams_in(archive, unlabelled=True)
    assert stream.label == "" and len(stream.positions) == 9 and not stream.spans


def test_spans_keep_their_trial_when_resampled():
    (stream,) = streams_in(MotionArchive(BODY_PARTS, (continuous("ab", (3, 4, 5)),)))
    assert [(s.label, s.trial) for s in resample(stream, 30.0).spans] == [("a", "7.0"), ("b", "7.1")]


def test_tracks_of_a_whole_recording_are_those_of_each_frame():
    recording = continuous("a", (3, 3))
    recording.positions[2, 1] = np.nan
    tracker = ProjectedTracker(DOOR, BODY_PARTS, BODY_PARTS[::-1])
    one_by_one = [tracker.update(frame).centres for frame in frames_of(recording)]
    at_once = [tracks.centres for tracks in view_tracks(DOOR, recording, BODY_PARTS, BODY_PARTS[::-1])]
    np.testing.assert_array_equal(at_once, one_by_one)


class Streamed(Phase):
    """The phase filter, which keeps the streams that it was to learn from."""

    kind = "streamed"
    calls = []  # noqa: RUF012

    @classmethod
    def learn_with_streams(cls, header, examples, streams):
        cls.calls.append((header, list(examples), list(streams)))
        return cls.learn(header, [e for e in examples if e.movement >= 0])

    def cross_validated(self, folds, watched):
        return self


@pytest.fixture
def calls(monkeypatch):
    monkeypatch.setitem(MODELS, "streamed", Streamed)
    Streamed.calls.clear()
    return Streamed.calls


@pytest.fixture(scope="module")
def people():
    """Three people who do each movement alone, and the third also without pause between them."""
    alone = perform(("1", "2", "3"), WORDS.labels, trials=1, seed=1)
    stream = replace(perform_continuously("3", (*WORDS.labels, "byebye"), seed=1), trial="c")
    return MotionArchive(alone.body_parts, (*alone.recordings, stream))


def test_a_model_that_can_gets_the_streams_at_every_facing_without_being_asked(calls, people, tmp_path):
    model = learn_view(people, DOOR, WORDS, kind="streamed", parameters={"facings": 2.0}, calibrate=False)
    ((header, examples, streams),) = calls
    assert header.background == () and {s.facing for s in streams} == {0, 1}
    front = [s for s in streams if s.facing == 0]
    shown = [(span.movement, span.trial) for s in front for span in s.spans]
    assert shown == [(e.movement, e.trial) for e in examples if e.facing == 0 and "c." in e.trial]
    assert len(shown) == 2, "byebye is neither a movement nor something else"
    seconds = sum(s.other_frames for s in front) / header.rate_hz
    assert header.provenance["other_motion_s"] == f"{seconds:.0f}" and header.provenance["other_motion_people"] == "1"
    write_model(tmp_path / "a.model", model)
    assert read_model(tmp_path / "a.model").header.provenance == header.provenance


def test_other_kinds_learn_as_before(people):
    alone = MotionArchive(people.body_parts, tuple(movements_in(people)))
    one, two = (learn_view(archive, DOOR, WORDS, kind="phase", calibrate=False) for archive in (people, alone))
    assert one.header.background is None and "other_motion_s" not in one.header.provenance
    for name, array in one.arrays().items():
        np.testing.assert_array_equal(array, two.arrays()[name])


def test_the_background_has_streams_too(calls, people):
    alone = MotionArchive(people.body_parts, people.recordings[:-1])
    story = Recording(people.recordings[0].positions, 30.0, "", "teller", "1")
    known = MotionArchive(people.body_parts, (people.recordings[-1], story))
    background = gather_background([known], ("byebye",), BODY_PARTS, 15.0)
    extra = replace(story, subject="walker", rate_hz=15.0)
    learn_view(alone, DOOR, WORDS, kind="streamed", calibrate=False, background=background, streams=[extra])
    ((header, examples, streams),) = calls
    assert header.background == ("byebye",)
    assert [e.trial for e in examples if e.movement == -1] == [
        span.trial for s in streams for span in s.spans if span.movement == -1
    ]
    assert {s.subject for s in streams} == {"3", "teller", "walker"}
    assert all(span.movement == -1 for s in streams for span in s.spans), "ok and shake are cut out"


def test_what_lies_outside_the_spans_is_something_else():
    assert Stream([None] * 9, (StreamSpan(2, 5, 0), StreamSpan(5, 6, 1))).other_frames == 5
