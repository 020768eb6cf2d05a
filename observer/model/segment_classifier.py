"""Judges the window from the begin of a movement until now, stretched to a fixed length, by MiniRocket and regressions.

One regression is for movements in progress, one for movements that have ended.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Self

import numpy as np
from numpy.typing import NDArray

from observer.features import places_and_differences, resampled
from observer.model.base import Arrays, Example
from observer.model.logistic import LogisticRegression
from observer.model.rocket import MiniRocket
from observer.model.training_rows import LEARNED_FRACTIONS
from observer.tracks import Floats32, Integers

LENGTH = 60
"""Points to which the window from begin to now is stretched."""
ENDED_FROM = 0.8
"""Share of a movement from which a window shows it as an ended one."""
FEWER_ROWS = 5
"""Ended movements have fewer rows than those in progress; their loss counts more, so that the penalty is alike."""


@dataclass(frozen=True, slots=True, eq=False)
class SegmentClassifier:
    """P(movement | window from begin to now), for movements in progress and for ended ones."""

    rocket: MiniRocket
    running: LogisticRegression
    ended: LogisticRegression

    def log_posteriors(self, segments: Sequence[Floats32]) -> Floats32:
        """N segments (F, 2 P + 3) since the begin -> (2, N, M) log probabilities if it is in progress, and ended."""
        windows = np.array([segment_window(rows, LENGTH) for rows in segments])
        features = _with_length(self.rocket.transform(windows), np.array([*map(len, segments)]))
        return np.stack([self.running.log_probabilities(features), self.ended.log_probabilities(features)])

    @classmethod
    def from_arrays(cls, arrays: Arrays, movements: int, parts: int) -> Self:
        """The inverse of `arrays`; ValueError if they do not fit."""
        rocket = MiniRocket.from_arrays(arrays)
        if rocket.length != LENGTH or rocket.channels.shape[2:] != (2 * parts,):
            raise ValueError(f"rocket_length, rocket_channels do not fit {LENGTH} frames of {parts} parts")
        size = rocket.features + 1
        return cls(
            rocket,
            LogisticRegression.from_arrays("running", arrays, (size, movements)),
            LogisticRegression.from_arrays("ended", arrays, (size, movements)),
        )

    def arrays(self) -> dict[str, NDArray[np.generic]]:
        """For a model file."""
        return {
            **self.rocket.as_arrays(),
            **self.running.as_arrays("running"),
            **self.ended.as_arrays("ended"),
        }


@dataclass(frozen=True, slots=True, eq=False)
class SegmentTable:
    """All windows to learn from: those of each example of a movement, cut off at ten fractions.

    features (N, D), movement_of (N,), fraction (N,) of the movement, and example_of (N,), the example's index.
    """

    rocket: MiniRocket
    features: Floats32
    movement_of: Integers
    fraction: NDArray[np.float64]
    example_of: Integers

    @classmethod
    def of(cls, examples: Sequence[Example], traces: Sequence[Floats32], kernels: int, seed: int = 0) -> Self:
        """From the examples and their traces (F, 2 P + 3). seed: of the kernels."""
        own = [n for n, example in enumerate(examples) if example.movement >= 0]
        cuts = [traces[n][: max(round(f * len(traces[n])), 1)] for n in own for f in LEARNED_FRACTIONS]
        windows = np.array([segment_window(cut, LENGTH) for cut in cuts])
        sums = places_and_differences(windows.shape[1] // 2)
        rocket = MiniRocket.learn(windows[len(LEARNED_FRACTIONS) - 1 :: len(LEARNED_FRACTIONS)], kernels, seed, sums)
        return cls(
            rocket,
            _with_length(rocket.transform(windows), np.array([len(cut) for cut in cuts])),
            np.repeat([examples[n].movement for n in own], len(LEARNED_FRACTIONS)),
            np.tile(LEARNED_FRACTIONS, len(own)),
            np.repeat(own, len(LEARNED_FRACTIONS)),
        )

    def learn(
        self, chosen: NDArray[np.bool_], movements: int, inverse_penalty: float, iterations: int
    ) -> SegmentClassifier:
        """From the chosen (N,) windows."""
        late = chosen & (self.fraction >= ENDED_FROM)
        targets = np.eye(movements, dtype=np.float32)[self.movement_of]

        running, ended = (
            LogisticRegression.learn(self.features[rows], targets[rows], c, iterations)
            for rows, c in ((chosen, inverse_penalty), (late, inverse_penalty * FEWER_ROWS))
        )
        return SegmentClassifier(self.rocket, running, ended)


def _with_length(features: Floats32, frames: NDArray[np.int64]) -> Floats32:
    lengths = np.log(frames.astype(np.float32))[:, None]
    return np.concatenate([features, lengths], axis=1)


def segment_window(trace: Floats32, length: int) -> Floats32:
    """(F, 2 P + 3) from a movement's begin to now -> (2 P, length) positions relative to the body's at the begin.

    All are in body sizes of now: what the size was taken to be in between must not change the motion's shape.
    """
    size = trace[:, -1:] / trace[-1, -1]
    places = trace[:, :-3] * size
    steps = np.zeros((len(trace), 2), np.float32)
    steps[1:] = (trace[1:, -3:-1] - trace[:-1, -3:-1]) * size[1:]
    places.reshape(len(trace), -1, 2)[...] += np.cumsum(steps, axis=0)[:, None]
    result: Floats32 = resampled(places, length).T
    return result
