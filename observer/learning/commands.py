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
from common.progress import ProgressBar
from common.text import named_numbers, plural, split_list
from common.vocabulary import Vocabulary
from observer.learning.descriptions import (
    describe_addition,
    describe_background,
    describe_camera,
    describe_evaluation,
    describe_leaning,
    describe_periods,
    describe_placement,
    describe_references,
    describe_vocabulary,
)
from observer.learning.learn_options import LearnOptions

if TYPE_CHECKING:
    from observer.learning.learning_sources import LearningSource
    from observer.motion.archive import MotionArchive

ENOUGH_RECORDINGS = 3
"""For movements with fewer recordings `learn` prints a warning."""


@takes_options
def learn(options: LearnOptions) -> None:
    """Learn one observer's model for its view, from recordings in 3-D that are projected into it, or from the 2-D
    tracks of its own camera, which need no --view.

    Example: labanmesh learn msr.npz --view yaw:45 -o corner1.model

    Example: labanmesh learn sofa.npz -o sofa.model

    Example: labanmesh learn own.npz --view yaw:45 --background msr.npz -o corner1.model

    Example: labanmesh learn own.npz --view yaw:45 --add-to corner1.model -o corner1.model

    Example: labanmesh learn --sensor left=a.npz --sensor right=b.npz -o models

    Example: labanmesh learn msr.npz --view cameras/cam1.toml --place 0.2,1.5 --facing -30 -o cam1.model

    Example: labanmesh learn msr.npz --scene scene.toml -o models

    Example: labanmesh learn teacher.npz --view yaw:45 --reference 1,2,3,4 -o corner1.model

    Example: labanmesh learn effort.npz --view yaw:45 --effort --rate 30 -o corner1.effort
    """
    _require_compatible(options)
    parameters = named_numbers("--parameter", options.parameter or [])
    # Begins before the imports, which take a moment.
    with ProgressBar("reading the recordings"):
        from observer.learning.learning_sources import read_sources
        from observer.motion.archive import require_labels
        from observer.motion.label_sets import labels_in
        from observer.motion.sensors import require_shared_labels

        labels = labels_in(options.labels)
        sources = read_sources(options)
    if options.effort:
        _learn_effort(options, sources[0])
    elif options.add_to:
        _add_movements(options, options.add_to, sources[0], labels, parameters)
    else:
        labels = labels or tuple(dict.fromkeys(label for source in sources for label in source.labels))
        if options.sensor:
            require_shared_labels(labels, {source.name: source.archive for source in sources})
        else:
            require_labels(labels, sources[0].archive, "--labels")
        vocabulary = Vocabulary(labels, options.name)
        _learn_all([_Part(options, source, vocabulary, parameters) for source in sources])


def _require_compatible(options: LearnOptions) -> None:
    """Raise BadInput for options that exclude each other."""
    if options.effort and options.add_to:
        raise BadInput("--effort --add-to: only movements can be added; Effort is learned from all examples at once")
    if options.background and options.edits:
        raise BadInput("--background: only for a new model; --add-to keeps the model's background, --effort needs none")
    if options.reference and options.edits:
        raise BadInput("--reference: only for a new model; --add-to keeps the model's own, --effort needs none")
    if options.parts and options.edits:
        raise BadInput("--body-parts: only for a new model of movements; omit it")


@dataclass(frozen=True, slots=True)
class _Part:
    """The input from which the model of one sensor is learned."""

    options: LearnOptions
    source: "LearningSource"
    vocabulary: Vocabulary
    parameters: Mapping[str, float]


def _learn_all(parts: Sequence[_Part]) -> None:
    """Learn and write one model for each part, several at once, and print what became of them."""
    from common.parallel import cores, run_parts

    with ProgressBar() as bar:

        def done(number: int, total: int) -> None:
            # Of one model the steps are not known.
            bar("learning", number, total if total > 1 else 0)

        texts = run_parts(_learn_movements, parts, parts[0].options.jobs or cores(), done)
    for part, text in zip(parts, texts, strict=True):
        print(text)
        _warn_of_few_recordings(part.source.archive, part.vocabulary.labels)


def _learn_movements(part: _Part) -> str:
    """Learn and write one model; what to print about it."""
    from observer.geometry.views import is_this_camera
    from observer.learning.examples import with_references
    from observer.learning.learn import learn_view, of_one_person
    from observer.model.model_file import write_model
    from observer.model.registry import DEFAULT_MODEL

    options, source = part.options, part.source
    output = options.output / f"{source.name}.model" if source.name else options.output
    learned = learn_view(
        of_one_person(source.archive) if options.known_people else source.archive,
        source.view,
        part.vocabulary,
        kind=options.model or DEFAULT_MODEL,
        body_parts=source.body_parts,
        parameters=part.parameters,
        provenance=source.provenance,
        background=source.background,
        placement=source.placement,
    )
    if chosen := split_list("--reference", options.reference):
        learned = with_references(learned, source.archive, source.view, chosen, source.placement)
    write_model(output, learned)
    header, recorded = learned.header, source.archive.body_parts
    lines = [
        f"{output}: {header.kind} for {header.view}, {header.vocabulary.size} movements from "
        f"{plural(int(header.provenance['examples']), 'example')} of "
        f"{plural(len(header.provenance['subjects'].split(',')), 'person', 'people')}, "
        f"{header.rate_hz:g} Hz, {output.stat().st_size / 1e6:.2f} MB",
        describe_evaluation(header),
        *describe_leaning(header),
        *describe_periods(header),
        *describe_placement(header, source.archive),
        *describe_references(header),
    ]
    lines += [describe_background(header)] if header.background is not None else []
    return "\n".join([*lines, *([describe_camera(header, recorded)] if is_this_camera(header.matrix) else [])])


def _add_movements(
    options: LearnOptions,
    old: Path,
    source: "LearningSource",
    labels: Sequence[str],
    parameters: Mapping[str, float],
) -> None:
    from observer.learning.editing import add_movements
    from observer.model.model_file import read_model, write_model

    with ProgressBar("learning"):
        edited = add_movements(
            read_model(old),
            source.archive,
            source.view,
            labels=labels,
            kind=options.model,
            parameters=parameters,
            source=source.provenance["archive"],
            placement=source.placement,
        )
    write_model(options.output, edited.model)
    print(describe_addition(options.output, edited))
    _warn_of_few_recordings(source.archive, edited.labels)


def _learn_effort(options: LearnOptions, source: "LearningSource") -> None:
    from observer.effort.effort_file import write_effort
    from observer.effort.model import learn_effort
    from observer.motion.projected import placed

    archive = placed(source.archive, source.placement) if source.placement else source.archive
    with ProgressBar("learning"):
        learned = learn_effort(archive, source.view, source.provenance)
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
    from observer.motion.label_sets import labels_in

    gone = labels_in(labels)
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
