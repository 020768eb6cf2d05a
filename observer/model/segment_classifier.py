"""Judges the window from the begin of a movement until now, stretched to a fixed length, by MiniRocket and regressions.

One part is for movements in progress, one for movements that have ended, one tells which of the two applies.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Self

import numpy as np
from numpy.typing import NDArray

from observer.model.base import Arrays, Example
from observer.model.logistic import LogisticRegression
from observer.model.rocket import MiniRocket
from observer.model.training_rows import FRACTIONS, segment_window

Floats32 = NDArray[np.float32]

LENGTH = 60
"""Points to which the window from begin to now is stretched."""
ENDED_FROM = 0.8
FEWER_ROWS = 5
"""Ended movements have fewer rows than those in progress; their loss counts more, so that the penalty is alike."""


@dataclass(frozen=True, slots=True, eq=False)
class SegmentClassifier:
    """P(movement | window from begin to now), for movements in progress and ended ones, and P(ended)."""

    rocket: MiniRocket
    running: LogisticRegression
    ended: LogisticRegression
    completion: LogisticRegression

    @classmethod
    def learn(
        cls, examples: Sequence[Example], traces: Sequence[Floats32], movements: int, parameters: Mapping[str, float]
    ) -> Self:
        """From the examples of movements, cut off at ten fractions."""
        own = [(e.movement, t) for e, t in zip(examples, traces, strict=True) if e.movement >= 0]
        cuts = [trace[: max(round(f * len(trace)), 1)] for _, trace in own for f in FRACTIONS]
        windows = np.array([segment_window(cut, LENGTH) for cut in cuts])
        whole = windows[len(FRACTIONS) - 1 :: len(FRACTIONS)]
        rocket = MiniRocket.learn(whole, int(parameters["kernels"]), seed=0)
        features = _with_length(rocket.transform(windows), np.array([len(cut) for cut in cuts]))
        movement_of = np.repeat([movement for movement, _ in own], len(FRACTIONS))
        targets = np.eye(movements, dtype=np.float32)[movement_of]
        fraction = np.tile(FRACTIONS, len(own))
        late = fraction >= ENDED_FROM
        c = parameters["inverse_penalty"]
        ended = np.clip((fraction - 0.7) / 0.25, 0, 1).astype(np.float32)
        ones = np.ones(len(features), np.float32)
        return cls(
            rocket,
            LogisticRegression.learn(features, targets, ones, c),
            LogisticRegression.learn(features[late], targets[late], ones[late], c * FEWER_ROWS),
            LogisticRegression.learn(features, np.stack([1 - ended, ended], axis=1), ones, c / 5),
        )

    def log_posterior(self, rows: Floats32, ended: bool) -> Floats32:
        """(F, 2 P + 3) since the begin -> (M,) log probabilities, not normalised. ended: the movement is over."""
        window = segment_window(rows, LENGTH)[None]
        features = _with_length(self.rocket.transform(window), np.array([len(rows)]))[0]
        over = self.ended.log_probabilities(features)
        if ended:
            return over
        share = np.exp(self.completion.log_probabilities(features)[1])
        result: Floats32 = (1 - share) * self.running.log_probabilities(features) + share * over
        return result

    @classmethod
    def from_arrays(cls, arrays: Arrays, movements: int, parts: int) -> Self:
        """The inverse of `arrays`; ValueError if they do not fit."""
        rocket = MiniRocket.from_arrays(arrays)
        if rocket.parameters.channels.shape[2] != 2 * parts:
            raise ValueError(f"rocket_channels do not fit {parts} parts")
        size = rocket.features + 1
        return cls(
            rocket,
            LogisticRegression.from_arrays("running", arrays, (size, movements)),
            LogisticRegression.from_arrays("ended", arrays, (size, movements)),
            LogisticRegression.from_arrays("completion", arrays, (size, 2)),
        )

    def arrays(self) -> dict[str, NDArray[np.generic]]:
        """For a model file."""
        return {
            **self.rocket.as_arrays(),
            **self.running.as_arrays("running"),
            **self.ended.as_arrays("ended"),
            **self.completion.as_arrays("completion"),
        }


def _with_length(features: Floats32, frames: NDArray[np.int64]) -> Floats32:
    lengths = np.log(frames.astype(np.float32))[:, None]
    return np.concatenate([features, lengths], axis=1)
