"""Offline classifiers (MiniRocket, 1-NN DTW) and our observers on the same trials, for the same fractions of each.

A panel, from which a classifier learns, uses nothing after the requested frame: size, origin and bridging of gaps come
from earlier frames. aeon is imported when a classifier learns.

Dempster, Schmidt and Webb, "MiniRocket: a very fast (almost) deterministic transform for time series classification",
KDD 2021. The parameters were chosen among training people (docs/results/peers.md).
"""

import warnings
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from observer.features import BodySize
from observer.geometry.views import View
from observer.motion.archive import MotionArchive
from observer.motion.projected import view_tracks
from observer.tracks import BODY_PARTS, Floats
from studies.evaluate import EvaluationResult, EvaluationSettings, Progress, evaluate, folds_of, trials_of
from studies.report import FRACTIONS
from studies.trials import EvaluationTrial, Split, make_trials

Panel = NDArray[np.float64]
Names = NDArray[np.str_]

KERNELS = 10_000
KERNELS_FAST = 1_000
DTW_WINDOW = 0.2
"""How far, as a share of the length, one movement may be ahead of the other."""


def view_centres(trial: EvaluationTrial, views: Sequence[View], recorded: tuple[str, ...]) -> Floats:
    """(V, F, P, 2) centres of hands and head in every frame of a trial, by view."""
    return np.array([[t.centres for t in view_tracks(view, trial.recording, recorded, BODY_PARTS)] for view in views])


def make_panel(
    centres: Sequence[Floats], trials: Sequence[EvaluationTrial], fraction: float, length: int, derived: bool
) -> Panel:
    """(N, C, length): each trial up to `fraction` of it, resampled to `length` frames.

    C is V*6 positions; if derived, also V*4 positions of the hands relative to the head, and V*6 velocities.
    """
    return np.array(
        [
            channels(own[:, trial.begin : trial.frame_at(fraction) + 1], length, derived)
            for own, trial in zip(centres, trials, strict=True)
        ]
    )


def channels(centres: Floats, length: int, derived: bool) -> Floats:
    """(V, F, P, 2) centres, v down -> (C, length): right and up from the first head, in body sizes, gaps bridged.

    Velocities are per recorded frame, so that they still distinguish slow from fast after resampling.
    """
    rows = np.concatenate([bridge_gaps(relative(view).reshape(len(view), -1).T) for view in centres])
    positions = resample_rows(rows, length)
    if not derived:
        return positions
    parts = positions.reshape(len(centres), len(BODY_PARTS), 2, length)
    head = BODY_PARTS.index("head")
    from_head = (np.delete(parts, head, axis=1) - parts[:, head, None]).reshape(-1, length)
    velocities = np.gradient(positions, axis=1) * ((length - 1) / max(rows.shape[1] - 1, 1))
    return np.concatenate([positions, from_head, velocities])


def relative(centres: Floats) -> Floats:
    """(F, P, 2) centres of one view, v down -> in body sizes, up positive, relative to the first visible head.

    The body size is that after the last frame; unknown places stay NaN. Without a visible head, or without a hand
    visible together with it, the size is unknown and everything is NaN.
    """
    reader = BodySize()
    size = [reader.update(frame, BODY_PARTS) for frame in centres][-1]
    head = centres[:, BODY_PARTS.index("head")]
    visible = np.isfinite(head).all(axis=1)
    first = head[visible.argmax()] if visible.any() else np.full(2, np.nan)
    placed: Floats = (centres - first) / size * (1.0, -1.0)
    return placed


def bridge_gaps(rows: Floats) -> Floats:
    """(C, F) -> the same without NaN: straight lines over gaps, constant at the ends, 0 where all is NaN."""
    result = np.zeros_like(rows)
    instants = np.arange(rows.shape[1])
    for row, visible in zip(range(len(rows)), np.isfinite(rows), strict=True):
        if visible.any():
            result[row] = np.interp(instants, instants[visible], rows[row, visible])
    return result


def resample_rows(rows: Floats, length: int) -> Floats:
    """(C, F) -> (C, length), linear in time from the first frame to the last."""
    instants = np.linspace(0, rows.shape[1] - 1, length)
    return np.array([np.interp(instants, np.arange(rows.shape[1]), row) for row in rows])


@dataclass(frozen=True, slots=True)
class Peer:
    """An offline classifier. predict: (training panel, labels, test panel, seed, fast) -> labels of the test panel.

    length: frames of its panels. derived: see make_panel. random: whether the result depends on the seed.
    """

    predict: Callable[[Panel, Names, Panel, int, bool], Names]
    length: int
    derived: bool
    random: bool


def _minirocket(train: Panel, labels: Names, test: Panel, seed: int, fast: bool) -> Names:
    from aeon.classification.convolution_based import MiniRocketClassifier

    # By default a ridge classifier whose penalty is cross-validated on the training panel.
    classifier = MiniRocketClassifier(n_kernels=KERNELS_FAST if fast else KERNELS, random_state=seed)
    return np.asarray(classifier.fit(train, labels).predict(test))


def _nearest(train: Panel, labels: Names, test: Panel, seed: int, fast: bool) -> Names:
    from aeon.classification.distance_based import KNeighborsTimeSeriesClassifier

    classifier = KNeighborsTimeSeriesClassifier(n_neighbors=1, distance="dtw", distance_params={"window": DTW_WINDOW})
    with warnings.catch_warnings():
        # numba warns about aeon's own code when it compiles it.
        warnings.filterwarnings("ignore", "unsafe cast from uint64 to int64")
        return np.asarray(classifier.fit(train, labels).predict(test))


PEERS: Mapping[str, Peer] = {
    "MiniRocket": Peer(_minirocket, length=64, derived=True, random=True),
    "1-NN DTW": Peer(_nearest, length=40, derived=False, random=False),
}


@dataclass(frozen=True, slots=True, eq=False)
class AccuracyCurve:
    """A classifier and right (F, N): how often it is right about each trial after each fraction."""

    name: str
    right: Floats


@dataclass(frozen=True, slots=True, eq=False)
class PeerComparison:
    """The curves of all classifiers on one set of movements: the same N trials, of `people` (N names), in each."""

    movements: str
    people: tuple[str, ...]
    curves: tuple[AccuracyCurve, ...]


def compare_peers(
    archive: MotionArchive,
    movements: str,
    settings: EvaluationSettings,
    seeds: Sequence[int],
    fast: bool = False,
    progress: Progress = lambda *_: None,
    peers: Mapping[str, Peer] = PEERS,
) -> PeerComparison:
    """Judge the settings' movements, called `movements`, by all classifiers; peers relearn for every fraction.

    Raises BadInput as evaluate does, and ModuleNotFoundError where aeon is not installed.
    """
    theirs = _peer_curves(archive, settings, seeds, fast, lambda what, *n: progress(f"{what}, {movements}", *n), peers)
    result = evaluate(archive, settings, lambda what, *n: progress(f"ours, {movements}", *n))
    people = tuple(r.trial.recording.subject for r in result.trials)
    return PeerComparison(movements, people, (*our_curves(result), *theirs))


def our_curves(result: EvaluationResult) -> list[AccuracyCurve]:
    """The fused curve, then, with several views, one per view."""
    truth = result.truth
    posteriors = [result.at_fraction(fraction) for fraction in FRACTIONS]
    fused = [p.argmax(axis=1) == truth for _, p in posteriors]
    curves = [AccuracyCurve("ours, fused", np.array(fused, dtype=np.float64))]
    for v, view in enumerate(result.settings.views):
        alone = [p[:, v].argmax(axis=1) == truth for p, _ in posteriors]
        curves.append(AccuracyCurve(f"ours, {view.name}", np.array(alone, dtype=np.float64)))
    return curves if len(result.settings.views) > 1 else curves[:1]


def _peer_curves(
    archive: MotionArchive,
    settings: EvaluationSettings,
    seeds: Sequence[int],
    fast: bool,
    progress: Progress,
    peers: Mapping[str, Peer],
) -> list[AccuracyCurve]:
    """One curve per peer over the trials in evaluate's order; a random peer is the mean over the seeds."""
    folds = folds_of(archive, settings, settings.labels)
    curves = []
    for name, peer in peers.items():
        advance = _counter(progress, name, len(folds) * len(FRACTIONS))
        rights = [_right(split, settings, n, peer, seeds, fast, advance) for n, split in enumerate(folds)]
        curves.append(AccuracyCurve(name, np.concatenate(rights, axis=1)))
    return curves


def _counter(progress: Progress, task: str, total: int) -> Callable[[], None]:
    done = iter(range(1, total + 1))
    return lambda: progress(task, next(done), total)


def _right(
    split: Split,
    settings: EvaluationSettings,
    number: int,
    peer: Peer,
    seeds: Sequence[int],
    fast: bool,
    advance: Callable[[], None],
) -> Floats:
    """(F, N) how often the peer is right about the test trials of one split."""
    views, parts = settings.views, split.train.body_parts
    learned = make_trials(split.train.recordings, onset_known=True, turn=0.0, rng=np.random.default_rng(0))
    asked = trials_of(split, settings, number)
    train_centres, test_centres = ([view_centres(t, views, parts) for t in group] for group in (learned, asked))
    result = []
    for fraction in FRACTIONS:
        train = make_panel(train_centres, learned, fraction, peer.length, peer.derived), _labels(learned)
        test, truth = make_panel(test_centres, asked, fraction, peer.length, peer.derived), _labels(asked)
        tries = [peer.predict(*train, test, seed, fast) == truth for seed in (seeds if peer.random else seeds[:1])]
        result.append(np.mean(tries, axis=0))
        advance()
    return np.array(result)


def _labels(trials: Sequence[EvaluationTrial]) -> Names:
    return np.array([trial.recording.label for trial in trials])
