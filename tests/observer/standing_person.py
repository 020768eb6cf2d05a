"""A recorded person who stands upright somewhere in a room."""

import numpy as np

from observer.tracks import WHOLE_BODY

HEIGHTS = {"head": 1.6, "neck": 1.38, "pelvis": 1.0, "hip": 0.99, "shoulder": 1.33, "elbow": 1.1, "hand": 0.85,
           "knee": 0.5, "foot": 0.08}  # fmt: skip


def person(x, z):
    """(15, 3) a person who stands there."""
    aside = {"left": -0.15, "right": 0.15}
    return np.array(
        [[x + aside.get(part.partition("_")[0], 0.0), HEIGHTS[part.rpartition("_")[2]], z] for part in WHOLE_BODY]
    )
