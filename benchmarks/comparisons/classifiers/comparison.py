"""Offline classifiers (MiniRocket, 1-NN DTW) and our observers on the same trials, for the same fractions of each.

A classifier learns again for every fraction. MiniRocket judges in two ways: all views as channels of one series; and
one classifier for each observer, whose probabilities are multiplied. aeon is imported when a classifier learns.

Dempster, Schmidt and Webb, "MiniRocket: a very fast (almost) deterministic transform for time series classification",
KDD 2021. The parameters were chosen among training people (docs/results/peers.md).
"""

import warnings
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np
from numpy.typing import NDArray

from benchmarks.comparisons.classifiers.panels import Panel, make_panel, view_centres
from common.parallel import run_parts
from observer.geometry.views import View
from observer.motion.archive import MotionArchive
from observer.tracks import Floats
from studies.evaluate import EvaluationResult, evaluate
from studies.report import FRACTIONS
from studies.sensors import performances, same_trials
from studies.settings import EvaluationSettings, Progress, folds_of, trials_of
from studies.trials import EvaluationTrial, Split, make_trials, with_labels

Names = NDArray[np.str_]

KERNELS = 10_000
KERNELS_FAST = 1_000
DTW_WINDOW = 0.2
"""How far, as a share of the length, one movement may be ahead of the other."""
UNKNOWN = -100.0
"""Score of a movement that no training person shows."""
PRODUCT = "MiniRocket, product"


@dataclass(frozen=True, slots=True)
class Peer:
    """An offline classifier. scores: (training panel, labels, test panel, seed, fast) -> (N, K), one column for each
    of the K different labels in sorted order; the largest is the answer, and sums of several observers' are too.

    length: frames of its panels. derived: see make_panel. random: whether the result depends on the seed.
    """

    scores: Callable[[Panel, Names, Panel, int, bool], Floats]
    length: int
    derived: bool
    random: bool

    def predict(self, train: Panel, labels: Names, test: Panel, seed: int, fast: bool) -> Names:
        """(N,) labels of the test panel."""
        answers: Names = np.unique(labels)[self.scores(train, labels, test, seed, fast).argmax(axis=1)]
        return answers


def _minirocket(train: Panel, labels: Names, test: Panel, seed: int, fast: bool) -> Floats:
    """log softmax of the decision values: aeon's classifier has no other measure of its certainty."""
    from aeon.classification.convolution_based import MiniRocketClassifier

    if len(set(labels.tolist())) == 1:
        return np.zeros((len(test), 1))
    # By default a ridge classifier whose penalty is cross-validated on the training panel.
    classifier = MiniRocketClassifier(n_kernels=KERNELS_FAST if fast else KERNELS, random_state=seed)
    with warnings.catch_warnings():
        # The anchor's first position is 0 in every series, and a still part hardly varies.
        warnings.filterwarnings("ignore", ".*with very little variation")
        fitted = classifier.fit(train, labels)
        values = np.asarray(fitted.pipeline_.decision_function(test), dtype=np.float64)
    if values.ndim == 1:
        values = np.stack([-values, values], axis=1)
    scores: Floats = values - np.log(np.exp(values).sum(axis=1, keepdims=True))
    return scores


def _nearest(train: Panel, labels: Names, test: Panel, seed: int, fast: bool) -> Floats:
    from aeon.classification.distance_based import KNeighborsTimeSeriesClassifier

    classifier = KNeighborsTimeSeriesClassifier(n_neighbors=1, distance="dtw", distance_params={"window": DTW_WINDOW})
    with warnings.catch_warnings():
        # numba warns about aeon's own code when it compiles it.
        warnings.filterwarnings("ignore", "unsafe cast from uint64 to int64")
        return np.asarray(classifier.fit(train, labels).predict_proba(test), dtype=np.float64)


PEERS: Mapping[str, Peer] = {
    "MiniRocket": Peer(_minirocket, length=64, derived=True, random=True),
    "1-NN DTW": Peer(_nearest, length=40, derived=False, random=False),
}


@dataclass(frozen=True, slots=True, eq=False)
class AccuracyCurve:
    """A classifier and right (F, N): how often it is right about each trial after each fraction.

    NaN for a trial that an observer has no recording of.
    """

    name: str
    right: Floats


@dataclass(frozen=True, slots=True, eq=False)
class PeerComparison:
    """The curves of all classifiers on one set of movements: the same N trials, of `people` (N names), in each."""

    movements: str
    people: tuple[str, ...]
    curves: tuple[AccuracyCurve, ...]


def seen_by_all(comparison: PeerComparison, movements: str) -> PeerComparison:
    """Only the trials that every observer has a recording of."""
    common = np.all([np.isfinite(curve.right).all(axis=0) for curve in comparison.curves], axis=0)
    people = tuple(name for name, one in zip(comparison.people, common, strict=True) if one)
    return PeerComparison(
        movements, people, tuple(AccuracyCurve(c.name, c.right[:, common]) for c in comparison.curves)
    )


def seen_by_some(comparison: PeerComparison) -> PeerComparison:
    """All trials, and only the curves that have an answer to each."""
    return PeerComparison(
        comparison.movements,
        comparison.people,
        tuple(curve for curve in comparison.curves if np.isfinite(curve.right).all()),
    )


@dataclass(frozen=True, slots=True)
class PeerOptions:
    """How thoroughly to compare. seeds: of random peers. fast: a tenth of the kernels. jobs: processes.

    ours: whether our observers are judged too.
    """

    seeds: Sequence[int] = (0,)
    fast: bool = False
    jobs: int = 1
    ours: bool = True


def compare_peers(
    archive: MotionArchive,
    movements: str,
    settings: EvaluationSettings,
    options: PeerOptions,
    progress: Progress = lambda *_: None,
    peers: Mapping[str, Peer] = PEERS,
    alone: Peer | None = None,
) -> PeerComparison:
    """Judge the settings' movements, called `movements`, by all classifiers; peers relearn for every fraction.

    peers: see all views as one series. alone: one for each observer, then the product. Raises BadInput as evaluate
    does, and ModuleNotFoundError where aeon is not installed.
    """
    curves = []
    if options.ours:
        result = evaluate(archive, settings, lambda what, *n: progress(f"{movements}: ours, {what}", *n), options.jobs)
        curves = our_curves(result)
    folds = folds_of(_whole(archive, settings), settings, settings.labels)
    trials = [trial for number, split in enumerate(folds) for trial in trials_of(split, settings, number)]
    truth = np.array([settings.labels.index(trial.recording.label) for trial in trials])
    whole = [Group(archive, settings.views)]
    for name, peer in peers.items():
        report = partial(progress, f"{movements}: {name}")
        curves.append(AccuracyCurve(name, right_of(_scores(whole, settings, peer, options, report)[0], truth)))
    if alone:
        archives = settings.sensors or (archive,) * len(settings.views)
        each = [Group(own, (view,)) for own, view in zip(archives, settings.views, strict=True)]
        scores = _scores(each, settings, alone, options, partial(progress, f"{movements}: {PRODUCT}"))
        curves.append(AccuracyCurve(PRODUCT, right_of(np.nansum(scores, axis=0), truth)))
        # Of several views of one archive the product is enough: the tables are long.
        for view, own in zip(settings.views, scores, strict=True) if settings.sensors else ():
            curves.append(AccuracyCurve(f"MiniRocket, {view.name}", right_of(own, truth)))
    people = tuple(trial.recording.subject for trial in trials)
    return PeerComparison(movements, people, tuple(curves))


def _whole(archive: MotionArchive, settings: EvaluationSettings) -> MotionArchive:
    return performances(settings.sensors) if settings.sensors else archive


def right_of(scores: Floats, truth: NDArray[np.int64]) -> Floats:
    """(S, F, N, M) scores by seed, (N,) true movements -> (F, N) how often right; NaN for trials without scores."""
    right = np.where(np.isfinite(scores[..., 0]), scores.argmax(axis=3) == truth, np.nan)
    mean: Floats = right.mean(axis=0)
    return mean


def our_curves(result: EvaluationResult) -> list[AccuracyCurve]:
    """The fused curve, then, with several views, one per view."""
    posteriors = [result.at_fraction(fraction) for fraction in FRACTIONS]
    fused = [p.argmax(axis=1) == result.truth for _, p in posteriors]
    curves = [AccuracyCurve("ours, fused", np.array(fused, dtype=np.float64))]
    for v, view in enumerate(result.settings.views):
        right = [
            np.where(np.isfinite(p[:, v, 0]), p[:, v].argmax(axis=1) == result.truth, np.nan) for p, _ in posteriors
        ]
        curves.append(AccuracyCurve(f"ours, {view.name}", np.array(right, dtype=np.float64)))
    return curves if len(result.settings.views) > 1 else curves[:1]


@dataclass(frozen=True, slots=True)
class Group:
    """Views of one archive that a peer sees as one series."""

    archive: MotionArchive
    views: tuple[View, ...]


@dataclass(frozen=True, slots=True, eq=False)
class PeerPart:
    """What a peer learns and judges in one fold, for one group; centres as view_centres, None without a recording."""

    peer: Peer
    labels: tuple[str, ...]
    body_parts: tuple[str, ...]
    learned: Sequence[EvaluationTrial]
    learned_centres: Sequence[Floats]
    judged: Sequence[EvaluationTrial | None]
    judged_centres: Sequence[Floats]
    options: PeerOptions


def _scores(
    groups: Sequence[Group],
    settings: EvaluationSettings,
    peer: Peer,
    options: PeerOptions,
    done: Callable[[int, int], None],
) -> Floats:
    """(G, S, F, N, M) by group, seed and fraction, for the trials in evaluate's order; NaN without a recording."""
    folds = folds_of(_whole(groups[0].archive, settings), settings, settings.labels)
    seeds = options.seeds if peer.random else options.seeds[:1]
    options = replace(options, seeds=seeds)
    parts = [
        _part(group, split, settings, number, peer, options) for group in groups for number, split in enumerate(folds)
    ]
    scores = run_parts(judge_fold, parts, options.jobs, done)
    return np.array([np.concatenate(scores[n : n + len(folds)], axis=2) for n in range(0, len(parts), len(folds))])


def _part(
    group: Group, split: Split, settings: EvaluationSettings, number: int, peer: Peer, options: PeerOptions
) -> PeerPart:
    parts = settings.body_parts or group.archive.body_parts
    people = {r.subject for r in split.train.recordings}
    known = [r for r in with_labels(group.archive, settings.labels).recordings if r.subject in people]
    learned = make_trials(known, onset_known=True, turn=0.0, rng=np.random.default_rng(0))
    asked = trials_of(split, settings, number)
    judged = same_trials(group.archive, asked) if settings.sensors else asked
    learned_centres, judged_centres = (
        [view_centres(trial.recording, group.views, group.archive.body_parts, parts) for trial in trials if trial]
        for trials in (learned, judged)
    )
    return PeerPart(peer, settings.labels, parts, learned, learned_centres, judged, judged_centres, options)


def judge_fold(part: PeerPart) -> Floats:
    """(S, F, N, M) scores by seed and fraction."""
    judged = [trial for trial in part.judged if trial is not None]
    rows = [n for n, trial in enumerate(part.judged) if trial is not None]
    labels = np.array([trial.recording.label for trial in part.learned])
    columns = [part.labels.index(label) for label in np.unique(labels)]
    scores = np.full((len(part.options.seeds), len(FRACTIONS), len(part.judged), len(part.labels)), np.nan)
    scores[:, :, rows] = UNKNOWN
    for f, fraction in enumerate(FRACTIONS):
        train, test = (
            make_panel(centres, trials, fraction, part.peer.length, part.peer.derived, part.body_parts)
            for centres, trials in ((part.learned_centres, part.learned), (part.judged_centres, judged))
        )
        for s, seed in enumerate(part.options.seeds):
            answers = part.peer.scores(train, labels, test, seed, part.options.fast)
            scores[np.ix_([s], [f], rows, columns)] = answers
    return scores
