"""What `labanmesh observe` would meet before its first frame, for each observer of a scene: one line of JSON each.

Run as a process, `python -m observer.runtime.preflight scene.toml [ID ...]`, by `labanmesh doctor`. No
camera is opened and no mediapipe started: both take their time.
"""

import json
import sys
from collections.abc import Callable, Iterator, Sequence
from dataclasses import asdict, dataclass, field
from importlib.util import find_spec
from pathlib import Path
from typing import TypeVar

from common.config import ObserverConfig, Scene, read_scene
from common.errors import LabanmeshError

T = TypeVar("T")


@dataclass(slots=True)
class Examined:
    """One observer. faults: why it cannot work; doubts: why it may work badly; each one line with the way out.

    source: as it may be printed. reads: what its tracker reads (positions, pictures, tracks), "" where that is a fault.
    labels, rate_hz: of its model; none where it cannot be read. lacks: packages that are not installed here.
    """

    observer: str
    source: str
    reads: str = ""
    labels: list[str] = field(default_factory=list)
    rate_hz: float | None = None
    faults: list[str] = field(default_factory=list)
    doubts: list[str] = field(default_factory=list)
    lacks: list[str] = field(default_factory=list)

    def attempt(self, what: Callable[[], T]) -> T | None:
        """Do it; a fault is noted and None returned."""
        try:
            return what()
        except LabanmeshError as error:
            self.faults.append(str(error))
        except ModuleNotFoundError as error:
            self.lacks.append(str(error.name))
        return None


def examine(scene: Scene, observer: str) -> Examined:
    """Try all that is needed before the first frame; never raises for what the scene file can get wrong."""
    from observer.camera.base import without_secrets
    from observer.geometry.views import parse_view
    from observer.runtime.scene_inputs import content_of
    from observer.tracking.registry import tracker_named

    section, key = scene.observer(observer), f"observers.{observer}"
    found = Examined(observer, without_secrets(section.source))
    view = found.attempt(lambda: parse_view(section.view, scene.place(".")))
    content = content_of(section.source)
    kind = found.attempt(lambda: tracker_named(section.tracker, f"{key}.tracker", content))
    found.reads = kind.reads if kind else ""
    rate_hz = None
    if view and kind:
        rate_hz = _sight(scene, section, found, kind.name)
    _model(scene, section, found, rate_hz, view.matrix.tolist() if view else None)
    return found


def _sight(scene: Scene, section: ObserverConfig, found: Examined, tracker: str) -> float | None:
    """Source and tracker; returns the rate that the model must have, where the source decides it."""
    from observer.runtime.scene_inputs import STANDARD_INPUT, open_inputs

    if tracker == "mediapipe":
        _pose(scene, section, found)
        section = section.model_copy(update={"tracker": "camshift", "face": (0, 0, 1, 1)})
        scene = scene.model_copy(update={"observers": {**scene.observers, found.observer: section}})
    if section.source == STANDARD_INPUT:
        found.doubts.append(
            "reads tracks from its standard input, which `up` cannot feed; TRACKER | labanmesh observe ..."
        )
        return None
    eyes = found.attempt(lambda: open_inputs(scene, found.observer, environment={}))
    return eyes.source.rate_hz if eyes and eyes.at_own_rate else None


def _pose(scene: Scene, section: ObserverConfig, found: Examined) -> None:
    if find_spec("mediapipe") is None:
        found.lacks.append("mediapipe")
    elif section.pose_model and not scene.place(section.pose_model).is_file():
        found.faults.append(
            f"pose_model = {section.pose_model!r}: no such file; a pose landmarker .task file is expected"
        )


def _model(scene: Scene, section: ObserverConfig, found: Examined, rate_hz: float | None, matrix: object) -> None:
    import numpy as np

    from observer.model.model_file import read_model, require

    place = scene.place(section.model)
    model = found.attempt(lambda: read_model(place))
    if model is None:
        return
    header = model.header
    found.labels, found.rate_hz = list(header.vocabulary.labels), header.rate_hz
    found.attempt(lambda: require(place, model, scene.named_vocabulary, rate_hz))
    if matrix is not None and not np.allclose(np.array(matrix), header.matrix):
        found.doubts.append(
            f"{place}: learned for {header.view}, this observer sees from {section.view}; "
            f"labanmesh learn ... --view {section.view}"
        )


def main(words: Sequence[str]) -> Iterator[str]:
    """The lines for a scene file and, if any are named, some of its observers only."""
    scene = read_scene(Path(words[0]))
    for observer in words[1:] or scene.roster:
        yield json.dumps(asdict(examine(scene, observer)))


if __name__ == "__main__":
    for line in main(sys.argv[1:]):
        print(line, flush=True)
