"""MiniRocket: a fixed bank of convolutions that turns a stretched window of motion into features. Pure.

Dempster, Schmidt and Webb, "MiniRocket: a very fast (almost) deterministic transform for time series classification",
KDD 2021. The 84 kernels have length 9, three weights 2 and six weights -1. Each is dilated; a feature is the share of
the window's instants at which the convolution exceeds a bias, which is a quantile of the convolution of a training
window. In a window of several channels each pair of kernel and dilation sums over a random few of them, as in aeon.
"""

from collections.abc import Sequence
from functools import lru_cache
from itertools import combinations
from typing import Self

import numpy as np
from numpy.typing import NDArray

from observer.model.base import Arrays, array_in
from observer.tracks import Floats32, Integers

TAPS = 9
"""Weights of a kernel, and at most as many channels are summed; MOST_DILATIONS is the paper's number too."""
KERNELS = np.full((84, TAPS), -1, dtype=np.float32)
"""(84, 9) weights: every choice of three positions has weight 2, the rest has -1; the sum is 0."""
for _row, _twos in enumerate(combinations(range(TAPS), 3)):
    KERNELS[_row, list(_twos)] = 2
MOST_DILATIONS = 32
GOLDEN_RATIO = (5**0.5 + 1) / 2
FLOAT32_ROUNDING = TAPS**2 * float(np.finfo(np.float32).eps)
"""Body sizes: the rounding of a convolution, of at most 9 channels at 9 taps. Places are of the order of 1."""


def choose_dilations(length: int, features: int) -> tuple[Integers, Integers]:
    """(D,) dilations for windows of `length` frames, evenly spaced in their logarithm, and (D,) biases per kernel.

    The last dilation lets a kernel span the window at most. length: at least 9; features: at least 84.
    """
    per_kernel = features // len(KERNELS)
    most = min(per_kernel, MOST_DILATIONS)
    spaced = np.logspace(0, np.log2((length - 1) / (TAPS - 1)), most, base=2).astype(np.int64)
    dilations, times = np.unique(spaced, return_counts=True)
    counts = (times * (per_kernel / most)).astype(np.int64)
    # Rounding down leaves some; the small dilations get them.
    rest = per_kernel - int(counts.sum())
    counts += rest // len(counts) + (np.arange(len(counts)) < rest % len(counts))
    return dilations, counts


class MiniRocket:
    """The transform of windows of n frames. Its features are ordered by dilation, number of the bias, and kernel.

    dilations (D,): frames between neighbouring weights. channels (D, 84, C): how often a kernel adds a channel.
    biases: D arrays (B, 84), each with its own number B of biases for every kernel of that dilation. features: how many
    there are, a multiple of 84.
    """

    def __init__(self, length: int, dilations: Integers, channels: Floats32, biases: Sequence[Floats32]) -> None:
        self.length, self.dilations, self.channels, self.biases = length, dilations, channels, tuple(biases)
        self.features = sum(bias.size for bias in biases)
        self._margins = [int(dilation) * (TAPS // 2) for dilation in dilations]
        steps = zip(self._margins, biases, strict=True)
        limits = [_limits(length, *step, number) for number, step in enumerate(steps)]
        shares = [1 / np.isfinite(limit).sum(axis=1) for limit in limits]
        self._shares: Floats32 = np.concatenate([share.ravel() for share in shares]).astype(np.float32)
        # Compared with a row of all instants at once.
        self._limits = [limit.reshape(len(limit), -1) for limit in limits]
        self._counter = np.uint8 if length <= np.iinfo(np.uint8).max else np.uint32

    @classmethod
    def learn(cls, windows: NDArray[np.floating], features: int, seed: int = 0, sums: Floats32 | None = None) -> Self:
        """From (N, C, n) training windows without NaN; `features` is rounded down to a multiple of 84.

        sums (S, C): sums of channels that kernels choose from instead of the channels. Convolutions are linear, so that
        this costs nothing later. The same windows and seed give the same transform.
        """
        windows = np.asarray(windows, dtype=np.float32)
        dilations, counts = choose_dilations(windows.shape[2], features)
        rng = np.random.default_rng(seed)
        sums = np.eye(windows.shape[1], dtype=np.float32) if sums is None else sums
        channels = choose_channels(len(dilations), len(sums), rng).astype(np.float32) @ sums
        quantiles = np.arange(1, counts.sum() * len(KERNELS) + 1) * GOLDEN_RATIO % 1
        ends = np.cumsum(counts * len(KERNELS))
        biases = []
        for dilation, own, quantile in zip(dilations, channels, np.split(quantiles, ends[:-1]), strict=True):
            shown = windows[rng.integers(len(windows), size=len(KERNELS))]
            # Of each kernel its own window.
            convolved = np.einsum("kqk->kq", convolve(shown, own, int(dilation)))
            bias = biases_of(convolved, quantile.reshape(len(KERNELS), -1)).T
            biases.append(bias.astype(np.float32, order="C"))
        return cls(windows.shape[2], dilations, channels, biases)

    def transform(self, windows: NDArray[np.floating]) -> Floats32:
        """(N, C, n) windows without NaN, as many channels and frames as were learned -> (N, features): 0 to 1."""
        return np.array([self._counts(window) for window in windows], np.float32) * self._shares

    def _counts(self, window: NDArray[np.floating]) -> NDArray[np.unsignedinteger]:
        """(C, n) -> (features,): at how many instants each convolution exceeds each bias."""
        begin, above = 0, np.empty((self.features // len(KERNELS), self.length * len(KERNELS)), np.bool_)
        for channels, dilation, limits in zip(self.channels, self.dilations.tolist(), self._limits, strict=True):
            end = begin + len(limits)
            np.greater(convolve(window[None], channels, dilation).reshape(1, -1), limits, out=above[begin:end])
            begin = end
        # Faster than a sum over the axis.
        by_instant = above.view(np.uint8).reshape(len(above), self.length, -1)
        counts: NDArray[np.unsignedinteger] = np.einsum("bqk->bk", by_instant, dtype=self._counter).ravel()
        return counts

    def as_arrays(self) -> dict[str, NDArray[np.generic]]:
        """For a model file; `from_arrays` reads them."""
        return {
            "rocket_length": np.int64(self.length).reshape(1),
            "rocket_dilations": self.dilations,
            "rocket_channels": self.channels,
            "rocket_counts": np.array([len(bias) for bias in self.biases]),
            "rocket_biases": np.concatenate([bias.ravel() for bias in self.biases]),
        }

    @classmethod
    def from_arrays(cls, arrays: Arrays) -> Self:
        """From the arrays of `as_arrays`; ValueError for arrays that do not fit or are not finite."""
        counts = array_in(arrays, "rocket_counts", (None,), np.int64)
        dilations = array_in(arrays, "rocket_dilations", counts.shape, np.int64)
        channels = array_in(arrays, "rocket_channels", (len(counts), len(KERNELS), None), np.float32)
        length = int(array_in(arrays, "rocket_length", (1,), np.int64)[0])
        if not ((dilations > 0) & (counts > 0)).all() or not dilations.max() * (TAPS - 1) < length:
            raise ValueError(f"rocket_dilations do not fit windows of {length} frames")
        ends = np.cumsum(counts)
        rows = array_in(arrays, "rocket_biases", (int(ends[-1]) * len(KERNELS),), np.float32).reshape(-1, len(KERNELS))
        return cls(length, dilations, channels, np.split(rows, ends[:-1]))


def choose_channels(dilations: int, channels: int, rng: np.random.Generator) -> NDArray[np.bool_]:
    """(D, 84, C): each pair of dilation and kernel gets 1 to 9 random channels, few more often than many."""
    most = np.log2(min(channels, TAPS) + 1)
    counts = (2 ** rng.uniform(0, most, (dilations, len(KERNELS)))).astype(np.int64)
    ranks = rng.random((dilations, len(KERNELS), channels)).argsort(axis=2).argsort(axis=2)
    return ranks < counts[:, :, None]


def convolve(windows: NDArray[np.floating], channels: NDArray[np.floating], dilation: int) -> Floats32:
    """(N, C, n) windows and (84, C) how often a kernel adds a channel -> (N, n, 84); a window is 0 outside.

    Channels are added first, so that the taps of a kernel weigh one row, however many channels there are.
    """
    count, _, length = windows.shape
    margin, kernels = dilation * (TAPS // 2), len(KERNELS)
    sums = np.zeros((count, length + 2 * margin, kernels), np.float32)
    np.matmul(windows.transpose(0, 2, 1), channels.T, out=sums[:, margin : margin + length])
    by_window, by_frame, by_kernel = sums.strides
    shape, strides = (count, TAPS, length * kernels), (by_window, by_frame * dilation, by_kernel)
    taps: Floats32 = np.ndarray(shape, np.float32, sums, strides=strides)
    result: Floats32 = np.einsum("ntx,tx->nx", taps, _tap_weights(length))
    return result.reshape(count, length, kernels)


@lru_cache(maxsize=8)
def _tap_weights(length: int) -> Floats32:
    """(9, n * 84): the weights of each tap at all instants."""
    return np.tile(KERNELS.T, length)


def biases_of(rows: NDArray[np.floating], quantiles: NDArray[np.floating]) -> NDArray[np.float64]:
    """(K, n) convolutions, (K, Q) quantiles of each -> (K, Q); a person who is still has 0, but for rounding."""
    bias = np.array([np.quantile(row, own) for row, own in zip(rows.astype(np.float64), quantiles, strict=True)])
    return np.where(np.abs(bias) < FLOAT32_ROUNDING, FLOAT32_ROUNDING, bias)


def _limits(length: int, margin: int, biases: Floats32, number: int) -> Floats32:
    """(B, 84) biases -> (B, length, 84) what a convolution must exceed at each instant.

    Every other kernel judges only the instants at which it lies inside the window: the limit at others is infinite.
    """
    limits = np.repeat(biases[:, None], length, axis=1)
    outer = limits[:, :, 1 - number % 2 :: 2]
    outer[:, :margin] = np.inf
    outer[:, length - margin :] = np.inf
    return limits
