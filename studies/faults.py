"""Faulty observers for `labanmesh evaluate --fault VIEW=KIND`: changed output. Seeded, pure."""

from collections.abc import Callable, Mapping, Sequence
from typing import NamedTuple

import numpy as np

from common.errors import BadInput
from observer.tracks import Floats

FAULT_DELAY_S = 1.0


class ObserverOutputs(NamedTuple):
    """Outputs in F frames of one trial: p (F, V, M), facing (F, V, M, K) or None, unlearned (F, V) or None."""

    p: Floats
    facing: Floats | None = None
    unlearned: Floats | None = None


class FaultCase(NamedTuple):
    """One array of an observer's outputs in a trial, (F, ...), and the same of another trial.

    prior: its value before any evidence, NaN where an observer does not estimate it. delay: frames in FAULT_DELAY_S.
    """

    own: Floats
    other: Floats
    prior: float
    delay: int
    rng: np.random.Generator


def wrong(case: FaultCase) -> Floats:
    """Certain and wrong: the outputs of another trial, drawn blindly; its last frame is repeated if it is shorter.

    The other trial may happen to show the same movement.
    """
    return case.other[np.minimum(np.arange(len(case.own)), len(case.other) - 1)]


def noise(case: FaultCase) -> Floats:
    """A new random distribution in every frame, from nearly certain to undecided."""
    if np.isnan(case.prior):
        return case.own
    return case.rng.dirichlet(np.full(case.own.shape[-1], 0.2), size=case.own.shape[:-1])


def silent(case: FaultCase) -> Floats:
    """No message: the prior in every frame."""
    return np.full_like(case.own, case.prior)


def late(case: FaultCase) -> Floats:
    """All outputs one second late, the prior before."""
    return np.concatenate([silent(case)[: case.delay], case.own])[: len(case.own)]


FAULTS: Mapping[str, Callable[[FaultCase], Floats]] = {"wrong": wrong, "noise": noise, "silent": silent, "late": late}
UNLEARNED = ObserverOutputs._fields.index("unlearned")


def parse_fault(text: str, views: Sequence[str]) -> tuple[str, str]:
    """`VIEW=KIND` -> (view, kind); raises BadInput that lists the known ones."""
    view, equals, kind = text.rpartition("=")
    if not equals or view not in views:
        raise BadInput(f"--fault {text!r}: VIEW=KIND is expected, VIEW one of {', '.join(views)}")
    if kind not in FAULTS:
        raise BadInput(f"--fault {text!r}: unknown fault {kind!r}; known: {', '.join(FAULTS)}")
    return view, kind


def disturb(
    outputs: Sequence[ObserverOutputs], views: Sequence[str], faults: Mapping[str, str], rate_hz: float, seed: int
) -> list[ObserverOutputs]:
    """The outputs in each trial with those of the faulty views replaced."""
    rng, delay = np.random.default_rng([seed, 1]), round(FAULT_DELAY_S * rate_hz)
    result = [ObserverOutputs(*(None if part is None else part.copy() for part in whole)) for whole in outputs]  # type: ignore[arg-type]
    for view, kind in faults.items():
        column = list(views).index(view)
        for n, whole in enumerate(outputs):
            another = (n + int(rng.integers(1, len(outputs)))) % len(outputs) if len(outputs) > 1 else n
            parts = zip(result[n], whole, outputs[another], strict=True)
            for number, (changed, own, other) in enumerate(parts):
                if changed is not None and own is not None and other is not None:
                    prior = np.nan if number == UNLEARNED else 1.0 / own.shape[-1]
                    changed[:, column] = FAULTS[kind](FaultCase(own[:, column], other[:, column], prior, delay, rng))
    return result
