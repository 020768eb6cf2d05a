"""Numbers that fill an interval evenly, however many they are: choosing some of many without chance."""

import math


def evenly(number: int) -> float:
    """0 to 1: successive numbers fill the interval evenly, however many there are (multiples of the golden ratio)."""
    return (number * (math.sqrt(5) - 1) / 2) % 1.0
