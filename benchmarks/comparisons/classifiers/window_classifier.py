"""Tells windows of movements and of something else apart, for one view of continuous recordings: MiniRocket of aeon."""

import warnings
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from benchmarks.comparisons.classifiers.comparison import PeerOptions
from benchmarks.comparisons.classifiers.panels import (
    body_sizes,
    bridge_gaps,
    from_first_anchor,
    resample_rows,
    view_centres,
)
from benchmarks.comparisons.classifiers.spotter_windows import LENGTHS, SHORTEST, choose_windows, window_lengths
from observer.geometry.views import View
from observer.motion.archive import Recording
from observer.tracks import Floats
from studies.settings import EvaluationSettings

FRAMES = 60
KERNELS, KERNELS_FAST = 2500, 168
PENALTY = 0.002
"""C of the logistic regression, on standardised features."""
STEP_S = 4 / 30


@dataclass(frozen=True, slots=True, eq=False)
class SpotterPart:
    """What one view learns from, and what it judges; all recordings are continuous."""

    view: View
    recorded: tuple[str, ...]
    settings: EvaluationSettings
    learned: Sequence[Recording]
    judged: Sequence[Recording]
    options: PeerOptions


@dataclass(frozen=True, slots=True, eq=False)
class StreamProbabilities:
    """frames (T,): where the windows end; p (T, LENGTHS, M + 1), something else last."""

    frames: NDArray[np.int64]
    p: Floats


def step_frames(rate_hz: float) -> int:
    """Frames between two windows of one length."""
    return max(round(STEP_S * rate_hz), 1)


class _ViewStream:
    """A stream as one view sees it: windows as a classifier wants them."""

    def __init__(self, stream: Recording, part: SpotterPart) -> None:
        self._parts = part.settings.body_parts or part.recorded
        self._centres = view_centres(stream, [part.view], part.recorded, self._parts)[0]
        self._sizes = body_sizes(self._centres, self._parts)

    def windows(self, begins: Sequence[int], ends: Sequence[int]) -> tuple[Floats, Floats]:
        """(N, C, FRAMES) positions from the first anchor, in body sizes; (N, C + 1) log duration and path lengths."""
        series, extras = zip(*(self._window(*window) for window in zip(begins, ends, strict=True)), strict=True)
        return np.array(series), np.array(extras)

    def _window(self, begin: int, end: int) -> tuple[Floats, Floats]:
        places = from_first_anchor(self._centres[begin:end], float(self._sizes[end - 1]), self._parts)
        rows = bridge_gaps(places.reshape(end - begin, -1).T)
        paths = np.abs(np.diff(rows, axis=1)).sum(axis=1)
        return resample_rows(rows, FRAMES), np.array([np.log(end - begin), *np.log(paths + 0.05)])


def judge_part(part: SpotterPart) -> list[StreamProbabilities]:
    """Learn from the training people's streams; the probabilities in each judged stream."""
    classifier = WindowClassifier(part)
    return [classifier.probabilities(stream) for stream in part.judged]


class WindowClassifier:
    """Tells windows of movements and of something else apart, for one view."""

    def __init__(self, part: SpotterPart) -> None:
        from aeon.transformations.collection.convolution_based import MiniRocket
        from sklearn.linear_model import LogisticRegression
        from sklearn.pipeline import make_pipeline
        from sklearn.preprocessing import StandardScaler

        self._part = part
        self._lengths_s = window_lengths(part.learned)
        labels, seed = part.settings.labels, part.options.seeds[0]
        rng = np.random.default_rng(seed)
        chosen = [choose_windows(stream, self._lengths_s, labels, rng) for stream in part.learned]
        shown = [
            _ViewStream(stream, part).windows([w.begin for w in own], [w.end for w in own])
            for stream, own in zip(part.learned, chosen, strict=True)
        ]
        self._rocket = MiniRocket(n_kernels=KERNELS_FAST if part.options.fast else KERNELS, random_state=seed)
        with warnings.catch_warnings():
            # The anchor's first position is 0 in every window, and a still part hardly varies.
            warnings.filterwarnings("ignore", ".*with very little variation")
            self._rocket.fit(np.concatenate([series for series, _ in shown]))
        self._classifier = make_pipeline(StandardScaler(), LogisticRegression(C=PENALTY, max_iter=200, tol=1e-3))
        features = np.concatenate([self._features(*own) for own in shown])
        self._classifier.fit(features, np.array([w.movement for own in chosen for w in own]))

    def _features(self, series: Floats, extras: Floats) -> NDArray[np.float32]:
        with warnings.catch_warnings():
            warnings.filterwarnings("ignore", ".*with very little variation")
            return np.hstack([np.asarray(self._rocket.transform(series)), extras]).astype(np.float32)

    def probabilities(self, stream: Recording) -> StreamProbabilities:
        """For windows that end every STEP_S, from when the shortest one is full."""
        rate = stream.rate_hz
        lengths = np.maximum((self._lengths_s * rate).astype(np.int64), SHORTEST)
        frames = np.arange(lengths[0] - 1, len(stream.positions), step_frames(rate))
        ends = np.repeat(frames + 1, LENGTHS)
        begins = np.maximum(ends - np.tile(lengths, len(frames)), 0)
        windows = _ViewStream(stream, self._part).windows(begins.tolist(), ends.tolist())
        p = np.zeros((len(ends), len(self._part.settings.labels) + 1))
        p[:, self._classifier[-1].classes_] = self._classifier.predict_proba(self._features(*windows))
        return StreamProbabilities(frames, p.reshape(len(frames), LENGTHS, -1))
