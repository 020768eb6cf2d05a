"""The verbs of an observer: `observe`, `import`, `learn` and `forget`."""

import hashlib
import logging
import sys
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from common.errors import BadInput
from common.progress import ProgressBar
from common.text import named_numbers, split_list
from common.vocabulary import Vocabulary

if TYPE_CHECKING:
    from common.config import Scene
    from observer.editing import Grown
    from observer.effort.reader import FacetReader
    from observer.model.base import Header
    from observer.motion.archive import MotionArchive
    from observer.opening import Eyes
    from observer.pipeline import Observer
    from observer.service import ObserverLike

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
    from observer.condition import Condition
    from observer.foreign.sources import MeshTracks
    from observer.model.base import Onset
    from observer.model.store import read_model, require
    from observer.opening import open_eyes
    from observer.pace import Pace
    from observer.pipeline import Observer
    from observer.service import serve

    log_to_stderr()
    named, condition = read_scene(scene), Condition()
    section = named.observer(observer)
    place = named.place(section.model)
    model = read_model(place)
    eyes = open_eyes(named, observer, model.header.body_parts, condition.camera)
    require(place, model, named.named_vocabulary, eyes.source.rate_hz if eyes.at_own_rate else None)
    _warn_of_another_view(place, model.header, eyes, section.view)
    onset = Onset(known=section.onset == "known", length=eyes.length)
    pace = None if eyes.at_own_rate else Pace(model.header.rate_hz)
    judge = Observer(eyes.tracker, model, onset, pace, _facets(named, observer, model.header, eyes))
    with ExitStack() as open_until_end:
        stop = open_until_end.enter_context(stop_on_signals())
        in_folder = section.preview not in ("", "window")
        target = preview or (str(named.place(section.preview)) if in_folder else section.preview)
        shown = open_until_end.enter_context(_previewed(target, observer, judge, eyes, model.header))
        link = open_until_end.enter_context(Link.open(named.mesh, "observer", process_id=observer))
        if isinstance(eyes.source, MeshTracks):
            eyes.source.listen(link)
        serve(named, observer, shown, eyes.source, link, stop, condition=condition)


def _facets(scene: "Scene", observer: str, header: "Header", eyes: "Eyes") -> "FacetReader":
    """Shape, and Effort where the scene names a model of it."""
    from observer.effort.effort_file import read_effort, require_rate
    from observer.effort.reader import FacetReader
    from observer.effort.shape import depth_in

    named, effort = scene.observer(observer).effort, None
    if named:
        effort = read_effort(scene.place(named))
        require_rate(scene.place(named), effort, header.rate_hz)
    return FacetReader(header.body_parts, header.rate_hz, depth_in(eyes.view.matrix), effort)


def _warn_of_another_view(place: Path, header: "Header", eyes: "Eyes", view: str) -> None:
    import numpy as np

    if not np.allclose(eyes.view.matrix, header.matrix):
        learned, seen = header.view, eyes.view.name
        log.warning(
            "%s: learned for %s, this observer sees from %s: labanmesh learn ... --view %s",
            *(place, learned, seen, view),
        )


@contextmanager
def _previewed(
    target: str, observer: str, judge: "Observer", eyes: "Eyes", header: "Header"
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


def learn(
    archive: Annotated[Path, typer.Argument(help="The motion archive to learn from (.npz).")],
    view: Annotated[str, typer.Option(help="door, wheel, table, yaw:DEG, yaw:DEG,pitch:DEG, or a camera file.")],
    output: Annotated[Path, typer.Option("-o", "--output", help="The model file to write.")],
    model: Annotated[str, typer.Option(help="phase (unless another is named), phase-symbols or frame-table.")] = "",
    labels: Annotated[str, typer.Option(help="The movements to tell apart, by commas; all of the archive's.")] = "",
    subjects: Annotated[str, typer.Option(help="The people to learn from, by commas; all of the archive's.")] = "",
    rate: Annotated[float | None, typer.Option(min=1, help="Frames a second of the observer; the archive's.")] = None,
    add_to: Annotated[
        Path | None, typer.Option(help="A model that gets the movements it has not; those it has stay as they are.")
    ] = None,
    background: Annotated[
        str,
        typer.Option(help="Archives of other movements, by commas, to know something else by; or blends: of its own."),
    ] = "",
    background_labels: Annotated[str, typer.Option(help="Which movements of those archives, by commas; all.")] = "",
    name: Annotated[str, typer.Option(help="A name for the vocabulary.")] = "movements",
    parameter: Annotated[
        list[str] | None, typer.Option(help="NAME=NUMBER of the model instead of its default; may be repeated.")
    ] = None,
    effort: Annotated[
        bool, typer.Option("--effort", help="How it is done instead of which it is, from trials such as -1_0_1_1.")
    ] = False,
) -> None:
    """One observer's model for its perspective, learned from recordings in 3-D projected into its view.

    Example: labanmesh learn msr.npz --view yaw:45 -o corner1.model

    Example: labanmesh learn own.npz --view yaw:45 --background msr.npz -o corner1.model

    Example: labanmesh learn own.npz --view yaw:45 --add-to corner1.model -o corner1.model

    Example: labanmesh learn effort.npz --view yaw:45 --effort --rate 30 -o corner1.effort
    """
    from observer.background_file import read_background
    from observer.geometry.views import parse_view
    from observer.learning import labels_of, learn_view, prepared
    from observer.model.registry import DEFAULT_MODEL
    from observer.model.store import write_model
    from observer.motion.archive_file import read_archive

    whole = prepared(read_archive(archive), split_list("--subjects", subjects), rate)
    provenance = {
        "archive": archive.name,
        "archive_sha256": hashlib.sha256(archive.read_bytes()).hexdigest(),
        "subjects": ",".join(sorted({r.subject for r in whole.recordings})),
    }
    given, chosen = named_numbers("--parameter", parameter or []), split_list("--labels", labels)
    others = read_background(background, background_labels, archive, whole, split_list("--subjects", subjects))
    if effort and add_to:
        raise BadInput("--effort --add-to: movements are added, Effort is learned from all its examples at once")
    if others and (effort or add_to):
        raise BadInput(
            "--background: goes with a new model alone; --add-to keeps what the model has, --effort needs none"
        )
    if effort:
        _learn_effort(whole, view, output, provenance)
    elif add_to:
        _add(add_to, whole, view, output, labels=chosen, kind=model, parameters=given, source=archive.name)
    else:
        learned = learn_view(
            whole,
            parse_view(view),
            Vocabulary(chosen or labels_of(whole), name),
            kind=model or DEFAULT_MODEL,
            parameters=given,
            provenance=provenance,
            background=others,
        )
        write_model(output, learned)
        _tell(output, learned.header, whole)


def _add(old: Path, archive: "MotionArchive", view: str, output: Path, **given: Any) -> None:  # noqa: ANN401
    """given: as with_movements takes it."""
    from observer.editing import with_movements
    from observer.geometry.views import parse_view
    from observer.model.store import read_model, write_model

    grown = with_movements(read_model(old), archive, parse_view(view), **given)
    write_model(output, grown.model)
    _tell_of_added(output, grown, archive)


def _tell(output: Path, header: "Header", archive: "MotionArchive") -> None:
    from observer.learned import believed, knows_else, too_few

    print(
        f"{output}: {header.kind} for {header.view}, {header.vocabulary.size} movements from "
        f"{header.provenance['examples']} examples of {len(header.provenance['subjects'].split(','))} people, "
        f"{header.rate_hz:g} Hz, {output.stat().st_size / 1e6:.2f} MB"
    )
    print(believed(header))
    if header.background is not None:
        print(knows_else(header))
    _warn(too_few(archive, header.vocabulary.labels))


def _tell_of_added(output: Path, grown: "Grown", archive: "MotionArchive") -> None:
    from observer.learned import believed_of_new, edited, too_few

    header, labels = grown.model.header, ", ".join(grown.labels)
    print(f"{output}: {labels} added from {grown.examples} examples of {grown.people} people; {edited(header)}")
    if grown.promoted:
        print(f"something else until now, and no more: {', '.join(grown.promoted)}")
    print(believed_of_new(grown.tried, grown.labels, header))
    _warn(too_few(archive, grown.labels))


def forget(
    model: Annotated[Path, typer.Argument(help="The model file (of labanmesh learn).")],
    labels: Annotated[str, typer.Option(help="The movements to take out, by commas.")],
    output: Annotated[Path, typer.Option("-o", "--output", help="The model file to write.")],
) -> None:
    """A model without some of its movements; the others stay as they are, nothing is learned again.

    Example: labanmesh forget corner1.model --labels wave -o corner1.model
    """
    from observer.editing import without_movements
    from observer.learned import edited
    from observer.model.store import read_model, write_model

    gone = split_list("--labels", labels)
    kept = without_movements(read_model(model), gone)
    write_model(output, kept)
    print(f"{output}: {', '.join(gone)} taken out; {edited(kept.header)}")


def _warn(lines: list[str]) -> None:
    for line in lines:
        print(line, file=sys.stderr)


def _learn_effort(archive: "MotionArchive", view: str, output: Path, provenance: dict[str, str]) -> None:
    from observer.effort.effort_file import write_effort
    from observer.effort.learning import learn_effort
    from observer.geometry.views import parse_view

    learned = learn_effort(archive, parse_view(view), provenance)
    write_effort(output, learned)
    print(
        f"{output}: Effort for {learned.view} from {learned.provenance['examples']} examples, {learned.rate_hz:g} Hz, "
        f"{output.stat().st_size / 1e6:.2f} MB"
    )
