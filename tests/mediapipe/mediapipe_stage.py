"""Reading and tracking of recorded pictures."""

import cv2
import numpy as np

from observer.tracks import Frame


def pictures(file, every=1):
    """(H, W, 3) pictures of a video."""
    video = cv2.VideoCapture(str(file))
    number = 0
    while video.grab():
        if number % every == 0:
            yield video.retrieve()[1]
        number += 1
    assert number, f"{file} has no pictures"


def follow(tracker, pictures, rate_hz):
    """Tracks of a sequence of pictures."""
    return [tracker.update(Frame(round(n * 1e9 / rate_hz), picture)) for n, picture in enumerate(pictures)]


def unmirrored(file):
    """The pictures of a mirrored video, turned back."""
    return [np.ascontiguousarray(picture[:, ::-1]) for picture in pictures(file)]


def side_by_side(*films):
    """The pictures of films next to each other; the shorter one waits in its last picture."""
    count = max(map(len, films))
    return [np.concatenate([film[min(n, len(film) - 1)] for film in films], axis=1) for n in range(count)]
