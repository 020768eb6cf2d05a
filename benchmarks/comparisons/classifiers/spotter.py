"""A sliding-window MiniRocket that spots movements in continuous recordings, beside our observers on the same streams.

Windows of several lengths that end now are stretched to one length. A classifier for each view tells the movements and
"something else" apart: what the training people do outside the labelled spans. The probabilities of the views are
multiplied. A verdict falls when a movement's probability, in the best of the windows, exceeds a threshold in two steps
in a row; the movement is armed again after 1.5 s below half of it. The window lengths follow from the training people's
spans, the threshold is the best one for a training person whom the classifiers do not know.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from benchmarks.comparisons.classifiers.comparison import PeerOptions
from benchmarks.comparisons.classifiers.window_classifier import (
    SpotterPart,
    StreamProbabilities,
    judge_part,
    step_frames,
)
from common.errors import BadInput
from common.parallel import run_parts
from observer.motion.archive import MotionArchive, Recording, subjects_in
from studies.settings import EvaluationSettings, folds_of
from studies.spotting import JudgedStream, SpottingScore, StreamScores, StreamVerdict

DOUBT = 1e-4
"""Added to a view's probabilities before they are multiplied, so that none has a veto."""
HOLD, REARM_S = 2, 1.5
THRESHOLDS = (0.3, 0.4, 0.5, 0.6, 0.7, 0.8, 0.9)


@dataclass(frozen=True, slots=True)
class SpotterFold:
    """The training people, the people who are judged, and the training person for whom the threshold is chosen."""

    train: frozenset[str]
    judged: frozenset[str]
    held: str


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
        train = subjects_in(split.train.recordings)
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
    """The score of the verdicts and of the answers on all streams."""
    total = StreamScores()
    for stream, probabilities in streams:
        verdicts = verdicts_of(probabilities, stream.rate_hz, labels, threshold)
        answers = answers_of(probabilities, len(stream.positions), labels)
        total = total.plus(StreamScores.of(JudgedStream(stream, verdicts, answers), labels))
    return total.first


def answers_of(probabilities: StreamProbabilities, frames: int, labels: Sequence[str]) -> list[str]:
    """The most probable movement in each frame, by the mean of all windows of the last step; "" for something else."""
    best = probabilities.p.mean(axis=1).argmax(axis=1)
    steps = np.searchsorted(probabilities.frames, np.arange(frames), "right") - 1
    return ["" if n < 0 or best[n] == len(labels) else labels[best[n]] for n in steps.tolist()]


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
