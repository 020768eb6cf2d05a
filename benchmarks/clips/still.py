"""Streams of people who stand still for 10 s, in the middle of a movement or not: nothing may be named.

Pictures: one picture of a film, again and again with the noise of a camera, through MediaPipe. Recordings: one instant
of a recording in 3-D, seen by the camera, with the noise of a depth camera.
"""

import zlib
from collections.abc import Iterator
from pathlib import Path

import cv2
import numpy as np

from benchmarks.clips.material import Clip, clip_view, pictures_of, track_pictures
from observer.geometry.projection import project
from observer.motion.archive import Recording
from observer.tracks import Floats, Picture

STILL_S = 10.0
SHARES = (0.0, 0.5, 1.0)
"""Where in a film or recording the person freezes: at its begin, in the middle, at its end."""
PICTURE_NOISE = 4.0
"""Standard deviation of a webcam's noise in a room, in grey levels of 255."""
FLICKER = 0.02
"""Standard deviation of the brightness from picture to picture, as a share."""
JOINT_NOISE_M = 0.01
"""Standard deviation of a depth camera's joints, of people who stand."""


def frozen_film(clip: Clip, share: float, rate_hz: float, folder: Path) -> Floats:
    """(F, 3, 2) px tracks of STILL_S of one noisy picture of a film, read from `folder` or written there."""
    pictures = list(pictures_of(clip))
    picture = pictures[round(share * (len(pictures) - 1))]
    frames = round(STILL_S * rate_hz)
    path = folder / f"{clip.name}_still_{round(100 * share)}.npz"
    return track_pictures(lambda: _noisy(picture, frames, clip.name), rate_hz, path)


def _noisy(picture: Picture, frames: int, seed: str) -> Iterator[Picture]:
    number = zlib.crc32(seed.encode()) % 2**31
    rng = np.random.default_rng(number)
    cv2.setRNGSeed(number)
    for _ in range(frames):
        noise = np.empty(picture.shape, np.int16)
        cv2.randn(noise, np.zeros(3), np.full(3, PICTURE_NOISE))
        light = 1.0 + FLICKER * rng.standard_normal()
        yield np.clip(picture * light + noise, 0, 255).astype(np.uint8)


def frozen_recording(recording: Recording, share: float, view: str, seed: int) -> Floats:
    """(F, 3, 2) px tracks of STILL_S of one instant of a recording, with JOINT_NOISE_M."""
    rng = np.random.default_rng(seed)
    positions = recording.positions[round(share * (len(recording.positions) - 1))].astype(np.float64)
    noise = rng.normal(0.0, JOINT_NOISE_M, (round(STILL_S * recording.rate_hz), *positions.shape))
    matrix = clip_view(view).matrix
    return np.array([project(matrix, instant) for instant in positions + noise])
