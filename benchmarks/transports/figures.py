"""Times and counts of one run to figures, and figures of several rounds to one with its range. Pure."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from statistics import median, quantiles

Judgements = Sequence[tuple[int, Mapping[str, int]]]
Found = dict[str, float]
"""One run's figures by name."""


@dataclass(frozen=True, slots=True)
class Figure:
    """The median over the rounds, the lowest and the highest of them."""

    median: float
    low: float
    high: float


def latencies(put_ns: Mapping[str, Sequence[int]], judgements: Judgements) -> list[int]:
    """Nanoseconds from each put to the first judgement that names it or a later one of the same publisher.

    put_ns: by publisher, that of sequence number 1 first. What no judgement names is left out.
    """
    answered = dict.fromkeys(put_ns, 0)
    times = []
    for arrived_ns, newest in judgements:
        for name, seq in newest.items():
            if name in answered and seq > answered[name]:
                times += [arrived_ns - at for at in put_ns[name][answered[name] : seq]]
                answered[name] = seq
    return times


def in_ms(times_ns: Sequence[int]) -> tuple[float, float]:
    """Median and 99th percentile."""
    return median(times_ns) / 1e6, quantiles(times_ns, n=100, method="inclusive")[98] / 1e6


def over_rounds(rounds: Iterable[Found]) -> dict[str, Figure]:
    """Each figure over all rounds that have it."""
    values: dict[str, list[float]] = {}
    for found in rounds:
        for name, value in found.items():
            values.setdefault(name, []).append(value)
    return {name: Figure(median(some), min(some), max(some)) for name, some in values.items()}
