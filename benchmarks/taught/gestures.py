"""`python -m benchmarks.taught.gestures`: writes `observer/model/common_gestures_table.py`, from other people's data.

The eight techniques of karate seen from three sides, and the ten movements of Northwestern-UCLA as each of its three
sensors saw them: none of MSR Action3D and of Florence 3D Actions, on which taught models are judged. What is stored are
means over all people and takes of one movement in one view, and how takes spread around such a mean; no recording.
"""

import sys
from collections import defaultdict
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np

from benchmarks.command_line import recordings_folder, run_command
from benchmarks.taught.few_takes import CENTRE_PX, DISTANCE_M, FOCAL_PX, SENSOR
from observer.geometry.projection import pinhole_matrix
from observer.geometry.views import View
from observer.model import common_gestures
from observer.model.body_trace import read_trace
from observer.model.common_gestures import CHANNELS, COSINES, as_text, cosines
from observer.motion.archive import MotionArchive, Recording, TracksCamera, movements_in, resample
from observer.motion.archive_file import read_archive
from observer.motion.projected import projected, view_of, view_tracks
from observer.tracks import BODY_PARTS, Floats, Floats32
from studies.sensors import with_parts

RATE_HZ = 15.0
YAWS_DEG = (-50.0, 0.0, 50.0)
FEWEST_FRAMES, FEWEST_TAKES = 8, 4
LARGEST = 6.0
"""Body sizes: a tracker's mistake."""
FARTHEST = 3.0
"""Body sizes from the mean that count."""
SMOOTHING = 1e-4
"""Ridge of a coefficient, times its number squared: short gestures have hardly more frames than cosines."""
DIRECTIONS = 12
STEP = 0.025
"""Of the integers of the table."""
LINE = 100


def classes(data: Path) -> Iterator[tuple[str, Floats32]]:
    """Name of movement and view, trace of a take."""
    karate = with_parts(read_archive(data / "karate" / "karate.npz"), BODY_PARTS)
    karate = MotionArchive(BODY_PARTS, tuple(movements_in(karate)))
    head = np.nanmean(np.concatenate([_even(r).positions[:, 2] for r in karate.recordings]), axis=0)
    for yaw in YAWS_DEG:
        matrix = pinhole_matrix(np.deg2rad(yaw), 0.1, DISTANCE_M, FOCAL_PX, CENTRE_PX, tuple(head.tolist()))
        yield from _seen(karate, View(f"karate {yaw:g}", matrix))
    for n in (1, 2, 3):
        archive = with_parts(read_archive(data / "nw_ucla" / f"sensor{n}.npz"), BODY_PARTS)
        yield from _seen(archive, View(f"nw_ucla {n}", SENSOR))


def _even(recording: Recording) -> Recording:
    return recording if recording.rate_hz == RATE_HZ else resample(recording, RATE_HZ)


def _seen(archive: MotionArchive, view: View) -> Iterator[tuple[str, Floats32]]:
    even = replace(archive, recordings=tuple(_even(r) for r in archive.recordings))
    tracks = projected(even, view, TracksCamera("gestures", (640, 480)))
    for recording in tracks.recordings:
        seen = view_tracks(view_of(tracks, ""), recording, tracks.body_parts, BODY_PARTS)
        yield f"{view.name} {recording.label}", read_trace(BODY_PARTS, RATE_HZ, seen)


def row_of(trace: Floats32) -> Floats:
    """(F, 9) -> (1 + CHANNELS * COSINES,) logarithm of the seconds, coefficients of each channel."""
    channels = np.concatenate([trace[:, :4], trace[:, -3:-1] - trace[0, -3:-1]], axis=1)
    basis = cosines(len(trace))
    ridge = SMOOTHING * len(trace) * np.diag(np.arange(COSINES) ** 2.0)
    coefficients = np.linalg.solve(basis.T @ basis + ridge, basis.T @ channels)
    return np.concatenate([[np.log(len(trace) / RATE_HZ)], coefficients.T.ravel()])


def learned(data: Path) -> tuple[Floats, Floats]:
    """(K, D) prototypes and (DIRECTIONS, D) spread."""
    rows: dict[str, list[Floats]] = defaultdict(list)
    for name, trace in classes(data):
        if len(trace) >= FEWEST_FRAMES:
            row = row_of(trace)
            if np.abs(row).max() <= LARGEST:
                rows[name].append(row)
    groups = [np.array(group) for group in rows.values() if len(group) >= FEWEST_TAKES]
    means = np.array([group.mean(axis=0) for group in groups])
    rests = np.concatenate([group - group.mean(axis=0) for group in groups])
    values, vectors = np.linalg.eigh(np.cov(np.clip(rests, -FARTHEST, FARTHEST).T))
    return means, (vectors[:, : -DIRECTIONS - 1 : -1] * np.sqrt(values[: -DIRECTIONS - 1 : -1])).T


def source_of(prototypes: Floats, spread: Floats) -> str:
    """The text of the module."""
    tables = [f"{name} = (\n{_lines(as_text(rows, STEP))})\n"
              for name, rows in (("PROTOTYPES", prototypes), ("SPREAD", spread))]  # fmt: skip
    return (
        '"""Numbers for `common_gestures.py`, written by `python -m benchmarks.taught.gestures`.\n\n'
        f"Means and spread of {len(prototypes)} movements and views: karate, 8 people, and Northwestern-UCLA\n"
        "Multiview Action3D, 6 people (Wang et al., CVPR 2014). Base64 of int8 rows: the logarithm of the\n"
        f"seconds, then {COSINES} cosines of each of {CHANNELS} channels.\n"
        '"""\n\n' + f"STEP = {STEP}\n" + '"""Of one unit, in body sizes."""\n' + "".join(tables)
    )


def _lines(text: str) -> str:
    return "".join(f'    "{text[n : n + LINE]}"\n' for n in range(0, len(text), LINE))


def gestures() -> None:
    """Write the module; print its path.

    LABANMESH_DATA names the folder of recordings.

    Example: python -m benchmarks.taught.gestures
    """
    data = recordings_folder()
    path = Path(common_gestures.__file__).with_name("common_gestures_table.py")
    path.write_text(source_of(*learned(data)))
    print(path)


if __name__ == "__main__":
    sys.exit(run_command(gestures, "taught.gestures"))
