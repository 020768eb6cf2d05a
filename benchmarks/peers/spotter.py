"""A sliding-window MiniRocket that spots movements in continuous recordings, beside our observers on the same streams.

Windows of several lengths that end now are stretched to one length. A classifier for each view tells the movements and
"something else" apart: what the training people do outside the labelled spans. The probabilities of the views are
multiplied. A verdict falls when a movement's probability, in the best of the windows, exceeds a threshold in two steps
in a row; the movement is armed again after 1.5 s below half of it. The window lengths follow from the training people's
spans, the threshold is the best one for a training person whom the classifiers do not know.
"""

import warnings
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from benchmarks.peers.comparison import PeerOptions
from benchmarks.peers.panels import body_sizes, bridge_gaps, from_first_head, resample_rows, view_centres
from common.errors import BadInput
from observer.geometry.views import View
from observer.motion.archive import MotionArchive, Recording, Span
from observer.tracks import BODY_PARTS, Floats
from studies.evaluate import EvaluationSettings, folds_of
from studies.parallel import run_parts
from studies.spotting import SpottingScore, StreamVerdict, score

FRAMES = 60
KERNELS, KERNELS_FAST = 2500, 168
PENALTY = 0.002
"""C of the logistic regression, on standardised features."""
STEP_S = 4 / 30
LENGTHS = 5
SHORTEST = 6
"""Frames of the shortest window."""
JITTER = 0.08
JITTERED = 6
"""Windows per span whose ends are moved by JITTER of its length."""
PREFIXES = (0.5, 0.65, 0.8)
"""So that a movement is recognised before it ends."""
ELSEWHERE = 14
"""Windows per span from anywhere else: something else."""
MOST_OVERLAP = 0.25
"""Intersection over union of such a window with a span."""
MOST_INSIDE = 0.5
"""The largest share of such a window that lies in a span."""
DOUBT = 1e-4
"""Added to a view's probabilities before they are multiplied, so that none has a veto."""
HOLD, REARM_S = 2, 1.5
THRESHOLDS = (0.3, 0.4, 0.5, 0.6, 0.7, 0.8, 0.9)


@dataclass(frozen=True, slots=True, eq=False)
class LabelledWindow:
    """Frames begin..end-1 of a stream; movement: its index, M for something else."""

    begin: int
    end: int
    movement: int


@dataclass(frozen=True, slots=True)
class SpotterFold:
    """The training people, the people who are judged, and the training person for whom the threshold is chosen."""

    train: frozenset[str]
    judged: frozenset[str]
    held: str


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


def spot_streams(
    archive: MotionArchive, settings: EvaluationSettings, options: PeerOptions, done: Callable[[int, int], None]
) -> SpottingScore:
    """The score over the streams of all test people; raises BadInput for an archive without continuous recordings."""
    streams = [recording for recording in archive.recordings if recording.spans]
    if not streams:
        raise BadInput("no continuous recording: a spotter needs spans within longer recordings")
    folds = _folds(archive, settings)
    # Two neighbours who are left out for each other share their classifiers.
    groups = list(dict.fromkeys(group for fold in folds for group in _groups(fold)))
    parts = [
        SpotterPart(
            view,
            archive.body_parts,
            settings,
            [stream for stream in streams if stream.subject in train],
            [stream for stream in streams if stream.subject in judged],
            options,
        )
        for train, judged in groups
        for view in settings.views
    ]
    by_part = run_parts(judge_part, parts, options.jobs, done)
    views = len(settings.views)
    known = {
        group: list(zip(parts[n * views].judged, _multiplied(by_part[n * views : (n + 1) * views]), strict=True))
        for n, group in enumerate(groups)
    }
    total = SpottingScore()
    for fold in folds:
        final, choosing = (known[group] for group in _groups(fold))
        held = [(stream, p) for stream, p in choosing if stream.subject == fold.held]
        best = max(THRESHOLDS, key=lambda threshold: score_of(held, settings.labels, threshold).f1)
        total = total.plus(score_of(final, settings.labels, best))
    return total


def _folds(archive: MotionArchive, settings: EvaluationSettings) -> list[SpotterFold]:
    folds = []
    for number, split in enumerate(folds_of(archive, settings, settings.labels)):
        train = sorted({r.subject for r in split.train.recordings}, key=lambda s: (len(s), s))
        held = train[min(number // 2 * 2, len(train) - 1)]
        folds.append(SpotterFold(frozenset(train), frozenset(r.subject for r in split.test), held))
    return folds


def _groups(fold: SpotterFold) -> list[tuple[frozenset[str], frozenset[str]]]:
    """The people who are learned from and those who are judged: for the figures, then for the threshold."""
    return [(fold.train, fold.judged), (fold.train - {fold.held}, fold.judged | {fold.held})]


def _multiplied(by_view: Sequence[Sequence[StreamProbabilities]]) -> list[StreamProbabilities]:
    result = []
    for views in zip(*by_view, strict=True):
        product = np.prod([view.p + DOUBT for view in views], axis=0)
        result.append(StreamProbabilities(views[0].frames, product / product.sum(axis=2, keepdims=True)))
    return result


def score_of(
    streams: Sequence[tuple[Recording, StreamProbabilities]], labels: Sequence[str], threshold: float
) -> SpottingScore:
    """The score of the verdicts on all streams."""
    total = SpottingScore()
    for stream, probabilities in streams:
        total = total.plus(score(verdicts_of(probabilities, stream.rate_hz, labels, threshold), stream, labels))
    return total


def verdicts_of(
    probabilities: StreamProbabilities, rate_hz: float, labels: Sequence[str], threshold: float
) -> list[StreamVerdict]:
    """A verdict when a movement is above the threshold in HOLD steps; the next of it when armed again."""
    verdicts = []
    above = np.zeros(len(labels), dtype=np.int64)
    below_s = np.zeros(len(labels))
    armed = np.ones(len(labels), dtype=np.bool_)
    step_s = step_frames(rate_hz) / rate_hz
    for frame, p in zip(probabilities.frames, probabilities.p[:, :, :-1].max(axis=1), strict=True):
        above = np.where(p > threshold, above + 1, 0)
        below_s = np.where(p < threshold / 2, below_s + step_s, 0.0)
        armed |= below_s > REARM_S
        best = int(p.argmax())
        if above[best] >= HOLD and armed[best]:
            verdicts.append(StreamVerdict(labels[best], frame / rate_hz, labels[best]))
            armed[best] = False
    return verdicts


def step_frames(rate_hz: float) -> int:
    """Frames between two windows of one length."""
    return max(round(STEP_S * rate_hz), 1)


def window_lengths(streams: Sequence[Recording]) -> Floats:
    """(LENGTHS,) seconds, evenly spaced in their logarithm, around the lengths of the spans."""
    seconds = [(span.end - span.start) / stream.rate_hz for stream in streams for span in stream.spans]
    low, high = np.quantile(seconds, [0.1, 0.9])
    lengths: Floats = np.geomspace(0.5 * low, 1.4 * high, LENGTHS)
    return lengths


def choose_windows(
    stream: Recording, lengths_s: Floats, labels: Sequence[str], rng: np.random.Generator
) -> list[LabelledWindow]:
    """Training windows: every span with both ends moved a little, its first parts, and windows of something else."""
    windows = []
    for span in stream.spans:
        length, movement = span.end - span.start, labels.index(span.label)
        for begin, end in rng.normal(0, JITTER * length, (JITTERED, 2)):
            windows.append(LabelledWindow(int(span.start + begin), int(span.end + end), movement))
        for share in PREFIXES:
            before = 0.1 * length * rng.random()
            windows.append(LabelledWindow(int(span.start - before), int(span.start + share * length), movement))
    frames = len(stream.positions)
    within = [
        LabelledWindow(max(w.begin, 0), min(max(w.end, max(w.begin, 0) + SHORTEST), frames), w.movement)
        for w in windows
    ]
    return [w for w in within if w.end - w.begin >= SHORTEST] + _elsewhere(stream, lengths_s, len(labels), rng)


def _elsewhere(stream: Recording, lengths_s: Floats, movement: int, rng: np.random.Generator) -> list[LabelledWindow]:
    windows: list[LabelledWindow] = []
    wanted, frames = ELSEWHERE * len(stream.spans), len(stream.positions)
    for _ in range(50 * wanted):
        length = max(int(rng.choice(lengths_s) * stream.rate_hz), SHORTEST)
        if len(windows) == wanted or length >= frames:
            continue
        begin = int(rng.integers(frames - length))
        if all(is_elsewhere(begin, begin + length, span) for span in stream.spans):
            windows.append(LabelledWindow(begin, begin + length, movement))
    return windows


def is_elsewhere(begin: int, end: int, span: Span) -> bool:
    """Whether the frames begin..end-1 show too little of the span to be it, or a part of it."""
    common = max(0, min(end, span.end) - max(begin, span.start))
    union = max(end, span.end) - min(begin, span.start)
    return common / union < MOST_OVERLAP and common / (end - begin) < MOST_INSIDE


class _ViewStream:
    """A stream as one view sees it: windows as a classifier wants them."""

    def __init__(self, stream: Recording, part: SpotterPart) -> None:
        self._parts = part.settings.body_parts or BODY_PARTS
        self._centres = view_centres(stream, [part.view], part.recorded, self._parts)[0]
        self._sizes = body_sizes(self._centres, self._parts)

    def windows(self, begins: Sequence[int], ends: Sequence[int]) -> tuple[Floats, Floats]:
        """(N, C, FRAMES) positions from the first head, in body sizes; (N, C + 1) log duration and log path lengths."""
        series, extras = zip(*(self._window(*window) for window in zip(begins, ends, strict=True)), strict=True)
        return np.array(series), np.array(extras)

    def _window(self, begin: int, end: int) -> tuple[Floats, Floats]:
        places = from_first_head(self._centres[begin:end], float(self._sizes[end - 1]), self._parts)
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
            # The head's first position is 0 in every window, and a still part hardly varies.
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
        seen = _ViewStream(stream, self._part).windows(begins.tolist(), ends.tolist())
        p = np.zeros((len(ends), len(self._part.settings.labels) + 1))
        p[:, self._classifier[-1].classes_] = self._classifier.predict_proba(self._features(*seen))
        return StreamProbabilities(frames, p.reshape(len(frames), LENGTHS, -1))
