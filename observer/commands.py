"""The command `labanmesh observe`."""

import gc
import logging
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from common.text import plural

if TYPE_CHECKING:
    from common.config import Scene
    from common.link import Link
    from observer.effort.reader import FacetReader
    from observer.model.base import Header, MovementModel
    from observer.runtime.people_observer import AnyObserver
    from observer.runtime.scene_inputs import ObserverInputs
    from observer.runtime.service import ObserverLike
    from observer.tracks import Tracker

log = logging.getLogger("labanmesh.observer")
LIGHTEN = "try smaller pictures (size_px), a lower rate_hz, a lighter tracker or another machine"
"""For an observer that is too slow for its source."""


def observe(
    scene: Annotated[Path, typer.Argument(help="The scene file (TOML), the same for every process of the scene.")],
    observer: Annotated[str, typer.Argument(help="The id of this observer in the scene file.")],
) -> None:
    """Run one observer: it watches the person from its view and publishes posteriors until its source ends.

    Example: labanmesh observe scene.toml cam1
    """
    from common.config import read_scene
    from common.lifecycle import log_to_stderr, stop_on_signals
    from common.link import Link
    from observer.foreign import MeshTracks
    from observer.runtime.scene_inputs import follows_one, open_inputs
    from observer.runtime.service import HealthReporter, serve
    from observer.teaching.service import answer_teachers, model_in_force, teachable

    log_to_stderr()
    config, health = read_scene(scene), HealthReporter()
    model = model_in_force(config, observer)
    parts = None if model is None else model.header.body_parts
    inputs = open_inputs(config, observer, parts, health.record_camera, fewer_parts=True)
    health.note = follows_one(config.people.most, len(config.roster), inputs.view, inputs.tracker.most)
    build = partial(pipeline_of, config, observer, inputs)
    with ExitStack() as stack:
        stop = stack.enter_context(stop_on_signals())
        begun = None if model is None else build(model)
        taught = stack.enter_context(teachable(config, observer, inputs, begun, build))
        paced = _paced(config, observer, taught, inputs)
        opened = Link.open(config.mesh, "observer", process_id=observer, scene=config.scene, stop=stop)
        link = stack.enter_context(opened)
        if isinstance(inputs.source, MeshTracks):
            inputs.source.listen(link)
        answer_teachers(link, config, observer, taught)
        shown = stack.enter_context(_with_pictures(config, observer, paced, inputs, link))
        gc.freeze()  # a collection that looks through all loaded modules takes 25 ms
        serve(config, observer, shown, inputs.source, link, stop, health=health)


def pipeline_of(scene: "Scene", observer: str, inputs: "ObserverInputs", model: "MovementModel") -> "AnyObserver":
    """The observer of these inputs; raises BadInput for a model that does not fit the scene."""
    from observer.model.base import Onset
    from observer.model.model_file import doubt_of_camera, doubt_of_view, require_match
    from observer.prepared_tracks import Resampler
    from observer.runtime.people_observer import FloorPlacer, PeopleObserver
    from observer.runtime.pipeline import Observer
    from observer.runtime.scene_inputs import person_in

    section, header = scene.observer(observer), model.header
    path, rate_hz = scene.model_file(observer), inputs.source.rate_hz if inputs.at_own_rate else None
    require_match(path, model, scene.named_vocabulary, rate_hz)
    person = person_in(scene, observer, inputs.view)
    doubts = (
        doubt_of_view(path, header, inputs.view, section.view, person),
        doubt_of_camera(path, header, observer, scene.roster),
    )
    for doubt in filter(None, doubts):
        log.warning(doubt)
    movements = plural(header.vocabulary.size, "movement")
    log.info("%s: %s model of %s for %s", observer, header.kind, movements, header.view)
    onset = Onset(known=section.onset == "known", length=inputs.length)
    # Half of fresh_s: with the frame after that, the next posterior comes before the last one is stale.
    judged_s = 0.0 if inputs.keeps_all else scene.fusion.fresh_s / 2

    def of_person(tracker: "Tracker") -> Observer:
        # Resampled also if it is motion at the model's rate: frames are skipped when the observer is too slow.
        facets = _facet_reader(scene, observer, header, inputs)
        return Observer(tracker, model, onset, Resampler(header.rate_hz), facets, judged_s)

    if inputs.tracker.most == 1:
        return of_person(inputs.tracker)
    placer = FloorPlacer(inputs.view, person, alone=len(scene.roster) == 1)
    return PeopleObserver(inputs.tracker, of_person, placer)


def _paced(scene: "Scene", observer_id: str, observer: "ObserverLike", inputs: "ObserverInputs") -> "ObserverLike":
    """The observer, which complains while it is too slow; pictures in real time are tracked only when needed."""
    from common.load import LoadMeter
    from observer.runtime.service import ObserverAround

    if inputs.keeps_all or not inputs.pictures:
        return ObserverAround(observer, LoadMeter("frames", LIGHTEN))
    # Imported on use: it needs OpenCV.
    from observer.runtime.pacing import PacedObserver, TrackingPace

    section = scene.observer(observer_id)
    pace = TrackingPace(section.max_hz, section.idle_hz)
    return PacedObserver(observer, inputs.tracker, pace, scene.fusion, LoadMeter("pictures", LIGHTEN))


def _facet_reader(scene: "Scene", observer: str, header: "Header", inputs: "ObserverInputs") -> "FacetReader":
    """Reads Shape, and Effort if the scene names a model of it."""
    from observer.effort.effort_file import read_effort, require_rate
    from observer.effort.reader import FacetReader, depth_in

    name, effort = scene.observer(observer).effort, None
    if name:
        effort = read_effort(scene.place(name))
        require_rate(scene.place(name), effort, header.rate_hz)
    return FacetReader(header.body_parts, header.rate_hz, depth_in(inputs.view.matrix), effort)


@contextmanager
def _with_pictures(
    scene: "Scene", observer_id: str, observer: "ObserverLike", inputs: "ObserverInputs", link: "Link"
) -> Iterator["ObserverLike"]:
    """The observer itself or, if its pictures or clips are wanted, the observer with these."""
    section = scene.observer(observer_id)
    if not (section.picture_hz or section.clips.folder or scene.watch.fallen):
        yield observer
        return
    from observer.preview.shown_pictures import shown_pictures

    with shown_pictures(scene, observer_id, observer, inputs.tracker, link) as pictured:
        yield pictured
