"""The cost of finding two hands and a face in a picture, at two sizes.

Floors, of the same pictures in the same run, one OpenCV thread:
- camshift: the plain calls on the whole picture: colour conversion to HSV, back-projection, and three CamShift calls.
- mediapipe (where it is installed): a bare call of its model, the conversion to RGB included.
"""

import importlib.util
import threading
from collections.abc import Callable, Iterator
from itertools import count

import cv2
import numpy as np

from benchmarks.timing import BATCH_S, ROUNDS, Row, compare
from observer.geometry.views import parse_view
from observer.motion.archive import MotionArchive
from observer.motion.resample import resample
from observer.rendering.scenery import Scenery
from observer.rendering.virtual_camera import VirtualCamera
from observer.source import RecordedMotion
from observer.tracking.camshift import CamshiftTracker
from observer.tracks import Floats, Frame, Tracker
from studies.performer import perform_continuously

SIZES = ((640, 480), (1280, 720))
RATE_HZ = 30.0
WARM_UP = 45
"""So many pictures, at first, teach the tracker who stands there."""
PICTURES = 90
Pictures = list[Frame]
Work = Callable[[], object]


def rows(rounds: int = ROUNDS, batch_s: float = BATCH_S) -> Iterator[Row]:
    """Two rows a size, or one without mediapipe."""
    cv2.setNumThreads(1)
    for size in SIZES:
        shot = pictures(size)
        yield camshift_row(shot, size, rounds, batch_s)
        if importlib.util.find_spec("mediapipe") is not None:
            yield mediapipe_row(shot, size, rounds, batch_s)


def pictures(size: tuple[int, int]) -> Pictures:
    """A virtual camera's pictures of the synthetic performer, cluttered and noisy: idle, then waving."""
    stream = resample(perform_continuously("1", ("byebye",)), RATE_HZ)
    archive = MotionArchive(("left_hand", "right_hand", "head"), (stream,))
    motion = RecordedMotion(archive.body_parts, archive.recordings, speed=0)
    camera = VirtualCamera(motion, parse_view("door"), size, Scenery(background="cluttered", noise=3.0))
    frames = camera.frames(threading.Event())
    return [next(frames) for _ in range(min(WARM_UP + PICTURES, len(stream.positions)))]


def camshift_row(shot: Pictures, size: tuple[int, int], rounds: int, batch_s: float) -> Row:
    """Our tracker, all three parts, against the plain calls."""
    name = f"tracking, camshift, {size[0]}x{size[1]}"
    return compare(name, tracking(CamshiftTracker(), shot), plain_calls(shot), rounds, batch_s)


def mediapipe_row(shot: Pictures, size: tuple[int, int], rounds: int, batch_s: float) -> Row:
    """Our tracker around MediaPipe's model, against its bare call."""
    from mediapipe.python.solutions.pose import Pose  # type: ignore[import-not-found,unused-ignore]

    from observer.tracking.mediapipe_pose import MediapipeTracker

    pose, numbers = Pose(), count()

    def bare() -> None:
        pose.process(cv2.cvtColor(shot[next(numbers) % len(shot)].content, cv2.COLOR_BGR2RGB))

    name = f"tracking, mediapipe, {size[0]}x{size[1]}"
    return compare(name, tracking(MediapipeTracker(), shot), bare, rounds, batch_s)


def tracking(tracker: Tracker, shot: Pictures) -> Work:
    """Updates of the tracker, the pictures forth and back, so that nothing jumps; warmed up."""
    period_ns, last = round(1e9 / RATE_HZ), len(shot) - 1
    numbers = count()

    def step() -> None:
        number = next(numbers)
        place = number % (2 * last)
        tracker.update(Frame(number * period_ns, shot[place if place <= last else 2 * last - place].content))

    for _ in range(WARM_UP):
        step()
    return step


def plain_calls(shot: Pictures) -> Work:
    """What a first programme does with each picture: no prediction, no sizes, no names, and nothing is ever lost.

    Its histogram and its three first windows are where our tracker found the parts in the last picture.
    """
    found, last = located(shot), shot[-1].content
    side = last.shape[0] // 12
    windows = [(int(u) - side // 2, int(v) - side // 2, side, side) for u, v in found]
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


def located(shot: Pictures) -> Floats:
    """(P, 2) px: where the parts were last seen, the picture's middle for one that never was."""
    tracker = CamshiftTracker()
    found = np.tile(np.array(shot[0].content.shape[1::-1]) / 2.0, (len(tracker.body_parts), 1))
    for number, frame in enumerate(shot):
        centres = tracker.update(Frame(round(number * 1e9 / RATE_HZ), frame.content)).centres
        found = np.where(np.isfinite(centres), centres, found)
    return found
