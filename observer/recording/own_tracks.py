"""An observer's own tracks as training data: the newest are remembered, and recordings are cut out of them. Pure."""

from collections import deque
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from common import SECOND_NS
from common.errors import BadInput
from common.text import plural
from observer.body import Stillness
from observer.motion.archive import Recording
from observer.prepared_tracks import at_even_rate
from observer.tracks import BODY_PARTS, Floats, Floats32, Frame, Tracks

RECORDING_HZ = 15.0
"""Default rate of recordings: most trackers find people as often on a small machine."""
RING_S = 600.0
MARGIN_S = 0.25
"""Rest that stays before and after a trimmed movement."""
WATCHED = (*BODY_PARTS, "left_knee", "right_knee")
"""The parts that show whether somebody moves: feet and what lies between tremble too much in a tracker's eyes."""


class RememberedFrame(NamedTuple):
    """The times of the motion and of the capture, ns, and the centres (P, 2)."""

    at_ns: int
    captured_ns: int
    centres: Floats32


class TracksRecorder:
    """Remembers the newest tracks of one observer, in memory only; recordings are cut out of them at any time.

    body_parts: names of the rows of the tracks. rate_hz: of recordings, best the model's. memory_s: tracks that are
    older than the newest by more are forgotten with the next frame. Each frame has two times in ns: that of the motion,
    `Frame.at_ns`, in which spans are cut, and that of its capture, by which others name a moment. Not thread-safe.
    """

    def __init__(self, body_parts: Sequence[str], rate_hz: float = RECORDING_HZ, memory_s: float = RING_S) -> None:
        self.body_parts, self.rate_hz, self.memory_s = tuple(body_parts), rate_hz, memory_s
        self.forget()

    def forget(self) -> None:
        """Forget all tracks."""
        self._frames: deque[RememberedFrame] = deque()

    @property
    def newest_ns(self) -> int | None:
        """Time of the newest frame; None before the first."""
        return self._frames[-1].at_ns if self._frames else None

    @property
    def oldest_ns(self) -> int | None:
        """Time of the oldest frame that is remembered; None without one."""
        return self._frames[0].at_ns if self._frames else None

    @property
    def captured_ns(self) -> tuple[int, int] | None:
        """When the oldest and the newest frame were captured, Unix epoch; None before the first."""
        return (self._frames[0].captured_ns, self._frames[-1].captured_ns) if self._frames else None

    def at_ns_of(self, captured_ns: int) -> int:
        """The time in the motion of the first frame captured then or later; of the newest if there is none."""
        return next((f for f in self._frames if f.captured_ns >= captured_ns), self._frames[-1]).at_ns

    def captured_ns_of(self, at_ns: int) -> int:
        """When the first frame from this time in the motion on was captured; the newest if there is none."""
        return next((f for f in self._frames if f.at_ns >= at_ns), self._frames[-1]).captured_ns

    def update(self, frame: Frame, tracks: Tracks) -> None:
        """Take in what the tracker found in a frame: centres (P, 2), NaN where not seen.

        If the clock is set back, all earlier tracks are forgotten, because nothing can be cut out of two times.
        """
        if self._frames:
            newest = self._frames[-1]
            if frame.at_ns == newest.at_ns:
                return
            if frame.at_ns < newest.at_ns or frame.captured_ns < newest.captured_ns:
                self.forget()
        self._frames.append(RememberedFrame(frame.at_ns, frame.captured_ns, tracks.centres.astype(np.float32)))
        oldest_ns = frame.at_ns - self.memory_s * SECOND_NS
        while self._frames[0].at_ns < oldest_ns:
            self._frames.popleft()

    def newest(self, seconds: float) -> Floats:
        """The centres (F, P, 2) of the last so many seconds, as the tracker found them."""
        begin_ns = (self.newest_ns or 0) - seconds * SECOND_NS
        return self._centres([f for f in self._frames if f.at_ns >= begin_ns])

    def _centres(self, frames: Sequence[RememberedFrame]) -> Floats:
        return np.array([f.centres for f in frames], np.float64).reshape(-1, len(self.body_parts), 2)

    def cut(self, begin_ns: int, end_ns: int, *, label: str = "", subject: str, trial: str = "") -> Recording:
        """What was found from `begin_ns` to `end_ns`, at the recorder's rate.

        label: the movement that it shows; "": none. Raises BadInput, one line for people, if there are fewer than two
        frames or no part was seen in any.
        """
        frames = [f for f in self._frames if begin_ns <= f.at_ns <= end_ns]
        if len(frames) < 2:
            raise BadInput(f"{len(frames)} pictures in {(end_ns - begin_ns) / SECOND_NS:.1f} s: is the camera working?")
        positions = at_even_rate(np.array([f.at_ns for f in frames]), self._centres(frames), self.rate_hz)
        if not np.isfinite(positions).any():
            raise BadInput("nobody was seen: labanmesh camera look shows whether the camera sees head and hands")
        return Recording(positions, self.rate_hz, label, subject, trial)


def watched_parts(body_parts: Sequence[str]) -> tuple[str, ...]:
    """Those of the parts that show whether somebody moves."""
    watched = tuple(part for part in body_parts if part in WATCHED)
    return watched if len(watched) > 1 else tuple(body_parts)


def moving_frames(recording: Recording, body_parts: Sequence[str]) -> tuple[int, int]:
    """First and past-the-end frame in which the person moves, with MARGIN_S of rest on both sides; (0, 0) if never."""
    stillness = Stillness(body_parts, recording.rate_hz)
    still = np.array([stillness.update(Tracks(c.astype(np.float64))) for c in recording.positions])
    moving = np.flatnonzero(still < 0.5)
    if not len(moving):
        return 0, 0
    margin = round(MARGIN_S * recording.rate_hz)
    # Stillness compares the newest 0.2 s with those before: a movement has begun earlier.
    return max(0, int(moving[0]) - 2 * margin), min(len(still), int(moving[-1]) + margin + 1)


def trimmed(recording: Recording, body_parts: Sequence[str], watched: Sequence[str] = ()) -> Recording:
    """The recording of one movement without the rest before and after it; unchanged if the person never moves.

    watched: the parts that show it; by default all.
    """
    watched = watched or body_parts
    begin, end = moving_frames(in_parts(recording, body_parts, watched), watched)
    return replace(recording, positions=recording.positions[begin:end]) if end else recording


def in_parts(recording: Recording, recorded: Sequence[str], wanted: Sequence[str]) -> Recording:
    """The recording, with the parts `recorded`, with the parts `wanted`, in that order; others are not seen."""
    if tuple(recorded) == tuple(wanted):
        return recording
    positions = np.full((len(recording.positions), len(wanted), recording.positions.shape[2]), np.nan, np.float32)
    for row, part in enumerate(wanted):
        if part in recorded:
            positions[:, row] = recording.positions[:, list(recorded).index(part)]
    return replace(recording, positions=positions)


def shares_text(shares: Mapping[str, float]) -> str:
    """The share of each part; of more than hands and head, the smallest and the largest share of the others."""
    others = [share for part, share in shares.items() if part not in BODY_PARTS]
    if len(others) in (0, len(shares)):
        return ", ".join(f"{part} {share:.0%}" for part, share in shares.items())
    named = ", ".join(f"{part} {share:.0%}" for part, share in shares.items() if part in BODY_PARTS)
    return f"{named}, {plural(len(others), 'other')} {min(others):.0%} to {max(others):.0%}"
