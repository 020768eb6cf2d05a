"""Common gestures: made examples of something else for models of few takes. Pure.

A few takes of three movements show little else, and a regression that learns from them takes any other movement for one
of the three. `common_gestures_table.py` has motion of other people: 54 prototypes, each the mean of one movement by 6
to 8 people in one view, and the directions in which people and takes differ from such a mean. Gestures are drawn from
these normal distributions, with a fixed seed. A gesture that is like a taught take is left out: it may be the taught
movement.
"""

import base64
from collections.abc import Mapping, Sequence
from functools import lru_cache

import numpy as np

from observer.geometry.views import is_this_camera
from observer.model.base import Example, Header, Stream
from observer.model.common_gestures_table import PROTOTYPES, SPREAD, STEP
from observer.model.few_takes import MOST_MOVEMENTS
from observer.model.nearest_take import MOST_TAKES, NearestTakes, NearestTakeWatch
from observer.model.parameters import Parameter, ParameterRange
from observer.tracks import BODY_PARTS, Floats, Floats32

COMMON_GESTURES = "common_gestures"
GESTURES: Mapping[str, Parameter] = {COMMON_GESTURES: Parameter(1.0, ParameterRange(0.0, 2.0, whole=True), earlier=0.0)}
"""1: a model of few takes by several people learns common gestures as something else; 2: so does one of takes by one
person; 0: no model does."""
CHANNELS, COSINES = 6, 10
"""Channels: both hands relative to the head, and the path of the head, each right and up. COSINES: coefficients of the
discrete cosine transform of each channel over a gesture's duration."""
DRAWN = 3
"""Gestures for each prototype."""
ALIKE = 2.0
"""Relative distance (`nearest_take.py`) below which a gesture may be the taught movement itself."""
SEED = 1


def cosines(frames: int) -> Floats:
    """(frames, COSINES) cos(π k (n + 1/2) / frames): the basis of the discrete cosine transform, not normalised."""
    at = (np.arange(frames) + 0.5) / frames
    return np.cos(np.pi * np.outer(at, np.arange(COSINES)))


def learns_gestures(header: Header, examples: Sequence[Example]) -> bool:
    """Whether a model of these examples learns common gestures.

    Not a model of many takes or movements, of positions in 3-D, or of body parts other than hands and head.
    """
    people = [example.subject for example in examples if example.movement >= 0]
    is_few = 2 <= len(people) <= MOST_TAKES and header.vocabulary.size <= MOST_MOVEMENTS
    is_taught = is_this_camera(header.matrix) and set(header.body_parts) == set(BODY_PARTS)
    return is_few and is_taught and header.parameters[COMMON_GESTURES] >= (1 if len(set(people)) > 1 else 2)


def streams_for(header: Header, examples: Sequence[Example], traces: Sequence[Floats32]) -> list[Stream]:
    """Common gestures as streams of something else, with traces (F, 2 P + 3) as features; none where they are
    not learned."""
    if not learns_gestures(header, examples):
        return []
    own = [(e, t) for e, t in zip(examples, traces, strict=True) if e.movement >= 0]
    takes = _takes(own, header.vocabulary.size)
    return [
        Stream((), subject="common", trial=str(n), features=trace.astype(np.float64))
        for n, trace in enumerate(drawn_traces(header.rate_hz, tuple(header.body_parts)))
        if takes is None or not _is_like(takes, trace)
    ]


@lru_cache(maxsize=4)
def drawn_traces(rate_hz: float, body_parts: tuple[str, ...]) -> tuple[Floats32, ...]:
    """The gestures, as traces (F, 2 P + 3) at this rate."""
    rng = np.random.default_rng(SEED)
    prototypes, spread = _table()
    drawn = np.repeat(prototypes, DRAWN, axis=0)
    drawn = drawn + rng.normal(size=(len(drawn), len(spread))) @ spread
    return tuple(_trace(row, rate_hz, body_parts) for row in drawn)


def _trace(row: Floats, rate_hz: float, body_parts: tuple[str, ...]) -> Floats32:
    """(1 + CHANNELS * COSINES,) logarithm of the seconds, coefficients -> (F, 2 P + 3)."""
    frames = max(round(float(np.exp(np.clip(row[0], -1.0, 1.6))) * rate_hz), 5)
    channels = cosines(frames) @ row[1:].reshape(CHANNELS, COSINES).T
    hands = {"left_hand": channels[:, 0:2], "right_hand": channels[:, 2:4], "head": np.zeros((frames, 2))}
    path = channels[:, 4:6] - channels[0, 4:6]
    parts = [hands[part] for part in body_parts]
    return np.concatenate([*parts, path, np.ones((frames, 1))], axis=1).astype(np.float32)


@lru_cache(maxsize=1)
def _table() -> tuple[Floats, Floats]:
    """(K, 1 + CHANNELS * COSINES) prototypes, and (R, the same) directions in which gestures spread by one standard
    deviation."""
    width = 1 + CHANNELS * COSINES
    whole = [np.frombuffer(base64.b64decode(text), np.int8).reshape(-1, width) for text in (PROTOTYPES, SPREAD)]
    prototypes, spread = (rows.astype(np.float64) * STEP for rows in whole)
    return prototypes, spread


def as_text(rows: Floats, step: float) -> str:
    """Rows in units of `step`, as `_table` reads them."""
    return base64.b64encode(np.clip(np.round(rows / step), -127, 127).astype(np.int8).tobytes()).decode()


def _takes(own: Sequence[tuple[Example, Floats32]], movements: int) -> NearestTakes | None:
    shown = [Example((), e.movement, 0, e.subject, e.trial, features=trace.astype(np.float64)) for e, trace in own]
    return NearestTakes.of(shown, movements)


def _is_like(takes: NearestTakes, trace: Floats32) -> bool:
    watch = NearestTakeWatch(takes, trace)
    return bool(watch.relative_distances.min() < ALIKE)
