"""The commands `labanmesh learn` and `labanmesh forget`."""

import hashlib
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from common.errors import BadInput
from common.text import named_numbers, split_list
from common.vocabulary import Vocabulary

if TYPE_CHECKING:
    from observer.learning.editing import Grown
    from observer.model.base import Header
    from observer.motion.archive import MotionArchive


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
    from observer.geometry.views import parse_view
    from observer.learning.learn import learn_view
    from observer.model.model_file import write_model
    from observer.model.registry import DEFAULT_MODEL
    from observer.motion.archive_file import read_archive
    from observer.motion.transforms import labels_of, select

    whole = select(read_archive(archive), split_list("--subjects", subjects), rate)
    provenance = {
        "archive": archive.name,
        "archive_sha256": hashlib.sha256(archive.read_bytes()).hexdigest(),
        "subjects": ",".join(sorted({r.subject for r in whole.recordings})),
    }
    given, chosen = named_numbers("--parameter", parameter or []), split_list("--labels", labels)
    others = _read_background(background, background_labels, archive, whole, split_list("--subjects", subjects))
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
    from observer.geometry.views import parse_view
    from observer.learning.editing import with_movements
    from observer.model.model_file import read_model, write_model

    grown = with_movements(read_model(old), archive, parse_view(view), **given)
    write_model(output, grown.model)
    _tell_of_added(output, grown, archive)


def _tell(output: Path, header: "Header", archive: "MotionArchive") -> None:
    from observer.learning.report import believed, knows_else, too_few

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
    from observer.learning.report import believed_of_new, edited, too_few

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
    from observer.learning.editing import without_movements
    from observer.learning.report import edited
    from observer.model.model_file import read_model, write_model

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


def _read_background(
    text: str, labels: str, learned: Path, whole: "MotionArchive", subjects: tuple[str, ...]
) -> "MotionArchive | None":
    """The texts of --background and --background-labels -> recordings; None where there is to be no background.

    learned: the archive that is learned from, and `whole` what of it; if it is named here too, only its `subjects` are
    taken. Raises BadInput for labels of no archive, and for what cannot be read or gathered.
    """
    from observer.learning.background import BLENDS, blends_alone, gathered
    from observer.motion.archive_file import read_archive
    from observer.motion.transforms import common_rate, select

    chosen = split_list("--background-labels", labels)
    if chosen and text in ("", BLENDS):
        raise BadInput(f"--background-labels {labels}: of which archive? name it with --background")
    if text in ("", BLENDS):
        return blends_alone(whole.body_parts) if text else None
    paths = [Path(name) for name in split_list("--background", text)]
    archives = [select(read_archive(p), subjects if p.resolve() == learned.resolve() else ()) for p in paths]
    return gathered(archives, chosen, whole.body_parts, common_rate(whole))
