"""The borders of the watch for falls, chosen on simulated falls alone and tried on recordings that had no say.

    LABANMESH_DATA=... python -m benchmarks.fall_borders

Each border is moved while the others stay: the values at which four cameras together see every simulated fall in time,
and nothing that comes near to a fall raises an alarm. Then the middles of these ranges are tried together, beside the
borders of the product, on the windows of falls and on people who do not fall (benchmarks/falls.py).
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from itertools import product
from pathlib import Path
from typing import Annotated

import typer

from benchmarks.command_line import run_command
from benchmarks.falls import IN_TIME_S, LEVEL, PEOPLE_WHO_DO_NOT_FALL, RAISED, seen_from, watch
from benchmarks.simulated_falls import DIRECTIONS_DEG, EVERYDAY, everyday, fall
from common.errors import BadInput
from observer.motion.archive import MotionArchive
from observer.motion.archive_file import read_archive
from observer.preview.posture_outlet import LyingBorders, LyingReader
from observer.tracks import WHOLE_BODY, Floats
from studies.performer.perform import PEOPLE

TRIED: Mapping[str, Sequence[float]] = {
    "lean_deg": (30, 40, 50, 60, 70),
    "height": (0.3, 0.4, 0.5, 0.6, 0.7),
    "aside": (1.1, 1.3, 1.5, 1.7, 1.9),
    "above": (0.4, 0.7, 1.0, 1.2, 1.4),
}
Simulated = Sequence[tuple[Sequence[Floats], float | None, float]]
"""Tracks of four cameras, when a fall begins and until when an alarm is in time; None: it is no fall."""


def _simulated() -> Simulated:
    cases = list[tuple[Sequence[Floats], float | None, float]]()
    for views in (LEVEL, RAISED):
        for slow, (seed, (person, direction)) in product((False, True), enumerate(product(PEOPLE, DIRECTIONS_DEG))):
            fallen = fall(person, direction, slow, seed=seed)
            cases.append((seen_from(fallen.recording, views), fallen.begins_s, fallen.lies_s + IN_TIME_S))
        for what, (seed, person) in product(EVERYDAY, enumerate(PEOPLE)):
            cases.append((seen_from(everyday(person, what, seed=seed), views), None, 0.0))
    return cases


def _wrong(cases: Simulated, borders: LyingBorders) -> tuple[int, int]:
    """Falls that are not seen in time, and false alarms."""
    missed = false = 0
    for tracks, begins_s, until_s in cases:
        alarm_s = watch(tracks, WHOLE_BODY, 30.0, borders).alarm_s()
        if begins_s is None:
            false += alarm_s is not None
        else:
            missed += alarm_s is None or not begins_s <= alarm_s <= until_s
    return missed, false


def _ranges(cases: Simulated) -> Iterator[tuple[str, Mapping[float, tuple[int, int]]]]:
    for name, values in TRIED.items():
        yield name, {value: _wrong(cases, replace(LyingBorders(), **{name: value})) for value in values}


def _middle(wrong: Mapping[float, tuple[int, int]]) -> float:
    """Of the values at which the fewest are wrong."""
    least = min(map(sum, wrong.values()))
    best = [value for value, each in wrong.items() if sum(each) == least]
    return (best[0] + best[-1]) / 2


def _alarms(archive: MotionArchive, views: Sequence[str], borders: LyingBorders, label: str = "") -> tuple[int, int]:
    """Alarms of each view alone, and how many there were to raise one."""
    own = [each for each in archive.recordings if not label or each.label == label]
    tracks = [[each.positions.astype(float)] if label else seen_from(each, views) for each in own]
    runs = [
        watch([one], archive.body_parts, each.rate_hz, borders).alarm_s()
        for each, seen in zip(own, tracks, strict=True)
        for one in seen
    ]
    return sum(run is not None for run in runs), len(runs)


def _tried(data: Path, borders: LyingBorders) -> Iterator[str]:
    windows = read_archive(data / "falls/falls.npz")
    for label in ("fall", "other"):
        yield f"  windows of {label}: alarms {' of '.join(map(str, _alarms(windows, (), borders, label)))}"
    for name, files in PEOPLE_WHO_DO_NOT_FALL.items():
        archives = [read_archive(data / file) for file in files]
        if LyingReader(archives[0].body_parts).can_tell:
            views = ("door",) if len(archives) > 1 else LEVEL[:2]
            alarms = sum(_alarms(archive, views, borders)[0] for archive in archives)
            yield f"  {name}: false alarms of {'a view' if len(views) == 1 else 'two views'} alone {alarms}"


def fall_borders(
    data: Annotated[Path | None, typer.Option(envvar="LABANMESH_DATA", help="The folder of recordings.")] = None,
) -> None:
    """Choose the borders of the watch for falls on simulated falls alone, and try them on the recordings.

    Example: LABANMESH_DATA=data python -m benchmarks.fall_borders
    """
    if data is None:
        raise BadInput("name the folder of recordings: LABANMESH_DATA=FOLDER, or --data FOLDER")
    chosen, cases = LyingBorders(), _simulated()
    print("SIMULATED, value: falls not seen in time, false alarms")
    for name, wrong in _ranges(cases):
        chosen = replace(chosen, **{name: _middle(wrong)})
        words = ", ".join(f"{value:g}: {missed} {false}" for value, (missed, false) in wrong.items())
        print(f"  {name}: {words}; middle {getattr(chosen, name):g}", flush=True)
    for title, borders in (("the middles", chosen), ("the product's", LyingBorders())):
        print(f"{title}: {borders}")
        for line in _tried(data, borders):
            print(line, flush=True)


if __name__ == "__main__":
    raise SystemExit(run_command(fall_borders, "fall_borders"))
