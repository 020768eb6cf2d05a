"""MiniRocket against sums written out term by term, and what learning it promises."""

from itertools import combinations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from observer.model.rocket import MiniRocket, choose_dilations

LENGTH, CHANNELS = 60, 6


def windows_of(seed, count=8, channels=CHANNELS, length=LENGTH):
    """(N, C, n) random walks."""
    return np.random.default_rng(seed).normal(size=(count, channels, length)).cumsum(axis=2).astype(np.float32)


def convolution(window, channels, twos, dilation):
    """(n,) the convolution at every instant, frames outside the window being 0."""
    length = window.shape[1]
    result = np.zeros(length)
    for t in range(length):
        for tap in range(9):
            frame = t + (tap - 4) * dilation
            if 0 <= frame < length:
                weight = 2.0 if tap in twos else -1.0
                result[t] += weight * sum(float(window[c, frame]) for c in np.flatnonzero(channels))
    return result


def plain_features(rocket, window):
    """The features of one window, one after the other, with the smallest distance to a bias beside each."""
    features, distances = [], []
    for n, (dilation, chosen, biases) in enumerate(zip(rocket.dilations, rocket.channels, rocket.biases, strict=True)):
        of_dilation = np.empty((2, *biases.shape))
        for kernel, twos in enumerate(combinations(range(9), 3)):
            convolved = convolution(window, chosen[kernel], twos, dilation)
            if (n + kernel) % 2:
                convolved = convolved[4 * dilation : len(convolved) - 4 * dilation]
            for b, bias in enumerate(biases[:, kernel]):
                of_dilation[:, b, kernel] = np.mean(convolved > bias), np.abs(convolved - bias).min()
        features.append(of_dilation[0].ravel())
        distances.append(of_dilation[1].ravel())
    return np.concatenate(features), np.concatenate(distances)


@settings(max_examples=8, deadline=None)
@given(seed=st.integers(0, 10_000), channels=st.integers(1, 11), length=st.sampled_from([9, 17, 33, 40]))
def test_features_are_the_shares_of_instants_above_a_bias(seed, channels, length):
    windows = windows_of(seed, 3, channels, length)
    rocket = MiniRocket.learn(windows[:2], 168, seed)
    expected, distance = plain_features(rocket, windows[2])
    sure = distance > 1e-4
    assert sure.mean() > 0.9
    np.testing.assert_allclose(rocket.transform(windows)[2, sure], expected[sure], atol=1e-6)


@pytest.mark.parametrize(("length", "features"), [(60, 2500), (60, 84), (9, 500), (64, 10_000), (300, 5000)])
def test_dilations_fit_the_window_and_share_all_features(length, features):
    dilations, counts = choose_dilations(length, features)
    assert dilations[0] == 1 and (np.diff(dilations) > 0).all() and dilations[-1] * 8 < length
    assert counts.sum() == features // 84 and (counts >= 0).all()
    windows = windows_of(1, 3, 2, length)
    assert MiniRocket.learn(windows, features).transform(windows).shape == (3, features // 84 * 84)


def test_sums_of_channels_are_channels_of_summed_windows():
    windows, sums = windows_of(9, 12), np.random.default_rng(9).integers(-1, 2, (10, CHANNELS)).astype(np.float32)
    summed = np.einsum("sc,ncq->nsq", sums, windows)
    features = MiniRocket.learn(windows, 500, 3, sums).transform(windows)
    expected = MiniRocket.learn(summed, 500, 3).transform(summed)
    # A sum in another order may round differently where a convolution equals a bias.
    assert (np.abs(features - expected) > 1e-6).mean() < 0.02


def test_learning_repeats_with_the_same_seed_only():
    windows = windows_of(4)
    same, again, other = (MiniRocket.learn(windows, 500, seed).transform(windows) for seed in (1, 1, 2))
    assert (same == again).all() and not (same == other).all()


def test_biases_spread_over_the_training_windows():
    """Each feature of a training set is neither always 0 nor always 1, apart from few."""
    windows = windows_of(5, 40)
    features = MiniRocket.learn(windows, 2500).transform(windows)
    assert (features.std(axis=0) > 0).mean() > 0.95
    assert features.mean() == pytest.approx(0.5, abs=0.1)
