"""Left and right that a pose model exchanges for some frames."""

import numpy as np
import pytest

from observer.tracking.sides import EXCHANGED, EXCHANGED_LIMBS, MEMORY_S, PAIRS, SideKeeper, _Memory

RATE_HZ = 30
LEFT = {11: (0.2, -0.5), 13: (0.35, -0.25), 15: (0.4, 0.0), 23: (0.12, 0.0), 25: (0.14, 0.4), 27: (0.15, 0.8),
        29: (0.15, 0.83), 31: (0.18, 0.88), 7: (0.07, -0.7), 17: (0.41, 0.05), 19: (0.42, 0.05)}  # fmt: skip


def person(turn=0.0, at=(0.5, 0.5)):
    """(33, 3) landmarks of a person who has turned by so many radians; 0: towards the camera, 180 degrees: away."""
    landmarks = np.zeros((33, 3))
    for row, (u, v) in LEFT.items():
        for side, sign in ((row, 1), (row + 1, -1)):
            landmarks[side, :2] = sign * u * np.cos(turn), v
    landmarks[[31, 32], 1] += 0.05 * (np.cos(turn) - 1)  # from behind the toes are farther, and higher in the picture
    landmarks[:, :2] = landmarks[:, :2] / 3 + at
    landmarks[:, 2] = 1.0
    return landmarks


def mended(frames, rate_hz=RATE_HZ):
    keeper = SideKeeper()
    return [keeper.update(landmarks, round(1000 * n / rate_hz) + 1) for n, landmarks in enumerate(frames)]


def right_frames(frames, truth, rate_hz=RATE_HZ):
    """Which frames have the sides of the truth."""
    return [np.array_equal(one, other) for one, other in zip(mended(frames, rate_hz), truth, strict=True)]


@pytest.mark.parametrize("seconds", [0.02, 0.1])
def test_the_memory_is_an_alpha_beta_filter(seconds):
    """Benedict and Bordner 1962: beta = alpha^2 / (2 - alpha)."""
    alpha = 1 - np.exp(-seconds / MEMORY_S)
    beta = alpha**2 / (2 - alpha)
    rng = np.random.default_rng(0)
    before, now, later = (rng.normal(0, 1, (33, 2)) for _ in range(3))
    memory = _Memory.of(before, 1.0, 0)
    position, speed = memory.differences.copy(), np.zeros((6, 2))
    for points in (now, later):
        memory.expect(seconds)
        memory.follow(points, 1.0, 0, seconds)
        residual = points[[a for a, _ in PAIRS]] - points[[b for _, b in PAIRS]] - (position + seconds * speed)
        position, speed = position + seconds * speed + alpha * residual, speed + beta / seconds * residual
        np.testing.assert_allclose(memory.differences, position)
        np.testing.assert_allclose(memory.speeds, speed)


@pytest.mark.parametrize("rate_hz", [60, 30, 10])
@pytest.mark.parametrize("order", [EXCHANGED, *EXCHANGED_LIMBS], ids=["whole", "arms", "legs"])
def test_an_exchange_in_the_middle_is_mended(order, rate_hz):
    truth = [person(turn) for turn in np.linspace(0, 0.6, 2 * rate_hz)]
    seen = [landmarks[order] if rate_hz <= n < 1.5 * rate_hz else landmarks for n, landmarks in enumerate(truth)]
    assert all(right_frames(seen, truth, rate_hz))


def test_single_frames_are_mended():
    truth = [person()] * 30
    seen = [landmarks[EXCHANGED] if n in (10, 12, 13, 20) else landmarks for n, landmarks in enumerate(truth)]
    assert all(right_frames(seen, truth))


@pytest.mark.parametrize("seconds", [2.0, 6.0])
def test_a_person_who_turns_keeps_their_sides(seconds):
    truth = [person(turn) for turn in np.linspace(0, 4 * np.pi, round(2 * seconds * RATE_HZ))]
    assert all(right_frames(truth, truth))


def test_an_exchange_at_the_start_ends_when_the_model_has_been_right_for_longer():
    truth = [person()] * 60
    seen = [landmarks[EXCHANGED] if n < 9 else landmarks for n, landmarks in enumerate(truth)]
    right = right_frames(seen, truth)
    assert right.index(True) <= 9 + 9 + 0.2 * RATE_HZ
    assert all(right[right.index(True) :])


def test_feet_that_face_as_the_shoulders_count_more():
    """The model takes the person for one who turns away, and leaves the feet where it sees them."""
    truth = [person()] * 60
    seen = [landmarks[EXCHANGED] if n < 15 else landmarks for n, landmarks in enumerate(truth)]
    assert right_frames(seen, truth).index(True) <= 15 + 0.5 * RATE_HZ


def test_the_model_is_believed_after_a_long_contradiction():
    truth = [person()] * 30 + [person(np.pi)] * 120
    assert right_frames(truth, truth)[-60:] == [True] * 60


def test_after_a_gap_and_for_somebody_else_the_models_sides_count():
    towards, away = person(), person(np.pi)
    keeper = SideKeeper()
    for ms in range(1, 1000, 33):
        keeper.update(towards, ms)
    assert np.array_equal(keeper.update(away, 1500), away)
    elsewhere = person(at=(1.4, 0.5))
    assert np.array_equal(keeper.update(elsewhere, 1533), elsewhere)


def test_the_landmarks_are_not_changed_and_nothing_is_read_from_a_body_without_size():
    keeper, landmarks = SideKeeper(), person()
    before = landmarks.copy()
    keeper.update(landmarks, 1)
    keeper.update(landmarks[EXCHANGED], 34)
    assert np.array_equal(landmarks, before)
    for nothing in (np.zeros((33, 3)), np.full((33, 3), np.nan)):
        assert keeper.update(nothing, 67) is nothing
