"""Sensors by name on the command line: which file each recorded, and the view that it is seen from."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from common.errors import BadInput
from observer.geometry.placement import PersonPlacement
from observer.geometry.views import View
from observer.motion.archive import MotionArchive
from observer.motion.projected import view_of

DEFAULT_VIEW = "door"
"""What a sensor recorded is in its own frame: seen from the Door, it is what the sensor saw."""


@dataclass(frozen=True, slots=True)
class SensorFile:
    """A sensor's name, its motion archive, its view, "" if none was given, and where its people are put, if told."""

    name: str
    path: Path
    view: str = ""
    placement: PersonPlacement | None = None

    def view_in(self, archive: MotionArchive) -> View:
        """The view of its archive, as `view_of` has it: DEFAULT_VIEW for 3-D positions, unless another was given."""
        return view_of(archive, self.view or ("" if archive.camera else DEFAULT_VIEW), self.name)


def parse_sensors(texts: Sequence[str]) -> list[SensorFile]:
    """`NAME=FILE.npz` or `NAME=FILE.npz@VIEW` each; raises BadInput for another form and a name given twice."""
    sensors: list[SensorFile] = []
    for text in texts:
        name, equals, place = text.partition("=")
        file, _, view = place.rpartition("@") if "@" in Path(place).name else (place, "", "")
        if not (name and equals and file) or "/" in name or place.endswith("@"):
            raise BadInput(f"--sensor {text!r}: NAME=FILE.npz or NAME=FILE.npz@VIEW is expected")
        if name in (sensor.name for sensor in sensors):
            raise BadInput(f"--sensor {text}: {name!r} is given twice; every sensor needs its own name")
        sensors.append(SensorFile(name, Path(file), view))
    return sensors
