"""Runs a tracker over some pictures of a source, draws the newest and reports what was found."""

import logging
import threading
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from itertools import islice

import cv2
import numpy as np

from common.errors import LabanmeshError
from common.messages import ProcessState
from observer.camera.live import LiveCamera
from observer.preview.painting import paint
from observer.preview.screen import back_projection
from observer.preview.sight import Picture, PreviewFrame, PreviewHistory
from observer.tracking.back_projection import SKIN
from observer.tracking.head import FaceFinder, have_cascade
from observer.tracks import Frame, FrameSource, State, Tracker

DARK, BRIGHT = 45.0, 215.0
"""Mean grey levels (0 to 255) below and above which colours are lost."""
SMALL_FACE = 24
"""Width of a face, px, below which hands are a handful of pixels."""
SKIN_TONED = 0.15
"""Share of the picture from which on skin colour is not the person's alone."""


@dataclass(frozen=True, slots=True)
class LookReport:
    """What was found in `pictures` pictures; shares are 0 to 1.

    rate_hz: measured for a live camera, else as the recording says. brightness: mean grey level, 0 to 255. faces: in
    how many of `faces_sought` pictures there was a face, and face_px how wide the last was. skin: share of the newest
    picture that has the skin's colour, None where the tracker knows no such colour. seen: for each part the share of
    pictures in which it was seen. states: in the newest.
    """

    source: str
    tracker: str
    size_px: tuple[int, int]
    rate_hz: float
    live: bool
    pictures: int
    brightness: float
    faces: int
    faces_sought: int
    face_px: int | None
    skin: float | None
    seen: Mapping[str, float]
    states: Mapping[str, State]
    complaint: str = ""


def lines(account: LookReport) -> Iterator[str]:
    """The account, a line a thing."""
    width, height = account.size_px
    rate = "measured" if account.live else "as recorded"
    yield f"{account.source}: {width}x{height} px, {account.rate_hz:.3g} Hz {rate}, {account.pictures} pictures seen"
    yield f"  {'light':<12}{account.brightness:.0f} of 255"
    if account.faces_sought:
        wide = f", {account.face_px} px wide" if account.face_px else ""
        yield f"  {'face':<12}in {account.faces} of {account.faces_sought} pictures{wide}"
    if account.skin is not None:
        yield f"  {'skin':<12}its colour in {100 * account.skin:.1f} % of the picture"
    for part, state in account.states.items():
        share = f"seen in {100 * account.seen[part]:.0f} % of the pictures"
        yield f"  {part.replace('_', ' '):<12}{state.value:<8} {share}"


def advice(account: LookReport) -> Iterator[str]:
    """What to do, the most urgent first; one line that all is well where nothing is to be done."""
    said = list(_advice(account))
    yield from said or [f'nothing to do: tracker = "{account.tracker}" suits this picture']


def _advice(account: LookReport) -> Iterator[str]:
    if account.complaint:
        yield f"{account.tracker} says: {account.complaint}"
    if account.brightness < DARK:
        yield "too dark: more light, best from behind the camera"
    if account.brightness > BRIGHT:
        yield "too bright: less light, or turn the camera away from the window"
    if account.tracker == "camshift":
        yield from _about_skin(account)
    missing = [part for part, share in account.seen.items() if not share]
    if account.tracker == "camshift" and account.seen.get("head") and missing:
        named = " and ".join(part.replace("_", " ") for part in missing)
        yield f"{named} not seen: camshift takes up a hand when it moves in view; wave, and look again"
    elif account.tracker != "camshift" and missing == list(account.seen):
        yield "nobody seen: step before the camera so that head and hands are in the picture"


def _about_skin(account: LookReport) -> Iterator[str]:
    if not account.seen.get("head"):
        yield (
            "no face followed: face the camera, nearer; or mark it (--face X,Y,WIDTH,HEIGHT), or use skin saved "
            "elsewhere (--skin FILE), or --tracker mediapipe"
        )
    elif account.face_px and account.face_px < SMALL_FACE:
        yield f"a face of {account.face_px} px is small: nearer, or larger pictures, or --tracker mediapipe"
    if account.skin is not None and account.skin > SKIN_TONED:
        yield "much has the colour of skin: another background or whiter light, or --tracker mediapipe"


PATIENCE_S = 10.0
"""So long a live camera may take beyond its own time for the pictures."""
FACE_EVERY = 3
"""A face is sought in every third picture: that costs more than tracking."""
SHORT_SIDE_PX = 480
"""Larger pictures are searched at this size, as `camshift` does."""
_SILENCE = logging.NullHandler()


@dataclass(frozen=True, slots=True, eq=False)
class LookResult:
    """account: in numbers. painted: the newest picture, as a preview shows it."""

    account: LookReport
    painted: Picture


class LastReport:
    """A `observer.camera.base.Report` that remembers the last reason."""

    def __init__(self) -> None:
        self.reason = ""

    def __call__(self, state: ProcessState, reason: str) -> None:
        """As a source calls it."""
        self.reason = reason


def look_at(
    source: FrameSource, tracker: Tracker, frames: int, name: str, tracker_name: str, trouble: LastReport
) -> LookResult:
    """At most so many pictures of a source called `name`, for people; `trouble` is what the source reports to.

    Raises LabanmeshError when a live camera gives none in PATIENCE_S, and what the source itself raises.
    """
    recent, faces = PreviewHistory(tracker.body_parts, source.rate_hz, name), _Faces()
    captured: list[int] = []
    states: list[tuple[State, ...]] = []
    frame: Frame | None = None
    sight: PreviewFrame | None = None
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
    return LookResult(account, paint(frame.content, sight))


def _account(
    name: str, tracker: str, picture: Picture, rate_hz: float, live: bool,
    sight: PreviewFrame, states: list[tuple[State, ...]], faces: "_Faces",
) -> LookReport:  # fmt: skip
    back, parts = sight.back_projection, sight.body_parts
    seen = np.mean([[state is State.SEEN for state in each] for each in states], axis=0)
    return LookReport(
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


def _seen(recent: PreviewHistory, tracker: Tracker, frame: Frame) -> PreviewFrame:
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
