"""From what cameras saw to one recording: one clock, positions in space, mended, in the performer's axes; pure."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from common.errors import BadInput
from observer.calibration.triangulate import GATE_PX
from observer.motion.archive import Recording
from observer.recording.axes import FRONT, UP, to_performer_axes
from observer.recording.mending import closed, moving_span, without_spikes
from observer.recording.rebuilding import rebuilt
from observer.recording.summary import summary
from observer.recording.timeline import Sighted, instants, sampled

Progress = Callable[[int, int], None]


@dataclass(frozen=True, slots=True)
class Choices:
    """gate_px: a camera further off is outvoted. up, front: axes of the room. trim: whether idle ends are cut off."""

    gate_px: float = GATE_PX
    up: str = UP
    front: str = FRONT
    trim: bool = False


def recorded(
    sighted: Sequence[Sighted],
    body_parts: Sequence[str],
    name: Recording,
    choices: Choices,
    progress: Progress = lambda *_: None,
) -> tuple[Recording, list[str]]:
    """`name` with the positions that the cameras agree on, at its own rate; and lines that say how good they are.

    Raises BadInput when there is no common time, or no part at any instant, with those lines.
    """
    at_ns = instants(sighted, name.rate_hz)
    known = [one for one in sighted if len(one.at_ns)]
    centres = np.stack([sampled(one, at_ns) for one in known], axis=2)
    found = rebuilt([one.matrix for one in known], centres, choices.gate_px, progress)
    positions = closed(without_spikes(found.positions, name.rate_hz), name.rate_hz)
    positions = to_performer_axes(positions, choices.up, choices.front)
    lines = summary([one.name for one in known], body_parts, found, positions)
    lines += [f"{one.name}: delivered no picture" for one in sighted if not len(one.at_ns)]
    if not np.isfinite(positions).any():
        raise BadInput(f"nothing was recorded: {'; '.join(lines)}")
    if choices.trim:
        hands = [row for row, part in enumerate(body_parts) if part.endswith("hand")]
        positions = positions[slice(*moving_span(positions, hands, name.rate_hz))]
    return replace(name, positions=positions.astype(np.float32)), lines
