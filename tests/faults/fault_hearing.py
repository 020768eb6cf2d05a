"""Which movements could be judged at all: while no vote reaches a listener, it is unknown what the person does."""

from itertools import pairwise

from common import SECOND_NS

DEAF_SHARE = 0.3
"""A movement of which a larger share was heard by nobody may be lost."""
DEAF_S = 0.5
"""Judgements further apart than this, or without a vote, are no hearing."""


def is_unheard(movement, judgements, least=1):
    """Whether more than DEAF_SHARE of a movement went by without a judgement with the votes of so many observers."""
    heard = [one["at_ns"] for one in judgements if one["agreement"]["n"] >= least]
    bounds = [one["at_ns"] for one in (*judgements[:1], *judgements[-1:])]
    times_ns = pairwise([*bounds[:1], *heard, *bounds[1:]])
    deaf = [(a, b) for a, b in times_ns if b - a > DEAF_S * SECOND_NS]
    unheard_ns = sum(max(min(b, movement.ended_ns) - max(a, movement.began_ns), 0) for a, b in deaf)
    return unheard_ns > DEAF_SHARE * (movement.ended_ns - movement.began_ns)
