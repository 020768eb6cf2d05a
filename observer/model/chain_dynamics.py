"""The dynamics of the phase filter at any frame rate: how people advance through the phases of a movement. Pure."""

from collections.abc import Mapping

import numpy as np

from observer.filtering.phase_filter import Dynamics
from observer.tracks import Floats

STEPS = (0.4, 0.3, 0.15, 0.1, 0.05)
"""P(advance by 0, 1, 2, 3, 4 phases in 1/15 s): people pause and hurry more often than they keep an even pace."""
ENTRY = (0.4, 0.3, 0.2, 0.1)
"""P(a movement is entered in its first, ... fourth phase)."""
UNDER_WAY = 0.2
"""P(the person is in the middle of a movement when an observer starts). With .5 a movement is noticed hardly sooner,
but the probability of rest begins at .7 in place of .9 where the person rests."""


def step_probabilities(share: float) -> Floats:
    """(K,) P(advance by k phases) within `share` fifteenths of a second.

    STEPS convolved with itself once per whole fifteenth; the remainder is one more step with that probability.
    """
    whole, part = int(share), share - int(share)
    steps = np.ones(1)
    for _ in range(whole):
        steps = np.convolve(steps, STEPS)
    if part > 0:
        once = part * np.array(STEPS)
        once[0] += 1 - part
        steps = np.convolve(steps, once)
    result: Floats = steps
    return result


def chain_dynamics(parameters: Mapping[str, float], share: float, onset_known: bool) -> Dynamics:
    """The dynamics of the phase filter; share: of a fifteenth of a second that a frame lasts.

    begin, forget and abandon are probabilities for 1/15 s, settled counts such fifteenths. With a known onset nothing
    settles, because a person who is known to do a movement may hold its pose for long.
    """
    begin, forget, abandon = (1 - (1 - parameters[name]) ** share for name in ("begin", "forget", "abandon"))
    return Dynamics(
        steps=step_probabilities(share)[None],
        speeds=np.ones(1),
        jitter=np.ones((1, 1)),
        entry=np.array(ENTRY),
        begin=begin,
        forget=forget,
        abandon=abandon,
        settled=np.inf if onset_known else parameters["settled"] / share,
        under_way=UNDER_WAY,
    )
