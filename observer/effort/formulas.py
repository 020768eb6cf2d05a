"""Laban's Effort and Shape as numbers, one formula each, over a window of tracks. Pure (docs/design/effort.md).

Shapes: tracks (T, P, D), D 2 in an image or 3 in a room (right, up, back); lengths in body sizes, time in seconds;
shares (P,) the weights α_k of the parts, summing to 1. After Larboulette and Gibet, "A review of computable expressive
descriptors of human motion", MOCO 2015. Gaps of a part are left out; a part that is never seen has no
share.
"""

import numpy as np
from numpy.typing import NDArray

from observer.effort.features import derivatives
from observer.tracks import Floats


def weight(tracks: Floats, rate_hz: float, shares: Floats) -> float:
    """max_t Σ α_k |v_k|²: the largest energy of motion; strong is high, light is low."""
    speed = _lengths(derivatives(tracks, rate_hz)[1])
    known = np.isfinite(speed)
    share = known @ shares
    energy = np.where(known, speed, 0.0) ** 2 @ shares
    return float((energy[share > 0] / share[share > 0]).max(initial=0.0))


def time(tracks: Floats, rate_hz: float, shares: Floats) -> float:
    """Σ α_k mean |a_k|: sudden is high, sustained is low."""
    return _mean(derivatives(tracks, rate_hz)[2], shares)


def flow(tracks: Floats, rate_hz: float, shares: Floats) -> float:
    """Σ α_k mean |jerk_k|: bound is high, free is low."""
    return _mean(derivatives(tracks, rate_hz)[3], shares)


def space(tracks: Floats, shares: Floats) -> float:
    """Σ α_k path length / net displacement, at least 1: direct is 1, indirect is more.

    Infinite for a part that ends where it began; 1 for a part that does not move.
    """
    ratios = np.ones(tracks.shape[1])
    for part in range(tracks.shape[1]):
        way = tracks[:, part][np.isfinite(tracks[:, part]).all(axis=1)]
        path = float(_lengths(np.diff(way, axis=0)).sum())
        if path > 0:
            net = float(np.linalg.norm(way[-1] - way[0]))
            ratios[part] = path / net if net > 0 else np.inf
    shares = _visible_shares(shares, tracks)
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
    """(T, 3) -> (T,) mean of the visible hands, relative to the face."""
    hands = places[:, :2]
    known = np.isfinite(hands)
    count = known.sum(axis=1)
    mean = np.where(count > 0, np.where(known, hands, 0.0).sum(axis=1) / np.maximum(count, 1), np.nan)
    against: Floats = mean - places[:, 2]
    return against


def _rate(values: Floats, rate_hz: float) -> float:
    """(T,) -> slope per second of the regression line through all values that are not NaN; 0 with fewer than two."""
    known = np.isfinite(values)
    if known.sum() < 2:
        return 0.0
    t = np.flatnonzero(known) / rate_hz
    t = t - t.mean()
    return float(t @ values[known] / (t @ t))


def _lengths(vectors: Floats) -> Floats:
    lengths: Floats = np.sqrt((vectors**2).sum(axis=-1))
    return lengths


def _mean(vectors: Floats, shares: Floats) -> float:
    """(T, P, D) -> Σ α_k of the mean length over the instants where part k is known."""
    lengths = _lengths(vectors)
    known: NDArray[np.bool_] = np.isfinite(lengths)
    means = np.where(known, lengths, 0.0).sum(axis=0) / np.maximum(known.sum(axis=0), 1)
    shares = np.where(known.any(axis=0), shares, 0.0)
    return float(means @ shares / shares.sum()) if shares.any() else 0.0


def _visible_shares(shares: Floats, tracks: Floats) -> Floats:
    """The shares among the parts that are ever seen."""
    left = np.where(np.isfinite(tracks).all(axis=2).any(axis=0), shares, 0.0)
    return left / left.sum() if left.any() else left
