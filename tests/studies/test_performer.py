"""The synthetic performer's recordings: what they hold, that they repeat, and what tells the movements apart."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from common.errors import BadInput
from studies.performer import MOVEMENTS, PEOPLE, perform, perform_continuously
from studies.performer.repertoire import KNOWN_PEOPLE

LEFT, RIGHT, HEAD = range(3)
X, Y, Z = range(3)


@pytest.fixture(scope="module")
def archive():
    return perform(trials=4, seed=7)


def of(archive, label):
    return [recording for recording in archive.recordings if recording.label == label]


def swung(recording, part=RIGHT):
    """Extent in metres, (3,), over the middle of a recording: what a swing moves and a hold does not."""
    frames = len(recording.positions)
    return np.ptp(recording.positions[frames * 2 // 5 : frames * 3 // 5, part], axis=0)


def test_the_papers_database(archive):
    assert MOVEMENTS == ("lunging", "maestro", "stretch", "ok", "point", "byebye", "shake", "nthrow")
    assert PEOPLE == ("1", "2", "3", "4")
    assert archive.body_parts == ("left_hand", "right_hand", "head")
    assert [(r.subject, r.label, r.trial) for r in archive.recordings] == [
        (p, m, t) for p in PEOPLE for m in MOVEMENTS for t in "1234"
    ]
    for recording in archive.recordings:
        assert recording.positions.shape[1:] == (3, 3) and recording.positions.dtype == np.float32
        assert np.isfinite(recording.positions).all()
        assert (recording.rate_hz, recording.spans) == (15.0, ())


def test_the_same_seed_gives_the_same_bits_and_another_does_not():
    def take(seed):
        archive = perform(("2",), ("shake",), trials=2, seed=seed)
        return b"".join(r.positions.tobytes() for r in archive.recordings)

    def long_take(seed):
        return perform_continuously("2", ("shake",), seed=seed).positions.tobytes()

    assert take(3) == take(3) != take(4)
    assert long_take(3) == long_take(3) != long_take(4)


@settings(max_examples=20, deadline=None)
@given(st.integers(0, 2**40))
def test_recordings_keep_to_anatomy(seed):
    for recording in perform(movements=MOVEMENTS, trials=1, seed=seed).recordings:
        height = KNOWN_PEOPLE[recording.subject].height
        hands, head = recording.positions[:, :2], recording.positions[:, 2]
        # Not further than arm, half the shoulders and the neck together, and a little noise.
        assert np.linalg.norm(hands - head[:, None], axis=2).max() < (0.386 + 0.129 + 0.118) * height + 0.02
        assert (head[:, Y] > 0.53 * height).all()
        assert (hands[..., Y] > 0.2 * height).all()
        assert np.linalg.norm(np.diff(recording.positions, axis=0), axis=2).max() * 15 < 8.0
        assert 1.5 <= len(recording.positions) / 15 <= 4.0
        ends = recording.positions[[0, -1]]
        assert np.linalg.norm(ends[0] - ends[1], axis=-1).max() < 0.15


def test_nthrow_swings_front_and_back_and_looks_like_ok_from_the_door(archive):
    for recording in of(archive, "nthrow"):
        x, y, z = swung(recording)
        assert z > max(0.1, 2 * y, 3 * x)
    nthrow, ok = (
        np.mean([r.positions[len(r.positions) // 2, RIGHT] for r in of(archive, m)], 0) for m in ("nthrow", "ok")
    )
    assert np.abs(nthrow - ok)[[X, Y]].max() < 0.08


def test_maestro_swings_as_byebye_does_from_the_door_and_not_from_the_wheel(archive):
    maestro, byebye = (np.median([swung(r) for r in of(archive, m)], axis=0) for m in ("maestro", "byebye"))
    assert maestro[X] == pytest.approx(byebye[X], rel=0.25)
    assert maestro[Z] > 5 * byebye[Z]


@pytest.mark.parametrize("person", PEOPLE)
def test_spans_hold_the_movements_and_rest_is_nearly_still(person):
    wanted = (*MOVEMENTS, "byebye")
    recording = perform_continuously(person, wanted, seed=5, rest_s=(1.0, 1.6))
    assert tuple(span.label for span in recording.spans) == wanted
    assert (recording.label, recording.subject) == ("", person)
    assert np.isfinite(recording.positions).all()
    speed = np.linalg.norm(np.diff(recording.positions[:, :2], axis=0), axis=2).max(axis=1) * 15
    idle = np.ones(len(speed), dtype=bool)
    last = 0
    for span in (*recording.spans, None):
        pause = (span.start if span else len(recording.positions)) - last
        assert 14 <= pause <= 25
        if span:
            idle[span.start - 1 : span.end] = False
            assert speed[span.start : span.end].max() > 0.8
            last = span.end
    assert np.mean(speed[idle] < 0.15) > 0.9
    assert speed[idle].max() < 0.4


def test_a_long_recording_ends_where_it_began():
    positions = perform_continuously("4", ("ok", "byebye") * 40, rate_hz=5.0, seed=2, rest_s=(0.5, 0.5)).positions
    assert np.linalg.norm(positions[-1] - positions[0], axis=1).max() < 0.08
    idle = perform_continuously("1", ())
    assert idle.spans == () and 15 <= len(idle.positions) <= 25


@pytest.mark.parametrize(
    ("call", "error"),
    [
        (lambda: perform(people=("5",)), "person '5': no synthetic person; known: 1, 2, 3, 4"),
        (lambda: perform(movements=("bybye",)), "movement 'bybye': not in the"),
        (lambda: perform_continuously("1", ("dance",)), "known: lunging, maestro"),
        (lambda: perform(trials=0), "trials = 0"),
        (lambda: perform(rate_hz=0.0), "rate_hz = 0.0"),
        (lambda: perform(seed=-1), "seed = -1"),
        (lambda: perform_continuously("1", (), rest_s=(2.0, 1.0)), "rest_s = (2.0, 1.0)"),
    ],
)
def test_bad_requests_are_one_line(call, error):
    with pytest.raises(BadInput) as caught:
        call()
    assert error in str(caught.value) and "\n" not in str(caught.value)
