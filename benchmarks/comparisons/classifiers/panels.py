"""What the offline classifiers see of a movement: panels of series, from our observers' tracks. Pure.

A panel uses nothing after the requested frame: size, origin and bridging of gaps come from earlier frames.
"""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from observer.body import TRUNK_POINTS
from observer.geometry.views import View
from observer.motion.archive import Recording
from observer.motion.projected import view_tracks
from observer.tracks import BODY_PARTS, Floats
from studies.trials import EvaluationTrial

Panel = NDArray[np.float64]
TORSO_SHARE = 0.45
"""Of the largest distance between the head and a hand: about a torso."""
HANDS = ("left_hand", "right_hand")


def view_centres(
    recording: Recording, views: Sequence[View], recorded: tuple[str, ...], body_parts: tuple[str, ...] = BODY_PARTS
) -> Floats:
    """(V, F, P, 2) centres of the P body parts in every frame of a recording, by view."""
    return np.array([[t.centres for t in view_tracks(view, recording, recorded, body_parts)] for view in views])


def make_panel(
    centres: Sequence[Floats],
    trials: Sequence[EvaluationTrial],
    fraction: float,
    length: int,
    derived: bool,
    body_parts: tuple[str, ...] = BODY_PARTS,
) -> Panel:
    """(N, C, length): each trial up to `fraction` of it, resampled to `length` frames.

    C is V*2P positions; if derived, also positions relative to the anchor of each frame, and V*2P velocities.
    """
    return np.array(
        [
            channels(own[:, trial.begin : trial.frame_at(fraction) + 1], length, derived, body_parts)
            for own, trial in zip(centres, trials, strict=True)
        ]
    )


def channels(centres: Floats, length: int, derived: bool, body_parts: tuple[str, ...] = BODY_PARTS) -> Floats:
    """(V, F, P, 2) centres, v down -> (C, length): right and up from the first anchor, in body sizes, gaps bridged.

    Velocities are per recorded frame, so that they still distinguish slow from fast after resampling.
    """
    rows = np.concatenate([bridge_gaps(relative(view, body_parts).reshape(len(view), -1).T) for view in centres])
    positions = resample_rows(rows, length)
    if not derived:
        return positions
    parts = positions.reshape(len(centres), len(body_parts), 2, length)
    anchor = anchor_rows(body_parts)
    others = np.delete(parts, anchor, axis=1) if len(anchor) == 1 else parts
    from_anchor = (others - parts[:, anchor].mean(axis=1, keepdims=True)).reshape(-1, length)
    velocities = np.gradient(positions, axis=1) * ((length - 1) / max(rows.shape[1] - 1, 1))
    return np.concatenate([positions, from_anchor, velocities])


def anchor_rows(body_parts: tuple[str, ...]) -> list[int]:
    """The rows of the one or two parts whose middle is the body's place, as for our observers: the head if recorded.

    All rows where no point of the trunk was recorded.
    """
    point = next((point for point in TRUNK_POINTS if set(point) <= set(body_parts)), body_parts)
    return [body_parts.index(part) for part in point]


def relative(centres: Floats, body_parts: tuple[str, ...] = BODY_PARTS) -> Floats:
    """(F, P, 2) centres of one view, v down -> in body sizes, up positive, relative to the first visible anchor.

    The body size is that after the last frame; unknown places stay NaN. Without a visible anchor, or without a hand
    visible together with it, the size is unknown and everything is NaN.
    """
    return from_first_anchor(centres, float(body_sizes(centres, body_parts)[-1]), body_parts)


def from_first_anchor(centres: Floats, size: float, body_parts: tuple[str, ...]) -> Floats:
    """The same with a size that is known."""
    anchor = centres[:, anchor_rows(body_parts)].mean(axis=1)
    visible = np.isfinite(anchor).all(axis=1)
    first = anchor[visible.argmax()] if visible.any() else np.full(2, np.nan)
    placed: Floats = (centres - first) / size * (1.0, -1.0)
    return placed


def body_sizes(centres: Floats, body_parts: tuple[str, ...] = BODY_PARTS) -> Floats:
    """(F, P, 2) centres -> (F,) TORSO_SHARE of the largest distance so far between anchor and hand; NaN until known.

    Without hands, of the largest distance between the anchor and any part.
    """
    ends = [body_parts.index(part) for part in HANDS if part in body_parts] or list(range(len(body_parts)))
    anchor = centres[:, anchor_rows(body_parts)].mean(axis=1, keepdims=True)
    distances = np.linalg.norm(centres[:, ends] - anchor, axis=2)
    largest = np.maximum.accumulate(np.nan_to_num(distances, nan=0.0).max(axis=1))
    sizes: Floats = np.where(largest > 0, TORSO_SHARE * largest, np.nan)
    return sizes


def bridge_gaps(rows: Floats) -> Floats:
    """(C, F) -> the same without NaN: straight lines over gaps, constant at the ends, 0 where all is NaN."""
    result = np.zeros_like(rows)
    instants = np.arange(rows.shape[1])
    for row, visible in zip(range(len(rows)), np.isfinite(rows), strict=True):
        if visible.any():
            result[row] = np.interp(instants, instants[visible], rows[row, visible])
    return result


def resample_rows(rows: Floats, length: int) -> Floats:
    """(C, F) -> (C, length), linear in time from the first frame to the last."""
    instants = np.linspace(0, rows.shape[1] - 1, length)
    return np.array([np.interp(instants, np.arange(rows.shape[1]), row) for row in rows])
