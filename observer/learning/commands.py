"""The commands `labanmesh learn` and `labanmesh forget`, and what they print."""

import sys
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from common.command_options import takes_options
from common.errors import BadInput
from common.text import named_numbers, plural, split_list
from common.vocabulary import Vocabulary
from observer.learning.descriptions import (
    describe_addition,
    describe_background,
    describe_camera,
    describe_evaluation,
    describe_vocabulary,
)

if TYPE_CHECKING:
    from observer.learning.sources import LearningSource
    from observer.motion.archive import MotionArchive
    from observer.motion.sensors import SensorFile

Texts = list[str] | None
ENOUGH_RECORDINGS = 3
"""For movements with fewer recordings `learn` prints a warning."""


@dataclass(frozen=True, slots=True)
class LearnOptions:
    """As typed on the command line."""

    output: Annotated[
        Path, typer.Option("-o", "--output", help="The model file to write; with --sensor the folder, for NAME.model.")
    ]
    archive: Annotated[
        Path | None, typer.Argument(help="The motion archive to learn from (.npz); none with --sensor.")
    ] = None
    view: Annotated[
        str, typer.Option(help="door, wheel, table, yaw:DEG, yaw:DEG,pitch:DEG, or a camera file; none for 2-D tracks.")
    ] = ""
    sensor: Annotated[
        Texts,
        typer.Option(
            help="NAME=FILE.npz or NAME=FILE.npz@VIEW in place of ARCHIVE --view: what a sensor recorded, by default "
            "seen from the door; may be repeated: one model each, with the same movements."
        ),
    ] = None
    model: Annotated[
        str, typer.Option(help="stacked (default), phase, discriminative, phase-symbols or frame-table.")
    ] = ""
    labels: Annotated[
        str, typer.Option(help="The movements to learn, separated by commas (default: all of the archive).")
    ] = ""
    subjects: Annotated[
        str, typer.Option(help="The people to learn from, separated by commas (default: all of the archive).")
    ] = ""
    body_parts: Annotated[
        str, typer.Option(help="The parts that the observer's tracker finds (default: all of the archive).")
    ] = ""
    rate: Annotated[
        float | None, typer.Option(min=1, max=1000, help="The observer's frames per second (default: the archive's).")
    ] = None
    add_to: Annotated[
        Path | None,
        typer.Option(help="Add the movements to this model; the recordings of its own movements are not needed."),
    ] = None
    background: Annotated[
        str,
        typer.Option(help="Archives of other movements, separated by commas, to recognise something else; or: blends."),
    ] = ""
    background_labels: Annotated[
        str, typer.Option(help="The movements to use of these archives, separated by commas (default: all).")
    ] = ""
    name: Annotated[str, typer.Option(help="A name for the vocabulary.")] = "movements"
    parameter: Annotated[Texts, typer.Option(help="NAME=NUMBER: a parameter of the model; may be repeated.")] = None
    effort: Annotated[
        bool, typer.Option("--effort", help="Learn Effort instead of movements, from trials such as -1_0_1_1.")
    ] = False
    jobs: Annotated[
        int, typer.Option(min=0, help="Processes to share the work of several --sensor; 0: one per core.")
    ] = 0

    @property
    def parts(self) -> tuple[str, ...]:
        """Body parts; empty: all of the archive."""
        return split_list("--body-parts", self.body_parts)


@takes_options
def learn(options: LearnOptions) -> None:
    """Learn one observer's model for its view, from recordings in 3-D that are projected into it, or from the 2-D
    tracks of its own camera, which need no --view.

    Example: labanmesh learn msr.npz --view yaw:45 -o corner1.model

    Example: labanmesh learn sofa.npz -o sofa.model

    Example: labanmesh learn own.npz --view yaw:45 --background msr.npz -o corner1.model

    Example: labanmesh learn own.npz --view yaw:45 --add-to corner1.model -o corner1.model

    Example: labanmesh learn --sensor left=a.npz --sensor right=b.npz -o models

    Example: labanmesh learn effort.npz --view yaw:45 --effort --rate 30 -o corner1.effort
    """
    from observer.learning.sources import read_source, sensors_to_learn
    from observer.motion.archive import require_labels

    _require_compatible(options)
    labels, parameters = split_list("--labels", options.labels), named_numbers("--parameter", options.parameter or [])
    edits = options.effort or options.add_to is not None
    sensors = sensors_to_learn(options.archive, options.view, options.sensor or [], options.output, edits)
    people, background = split_list("--subjects", options.subjects), (options.background, options.background_labels)
    sources = [read_source(one, people, options.rate, options.parts, background) for one in sensors]
    if options.effort:
        _learn_effort(options, sources[0])
    elif options.add_to:
        _add_movements(options, options.add_to, sources[0], labels, parameters)
    else:
        labels = labels or tuple(dict.fromkeys(label for source in sources for label in source.labels))
        for sensor, source in zip(sensors, sources, strict=True):
            require_labels(labels, source.archive, f"--sensor {sensor.name}: --labels" if sensor.name else "--labels")
        vocabulary = Vocabulary(labels, options.name)
        _learn_all([_Part(options, *of_one, vocabulary, parameters) for of_one in zip(sensors, sources, strict=True)])


def _require_compatible(options: LearnOptions) -> None:
    """Raise BadInput for options that exclude each other."""
    edits = options.effort or options.add_to is not None
    if options.effort and options.add_to:
        raise BadInput("--effort --add-to: only movements can be added; Effort is learned from all examples at once")
    if options.background and edits:
        raise BadInput("--background: only for a new model; --add-to keeps the model's background, --effort needs none")
    if options.parts and edits:
        raise BadInput("--body-parts: only for a new model of movements; omit it")


@dataclass(frozen=True, slots=True)
class _Part:
    """What the model of one sensor is learned from."""

    options: LearnOptions
    sensor: "SensorFile"
    source: "LearningSource"
    vocabulary: Vocabulary
    parameters: Mapping[str, float]


def _learn_all(parts: Sequence[_Part]) -> None:
    """Learn and write one model for each part, several at once, and print what became of them."""
    from common.parallel import cores, run_parts
    from common.progress import ProgressBar

    with ProgressBar() as bar:

        def done(number: int, total: int) -> None:
            if total > 1:
                bar("learning", number, total)

        texts = run_parts(_learn_movements, parts, parts[0].options.jobs or cores(), done)
    for part, text in zip(parts, texts, strict=True):
        print(text)
        _warn_of_few_recordings(part.source.archive, part.vocabulary.labels)


def _learn_movements(part: _Part) -> str:
    """Learn and write one model; what to print about it."""
    from observer.geometry.views import is_this_camera
    from observer.learning.learn import learn_view
    from observer.model.model_file import write_model
    from observer.model.registry import DEFAULT_MODEL

    options, sensor, source = part.options, part.sensor, part.source
    output = options.output / f"{sensor.name}.model" if sensor.name else options.output
    learned = learn_view(
        source.archive,
        source.view,
        part.vocabulary,
        kind=options.model or DEFAULT_MODEL,
        body_parts=options.parts or None,
        parameters=part.parameters,
        provenance=source.provenance,
        background=source.background,
    )
    write_model(output, learned)
    header = learned.header
    lines = [
        f"{output}: {header.kind} for {header.view}, {header.vocabulary.size} movements from "
        f"{plural(int(header.provenance['examples']), 'example')} of "
        f"{plural(len(header.provenance['subjects'].split(',')), 'person', 'people')}, "
        f"{header.rate_hz:g} Hz, {output.stat().st_size / 1e6:.2f} MB",
        describe_evaluation(header),
    ]
    lines += [describe_background(header)] if header.background is not None else []
    return "\n".join([*lines, *([describe_camera(header)] if is_this_camera(header.matrix) else [])])


def _add_movements(
    options: LearnOptions, old: Path, source: "LearningSource", labels: Sequence[str], parameters: Mapping[str, float]
) -> None:
    from observer.learning.editing import add_movements
    from observer.model.model_file import read_model, write_model

    edited = add_movements(
        read_model(old),
        source.archive,
        source.view,
        labels=labels,
        kind=options.model,
        parameters=parameters,
        source=source.provenance["archive"],
    )
    write_model(options.output, edited.model)
    print(describe_addition(options.output, edited))
    _warn_of_few_recordings(source.archive, edited.labels)


def _learn_effort(options: LearnOptions, source: "LearningSource") -> None:
    from observer.effort.effort_file import write_effort
    from observer.effort.model import learn_effort

    learned = learn_effort(source.archive, source.view, source.provenance)
    write_effort(options.output, learned)
    print(
        f"{options.output}: Effort for {learned.view} from {plural(int(learned.provenance['examples']), 'example')}, "
        f"{learned.rate_hz:g} Hz, {options.output.stat().st_size / 1e6:.2f} MB"
    )


def forget(
    model: Annotated[Path, typer.Argument(help="The model file (of labanmesh learn).")],
    labels: Annotated[str, typer.Option(help="The movements to remove, separated by commas.")],
    output: Annotated[Path, typer.Option("-o", "--output", help="The model file to write.")],
) -> None:
    """Remove movements from a model; no recordings are needed.

    Example: labanmesh forget corner1.model --labels wave -o corner1.model
    """
    from observer.learning.editing import remove_movements
    from observer.model.model_file import read_model, write_model

    gone = split_list("--labels", labels)
    smaller = remove_movements(read_model(model), gone)
    write_model(output, smaller)
    print(f"{output}: {', '.join(gone)} taken out; {describe_vocabulary(smaller.header)}")


def _warn_of_few_recordings(archive: "MotionArchive", labels: Sequence[str]) -> None:
    from observer.motion.archive import movements_in

    counts = Counter(recording.label for recording in movements_in(archive))
    for label in labels:
        if counts[label] < ENOUGH_RECORDINGS:
            count = plural(counts[label], "recording")
            print(f"warning: {label}: {count}; record it at least {ENOUGH_RECORDINGS} times", file=sys.stderr)
