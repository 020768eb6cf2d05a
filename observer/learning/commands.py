"""The commands `labanmesh learn` and `labanmesh forget`, and what they print."""

import hashlib
import sys
from collections import Counter
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from common.errors import BadInput
from common.text import named_numbers, plural, split_list
from common.vocabulary import Vocabulary

if TYPE_CHECKING:
    from observer.learning.editing import EditedModel
    from observer.model.base import Header
    from observer.motion.archive import MotionArchive

ENOUGH_RECORDINGS = 3
"""For movements with fewer recordings `learn` prints a warning."""


def learn(
    archive: Annotated[Path, typer.Argument(help="The motion archive to learn from (.npz).")],
    view: Annotated[str, typer.Option(help="door, wheel, table, yaw:DEG, yaw:DEG,pitch:DEG, or a camera file.")],
    output: Annotated[Path, typer.Option("-o", "--output", help="The model file to write.")],
    model: Annotated[str, typer.Option(help="phase (default), phase-symbols or frame-table.")] = "",
    labels: Annotated[
        str, typer.Option(help="The movements to learn, separated by commas (default: all of the archive).")
    ] = "",
    subjects: Annotated[
        str, typer.Option(help="The people to learn from, separated by commas (default: all of the archive).")
    ] = "",
    rate: Annotated[
        float | None, typer.Option(min=1, max=1000, help="The observer's frames per second (default: the archive's).")
    ] = None,
    add_to: Annotated[
        Path | None, typer.Option(help="Add the movements to this model, whose own movements stay unchanged.")
    ] = None,
    background: Annotated[
        str,
        typer.Option(help="Archives of other movements, separated by commas, to recognise something else; or: blends."),
    ] = "",
    background_labels: Annotated[
        str, typer.Option(help="The movements to use of these archives, separated by commas (default: all).")
    ] = "",
    name: Annotated[str, typer.Option(help="A name for the vocabulary.")] = "movements",
    parameter: Annotated[
        list[str] | None, typer.Option(help="NAME=NUMBER: a parameter of the model; may be repeated.")
    ] = None,
    effort: Annotated[
        bool, typer.Option("--effort", help="Learn Effort instead of movements, from trials such as -1_0_1_1.")
    ] = False,
) -> None:
    """Learn one observer's model for its view, from recordings in 3-D that are projected into it.

    Example: labanmesh learn msr.npz --view yaw:45 -o corner1.model

    Example: labanmesh learn own.npz --view yaw:45 --background msr.npz -o corner1.model

    Example: labanmesh learn own.npz --view yaw:45 --add-to corner1.model -o corner1.model

    Example: labanmesh learn effort.npz --view yaw:45 --effort --rate 30 -o corner1.effort
    """
    from observer.motion.archive import select
    from observer.motion.archive_file import read_archive

    people = split_list("--subjects", subjects)
    whole = select(read_archive(archive), people, rate)
    provenance = {
        "archive": archive.name,
        "archive_sha256": hashlib.sha256(archive.read_bytes()).hexdigest(),
        "subjects": ",".join(sorted({r.subject for r in whole.recordings})),
    }
    parameters, chosen = named_numbers("--parameter", parameter or []), split_list("--labels", labels)
    others = _read_background(background, background_labels, archive, whole, people)
    if effort and add_to:
        raise BadInput("--effort --add-to: only movements can be added; Effort is learned from all examples at once")
    if others and (effort or add_to):
        raise BadInput("--background: only for a new model; --add-to keeps the model's background, --effort needs none")
    if effort:
        _learn_effort(whole, view, output, provenance)
    elif add_to:
        _add_movements(add_to, whole, view, output, chosen, model, parameters, archive.name)
    else:
        _learn_movements(whole, view, output, chosen, name, model, parameters, provenance, others)


def _learn_movements(
    archive: "MotionArchive",
    view: str,
    output: Path,
    labels: Sequence[str],
    name: str,
    kind: str,
    parameters: Mapping[str, float],
    provenance: Mapping[str, str],
    background: "MotionArchive | None",
) -> None:
    from observer.geometry.views import parse_view
    from observer.learning.learn import learn_view
    from observer.model.model_file import write_model
    from observer.model.registry import DEFAULT_MODEL
    from observer.motion.archive import labels_of, require_labels

    require_labels(labels, archive, "--labels")
    learned = learn_view(
        archive,
        parse_view(view),
        Vocabulary(tuple(labels) or labels_of(archive), name),
        kind=kind or DEFAULT_MODEL,
        parameters=parameters,
        provenance=provenance,
        background=background,
    )
    write_model(output, learned)
    header = learned.header
    print(
        f"{output}: {header.kind} for {header.view}, {header.vocabulary.size} movements from "
        f"{plural(int(header.provenance['examples']), 'example')} of "
        f"{plural(len(header.provenance['subjects'].split(',')), 'person', 'people')}, "
        f"{header.rate_hz:g} Hz, {output.stat().st_size / 1e6:.2f} MB"
    )
    print(describe_evaluation(header))
    if header.background is not None:
        print(describe_background(header))
    _warn_of_few_recordings(archive, header.vocabulary.labels)


def _add_movements(
    old: Path,
    archive: "MotionArchive",
    view: str,
    output: Path,
    labels: Sequence[str],
    kind: str,
    parameters: Mapping[str, float],
    source: str,
) -> None:
    from observer.geometry.views import parse_view
    from observer.learning.editing import add_movements
    from observer.model.model_file import read_model, write_model

    edited = add_movements(
        read_model(old), archive, parse_view(view), labels=labels, kind=kind, parameters=parameters, source=source
    )
    write_model(output, edited.model)
    print(describe_addition(output, edited))
    _warn_of_few_recordings(archive, edited.labels)


def _learn_effort(archive: "MotionArchive", view: str, output: Path, provenance: Mapping[str, str]) -> None:
    from observer.effort.effort_file import write_effort
    from observer.effort.model import learn_effort
    from observer.geometry.views import parse_view

    learned = learn_effort(archive, parse_view(view), provenance)
    write_effort(output, learned)
    print(
        f"{output}: Effort for {learned.view} from {plural(int(learned.provenance['examples']), 'example')}, "
        f"{learned.rate_hz:g} Hz, {output.stat().st_size / 1e6:.2f} MB"
    )


def _read_background(
    background: str, labels: str, learned: Path, archive: "MotionArchive", subjects: Sequence[str]
) -> "MotionArchive | None":
    """The recordings of --background and --background-labels; None without a background.

    learned: path of the archive to learn from, `archive` its selected recordings; if it is also a background, only the
    `subjects` are taken. Raises BadInput for labels without an archive, and for what cannot be read or gathered.
    """
    from observer.learning.examples import gather_background
    from observer.learning.learn import BLENDS
    from observer.motion.archive import MotionArchive, common_rate, select
    from observer.motion.archive_file import read_archive

    chosen = split_list("--background-labels", labels)
    if chosen and background in ("", BLENDS):
        raise BadInput(f"--background-labels {labels}: of which archive? name it with --background")
    if not background:
        return None
    if background == BLENDS:
        return MotionArchive(archive.body_parts, ())
    paths = [Path(name) for name in split_list("--background", background)]
    archives = [select(read_archive(p), subjects if p.resolve() == learned.resolve() else ()) for p in paths]
    return gather_background(archives, chosen, archive.body_parts, common_rate(archive))


def forget(
    model: Annotated[Path, typer.Argument(help="The model file (of labanmesh learn).")],
    labels: Annotated[str, typer.Option(help="The movements to remove, separated by commas.")],
    output: Annotated[Path, typer.Option("-o", "--output", help="The model file to write.")],
) -> None:
    """Remove movements from a model; the others stay unchanged, and nothing is learned again.

    Example: labanmesh forget corner1.model --labels wave -o corner1.model
    """
    from observer.learning.editing import remove_movements
    from observer.model.model_file import read_model, write_model

    gone = split_list("--labels", labels)
    smaller = remove_movements(read_model(model), gone)
    write_model(output, smaller)
    print(f"{output}: {', '.join(gone)} taken out; {describe_vocabulary(smaller.header)}")


def describe_evaluation(header: "Header") -> str:
    """How well the model did on examples that it had not learned, and its calibration."""
    tried, right = int(header.provenance.get("tried", "0")), int(header.provenance.get("right", "0"))
    result = f"right {100 * right / tried:.0f} %" if tried else "its accuracy is unknown"
    return f"tried on {_left_out(tried)}: {result}, {_calibration(header)}"


def describe_addition(output: Path, edited: "EditedModel") -> str:
    """What was added, and how well the new movements are recognised; the calibration is that of the old ones."""
    from observer.learning.learn import right_count

    header, labels, results = edited.model.header, ", ".join(edited.labels), edited.results
    examples = f"{plural(edited.examples, 'example')} of {plural(edited.people, 'person', 'people')}"
    lines = [f"{output}: {labels} added from {examples}; {describe_vocabulary(header)}"]
    if edited.promoted:
        lines.append(f"no longer something else: {', '.join(edited.promoted)}")
    share = f": right {100 * right_count(results) / len(results):.0f} %" if results else ""
    lines.append(f"tried on {_left_out(len(results))} of {labels}{share}; {_calibration(header)}")
    return "\n".join(lines)


def _left_out(count: int) -> str:
    return plural(count, "left-out example") if count else "no left-out examples"


def describe_background(header: "Header") -> str:
    """From what the model recognises that a movement is none of its own."""
    known = list(header.background or ())
    seconds = float(header.provenance.get("other_motion_s", "0"))
    if seconds:
        people = plural(int(header.provenance["other_motion_people"]), "person", "people")
        known.append(f"{seconds / 60:.1f} minutes of other motion of {people}")
    shown = f" and by {', '.join(known)}" if known else ""
    return f"something else is known by blends of the movements{shown}"


def describe_vocabulary(header: "Header") -> str:
    """What to do with the other observers of the scene, whose posteriors would otherwise be rejected."""
    vocabulary = header.vocabulary
    return (
        f"{vocabulary.size} movements now: edit the models of all observers of the scene alike, because fusion rejects "
        f"posteriors of another vocabulary (this is {vocabulary.digest})"
    )


def _warn_of_few_recordings(archive: "MotionArchive", labels: Sequence[str]) -> None:
    from observer.motion.archive import movements_in

    counts = Counter(recording.label for recording in movements_in(archive))
    for label in labels:
        if counts[label] < ENOUGH_RECORDINGS:
            count = plural(counts[label], "recording")
            print(f"warning: {label}: {count}; record it at least {ENOUGH_RECORDINGS} times", file=sys.stderr)


def _calibration(header: "Header") -> str:
    from observer.model.posterior_calibration import CAUTIOUS

    calibration = header.calibration
    # A model that knows "something else" has no predictive statistics, however well it was evaluated.
    cautious = (
        calibration.temperature >= CAUTIOUS.temperature
        and calibration.doubt >= CAUTIOUS.doubt
        and not calibration.foreseen
        and header.background is None
    )
    reason = ", cautiously: other people may do it otherwise" if cautious else ""
    return f"temperature {calibration.temperature:.1f}, doubt {calibration.doubt:.2g}{reason}"
