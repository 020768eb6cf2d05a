"""What a watch believes as one table: its movements and, where it knows of others, "something else". Pure."""

import numpy as np

from observer.model.base import Watch
from observer.model.certainty import Certainty
from observer.tracks import Floats


def answers_of(watch: Watch) -> Floats:
    """(A, K) posterior over answers and facings: the M movements and, if it is known, "something else" as the last."""
    joint, unlearned = watch.joint, watch.unlearned
    learned = watch.p[:, None] if joint is None else joint
    return learned if unlearned is None else np.vstack([learned * (1.0 - unlearned.sum()), unlearned])


def given_learned(answers: Floats) -> Floats:
    """(M + 1, K) -> (M, K) given that it is one of the movements; uniform where that cannot be."""
    learned = answers[:-1]
    total = float(learned.sum())
    return learned / total if total > 0 else np.full(learned.shape, 1.0 / learned.size)


def believed(watch: Watch, certainty: Certainty) -> tuple[Floats, float | None]:
    """(M, K) what can be believed of its movements, given that it is one, and P(none of them), None if not known."""
    answers = certainty.of(answers_of(watch))
    if watch.unlearned is not None:
        return given_learned(answers), float(answers[-1].sum())
    return answers, certainty.unlearned(answers.sum(axis=1), watch.foreseen)
