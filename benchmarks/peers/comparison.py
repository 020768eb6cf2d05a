"""Our judges and their peers on the same trials: learned from the same people, asked when as much has been seen."""

from collections.abc import Callable, Mapping, Sequence

import numpy as np

from benchmarks.peers.classifiers import PEERS, Names, Peer, panel, watched
from benchmarks.peers.table import Contest, Curve, Floats
from observer.motion.archive import MotionArchive
from studies.evaluate import Answer, Progress, Question, at_fraction, evaluate, trials_of
from studies.report import FRACTIONS, truth_of
from studies.trials import Split, Trial, splits, trials, with_labels


def compared(
    archive: MotionArchive,
    movements: str,
    question: Question,
    seeds: Sequence[int],
    fast: bool = False,
    progress: Progress = lambda *_: None,
    peers: Mapping[str, Peer] = PEERS,
) -> Contest:
    """All judge the question's movements, which together are called `movements`; peers anew for every fraction.

    Raises BadInput as evaluate does, and ModuleNotFoundError where aeon is not installed.
    """
    theirs = peer_curves(archive, question, seeds, fast, lambda what, *n: progress(f"{what}, {movements}", *n), peers)
    answer = evaluate(archive, question, lambda what, *n: progress(f"ours, {movements}", *n))
    people = tuple(judged.trial.recording.subject for judged in answer.judged)
    return Contest(movements, people, (*our_curves(answer), *theirs))


def our_curves(answer: Answer) -> list[Curve]:
    """Fused, then, where there are several, each view alone."""
    truth = truth_of(answer)
    beliefs = [at_fraction(answer.judged, fraction) for fraction in FRACTIONS]
    fused = [p.argmax(axis=1) == truth for _, p in beliefs]
    curves = [Curve("ours, fused", np.array(fused, dtype=np.float64))]
    for v, view in enumerate(answer.question.views):
        alone = [p[:, v].argmax(axis=1) == truth for p, _ in beliefs]
        curves.append(Curve(f"ours, {view.name}", np.array(alone, dtype=np.float64)))
    return curves if len(answer.question.views) > 1 else curves[:1]


def peer_curves(
    archive: MotionArchive,
    question: Question,
    seeds: Sequence[int],
    fast: bool,
    progress: Progress,
    peers: Mapping[str, Peer],
) -> list[Curve]:
    """One curve a peer, over the trials in evaluate's order; a peer that depends on chance is the mean over seeds."""
    chosen = with_labels(archive, question.labels)
    folds = list(splits(chosen, question.train_subjects, question.test_subjects, question.leave_one_subject_out))
    curves = []
    for name, peer in peers.items():
        told = _counted(progress, name, len(folds) * len(FRACTIONS))
        rights = [_right(split, question, n, peer, seeds, fast, told) for n, split in enumerate(folds)]
        curves.append(Curve(name, np.concatenate(rights, axis=1)))
    return curves


def _counted(progress: Progress, what: str, total: int) -> Callable[[], None]:
    done = iter(range(1, total + 1))
    return lambda: progress(what, next(done), total)


def _right(
    split: Split,
    question: Question,
    number: int,
    peer: Peer,
    seeds: Sequence[int],
    fast: bool,
    told: Callable[[], None],
) -> Floats:
    """(F, N) how often this peer is right about the test trials of one split."""
    views, parts = question.views, split.train.body_parts
    learned = trials(split.train.recordings, onset_known=True, turn=0.0, rng=np.random.default_rng(0))
    asked = trials_of(split, question, number)
    seen_learned, seen_asked = ([watched(trial, views, parts) for trial in group] for group in (learned, asked))
    result = []
    for fraction in FRACTIONS:
        shown = (panel(seen_learned, learned, fraction, peer.length, peer.derived), _labels(learned))
        test, truth = panel(seen_asked, asked, fraction, peer.length, peer.derived), _labels(asked)
        tries = [peer.judged(*shown, test, seed, fast) == truth for seed in (seeds if peer.by_chance else seeds[:1])]
        result.append(np.mean(tries, axis=0))
        told()
    return np.array(result)


def _labels(some: Sequence[Trial]) -> Names:
    return np.array([trial.recording.label for trial in some])
