"""Runs a tracker over some pictures of a source, paints the newest, and reports in words what was found."""

import logging
import threading
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import islice

import cv2
import numpy as np

from common import SECOND_NS
from common.errors import LabanmeshError
from common.text import plural
from common.tracker_choice import TrackerChoice
from observer.camera.live import LiveCamera
from observer.preview.small_picture import Sighting
from observer.preview.track_doubts import Box, Doubt, doubts, explain
from observer.tracking.back_projection import SKIN
from observer.tracking.head import FaceFinder, have_cascade
from observer.tracking.skin import SkinHistogram
from observer.tracks import Frame, FrameSource, Picture, SeenPeople, State, Tracker, Tracks

DARK, BRIGHT = 45.0, 215.0
"""Mean grey levels (0 to 255) below and above which colours are lost."""
SMALL_FACE = 24
"""Face width in px below which a hand is only a few pixels wide."""
SKIN_TONED = 0.15
"""Share of the picture from which skin colour is not the person's alone."""
CAMERA_RESERVE_S = 10.0
"""Time that a live camera may take beyond the nominal time of the pictures."""
FACE_EVERY = 3
"""A face is searched in every third picture, because that costs more than tracking."""
SHORT_SIDE_PX = 480
"""Larger pictures are reduced for the search, as `camshift` does."""
SKIN_ROW_PX = 320
"""Skin is counted in about this many pixels of a row."""
_DISCARD = logging.NullHandler()


@dataclass(frozen=True, slots=True)
class LookReport:
    """What was found in `pictures` pictures; shares are 0 to 1.

    rate_hz: measured for a live camera, else as the recording states. brightness: mean grey level, 0 to 255. faces:
    number of pictures with a face among the `faces_searched`, and face_px the width of the last. skin: share of the
    newest picture in the skin's colour, None for a tracker without one. seen_share: by part, the share of pictures in
    which it was seen. states: in the newest picture. reason: why this tracker, "" if it was named; lacks: why not a
    better one. doubts: signs that the tracks are wrong. people: in the newest picture, from trackers that tell.
    size_note: how the pictures differ from those of the camera file, "" if they do not.
    """

    source: str
    tracker: str
    size_px: tuple[int, int]
    rate_hz: float
    live: bool
    pictures: int
    brightness: float
    faces: int
    faces_searched: int
    face_px: int | None
    skin: float | None
    seen_share: Mapping[str, float]
    states: Mapping[str, State]
    complaint: str = ""
    reason: str = ""
    lacks: str = ""
    doubts: Sequence[Doubt] = ()
    people: SeenPeople | None = None
    size_note: str = ""


def report_lines(report: LookReport) -> Iterator[str]:
    """The report, one line per fact."""
    width, height = report.size_px
    rate = "measured" if report.live else "as recorded"
    pictures = plural(report.pictures, "picture")
    yield f"{report.source}: {width}x{height} px, {report.rate_hz:.3g} Hz {rate}, {pictures} read"
    yield f"  {'tracker':<12}{report.tracker}{f': {report.reason}' if report.reason else ''}"
    yield f"  {'light':<12}{report.brightness:.0f} of 255"
    if report.faces_searched:
        wide = f", {report.face_px} px wide" if report.face_px else ""
        yield f"  {'face':<12}in {report.faces} of {plural(report.faces_searched, 'picture')}{wide}"
    if report.skin is not None:
        yield f"  {'skin':<12}its colour in {100 * report.skin:.1f} % of the picture"
    if report.people is not None:
        yield f"  {'people':<12}{_people(report.people)}"
    column = max([12, *(len(part) + 1 for part in report.states)])
    for part, state in report.states.items():
        share = f"seen in {100 * report.seen_share[part]:.0f} % of the pictures"
        yield f"  {part.replace('_', ' '):<{column}}{state.value:<8} {share}"


def _people(people: SeenPeople) -> str:
    if people.followed is None:
        return f"{people.count} seen, nobody followed"
    at = people.followed
    place = f"{(at.left + at.right) / 2:.0f}, {(at.top + at.bottom) / 2:.0f} px"
    return f"{people.count} seen; followed: the one at {place}, {at.bottom - at.top:.0f} px tall"


def advice(report: LookReport) -> Iterator[str]:
    """What to do, most urgent first; one line that all is well when there is nothing to do."""
    lines = list(_advice(report))
    if lines and report.lacks:
        lines.append(report.lacks)
    yield from lines or [f'nothing to do: tracker = "{report.tracker}" suits this picture']


def _advice(report: LookReport) -> Iterator[str]:
    if report.size_note:
        yield report.size_note
    if report.complaint:
        yield f"{report.tracker} reports: {report.complaint}"
    if report.brightness < DARK:
        yield "too dark: add light, best from behind the camera"
    if report.brightness > BRIGHT:
        yield "too bright: reduce the light, or turn the camera away from the window"
    if report.tracker == "camshift":
        yield from _skin_advice(report)
    missing = [part for part, share in report.seen_share.items() if not share]
    if report.tracker == "camshift" and report.seen_share.get("head") and missing:
        parts = " and ".join(part.replace("_", " ") for part in missing)
        yield f"{parts} not seen: camshift finds a hand when it moves in view; wave, and look again"
    elif report.tracker != "camshift" and missing == list(report.seen_share):
        yield "nobody seen: stand in front of the camera so that head and hands are in the picture"
    yield from (explain(doubt, report.tracker) for doubt in report.doubts)


def _skin_advice(report: LookReport) -> Iterator[str]:
    if not report.seen_share.get("head"):
        yield (
            "no face tracked: face the camera, nearer; or mark it (--face X,Y,WIDTH,HEIGHT), or use skin saved "
            "elsewhere (--skin FILE), or --tracker mediapipe"
        )
    elif report.face_px and report.face_px < SMALL_FACE:
        yield f"a face of {report.face_px} px is small: come nearer, use larger pictures, or --tracker mediapipe"
    if report.skin is not None and report.skin > SKIN_TONED:
        yield "much of the picture has the colour of skin: change the background or the light, or --tracker mediapipe"


def look_at(
    source: FrameSource, tracker: Tracker, frames: int, name: str, choice: TrackerChoice, reasons: Sequence[str]
) -> tuple[LookReport, Sighting]:
    """Track at most `frames` pictures of a source: what was found, and the newest picture as the tracker sees it.

    name: of the source, for people. reasons: what the source has reported of its camera.

    Raises LabanmeshError when a live camera delivers no picture within CAMERA_RESERVE_S, and what the source raises.
    """
    faces, tracked, frame = _FaceCount(), list[tuple[int, int, Tracks]](), None
    for frame in _first_frames(source, frames):
        tracked.append((frame.captured_ns, frame.at_ns, tracker.update(frame)))
        faces.search(frame.content)
    if frame is None:
        reason = (reasons or [""])[-1] or "the source delivered nothing"
        raise LabanmeshError(f"{name}: no picture within {CAMERA_RESERVE_S:g} s: {reason}")
    picture, parts, live = frame.content, tracker.body_parts, isinstance(source, LiveCamera)
    captured_ns, at_ns, tracks = zip(*tracked, strict=True)
    centres = np.array([each.centres for each in tracks])
    report = LookReport(
        source=name,
        tracker=choice.name,
        reason=choice.reason,
        lacks=choice.lacks,
        size_px=(picture.shape[1], picture.shape[0]),
        rate_hz=_measured_hz(captured_ns, source.rate_hz) if live else source.rate_hz,
        live=live,
        pictures=len(tracks),
        brightness=float(cv2.cvtColor(picture, cv2.COLOR_BGR2GRAY).mean()),
        faces=faces.detected,
        faces_searched=faces.searched,
        face_px=faces.width_px,
        skin=_skin_share(getattr(tracker, "skin", None), picture),
        seen_share=dict(zip(parts, np.isfinite(centres).all(axis=2).mean(axis=0).tolist(), strict=True)),
        states=dict(zip(parts, tracks[-1].states, strict=True)),
        complaint=str(getattr(tracker, "complaint", "")),
        people=tracks[-1].people,
        doubts=doubts(centres, parts, at_ns, faces.boxes),
    )
    return report, Sighting(picture, tracks[-1], parts, frame.captured_ns)


def _skin_share(skin: SkinHistogram | None, picture: Picture) -> float | None:
    """The share of the picture in the colour of the skin; None for a tracker without one."""
    if skin is None:
        return None
    step = max(1, picture.shape[1] // SKIN_ROW_PX)
    return float((skin.back_project(picture[::step, ::step].copy()) >= SKIN).mean())


def _first_frames(source: FrameSource, frames: int) -> Iterator[Frame]:
    """The source's first frames; from a live camera only those before the timeout."""
    stop = threading.Event()
    timer = threading.Timer(CAMERA_RESERVE_S + frames / source.rate_hz, stop.set)
    if isinstance(source, LiveCamera):
        timer.start()
        # Its faults are part of our error; without a handler Python would print the warnings as well.
        logging.getLogger("labanmesh.observer").addHandler(_DISCARD)
    try:
        yield from islice(source.frames(stop), frames)
    finally:
        timer.cancel()
        stop.set()
        logging.getLogger("labanmesh.observer").removeHandler(_DISCARD)


def _measured_hz(captured_ns: Sequence[int], nominal_hz: float) -> float:
    """Pictures per second; the nominal rate when there are too few."""
    duration_ns = captured_ns[-1] - captured_ns[0]
    return (len(captured_ns) - 1) / duration_ns * SECOND_NS if duration_ns > 0 else nominal_hz


class _FaceCount:
    """Counts the pictures in which OpenCV's cascade detects a face, where there is a cascade."""

    def __init__(self) -> None:
        self._finder = FaceFinder() if have_cascade() else None
        self._number = -1
        self.searched, self.detected = 0, 0
        self.width_px: int | None = None
        self.boxes: dict[int, list[Box]] = {}
        """The faces in each picture that was searched, px of the picture."""

    def search(self, picture: Picture) -> None:
        self._number += 1
        if self._finder is None or self._number % FACE_EVERY:
            return
        scale = min(1.0, SHORT_SIDE_PX / min(picture.shape[:2]))
        small = picture if scale == 1.0 else cv2.resize(picture, None, fx=scale, fy=scale)
        boxes = self._finder.find(small, max(small.shape[0] // 24, 16))
        self.searched += 1
        self.boxes[self._number] = [
            (left / scale, top / scale, width / scale, height / scale) for left, top, width, height in boxes
        ]
        if boxes:
            self.detected += 1
            self.width_px = round(boxes[0][2] / scale)
