"""Our observers and the peers on the same trials: the same training people, the same fractions of the movement."""

from collections.abc import Callable, Mapping, Sequence

import numpy as np

from benchmarks.peers.classifiers import PEERS, Names, Peer, make_panel, view_centres
from benchmarks.peers.table import AccuracyCurve, Floats, PeerComparison
from observer.motion.archive import MotionArchive
from studies.evaluate import EvaluationResult, EvaluationSettings, Progress, evaluate, folds_of, trials_of
from studies.report import FRACTIONS
from studies.trials import EvaluationTrial, Split, make_trials


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
