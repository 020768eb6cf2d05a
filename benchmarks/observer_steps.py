"""What one frame costs an observer: tracking hands and head in a picture; and the people and models of observer.py.

Floors, on the same pictures with one OpenCV thread:
- camshift: the plain calls on the whole picture: conversion to HSV, back-projection, and three CamShift calls.
- mediapipe (where it is installed): a bare call of its model, with the conversion to RGB.
"""

import importlib.util
import threading
from collections.abc import Callable, Iterator
from itertools import count
from pathlib import Path

import cv2
import numpy as np

from benchmarks.timing import BATCH_S, ROUNDS, BenchmarkRow, compare
from common.vocabulary import Vocabulary
from observer.geometry.views import parse_view
from observer.learning.learn import learn_view
from observer.model.base import MovementModel
from observer.motion.archive import MotionArchive, labels_of, resample, subjects_in
from observer.motion.importers import import_recordings
from observer.motion.playback import RecordedMotion
from observer.rendering.scenery import Scenery
from observer.rendering.virtual_camera import VirtualCamera
from observer.tracking.camshift import CamshiftTracker
from observer.tracks import BODY_PARTS, Floats, Frame, Tracker
from studies.performer import perform, perform_continuously
from studies.sensors import with_parts

SIZES = ((640, 480), (1280, 720))
RATE_HZ = 30.0
TRACKER_WARM_UP = 45
"""Pictures in which the tracker first finds the person."""
PICTURES = 90
Pictures = list[Frame]
Work = Callable[[], object]


def tracking_rows(rounds: int = ROUNDS, batch_s: float = BATCH_S) -> Iterator[BenchmarkRow]:
    """One row per size, two where mediapipe is installed."""
    cv2.setNumThreads(1)
    for size in SIZES:
        shot = pictures(size)
        yield camshift_row(shot, size, rounds, batch_s)
        if importlib.util.find_spec("mediapipe") is not None:
            yield mediapipe_row(shot, size, rounds, batch_s)


def pictures(size: tuple[int, int]) -> Pictures:
    """A virtual camera's pictures of the synthetic performer, cluttered and noisy: at rest, then waving."""
    stream = resample(perform_continuously("1", ("byebye",)), RATE_HZ)
    archive = MotionArchive(("left_hand", "right_hand", "head"), (stream,))
    motion = RecordedMotion(archive.body_parts, archive.recordings, speed=0)
    camera = VirtualCamera(motion, parse_view("door"), size, Scenery(background="cluttered", noise=3.0))
    frames = camera.frames(threading.Event())
    return [next(frames) for _ in range(min(TRACKER_WARM_UP + PICTURES, len(stream.positions)))]


def camshift_row(shot: Pictures, size: tuple[int, int], rounds: int, batch_s: float) -> BenchmarkRow:
    """Our tracker of three parts against the plain calls."""
    name = f"tracking, camshift, {size[0]}x{size[1]}"
    return compare(name, tracking(CamshiftTracker(), shot), plain_calls(shot), rounds, batch_s)


def mediapipe_row(shot: Pictures, size: tuple[int, int], rounds: int, batch_s: float) -> BenchmarkRow:
    """Our tracker around MediaPipe's model against its bare call."""
    from mediapipe.python.solutions.pose import Pose  # type: ignore[import-not-found,unused-ignore]

    from observer.tracking.mediapipe_pose import MediapipeTracker

    pose, numbers = Pose(), count()

    def bare() -> None:
        pose.process(cv2.cvtColor(shot[next(numbers) % len(shot)].content, cv2.COLOR_BGR2RGB))

    name = f"tracking, mediapipe, {size[0]}x{size[1]}"
    return compare(name, tracking(MediapipeTracker(), shot), bare, rounds, batch_s)


def tracking(tracker: Tracker, shot: Pictures) -> Work:
    """Updates of the tracker on the pictures forwards and backwards, so that nothing jumps; warmed up."""
    period_ns, last = round(1e9 / RATE_HZ), len(shot) - 1
    numbers = count()

    def step() -> None:
        number = next(numbers)
        place = number % (2 * last)
        tracker.update(Frame(number * period_ns, shot[place if place <= last else 2 * last - place].content))

    for _ in range(TRACKER_WARM_UP):
        step()
    return step


def plain_calls(shot: Pictures) -> Work:
    """The simplest tracker: no prediction, no sizes, no names, no loss of a part.

    Histogram and first windows are where our tracker finds the parts in the last picture.
    """
    centres, last = last_centres(shot), shot[-1].content
    side = last.shape[0] // 12
    windows = [(int(u) - side // 2, int(v) - side // 2, side, side) for u, v in centres]
    x, y, w, h = first = windows[2]
    hsv = cv2.cvtColor(last[y : y + h, x : x + w], cv2.COLOR_BGR2HSV)
    histogram = cv2.calcHist([hsv], [0, 1], None, [45, 32], [0, 180, 0, 256])
    cv2.normalize(histogram, histogram, 0, 255, cv2.NORM_MINMAX)
    stop, numbers = (cv2.TERM_CRITERIA_EPS | cv2.TERM_CRITERIA_COUNT, 10, 1.0), count()

    def step() -> None:
        hsv = cv2.cvtColor(shot[next(numbers) % len(shot)].content, cv2.COLOR_BGR2HSV)
        back = cv2.calcBackProject([hsv], [0, 1], histogram, [0, 180, 0, 256], 1)
        for i in range(len(windows)):
            _, window = cv2.CamShift(back, windows[i], stop)
            windows[i] = (window[0], window[1], window[2], window[3]) if window[2] and window[3] else first

    return step


def last_centres(shot: Pictures) -> Floats:
    """(P, 2) px: where each part was last visible; the middle of the picture if it never was."""
    tracker = CamshiftTracker()
    result = np.tile(np.array(shot[0].content.shape[1::-1]) / 2.0, (len(tracker.body_parts), 1))
    for number, frame in enumerate(shot):
        centres = tracker.update(Frame(round(number * 1e9 / RATE_HZ), frame.content)).centres
        result = np.where(np.isfinite(centres), centres, result)
    return result


FACINGS = 12
RECORDINGS = 20
"""Test recordings of the other half of the people, watched over and over."""


def learned(kind: str, train: MotionArchive, facings: int = 1) -> MovementModel:
    """A model of all movements in the Door view."""
    parameters = {"facings": float(facings)} if facings > 1 else {}
    vocabulary = Vocabulary(labels_of(train), "bench")
    return learn_view(train, parse_view("door"), vocabulary, kind=kind, parameters=parameters, calibrate=False)


def recorded(data: Path | None) -> MotionArchive:
    """Hands and head: MSR Action3D, 20 movements; without it the synthetic performer, 8 movements."""
    if data is None:
        return perform()
    return with_parts(import_recordings("msr-action3d", data / "msr_action3d").archive, BODY_PARTS)


def halves(archive: MotionArchive) -> tuple[MotionArchive, MotionArchive]:
    """Every other person for training; some recordings of the others for test."""
    learned = subjects_in(archive.recordings)[::2]
    train = tuple(r for r in archive.recordings if r.subject in learned)
    others = tuple(r for r in archive.recordings if r.subject not in learned)
    test = others[:: max(len(others) // RECORDINGS, 1)]
    return MotionArchive(archive.body_parts, train), MotionArchive(archive.body_parts, test)
