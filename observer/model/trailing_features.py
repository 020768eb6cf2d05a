"""Features of the motion up to now, over trailing windows of several lengths, from past frames only. Pure.

`TrailingFeatures` describes each trailing window of a trace (`features.py`) by the mean, least, greatest and spread
of positions and velocities, and by how often dilated convolutions exceed their biases (`rocket.py`; here causal, and
counted over windows that end now).
"""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Self

import numpy as np
from numpy.typing import NDArray

from observer.features import REFERENCE_HZ, relative_and_path
from observer.model.base import Arrays, array_in
from observer.model.rocket import GOLDEN_RATIO, KERNELS, TAPS, biases_of, choose_channels
from observer.tracks import Floats, Floats32, Integers

SHORTEST_S = 0.4
"""The shortest window of convolutions. One of postures is half as long."""
DOUBLINGS = 4
"""Each further window is twice as long, up to 6.4 s."""
LENGTHS_S = [SHORTEST_S * 2**n for n in range(DOUBLINGS + 1)]
LONGEST_CONVOLUTIONS, LONGEST_POSTURES = 1.5, 2.8
"""The longest windows, as multiples of the median movement's duration."""
WIDEST_KERNEL_S = 2.2
"""The longest time over which a kernel reaches."""


@dataclass(frozen=True, slots=True)
class Windows:
    """Lengths of trailing windows in frames, and the kernels' dilations."""

    convolutions: tuple[int, ...]
    postures: tuple[int, ...]
    dilations: tuple[int, ...]

    @classmethod
    def of(cls, rate_hz: float, median_s: float) -> Self:
        """For movements whose median duration is median_s seconds."""

        def frames(seconds: Iterable[float]) -> tuple[int, ...]:
            return tuple(sorted({max(round(s * rate_hz), 2) for s in seconds}))

        return cls(
            frames([SHORTEST_S, *(s for s in LENGTHS_S if s <= LONGEST_CONVOLUTIONS * median_s)]),
            frames([SHORTEST_S / 2, SHORTEST_S, *(s for s in LENGTHS_S if s <= LONGEST_POSTURES * median_s)]),
            tuple(d for d in (1, 2, 4, 8) if d == 1 or (TAPS - 1) * d <= WIDEST_KERNEL_S * rate_hz),
        )

    @property
    def history(self) -> int:
        """Frames before the newest that features depend on."""
        return max(max(self.convolutions) + (TAPS - 1) * max(self.dilations), max(self.postures))


class TrailingFeatures:
    """Reads features from traces; channels (D, 84, 2 P) and biases (D, 84) are learned."""

    def __init__(self, windows: Windows, rate_hz: float, channels: NDArray[np.bool_], biases: Floats32) -> None:
        self.windows, self._rate_hz, self._channels, self._biases = windows, rate_hz, channels, biases
        self._weights = [weights_of(own) for own in channels]
        values = channels.shape[2]
        self.convolutions = len(KERNELS) * len(windows.dilations) * len(windows.convolutions)
        """How many of the features, the first ones, are shares of convolutions; the others are statistics."""
        self.size = self.convolutions + 2 * values * (4 * len(windows.postures) + 1)

    @classmethod
    def learn(cls, windows: Windows, rate_hz: float, traces: Sequence[Floats32], seed: int = 0) -> Self:
        """Biases are quantiles of the convolutions of some traces (F, 2 P + 3)."""
        rng = np.random.default_rng(seed)
        paths = [relative_and_path(rows)[1] for rows in traces]
        channels = choose_channels(len(windows.dilations), paths[0].shape[1], rng)
        shown = [paths[n] for n in rng.permutation(len(paths))[:MOST_SHOWN]]
        quantiles = np.arange(1, len(KERNELS) + 1) * GOLDEN_RATIO % 1
        biases = []
        for dilation, own in zip(windows.dilations, channels, strict=True):
            rows = np.concatenate([_convolve(path, dilation, weights_of(own)) for path in shown])
            biases.append(biases_of(rows.T, np.roll(quantiles, dilation)[:, None])[:, 0])
        return cls(windows, rate_hz, channels, np.array(biases, np.float32))

    def of(self, rows: Floats32, at: Integers) -> Floats32:
        """(F, 2 P + 3) trace, (A,) frames -> (A, size); before its first row a trace is taken to be still."""
        relative, path = relative_and_path(rows)
        velocity = np.diff(path, axis=0, prepend=path[:1]) * np.float32(self._rate_hz / REFERENCE_HZ)
        values = np.concatenate([relative, velocity], axis=1)
        blocks = [*self._shares(path, at), *_statistics(values, at, self.windows.postures)]
        return np.concatenate(blocks, axis=1)

    def watch(self) -> "TrailingWatch":
        """Start watching a stream, row by row."""
        return TrailingWatch(self.windows, self._rate_hz, np.array(self._weights), self._biases)

    def _shares(self, path: Floats32, at: Integers) -> Iterable[Floats32]:
        for dilation, weights, biases in zip(self.windows.dilations, self._weights, self._biases, strict=True):
            above = _convolve(path, dilation, weights) > biases
            counts = np.zeros((len(path) + 1, len(biases)), np.float32)
            np.cumsum(above, axis=0, out=counts[1:])
            for length in self.windows.convolutions:
                begin = at + 1 - length
                # A still trace has convolutions of 0.
                missing = np.maximum(-begin, 0)[:, None] * (biases < 0)
                yield (counts[at + 1] - counts[np.maximum(begin, 0)] + missing.astype(np.float32)) / np.float32(length)

    def as_arrays(self) -> dict[str, NDArray[np.generic]]:
        """For a model file."""
        w = self.windows
        lengths = {"convolutions": w.convolutions, "postures": w.postures, "dilations": w.dilations}
        of_windows = {f"trailing_{name}": np.array(values) for name, values in lengths.items()}
        return {**of_windows, "trailing_channels": self._channels, "trailing_biases": self._biases}

    @classmethod
    def from_arrays(cls, arrays: Arrays, rate_hz: float, parts: int) -> Self:
        """The inverse of `as_arrays`; ValueError for arrays that do not fit P = `parts`."""
        names = ("convolutions", "postures", "dilations")
        # Longer ones would fill the memory.
        most = max(round(LENGTHS_S[-1] * rate_hz), 2)
        lengths = [array_in(arrays, f"trailing_{name}", (None,), np.int64).tolist() for name in names]
        if any(not own or own[0] < 1 or own[-1] > most or own != sorted({*own}) for own in lengths):
            raise ValueError(f"trailing windows {lengths}: increasing ones up to {most} are expected")
        shape = (len(lengths[2]), len(KERNELS))
        channels = array_in(arrays, "trailing_channels", (*shape, 2 * parts), np.bool_)
        biases = array_in(arrays, "trailing_biases", shape, np.float32)
        return cls(Windows(*map(tuple, lengths)), rate_hz, channels, biases)


class TrailingWatch:
    """The features of the newest row of a stream, as `TrailingFeatures.of` finds them in the whole recording.

    It keeps sums since the first row, and the extremes of each window: a row costs the same for short and long windows.
    """

    def __init__(self, windows: Windows, rate_hz: float, weights: Floats32, biases: Floats32) -> None:
        """weights (D, 9 * 2 P, 84) and biases (D, 84) of the convolutions."""
        dilations, taps, kernels = weights.shape
        self._weights, self._biases, self._rate = weights, biases, np.float32(rate_hz / REFERENCE_HZ)
        self._taps = np.array(windows.dilations)[:, None] * np.arange(1 - TAPS, 1)
        self._convolutions, self._postures = np.array(windows.convolutions), np.array(windows.postures)
        self._history, self._newest = windows.history, -1
        # Extremes of a window are those of shorter ones that overlap: how many frames before each of these ends.
        lengths = (1, *windows.postures)
        self._overlapping = [(*range(one, two - one, one), two - one) for one, two in pairwise(lengths)]
        # With twice the history it makes room once in a history.
        stored, path = 2 * self._history, taps // TAPS
        self._paths: Floats32 = np.zeros((stored, path), np.float32)
        self._counts: Floats32 = np.zeros((stored, dilations, kernels), np.float32)
        self._moments: Floats = np.zeros((stored, 2, 2 * path))
        self._extremes: Floats32 = np.zeros((stored, len(lengths), 2, 2 * path), np.float32)

    def update(self, row: Floats32) -> None:
        """One more row (2 P + 3,) of the trace."""
        path = (row[:-3].reshape(-1, 2) + row[-3:-1]).ravel()
        if self._newest < 0:
            self._begin(row[:-3], path)
        elif self._newest == len(self._paths) - 1:
            self._move_back()
        self._newest += 1
        n = self._newest
        self._paths[n] = path
        above = (
            np.matmul(self._paths[n + self._taps].reshape(len(self._taps), 1, -1), self._weights)[:, 0] > self._biases
        )
        np.add(self._counts[n - 1], above, out=self._counts[n])
        values = np.concatenate([row[:-3], (path - self._paths[n - 1]) * self._rate], dtype=np.float64)
        np.add(self._moments[n - 1], (values, np.square(values)), out=self._moments[n])
        extremes = self._extremes
        extremes[n, 0] = -values, values
        for level, before in enumerate(self._overlapping):
            np.maximum(extremes[n, level], extremes[n - before[0], level], out=extremes[n, level + 1])
            for frames in before[1:]:
                np.maximum(extremes[n, level + 1], extremes[n - frames, level], out=extremes[n, level + 1])

    def _begin(self, places: Floats32, path: Floats32) -> None:
        """Before its first row a trace is taken to be still."""
        self._newest = self._history - 1
        values = np.concatenate([places, np.zeros_like(path)], dtype=np.float64)
        frames = np.arange(self._history)
        self._paths[: self._history] = path
        self._counts[: self._history] = frames[:, None, None] * (self._biases < 0)
        self._moments[: self._history] = frames[:, None, None] * np.array([values, np.square(values)])
        self._extremes[: self._history] = -values, values

    def _move_back(self) -> None:
        """Make room; sums begin anew, so that they stay accurate."""
        for stored in (self._paths, self._counts, self._moments, self._extremes):
            stored[: self._history] = stored[-self._history :]
        for sums in (self._counts, self._moments):
            sums[: self._history] -= sums[0].copy()
        self._newest = self._history - 1

    def features(self) -> Floats32:
        """(size,) the features of the newest row; there is at least one."""
        n, lengths = self._newest, self._convolutions[:, None]
        shares = (self._counts[n] - self._counts[n - self._convolutions]).transpose(1, 0, 2) / np.float32(lengths)
        moments = self._moments[n] - self._moments[n - self._postures]
        moments /= self._postures[:, None, None]
        mean, squares = moments[:, 0], moments[:, 1]
        spread = np.sqrt(np.maximum(squares - np.square(mean), 0.0))
        least, greatest = -self._extremes[n, 1:, 0], self._extremes[n, 1:, 1]
        of_postures = np.stack([mean, least, greatest, spread], axis=1)
        return np.concatenate([shares.ravel(), self._extremes[n, 0, 1], of_postures.ravel()], dtype=np.float32)


MOST_SHOWN = 48
"""Traces whose convolutions tell the quantiles for the biases."""


def weights_of(channels: NDArray[np.bool_]) -> Floats32:
    """(84, C) whether a kernel adds a channel -> (9 * C, 84) weights of one matrix product."""
    weights = KERNELS.T[:, None, :] * channels.T[None]
    return np.ascontiguousarray(weights.reshape(-1, len(KERNELS)), dtype=np.float32)


def _convolve(path: Floats32, dilation: int, weights: Floats32) -> Floats32:
    """(F, C) -> (F, 84) causal convolutions: the last tap is the frame itself; earlier frames are like the first."""
    reach = (TAPS - 1) * dilation
    padded = np.concatenate([np.repeat(path[:1], reach, axis=0), path])
    result: Floats32 = _taps(padded, dilation, len(path)) @ weights
    return result


def _taps(padded: Floats32, dilation: int, frames: int) -> Floats32:
    """(8 * dilation + frames, C) -> (frames, 9 * C): the nine frames that a kernel weighs, the frame itself last."""
    by_frame, by_channel = padded.strides
    shape, strides = (TAPS, padded.shape[1], frames), (by_frame * dilation, by_channel, by_frame)
    taps: Floats32 = np.ndarray(shape, np.float32, padded, strides=strides)
    return taps.reshape(-1, frames).T


def _statistics(values: Floats32, at: Integers, lengths: Sequence[int]) -> list[Floats32]:
    """(F, C) -> blocks (A, C): the newest, and per window the mean, least, greatest and standard deviation."""
    longest = max(lengths)
    padded = np.concatenate([np.repeat(values[:1], longest, axis=0), values])
    blocks = [values[at]]
    for length in lengths:
        window = np.lib.stride_tricks.sliding_window_view(padded, length, axis=0)[at + 1 + longest - length]
        blocks += [window.mean(axis=2), window.min(axis=2), window.max(axis=2), window.std(axis=2)]
    return blocks
