"""A film of tracks for lessons: somebody who, for ever, rests, waves, and points."""

import numpy as np

from observer.motion.archive import MotionArchive, Recording, TracksCamera
from observer.motion.archive_file import write_archive
from observer.tracks import BODY_PARTS

RATE_HZ = 15
REST = np.array([[280.0, 300.0], [360.0, 300.0], [320.0, 100.0]])


def waving():
    lifted = ((t, min(1, 4 * t, 4 - 4 * t)) for t in steps(2))
    return [np.add(REST, [[0, 0], [30 + 60 * np.sin(4 * np.pi * t), -220 * up], [0, 0]]) for t, up in lifted]


def pointing():
    return [np.add(REST, [[-200 * up, -120 * up], [0, 0], [0, 0]]) for up in np.sin(np.pi * steps(1.6))]


def waving_left():
    """The same with the other hand."""
    return [np.add(REST, [[-30 - 60 * np.sin(4 * np.pi * t), -220 * min(1, 4 * t, 4 - 4 * t)], [0, 0], [0, 0]])
            for t in steps(2)]  # fmt: skip


def steps(seconds):
    return np.linspace(0, 1, round(seconds * RATE_HZ))


def film(path, seed, scale):
    """Somebody who, for ever, rests, waves three times, and points three times: one camera's tracks."""
    frames = []
    for movement in 3 * [waving] + 3 * [pointing]:
        frames += [REST] * (3 * RATE_HZ) + movement() + [REST] * (2 * RATE_HZ)
    write(path, [seen(scale * np.array(frames), seed)], "film")


def seen(frames, seed, label="", trial="0"):
    """What a camera sees of them."""
    noise = np.random.default_rng(seed).normal(0, 1.5, (len(frames), 3, 2))
    return Recording((frames + noise).astype(np.float32), RATE_HZ, label, "anna", trial)


def write(path, recordings, camera):
    write_archive(path, MotionArchive(BODY_PARTS, tuple(recordings), camera=TracksCamera(camera)))
