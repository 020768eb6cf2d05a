"""What discriminative models learn from, and that evaluating a fold at once gives what watching its examples gives."""

from dataclasses import replace

import numpy as np
import pytest

from common.probability import softmax
from common.vocabulary import Vocabulary
from observer.geometry.views import parse_view
from observer.learning.learn import learn_view
from observer.model.base import (
    Example,
    Header,
    Onset,
    Stream,
    StreamSpan,
    recording_numbers,
    with_defaults,
    with_features,
)
from observer.model.body_trace import extent, places_and_differences
from observer.model.cross_validation import CrossValidation
from observer.model.discriminative import Discriminative
from observer.model.logistic import LogisticRegression
from observer.model.stack_exponents import ENDED, RUNNING
from observer.model.stacked import Stacked
from observer.model.training_rows import (
    RECOGNISABLE,
    between_rests,
    learned_facings,
    rows_of_examples,
    rows_of_streams,
    segment_window,
)
from observer.model.training_table import ENOUGH_EXAMPLES, RARELY, SMALL_SHARE, TrainingTable
from observer.motion.archive import MotionArchive, Recording
from observer.tracks import BODY_PARTS, Tracks

RATE_HZ = 15.0
VOCABULARY = Vocabulary(("circle", "raise", "wave"))


def hands(movement, subject, trial, frames=30):
    """(F, 3, 2) a person of its own size and tempo who moves the right hand."""
    rng = np.random.default_rng([movement, subject, trial])
    frames += 2 * subject + trial
    t = np.linspace(0, 1, frames)
    up = np.sin(np.pi * t)
    path = [
        np.stack([0.3 * np.sin(4 * np.pi * t), 0.6 - 0.4 * (1 - np.cos(4 * np.pi * t))], 1),
        np.stack([0.2 + 0 * t, 0.6 - 1.2 * up], 1),
        np.stack([0.3 + 0.3 * np.sin(6 * np.pi * t) * up, 0.6 - np.minimum(3 * up, 1)], 1),
    ][movement]
    points = np.zeros((frames, 3, 2))
    points[:, 0], points[:, 1] = (-0.2, 0.6), path
    return points * (1 + 0.1 * subject) + rng.normal(0, 0.004, points.shape)


def example(movement, subject, trial):
    return Example([Tracks(p) for p in hands(movement, subject, trial)], movement, 0, str(subject), str(trial))


@pytest.fixture(scope="module")
def header():
    header = Header("discriminative", VOCABULARY, "door", np.eye(3, 4), RATE_HZ, BODY_PARTS, {"kernels": 336.0})
    return with_defaults(header, Discriminative.PARAMETERS)


@pytest.fixture(scope="module")
def examples(header):
    shown = [example(m, s, t) for s in range(4) for t in range(2) for m in range(3)]
    return with_features(Discriminative, header, shown)


def traces_of(examples):
    return [e.features.astype(np.float32) for e in examples]


@pytest.fixture(scope="module")
def table(header, examples):
    return TrainingTable(header, examples, traces_of(examples), (), ())


def test_targets_are_distributions_and_a_movement_is_shown_from_a_third_on(examples):
    for rows in rows_of_examples(examples, traces_of(examples), 3, RATE_HZ):
        np.testing.assert_allclose(rows.targets.sum(axis=1), 1.0, atol=1e-6)
        assert rows.at.min() >= 0 and rows.at.max() < len(rows.trace)
        if len(rows.examples) == 1:
            movement = examples[rows.examples[0]].movement
            assert rows.targets[0, -1] == 1.0 and (rows.targets[5:11, movement] == 1.0).all()
            assert (rows.targets[11:, -1] == 1.0).all(), "at rest afterwards"
        else:
            one, other = rows.examples
            assert examples[one].movement != examples[other].movement and (rows.targets[:, -1] == 1.0).all()


def test_another_seed_draws_other_kernels_and_the_same_one_the_same(header, examples, table):
    def of(seed):
        drawn = replace(header, parameters={**header.parameters, "seed": seed})
        return TrainingTable(drawn, examples, traces_of(examples), (), ())

    def arrays(table):
        return [*table.trailing.as_arrays().values(), *table._segments.rocket.as_arrays().values()]

    same, other = (arrays(of(seed)) for seed in (0.0, 1.0))
    assert all(np.array_equal(a, b) for a, b in zip(arrays(table), same, strict=True))
    assert not all(np.array_equal(a, b) for a, b in zip(arrays(table), other, strict=True))


def test_rests_keep_the_movement_as_it_is(examples):
    trace = traces_of(examples)[0]
    shown = between_rests(trace, 12, 7, np.random.default_rng(0))
    np.testing.assert_array_equal(shown[12:-7], trace)
    assert len(shown) == len(trace) + 19 and np.abs(shown[:12] - trace[0]).max() < 0.2


def test_a_stream_shows_its_spans_and_else_something_else(examples):
    tracks = [t for e in examples[:2] for t in (*e.tracks, *e.tracks[-1:] * 20)]
    first, begin = len(examples[0].tracks), len(examples[0].tracks) + 20
    spans = (StreamSpan(0, first, 0, "0"), StreamSpan(begin, begin + len(examples[1].tracks), 1, "0"))
    stream = Stream(tracks, spans, 0, "0", "0")
    trace = np.zeros((len(tracks), 9), np.float32)
    (rows,) = rows_of_streams([stream], [trace], 3, RATE_HZ)
    shown = rows.targets.argmax(axis=1)
    assert (shown[first // 2 : first] == 0).all() and (shown[first + 3 : begin] == 3).all()
    assert (shown[begin + 20 : spans[1].end] == 1).all() and (shown[spans[1].end + 3 :] == 3).all()


def test_a_segment_does_not_depend_on_where_it_began_nor_on_the_size_that_was_known(examples):
    trace = traces_of(examples)[4]
    moved = trace.copy()
    moved[:, -3:-1] += (4.0, -2.0)
    np.testing.assert_allclose(segment_window(moved, 60), segment_window(trace, 60), atol=1e-5)
    # All lengths are halved while the size is thought to be twice as large.
    late = trace.copy()
    late[:10, :-3] /= 2
    late[:10, -1] *= 2
    np.testing.assert_allclose(segment_window(late, 60)[:, 30:], segment_window(trace, 60)[:, 30:], atol=0.2)


def test_a_window_holds_the_parts_where_they_are_and_where_the_body_has_gone_since_the_begin():
    """Two parts: one stays beside the body, which moves, the other moves against it."""
    frames = np.arange(11)[:, None]
    first, second = np.array([[1.0, 2.0]] * 11), 0.1 * frames * [1.0, 0.0]
    path = 5.0 + 0.2 * frames * [1.0, -1.0]
    trace = np.hstack([first, second, path, np.ones((11, 1))]).astype(np.float32)
    moved = path - path[0]
    window = np.hstack([first + moved, second + moved])
    np.testing.assert_allclose(segment_window(trace, 11), window.T, atol=1e-5)
    np.testing.assert_allclose(segment_window(trace, 21)[:, ::2], window.T, atol=1e-5)


def test_a_movement_in_a_stream_is_shown_fully_from_a_share_of_its_span_on():
    stream = Stream((), (StreamSpan(20, 60, 1, "1"),), 0, "anna", "1")
    (rows,) = rows_of_streams([stream], [np.zeros((90, 9), np.float32)], 2, RATE_HZ)
    for at, targets in zip(rows.at, rows.targets, strict=True):
        # It counts as shown for 0.1 s after its end too.
        inside = 20 <= at < 60 + 0.1 * RATE_HZ
        shown = min((at - 20) / 40 / RECOGNISABLE, 1.0) if inside else 0.0
        assert targets == pytest.approx([0.0, shown, 1.0 - shown], abs=1e-6)


def test_the_least_extents_are_a_share_of_what_all_but_few_examples_reach(examples, table):
    for movement, least in enumerate(table.least_extents):
        largest = [
            max(extent(trace[: n + 1], RATE_HZ) for n in range(len(trace)))
            for trace, example in zip(traces_of(examples), examples, strict=True)
            if example.movement == movement
        ]
        assert least == pytest.approx(SMALL_SHARE * np.quantile(largest, RARELY))
        assert 0 < least < min(largest)


def test_each_of_few_examples_counts_more(header, examples, table):
    """The loss of few examples is scaled to that of ENOUGH_EXAMPLES, so that a penalty suits both."""
    penalty = header.parameters["trailing_penalty"] * ENOUGH_EXAMPLES / len(examples)
    expected = LogisticRegression.learn(table._features, table._targets, table._weights, penalty)
    np.testing.assert_allclose(table.learn()[0].weights, expected.weights, atol=1e-4)


def test_channels_of_a_segment_are_the_places_of_parts_and_their_differences():
    hand, foot, head = np.array([1.0, 2.0]), np.array([4.0, -1.0]), np.array([0.5, 0.25])
    sums = places_and_differences(3) @ np.concatenate([hand, foot, head])
    expected = [hand, foot, head, foot - hand, head - hand, head - foot]
    np.testing.assert_allclose(sums, np.concatenate(expected))


def test_a_fold_does_not_learn_from_those_left_out(header, examples, table):
    fold = [n for n, e in enumerate(examples) if e.subject == "3"]
    others = [replace(e, movement=(e.movement + 1) % 3) if e.subject == "3" else e for e in examples]
    mislabelled = TrainingTable(header, others, traces_of(others), (), ())
    for one, other in zip(table.learn(fold)[:1], mislabelled.learn(fold)[:1], strict=True):
        # Blends are chosen by movement, so that a few of their rows differ.
        np.testing.assert_allclose(one.weights, other.weights, atol=0.3)
    one, other = table.learn(fold)[1], mislabelled.learn(fold)[1]
    np.testing.assert_array_equal(one.running.weights, other.running.weights)


def test_streams_of_people_left_out_are_left_out_and_else_only_the_spans(header, examples):
    def stream(subject):
        tracks = [t for e in examples if e.subject == subject for t in e.tracks]
        ends = np.cumsum([0, *(len(e.tracks) for e in examples if e.subject == subject)])
        own = [e for e in examples if e.subject == subject]
        spans = [StreamSpan(int(a), int(b), e.movement, e.trial) for a, b, e in zip(ends, ends[1:], own, strict=False)]
        return Stream(tracks, tuple(spans), 0, subject, "0")

    streams = with_features(Discriminative, header, [stream("0"), stream("1")])
    table = TrainingTable(header, examples, traces_of(examples), streams, [s.features.astype("f4") for s in streams])
    person = {n for n, e in enumerate(examples) if e.subject == "0"}
    none, some = table._stream_rows_apart(person)
    assert not none.any() and some.all()
    one, _ = table._stream_rows_apart({0})
    assert (~one).sum() == len(examples[0].tracks)


def test_a_fold_at_once_is_what_a_watch_of_its_model_says(header, examples, table):
    fold = [n for n, e in enumerate(examples) if e.subject == "3"]
    movement, segments = table.learn(fold, 20)
    memory = Discriminative.learn(header, examples).memory
    header = replace(header, background=())
    model = Discriminative(header, table.trailing, movement, segments, table.longest, table.least_extents, memory)
    for n, members in table.held_out(fold)[0].items():
        watch, tracks = model.watch(Onset(known=True)), examples[n].tracks
        for number, frame in enumerate(tracks, 1):
            watch.update(frame)
            if number == round(0.5 * len(tracks)):
                assert np.abs(watch.p - softmax(members.after((0.5,)))[0]).max() < 0.1
        watch.end()
        np.testing.assert_allclose(watch.p, softmax(members.after((1.0,)))[0], atol=0.01)


def test_at_many_facings_the_examples_learned_from_and_those_watched_are_held_out(header):
    header = replace(header, parameters={**header.parameters, "facings": 12.0})
    shown = [
        replace(example(max(m, 0), s, 0), movement=m, facing=k)
        for k in range(12)
        for s in range(4)
        for m in (-1, 0, 1, 2)
    ]
    shown = with_features(Discriminative, replace(header, background=("nod",)), shown)
    numbers = recording_numbers(shown)
    folds = [[n for n, number in enumerate(numbers) if number // 8 == half] for half in (0, 1)]
    watched = {5, 6, 7, 190}
    results, _ = Discriminative.held_out(header, CrossValidation(shown, (), folds, watched, (0.6, 1.0)))
    learned = set(learned_facings(shown, 12))
    assert set(results) == {n for n in learned | watched if shown[n].movement >= 0}
    assert {(e.subject, e.movement) for e in map(shown.__getitem__, learned)} == {
        (e.subject, e.movement) for e in shown
    }
    right = [members.after((1.0,))[0].argmax() == shown[n].movement for n, members in results.items()]
    assert np.mean(right) > 0.8


@pytest.mark.parametrize("facings", [1, 4])
def test_learned_exponents_are_stored_and_explicit_ones_stay(facings):
    recordings = []
    for m, label in enumerate(VOCABULARY.labels):
        for subject in range(4):
            flat = hands(m, subject, 0)
            positions = np.concatenate([flat[..., :1], -flat[..., 1:], np.zeros_like(flat[..., :1])], axis=-1)
            recordings.append(Recording(positions.astype(np.float32), RATE_HZ, label, str(subject), "1"))
    archive, door = MotionArchive(BODY_PARTS, tuple(recordings)), parse_view("door")
    explicit = {"kernels": 336.0, "generative": 0.25, "facings": float(facings)}
    model = learn_view(archive, door, VOCABULARY, kind="stacked", parameters=explicit)
    assert model.header.parameters["generative"] == 0.25
    assert all(0 <= model.header.parameters[name] <= 2 for name in (*RUNNING, *ENDED))
    tried, right = (int(model.header.provenance[name]) for name in ("tried", "right"))
    assert tried == 12 * facings and right >= 0.75 * tried


def test_where_only_the_trailing_windows_judge_the_exponents_of_both_members_do_not_count(examples):
    exponents = dict.fromkeys((*RUNNING, *ENDED), 0.3)
    header = Header("stacked", VOCABULARY, "door", np.eye(3, 4), RATE_HZ, BODY_PARTS, {"kernels": 336.0, **exponents})
    own = [replace(e, features=None) for e in examples[:6]]
    model = Stacked.learn_with_streams(header, with_features(Stacked, header, own), ())
    both, alone = model.watch(Onset()), model.discriminative.watch(Onset())
    # Movements that go on for longer than any example: where the next one begins is unknown.
    tracks = [t for _ in range(4) for t in own[2].tracks]
    differ = []
    for frame in tracks:
        both.update(frame)
        alone.update(frame)
        differ.append(np.abs(both.p - alone.p).max())
    assert alone.segment.begun is None
    assert differ[-1] < 1e-3 < differ[10], "while the begin is known the exponents count"
