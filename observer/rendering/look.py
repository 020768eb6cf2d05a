"""How a performer looks: skin, hair and clothes, drawn by a seed so that every camera may show the same person."""

from dataclasses import dataclass

import numpy as np

Bgr = tuple[float, float, float]
"""A colour in daylight, 0 to 255: blue, green, red."""

SKIN_TONES: tuple[Bgr, ...] = (
    (180.0, 205.0, 240.0),
    (150.0, 180.0, 225.0),
    (120.0, 155.0, 205.0),
    (90.0, 125.0, 180.0),
    (65.0, 95.0, 145.0),
    (48.0, 70.0, 108.0),
)
"""From very light to very dark, one for each of Fitzpatrick's six types; a person's lies between two of them."""

# Nothing that is worn has the hue of skin: a tracker that finds the shirt errs for reasons of its own.
_HAIR: tuple[Bgr, ...] = ((24.0, 24.0, 28.0), (38.0, 42.0, 48.0), (120.0, 120.0, 118.0), (30.0, 32.0, 44.0))
_SHIRTS: tuple[Bgr, ...] = (
    (130.0, 70.0, 30.0),
    (70.0, 105.0, 40.0),
    (120.0, 45.0, 95.0),
    (62.0, 58.0, 55.0),
    (150.0, 120.0, 40.0),
    (60.0, 80.0, 65.0),
)
_TROUSERS: tuple[Bgr, ...] = ((70.0, 50.0, 40.0), (42.0, 40.0, 40.0), (95.0, 90.0, 86.0), (50.0, 60.0, 48.0))


@dataclass(frozen=True, slots=True)
class Look:
    """Colours of one person. skin: between two of SKIN_TONES; nothing else has the hue of skin."""

    skin: Bgr
    hair: Bgr
    shirt: Bgr
    trousers: Bgr
    shoes: Bgr = (30.0, 28.0, 28.0)


def look_of(seed: int) -> Look:
    """The look that belongs to a seed, 0 or more."""
    rng = np.random.default_rng((seed, 1))
    place = rng.uniform(0.0, len(SKIN_TONES) - 1.0)
    tone = [float(np.interp(place, range(len(SKIN_TONES)), channel)) for channel in zip(*SKIN_TONES, strict=True)]
    hair, shirt, trousers = (colours[rng.integers(len(colours))] for colours in (_HAIR, _SHIRTS, _TROUSERS))
    return Look((tone[0], tone[1], tone[2]), hair, shirt, trousers)
