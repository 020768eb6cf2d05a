"""Several sensors that recorded the same performances: which recordings show one performance, and at what time.

The same label, subject and trial in two archives is the same performance. Each sensor's recording was cut out by itself
and none has timestamps, so that sensors are compared at equal fractions of their recordings.
"""

import math
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from common.errors import BadInput
from observer.geometry.views import View
from observer.motion.archive import MotionArchive, Recording, movements_in, retime
from observer.motion.sensors import parse_sensors
from studies.trials import EvaluationTrial


def read_sensors(
    texts: Sequence[str], read: Callable[[Path], MotionArchive]
) -> tuple[tuple[View, ...], tuple[MotionArchive, ...]]:
    """`NAME=FILE.npz` or `NAME=FILE.npz@VIEW` each -> the views, under the sensors' names, and their archives.

    The archives get the body parts that all have. Raises BadInput for fewer than two sensors, a text of another form,
    a name given twice, two recordings of one performance in a file, and sensors without a common body part or rate.
    """
    if len(texts) < 2:
        raise BadInput(f"--sensor {texts[0]}: at least two sensors are needed; for one archive use ARCHIVE --views")
    sensors = parse_sensors(texts)
    archives = [read(sensor.path) for sensor in sensors]
    of_sensors = list(zip(sensors, archives, strict=True))
    views = tuple(View(sensor.name, sensor.view_in(archive).matrix) for sensor, archive in of_sensors)
    for sensor, archive in of_sensors:
        _require_one_of_each(archive, sensor.name)
        if (archive.camera is None) != (archives[0].camera is None):
            raise BadInput(f"--sensor {sensor.name}: all sensors must be 2-D tracks, or all positions in 3-D")
    parts = tuple(p for p in archives[0].body_parts if all(p in a.body_parts for a in archives))
    rates = sorted({r.rate_hz for archive in archives for r in archive.recordings})
    if not parts or len(rates) > 1:
        detail = f"rates of {rates[0]:g} and {rates[-1]:g} Hz" if parts else "no body part that all have"
        raise BadInput(f"--sensor: {detail}; record or convert the sensors alike")
    return views, tuple(with_parts(archive, parts) for archive in archives)


def _require_one_of_each(archive: MotionArchive, name: str) -> None:
    keys: set[tuple[str, str, str]] = set()
    for recording in archive.recordings:
        if key_of(recording) in keys:
            performance = " ".join(filter(None, key_of(recording)))
            raise BadInput(f"--sensor {name}: two recordings of {performance}; give each another trial")
        keys.add(key_of(recording))


def with_parts(archive: MotionArchive, parts: tuple[str, ...]) -> MotionArchive:
    """Only these body parts, in this order; raises BadInput for one that the archive lacks."""
    if parts == archive.body_parts:
        return archive
    missing = [part for part in parts if part not in archive.body_parts]
    if missing:
        raise BadInput(f"body part {missing[0]!r}: not in the recording; it has {', '.join(archive.body_parts)}")
    rows = [archive.body_parts.index(part) for part in parts]
    recordings = tuple(replace(r, positions=r.positions[:, rows]) for r in archive.recordings)
    return replace(archive, body_parts=parts, recordings=recordings)


def key_of(recording: Recording) -> tuple[str, str, str]:
    """The key that all recordings of one performance share: label, subject and trial."""
    return recording.label, recording.subject, recording.trial


def performances(archives: Sequence[MotionArchive]) -> MotionArchive:
    """Every performance once, as the first sensor recorded it that has it."""
    first: dict[tuple[str, str, str], Recording] = {}
    for archive in archives:
        for recording in archive.recordings:
            first.setdefault(key_of(recording), recording)
    return MotionArchive(archives[0].body_parts, tuple(first.values()))


def same_performances(archive: MotionArchive, recordings: Sequence[Recording]) -> list[Recording | None]:
    """What a sensor recorded of each performance; None where it has no recording."""
    pieces = MotionArchive(archive.body_parts, (*movements_in(archive), *archive.recordings))
    own = {key_of(recording): recording for recording in pieces.recordings}
    return [own.get(key_of(recording)) for recording in recordings]


def same_trials(archive: MotionArchive, trials: Sequence[EvaluationTrial]) -> list[EvaluationTrial | None]:
    """The trials as a sensor recorded them; None where it has no recording."""
    own = same_performances(archive, [trial.recording for trial in trials])
    return [
        None if recording is None else replace(trial, recording=recording, begin=0, end=len(recording.positions))
        for trial, recording in zip(trials, own, strict=True)
    ]


def same_streams(archive: MotionArchive, recordings: Sequence[Recording]) -> list[Recording]:
    """What a sensor recorded, stretched to the length of each recording; nothing is seen where it has no recording."""
    own = same_performances(archive, recordings)
    return [_stretched(recording, to) for recording, to in zip(own, recordings, strict=True)]


def _stretched(recording: Recording | None, to: Recording) -> Recording:
    if recording is None:
        return replace(to, positions=np.full_like(to.positions, np.nan))
    frames, wanted = len(recording.positions), len(to.positions)
    if frames == wanted:
        return replace(to, positions=recording.positions)
    positions = retime(recording, (frames - 1) / (wanted - 1)).positions if min(frames, wanted) > 1 else None
    if positions is None:
        positions = recording.positions[frames_at_fractions(frames, wanted)]
    return replace(to, positions=positions[:wanted])


def frames_at_fractions(frames: int, wanted: int) -> NDArray[np.int64]:
    """(wanted,) frames of a recording of `frames` frames after 1/wanted, 2/wanted, ... of it, none later than that."""
    return np.array([max(math.ceil((n + 1) * frames / wanted - 1e-9), 1) - 1 for n in range(wanted)], dtype=np.int64)
