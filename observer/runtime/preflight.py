"""Checks an observer without starting it: what `labanmesh observe` would meet before its first frame.

`labanmesh doctor` may not import this room and runs it as a process, `python -m observer.runtime.preflight scene.toml
[ID ...]`, which prints one JSON object per observer and line. It neither opens a camera nor starts MediaPipe, as both
take seconds.
"""

import json
import sys
from collections.abc import Callable, Iterator, Sequence
from dataclasses import asdict, dataclass, field
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING, TypeVar

from common.config import ObserverConfig, Scene, sound_part
from common.errors import LabanmeshError
from common.text import without_secrets
from common.tracker_choice import STANDARD_INPUT, chosen_tracker, content_of

if TYPE_CHECKING:
    from observer.geometry.views import View
    from observer.model.base import Header

T = TypeVar("T")


@dataclass(slots=True)
class PreflightResult:
    """One observer. faults: why it cannot work; doubts: why it may work badly; each one line with a remedy.

    source: without passwords. tracker: its name, and why where the scene file leaves it open; lacks_tracker: why the
    better one was not chosen. reads: what its tracker reads (positions, pictures, tracks), "" if that is a fault.
    labels, rate_hz, kind: of its model, empty and None if it cannot be read. lacks: packages not installed here.
    taught_from: the camera from whose tracks the model was taught, which holds until that camera moves; "" for others.
    blends_only: whether it learned from no recordings of other motion what is no movement.
    """

    observer: str
    source: str
    reads: str = ""
    tracker: str = ""
    lacks_tracker: str = ""
    labels: list[str] = field(default_factory=list)
    rate_hz: float | None = None
    kind: str = ""
    faults: list[str] = field(default_factory=list)
    doubts: list[str] = field(default_factory=list)
    lacks: list[str] = field(default_factory=list)
    taught_from: str = ""
    blends_only: bool = False

    def attempt(self, action: Callable[[], T]) -> T | None:
        """The action's result; on an error it is recorded and the result is None."""
        try:
            return action()
        except LabanmeshError as error:
            self.faults.append(str(error))
        except ModuleNotFoundError as error:
            self.lacks.append(str(error.name))
        except ImportError as error:
            self.faults.append(f"{error}; install that library of the system (for libGL: libgl1 libglib2.0-0)")
        return None


def check_observer(scene: Scene, observer: str) -> PreflightResult:
    """Check everything that is needed before the first frame; never raises for what a scene file can get wrong."""
    from observer.geometry.views import parse_view
    from observer.tracking.registry import tracker_named

    section, key = scene.observer(observer), f"observers.{observer}"
    result = PreflightResult(observer, without_secrets(section.source, show_path=section.show_path))
    view = result.attempt(lambda: parse_view(section.view, scene.place(".")))
    content = content_of(section.source)
    choice = chosen_tracker(section)
    kind = result.attempt(lambda: tracker_named(choice.name, f"{key}.tracker", content))
    result.tracker = f"{choice.name} ({choice.reason})" if choice.reason and not choice.lacks else choice.name
    result.lacks_tracker = choice.lacks
    result.reads = kind.reads if kind else ""
    # A fault of the view or the tracker does not hide one of the source, which is opened with others then.
    others = {**({} if view else {"view": "door"}), **({} if kind else {"tracker": "auto"})}
    rate_hz = _check_inputs(scene, section.model_copy(update=others), result)
    _check_model(scene, section, result, rate_hz, view, kind.finds if kind else ())
    return result


def _check_inputs(scene: Scene, section: ObserverConfig, result: PreflightResult) -> float | None:
    """Check source and tracker; returns the rate that the model must have, if the source determines it."""
    from observer.geometry.views import scale_note
    from observer.runtime.scene_inputs import open_inputs

    if chosen_tracker(section).name == "mediapipe":
        if find_spec("mediapipe") is None:
            result.lacks.append("mediapipe")
        elif section.pose_model and not scene.place(section.pose_model).is_file():
            result.faults.append(
                f"pose_model = {section.pose_model!r}: no such file; a pose landmarker .task file is expected"
            )
        section = section.model_copy(update={"tracker": "camshift", "face": (0, 0, 1, 1)})
    if section.source == STANDARD_INPUT:
        result.doubts.append(
            "reads tracks from its standard input, which `up` cannot feed; TRACKER | labanmesh observe ..."
        )
        return None
    scene = scene.model_copy(update={"observers": {**scene.observers, result.observer: section}})
    inputs = result.attempt(lambda: open_inputs(scene, result.observer, environment={}))
    size_px = section.size_px or getattr(inputs.source if inputs else None, "size_px", None)
    if inputs and inputs.pictures and size_px and (note := scale_note(inputs.view, size_px)):
        result.doubts.append(note)
    return inputs.source.rate_hz if inputs and inputs.at_own_rate else None


def _check_model(
    scene: Scene,
    section: ObserverConfig,
    result: PreflightResult,
    rate_hz: float | None,
    view: "View | None",
    finds: Sequence[str],
) -> None:
    from observer.geometry.views import is_this_camera
    from observer.model.base import LearnsStreams, knows_blends_only
    from observer.model.model_file import read_model, require_match
    from observer.runtime.scene_inputs import is_untaught

    path = scene.model_file(result.observer)
    if is_untaught(scene, result.observer):
        result.doubts.append(
            f"{path}: no such model file; teach it while it runs: labanmesh teach {scene.file} LABEL ..."
        )
        return
    model = result.attempt(lambda: read_model(path))
    if model is None:
        return
    header = model.header
    result.labels, result.rate_hz, result.kind = list(header.vocabulary.labels), header.rate_hz, header.kind
    result.attempt(lambda: require_match(path, model, scene.named_vocabulary, rate_hz))
    _check_parts(header, result, finds)
    _check_view(scene, section, result, header, view)
    if is_this_camera(header.matrix):
        result.taught_from = header.view.partition(":")[2] or result.observer
    if isinstance(model, LearnsStreams) and knows_blends_only(header):
        result.blends_only = True


def _check_parts(header: "Header", result: PreflightResult, finds: Sequence[str]) -> None:
    """Whether the tracker finds the body parts that the model reads."""
    from observer.prepared_tracks import lacking_parts

    lacking = [part for part in header.body_parts if finds and part not in finds]
    if not lacking:
        return
    line = lacking_parts(lacking, finds)
    if len(lacking) < len(header.body_parts):
        result.doubts.append(f"{line}; as it is, the model judges by the others")
    else:
        result.faults.append(line)


def _check_view(
    scene: Scene, section: ObserverConfig, result: PreflightResult, header: "Header", view: "View | None"
) -> None:
    """Whether the model was learned for this view, and for this camera."""
    from observer.model.model_file import doubt_of_camera, doubt_of_view
    from observer.runtime.scene_inputs import person_in

    path = scene.model_file(result.observer)
    if view and not view.has_place and (section.place, section.facing) != (None, None):
        result.doubts.append(f"place, facing: only for camera files; view = {section.view!r} is none and ignores them")
    person = person_in(scene, result.observer, view) if view else None
    doubts = (
        doubt_of_view(path, header, view, section.view, person) if view else "",
        doubt_of_camera(path, header, result.observer, scene.roster),
    )
    result.doubts += filter(None, doubts)


def main(words: Sequence[str]) -> Iterator[str]:
    """The lines for a scene file or, if ids follow, for these observers of it."""
    scene = sound_part(Path(words[0]))
    if scene:
        for observer in words[1:] or scene.roster:
            yield json.dumps(asdict(check_observer(scene, observer)))


if __name__ == "__main__":
    for line in main(sys.argv[1:]):
        print(line, flush=True)
