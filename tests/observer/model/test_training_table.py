"""What the regressions learn from, and what the stacker learns from: people of whom the members know nothing."""

from dataclasses import replace

import numpy as np
import pytest

from common.vocabulary import Vocabulary
from observer.features import extent
from observer.model.base import (
    Example,
    Header,
    Onset,
    Stream,
    StreamSpan,
    recording_numbers,
    with_defaults,
)
from observer.model.held_out import STRANGE_FROM, STRANGE_SHARE, Watched, rows_of_fold, stacker_rows, streams_left_out
from observer.model.segment_classifier import segment_window
from observer.model.stacked import Stacked
from observer.model.stacker import BEGIN_UNKNOWN, LOWEST
from observer.model.training_memory import TrainingMemory
from observer.model.training_rows import (
    LEARNED_FRACTIONS,
    RECOGNISABLE,
    rows_of_examples,
    rows_of_streams,
)
from observer.model.training_table import TrainingTable
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
    header = Header("stacked", VOCABULARY, "door", np.eye(3, 4), RATE_HZ, BODY_PARTS, {"kernels": 336.0})
    return with_defaults(header, Stacked.PARAMETERS)


@pytest.fixture(scope="module")
def examples(header):
    shown = [example(m, s, t) for s in range(4) for t in range(2) for m in range(3)]
    return [Stacked.read(header, each) for each in shown]


def traces_of(examples):
    return [e.features.astype(np.float32) for e in examples]


@pytest.fixture(scope="module")
def table(header, examples):
    return TrainingTable(header, examples, ())


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


def test_lengths_extents_and_the_usual_posture_are_those_of_the_examples(examples, table):
    traces, memory = traces_of(examples), TrainingMemory(tuple(examples), ())
    for movement in range(3):
        own = [trace for trace, e in zip(traces, examples, strict=True) if e.movement == movement]
        largest = [max(extent(trace[: n + 1], RATE_HZ) for n in range(len(trace))) for trace in own]
        assert table.extents[movement] == pytest.approx(np.median(largest))
        assert memory.lengths_of(movement) == [len(trace) for trace in own]
    everything = np.concatenate(traces)
    np.testing.assert_allclose(memory.usual_posture, everything[:, :6].mean(axis=0), rtol=1e-4)


def test_a_fold_does_not_learn_from_those_left_out(header, examples, table):
    fold = [n for n, e in enumerate(examples) if e.subject == "3"]
    others = [replace(e, movement=(e.movement + 1) % 3) if e.subject == "3" else e for e in examples]
    mislabelled = TrainingTable(header, others, ())
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

    streams = [Stacked.read(header, stream(subject)) for subject in "01"]
    table = TrainingTable(header, examples, streams)
    person = {n for n, e in enumerate(examples) if e.subject == "0"}
    none, some = table._stream_rows_apart(person, (0, 2))
    assert not none.any() and some.all()
    one, _ = table._stream_rows_apart({0}, None)
    assert (~one).sum() == len(examples[0].tracks)


@pytest.fixture(scope="module")
def watched(header, examples):
    """What a model of the people 0 to 2 makes of the others' examples and streams, and its fold."""
    fold = [n for n, e in enumerate(examples) if e.subject == "3"]
    others = [e for e in examples if e.subject != "3"]
    model = Stacked.learn_with_streams(header, others, ())
    tracks = [t for e in examples if e.subject == "3" for t in e.tracks]
    spans = (StreamSpan(0, len(examples[fold[0]].tracks), 0, "0"),)
    streams = [Stream(tracks, spans, 0, "3", "0"), Stream(tracks, spans, 0, "0", "0")]
    apart = list(streams_left_out(streams, examples, fold, (0, 2)))
    return fold, rows_of_fold(model, examples, fold[:2], apart, 3.0), model


def test_the_people_left_out_are_watched_as_a_person_is_later(examples, watched):
    fold, rows, model = watched
    by_example = {n: [row for row in rows if row.example == n] for n in fold}
    assert {n for n, own in by_example.items() if own} == set(fold[:2])
    for n in fold[:2]:
        own = by_example[n]
        shown = [row for row in own if row.truth >= 0]
        assert [row.progress for row in shown] == pytest.approx([*LEARNED_FRACTIONS, np.inf])
        assert sum(row.weight for row in shown) == pytest.approx(1)
        assert {row.truth for row in shown} == {examples[n].movement}
        faint = [row for row in own if row.truth < 0]
        assert len(faint) == (0 if n % 2 == 0 else len(shown)), "between rests it is also shown faintly"
    watch = model.watch(Onset(known=True))
    known = next(n for n in fold[:2] if n % 2 == 0)
    for frame in examples[known].tracks:
        watch.pass_over(frame)
    watch.end()
    np.testing.assert_array_equal(by_example[known][-1].instant.members, watch.instant.members)


@pytest.mark.parametrize("whose", ["somebody else", "one of whose takes some are left out"])
def test_of_ordinary_life_each_fold_leaves_out_and_watches_another_part(header, examples, whose):
    subject = whose if whose == "somebody else" else examples[0].subject
    life = Stream(examples[0].tracks * 3, (), 0, subject, "0")
    streams = [Stacked.read(header, life)]
    table = TrainingTable(header, examples, streams)
    parts = [next(streams_left_out(streams, examples, [0], (k, 3))) for k in range(3)]
    assert [t for part in parts for t in part.tracks] == list(life.tracks)
    learned = np.array([table._stream_rows_apart({0}, (k, 3))[0] for k in range(3)])
    assert (learned.sum(axis=0) == 2).all(), "each row is left out once"
    assert (~learned).sum(axis=1).tolist() == [len(part.tracks) for part in parts]


def test_a_movement_in_a_stream_weighs_as_one_take_however_long_it_lasts(watched):
    _, rows, _ = watched
    inside = [row for row in rows if row.example < 0 and row.truth >= 0]
    assert 0 < sum(row.weight for row in inside) <= 1.2
    taught = stacker_rows(rows, struck=False).teaches_label
    begins_known = [row.example < 0 and not row.instant.context[BEGIN_UNKNOWN] for row in rows]
    assert [not t for t in taught] == [known or row.truth < 0 for known, row in zip(begins_known, rows, strict=True)]


def test_streams_of_people_who_were_learned_from_are_not_watched_and_of_others_so_many_seconds(watched):
    _, rows, _ = watched
    of_streams = [row for row in rows if row.example < 0]
    assert of_streams and sum(row.weight for row in of_streams) <= 3.0 + 1e-9
    assert {row.truth for row in of_streams} <= {0, -1}


def test_late_instants_of_movements_are_also_those_of_movements_that_are_not_known(watched):
    _, watched_rows, _ = watched
    rows, count = stacker_rows(watched_rows), len(watched_rows)
    late = [row for row in watched_rows if row.truth >= 0 and row.progress >= STRANGE_FROM]
    assert len(rows.truth) == count + len(late) and (rows.truth[count:] == -1).all()
    assert (rows.shown[:count] <= 1).all() and (rows.shown[count:] == 0).all()
    for n, row in enumerate(late, count):
        judging = row.instant.members[:4].any(axis=1)
        np.testing.assert_allclose(rows.instants.members[n, :4, row.truth][judging], LOWEST)
    only_two = [replace(row, instant=_of_two(row)) for row in watched_rows]
    assert len(stacker_rows(only_two).truth) == count, "without one of two, the other is certain"
    assert stacker_rows([]) is None


def test_movements_not_known_weigh_what_recorded_other_motion_lacks_of_a_share_of_the_known_ones(watched):
    _, watched_rows, _ = watched
    known = [row for row in watched_rows if row.truth >= 0]
    other = replace(known[0], truth=-1, example=-1, progress=0.0)
    moving = sum(row.weight for row in known)
    for share in (0.0, 0.1, 0.2, 0.5):
        rows = stacker_rows([*known, replace(other, weight=share * moving)])
        struck = rows.weights[len(known) + 1 :].sum()
        assert struck == pytest.approx(max(STRANGE_SHARE - share, 0.0) * moving), share


def _of_two(row: Watched):
    """The instant with the first two movements only."""
    instant = row.instant
    return replace(instant, members=instant.members[:, :2], by_movement=instant.by_movement[:, :2])


@pytest.mark.parametrize("facings", [1, 12])
def test_each_fold_is_judged_by_a_model_of_the_others_at_any_number_of_facings(header, facings):
    header = replace(header, parameters={**header.parameters, "kernels": 84.0, "facings": float(facings)})
    shown = [
        replace(example(max(m, 0), s, 0), movement=m, facing=k)
        for k in range(facings)
        for s in range(4)
        for m in (-1, 0, 1, 2)
    ]
    header = replace(header, background=("nod",))
    shown = [Stacked.read(header, each) for each in shown]
    numbers = recording_numbers(shown)
    folds = [[n for n, number in enumerate(numbers) if number // 8 == half] for half in (0, 1)]
    watched = {n for n, number in enumerate(numbers) if number % 8 < 4 and shown[n].facing in (0, facings - 1)}
    model = Stacked.learn(header, shown)
    results = model.cross_validated(folds, watched).header.provenance
    assert int(results["tried"]) == len([n for n in watched if shown[n].movement >= 0])
    assert int(results["right"]) > 0.7 * int(results["tried"])
