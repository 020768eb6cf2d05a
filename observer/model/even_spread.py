"""Numbers that fill an interval evenly, in place of random ones: the same choice each time, however many there are."""

import math


def evenly_spread(number: int) -> float:
    """The fractional part of `number` times the golden ratio: successive numbers fill [0, 1) evenly, however many."""
    return (number * (math.sqrt(5) - 1) / 2) % 1.0
