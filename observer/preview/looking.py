"""Looks at a source for a moment: runs a tracker over some pictures, paints the newest, says what was found."""

import logging
import threading
from collections.abc import Iterator
from dataclasses import dataclass
from itertools import islice

import cv2
import numpy as np

from common.errors import LabanmeshError
from common.messages import ProcessState
from observer.camera.live import LiveCamera
from observer.preview.account import Account
from observer.preview.painting import paint
from observer.preview.previewed import back_projection
from observer.preview.sight import Picture, Recent, Sight
from observer.source import FrameSource
from observer.tracking.face import FaceFinder, have_cascade
from observer.tracking.window import SKIN
from observer.tracks import Frame, State, Tracker

PATIENCE_S = 10.0
"""So long a live camera may take beyond its own time for the pictures."""
FACE_EVERY = 3
"""A face is sought in every third picture: that costs more than tracking."""
SHORT_SIDE_PX = 480
"""Larger pictures are searched at this size, as `camshift` does."""
_SILENCE = logging.NullHandler()


@dataclass(frozen=True, slots=True, eq=False)
class Looked:
    """account: in numbers. painted: the newest picture, as a preview shows it."""

    account: Account
    painted: Picture


class Trouble:
    """A `observer.camera.base.Report` that remembers the last reason."""

    def __init__(self) -> None:
        self.reason = ""

    def __call__(self, state: ProcessState, reason: str) -> None:
        """As a source calls it."""
        self.reason = reason


def look_at(
    source: FrameSource, tracker: Tracker, frames: int, name: str, tracker_name: str, trouble: Trouble
) -> Looked:
    """At most so many pictures of a source called `name`, for people; `trouble` is what the source reports to.

    Raises LabanmeshError when a live camera gives none in PATIENCE_S, and what the source itself raises.
    """
    recent, faces = Recent(tracker.body_parts, source.rate_hz, name), _Faces()
    captured: list[int] = []
    states: list[tuple[State, ...]] = []
    frame: Frame | None = None
    sight: Sight | None = None
    for frame in _some(source, frames):
        sight = _seen(recent, tracker, frame)
        faces.look(frame.content)
        captured.append(frame.captured_ns)
        states.append(sight.tracks.states)
    if frame is None or sight is None:
        raise LabanmeshError(f"{name}: no picture within {PATIENCE_S:g} s: {trouble.reason or 'nothing came'}")
    live = isinstance(source, LiveCamera)
    rate_hz = _measured(captured, source.rate_hz) if live else source.rate_hz
    account = _account(name, tracker_name, frame.content, rate_hz, live, sight, states, faces)
    return Looked(account, paint(frame.content, sight))


def _account(
    name: str, tracker: str, picture: Picture, rate_hz: float, live: bool,
    sight: Sight, states: list[tuple[State, ...]], faces: "_Faces",
) -> Account:  # fmt: skip
    back, parts = sight.back_projection, sight.body_parts
    seen = np.mean([[state is State.SEEN for state in each] for each in states], axis=0)
    return Account(
        source=name,
        tracker=tracker,
        size_px=(picture.shape[1], picture.shape[0]),
        rate_hz=rate_hz,
        live=live,
        pictures=len(states),
        brightness=float(cv2.cvtColor(picture, cv2.COLOR_BGR2GRAY).mean()),
        faces=faces.found,
        faces_sought=faces.sought,
        face_px=faces.width_px,
        skin=None if back is None else float((back >= SKIN).mean()),
        seen=dict(zip(parts, seen.tolist(), strict=True)),
        states=dict(zip(parts, states[-1], strict=True)),
        complaint=sight.complaint,
    )


def _seen(recent: Recent, tracker: Tracker, frame: Frame) -> Sight:
    tracks = tracker.update(frame)
    back = back_projection(tracker, frame.content)
    return recent.see(tracks, back_projection=back, complaint=str(getattr(tracker, "complaint", "")))


def _some(source: FrameSource, frames: int) -> Iterator[Frame]:
    """The source's first frames; from a live camera only what comes in time."""
    stop = threading.Event()
    timer = threading.Timer(PATIENCE_S + frames / source.rate_hz, stop.set)
    if isinstance(source, LiveCamera):
        timer.start()
        # Its troubles are told in our one line; Python would print the log's warnings beside it.
        logging.getLogger("labanmesh.observer").addHandler(_SILENCE)
    try:
        yield from islice(source.frames(stop), frames)
    finally:
        timer.cancel()
        stop.set()
        logging.getLogger("labanmesh.observer").removeHandler(_SILENCE)


def _measured(captured_ns: list[int], nominal_hz: float) -> float:
    """Pictures a second; the nominal rate where there are too few to tell."""
    lasted_ns = captured_ns[-1] - captured_ns[0]
    return (len(captured_ns) - 1) / lasted_ns * 1e9 if lasted_ns > 0 else nominal_hz


class _Faces:
    """Counts the pictures in which OpenCV's cascade finds a face, where there is one."""

    def __init__(self) -> None:
        self._finder = FaceFinder() if have_cascade() else None
        self._number = -1
        self.sought, self.found = 0, 0
        self.width_px: int | None = None

    def look(self, picture: Picture) -> None:
        self._number += 1
        if self._finder is None or self._number % FACE_EVERY:
            return
        scale = min(1.0, SHORT_SIDE_PX / min(picture.shape[:2]))
        small = picture if scale == 1.0 else cv2.resize(picture, None, fx=scale, fy=scale)
        boxes = self._finder.find(small, max(small.shape[0] // 24, 16))
        self.sought += 1
        if boxes:
            self.found += 1
            self.width_px = round(boxes[0][2] / scale)
