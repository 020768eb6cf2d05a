"""Sensors by name on the command line: which file each recorded, and the view that it is seen from."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from common.errors import BadInput
from common.text import nearest
from observer.geometry.placement import PersonPlacement
from observer.geometry.views import View
from observer.motion.archive import MotionArchive, labels_of
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


def require_shared_labels(labels: Sequence[str], archives: Mapping[str, MotionArchive]) -> None:
    """Raise BadInput unless every sensor recorded each of these movements: a model is learned for each sensor.

    archives: by the sensors' names.
    """
    own = {name: labels_of(archive) for name, archive in archives.items()}
    anywhere = tuple(dict.fromkeys(label for known in own.values() for label in known))
    for label in labels:
        if label not in anywhere:
            raise BadInput(f"--labels {label}: no recording shows this movement; {nearest(label, anywhere)}")
    shared = [label for label in labels if all(label in known for known in own.values())]
    if not shared:
        listed = "; ".join(f"{name} has {', '.join(known)}" for name, known in own.items())
        raise BadInput(
            f"--sensor: none of the movements was recorded by all sensors ({listed}); give recordings of the same "
            "movements, under the same labels"
        )
    for name, known in own.items():
        if missing := [label for label in labels if label not in known]:
            raise BadInput(
                f"--sensor {name}: no recording shows {', '.join(missing)}; record it with this sensor too, or leave "
                f"it out: --labels {','.join(shared)}"
            )
