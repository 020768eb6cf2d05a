"""Laban's Effort and Shape as numbers: one formula each, over a window of tracks. Pure (docs/design/effort.md).

Shapes: tracks (T, P, D), D 2 in an image or 3 in a room (right, up, back); lengths in body sizes, time in seconds;
shares (P,) the weights α_k of the parts, summing to 1. After Larboulette and Gibet, "A review of computable expressive
descriptors of human motion", MOCO 2015. A part with a gap counts by what is seen of it; one never seen not at all.
"""

import numpy as np
from numpy.typing import NDArray

from observer.effort.course import derivatives
from observer.tracks import Floats


def weight(tracks: Floats, rate_hz: float, shares: Floats) -> float:
    """max_t Σ α_k |v_k|²: the greatest energy of motion; strong is much, light is little."""
    speed = _lengths(derivatives(tracks, rate_hz)[1])
    seen = np.isfinite(speed)
    share = seen @ shares
    energy = np.where(seen, speed, 0.0) ** 2 @ shares
    return float((energy[share > 0] / share[share > 0]).max(initial=0.0))


def time(tracks: Floats, rate_hz: float, shares: Floats) -> float:
    """Σ α_k mean |a_k|: sudden is much, sustained is little."""
    return _mean(derivatives(tracks, rate_hz)[2], shares)


def flow(tracks: Floats, rate_hz: float, shares: Floats) -> float:
    """Σ α_k mean |jerk_k|: bound is much, free is little."""
    return _mean(derivatives(tracks, rate_hz)[3], shares)


def space(tracks: Floats, shares: Floats) -> float:
    """Σ α_k path length / net displacement, at least 1: direct is 1, indirect is more; a part that ends where it began
    has no direct way, and a part that is still counts as 1.
    """
    ratios = np.ones(tracks.shape[1])
    for part in range(tracks.shape[1]):
        way = tracks[:, part][np.isfinite(tracks[:, part]).all(axis=1)]
        path = float(_lengths(np.diff(way, axis=0)).sum())
        if path > 0:
            net = float(np.linalg.norm(way[-1] - way[0]))
            ratios[part] = path / net if net > 0 else np.inf
    shares = _seen(shares, tracks)
    return float(ratios[shares > 0] @ shares[shares > 0]) if shares.any() else 1.0


def triangle(tracks: Floats) -> Floats:
    """(T, 3, D) two hands and the face -> (T,) the area between them, in body sizes squared."""
    left, right = tracks[:, 0] - tracks[:, 2], tracks[:, 1] - tracks[:, 2]
    squares = (left**2).sum(axis=1) * (right**2).sum(axis=1) - (left * right).sum(axis=1) ** 2
    area: Floats = np.sqrt(np.maximum(squares, 0.0)) / 2
    return area


def spreading(tracks: Floats, rate_hz: float) -> float:
    """(T, 3, D) -> mean rate of √area, body sizes a second: positive spreads, negative encloses."""
    return _rate(np.sqrt(triangle(tracks)), rate_hz)


def rising(tracks: Floats, rate_hz: float, up: int = 1) -> float:
    """(T, 3, D) -> mean rate of the hands' height against the face, body sizes a second; axis `up` is upwards."""
    return _rate(_hands_against_face(tracks[:, :, up]), rate_hz)


def advancing(tracks: Floats, rate_hz: float, back: int = 2) -> float:
    """(T, 3, D) -> mean rate of the hands' way forward of the face, body sizes a second; axis `back` is backwards."""
    return -_rate(_hands_against_face(tracks[:, :, back]), rate_hz)


def _hands_against_face(places: Floats) -> Floats:
    """(T, 3) -> (T,) the mean of the hands that are seen, from the face on."""
    hands = places[:, :2]
    seen = np.isfinite(hands)
    count = seen.sum(axis=1)
    mean = np.where(count > 0, np.where(seen, hands, 0.0).sum(axis=1) / np.maximum(count, 1), np.nan)
    against: Floats = mean - places[:, 2]
    return against


def _rate(values: Floats, rate_hz: float) -> float:
    """(T,) -> the slope of the line through what is seen, per second; 0 with less than two instants."""
    seen = np.isfinite(values)
    if seen.sum() < 2:
        return 0.0
    t = np.flatnonzero(seen) / rate_hz
    t = t - t.mean()
    return float(t @ values[seen] / (t @ t))


def _lengths(vectors: Floats) -> Floats:
    lengths: Floats = np.sqrt((vectors**2).sum(axis=-1))
    return lengths


def _mean(vectors: Floats, shares: Floats) -> float:
    """(T, P, D) -> Σ α_k of the mean length over the instants at which part k is seen."""
    lengths = _lengths(vectors)
    seen: NDArray[np.bool_] = np.isfinite(lengths)
    means = np.where(seen, lengths, 0.0).sum(axis=0) / np.maximum(seen.sum(axis=0), 1)
    shares = np.where(seen.any(axis=0), shares, 0.0)
    return float(means @ shares / shares.sum()) if shares.any() else 0.0


def _seen(shares: Floats, tracks: Floats) -> Floats:
    """The shares among the parts that are seen at all."""
    left = np.where(np.isfinite(tracks).all(axis=2).any(axis=0), shares, 0.0)
    return left / left.sum() if left.any() else left
