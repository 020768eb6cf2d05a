"""One clock for several cameras: what each saw, at the same instants; pure."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from common.errors import BadInput
from observer.tracks import Floats

LONGEST_GAP_S = 0.2
"""A part not seen for longer is not known between: a hand may have gone there and back."""

SAME_S = 1e-6
"""Instants nearer than this are one, so that rounding makes none depend on a neighbour that was not seen."""


@dataclass(frozen=True, slots=True, eq=False)
class Sighted:
    """What one camera saw. matrix: (3, 4). at_ns: (F,) when. centres: (F, P, 2) undistorted px, NaN: not seen."""

    name: str
    matrix: Floats
    at_ns: NDArray[np.int64]
    centres: Floats


def instants(sighted: Sequence[Sighted], rate_hz: float) -> NDArray[np.int64]:
    """(K,) ns, evenly at this rate, from when a second camera has begun to when a second-last one has ended.

    Raises BadInput when there is no such time, naming who saw nothing.
    """
    blind = [one.name for one in sighted if not len(one.at_ns)]
    known = [one for one in sighted if len(one.at_ns)]
    if len(known) < 2:
        raise BadInput(f"no pictures from {', '.join(blind)}: two cameras at least must see the performer")
    begin = sorted(int(one.at_ns[0]) for one in known)[1]
    end = sorted(int(one.at_ns[-1]) for one in known)[-2]
    if end <= begin:
        raise BadInput(
            f"{', '.join(one.name for one in known)}: no two of them saw the same moment; recordings count from their "
            "beginning and cameras by the clock, so mix none, and let both last longer than one frame"
        )
    return begin + np.round(np.arange(int((end - begin) * rate_hz / 1e9 + 1e-6) + 1) * 1e9 / rate_hz).astype(np.int64)


def sampled(one: Sighted, at_ns: NDArray[np.int64], longest_gap_s: float = LONGEST_GAP_S) -> Floats:
    """(K, P, 2) centres at these instants, linear between the two sightings of a part around each.

    NaN before the first, after the last, and where those two are more than `longest_gap_s` apart.
    """
    result = np.full((len(at_ns), *one.centres.shape[1:]), np.nan)
    # From the first instant, as whole nanoseconds since 1970 are more than a float holds.
    times, wanted = (one.at_ns - at_ns[0]) / 1e9, (at_ns - at_ns[0]) / 1e9
    for part in range(one.centres.shape[1]):
        seen = np.isfinite(one.centres[:, part]).all(axis=-1)
        if seen.any():
            result[:, part] = _between(times[seen], one.centres[seen, part], wanted, longest_gap_s)
    return result


def _between(times: Floats, values: Floats, wanted: Floats, longest_gap_s: float) -> Floats:
    """(F,) growing, (F, D) -> (K, D)."""
    after = np.clip(np.searchsorted(times, wanted - SAME_S), 0, len(times) - 1)
    before = np.maximum(after - 1, 0)
    gap = times[after] - times[before]
    exact = np.abs(times[after] - wanted) <= SAME_S
    weight = np.where(exact, 1.0, (wanted - times[before]) / np.where(gap > 0, gap, 1.0))[:, None]
    known = exact | ((gap > 0) & (gap <= longest_gap_s) & (wanted > times[before]) & (wanted < times[after]))
    return np.where(known[:, None], (1 - weight) * values[before] + weight * values[after], np.nan)
