"""The verbs of an observer: `observe`, `import`, `learn` and `forget`."""

import logging
import sys
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from common.progress import ProgressBar

if TYPE_CHECKING:
    from common.config import Scene
    from observer.effort.reader import FacetReader
    from observer.model.base import Header
    from observer.runtime.pipeline import Observer
    from observer.runtime.scene_inputs import ObserverInputs
    from observer.runtime.service import ObserverLike

log = logging.getLogger("labanmesh.observer")


def observe(
    scene: Annotated[Path, typer.Argument(help="The scene file (TOML), the same for every process of the scene.")],
    observer: Annotated[str, typer.Argument(help="The id of this observer in the scene file.")],
    preview: Annotated[
        str, typer.Option(help="Show what it sees: a film to write (.mp4, .avi), a folder or NAME.png, or window.")
    ] = "",
) -> None:
    """One observer: sees the performer from its view and says on the mesh what it believes, until its source ends.

    Example: labanmesh observe scene.toml cam1 --preview cam1.mp4
    """
    from common.config import read_scene
    from common.lifecycle import log_to_stderr, stop_on_signals
    from common.link import Link
    from observer.foreign.sources import MeshTracks
    from observer.model.base import Onset
    from observer.model.model_file import read_model, require
    from observer.runtime.instrumentation import HealthReporter
    from observer.runtime.pipeline import Observer, Resampler
    from observer.runtime.scene_inputs import open_inputs
    from observer.runtime.service import serve

    log_to_stderr()
    named, condition = read_scene(scene), HealthReporter()
    section = named.observer(observer)
    place = named.place(section.model)
    model = read_model(place)
    eyes = open_inputs(named, observer, model.header.body_parts, condition.camera)
    require(place, model, named.named_vocabulary, eyes.source.rate_hz if eyes.at_own_rate else None)
    _warn_of_another_view(place, model.header, eyes, section.view)
    onset = Onset(known=section.onset == "known", length=eyes.length)
    pace = None if eyes.at_own_rate else Resampler(model.header.rate_hz)
    judge = Observer(eyes.tracker, model, onset, pace, _facets(named, observer, model.header, eyes))
    with ExitStack() as open_until_end:
        stop = open_until_end.enter_context(stop_on_signals())
        in_folder = section.preview not in ("", "window")
        target = preview or (str(named.place(section.preview)) if in_folder else section.preview)
        shown = open_until_end.enter_context(_previewed(target, observer, judge, eyes, model.header))
        opening = Link.open(named.mesh, "observer", process_id=observer, scene=named.scene)
        link = open_until_end.enter_context(opening)
        if isinstance(eyes.source, MeshTracks):
            eyes.source.listen(link)
        serve(named, observer, shown, eyes.source, link, stop, condition=condition)


def _facets(scene: "Scene", observer: str, header: "Header", eyes: "ObserverInputs") -> "FacetReader":
    """Shape, and Effort where the scene names a model of it."""
    from observer.effort.effort_file import read_effort, require_rate
    from observer.effort.reader import FacetReader
    from observer.effort.shape import depth_in

    named, effort = scene.observer(observer).effort, None
    if named:
        effort = read_effort(scene.place(named))
        require_rate(scene.place(named), effort, header.rate_hz)
    return FacetReader(header.body_parts, header.rate_hz, depth_in(eyes.view.matrix), effort)


def _warn_of_another_view(place: Path, header: "Header", eyes: "ObserverInputs", view: str) -> None:
    import numpy as np

    if not np.allclose(eyes.view.matrix, header.matrix):
        learned, seen = header.view, eyes.view.name
        log.warning(
            "%s: learned for %s, this observer sees from %s: labanmesh learn ... --view %s",
            *(place, learned, seen, view),
        )


@contextmanager
def _previewed(
    target: str, observer: str, judge: "Observer", eyes: "ObserverInputs", header: "Header"
) -> Iterator["ObserverLike"]:
    """The judge, looked at while it works if there is a target."""
    if not target:
        yield judge
        return
    from observer.preview.screen import PreviewingObserver, open_preview
    from observer.preview.sight import PreviewHistory

    rate_hz = eyes.source.rate_hz
    with open_preview(target, rate_hz, keep_all=eyes.keeps_all) as preview:
        yield PreviewingObserver(judge, eyes.tracker, preview, PreviewHistory(header.body_parts, rate_hz, observer))


def import_recordings(
    kind: Annotated[str, typer.Argument(help="msr-action3d, florence3d, bvh or csv.")],
    path: Annotated[Path, typer.Argument(help="The folder or file that holds the recordings.")],
    output: Annotated[Path, typer.Option("-o", "--output", help="The motion archive to write (.npz).")],
) -> None:
    """Recordings of others become a motion archive: hands and head in metres, as docs/reference/motion.md says.

    Example: labanmesh import msr-action3d MSRAction3DSkeletonReal3D -o msr.npz
    """
    from observer.motion.archive_file import write_archive
    from observer.motion.importers import import_recordings as read

    with ProgressBar() as bar:
        result = read(kind, path, progress=lambda done, total: bar("reading", done, total))
    write_archive(output, result.archive)
    for note in result.notes:
        print(note, file=sys.stderr)
    recordings = result.archive.recordings
    frames = sum(len(r.positions) for r in recordings)
    labels, subjects = {r.label for r in recordings}, {r.subject for r in recordings}
    print(
        f"{output}: {len(recordings)} recordings, {len(labels)} movements, {len(subjects)} people, {frames} frames "
        f"at {recordings[0].rate_hz:g} Hz"
    )
