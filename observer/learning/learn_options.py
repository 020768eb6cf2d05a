"""The options of `labanmesh learn`."""

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import typer

from common.text import split_list

Texts = list[str] | None
Place = Annotated[
    str,
    typer.Option(
        help="X,Z or X,Y,Z: where the person stands in the room of the camera file, metres; Y: height of the head."
    ),
]
Facing = Annotated[
    float | None,
    typer.Option(
        min=-36_000,
        max=36_000,
        help="Degrees that the person is turned to the left of the direction towards yaw:0 of that room.",
    ),
]
ModelKind = Annotated[str, typer.Option(help="stacked (default), phase or frame-table.")]
Parameters = Annotated[
    Texts, typer.Option(help="NAME=NUMBER: a parameter of the model; may be repeated. docs/design/model.md#parameters.")
]


@dataclass(frozen=True, slots=True)
class LearnOptions:
    """The options of `labanmesh learn`, as they were typed."""

    output: Annotated[
        Path,
        typer.Option(
            "-o", "--output", help="The model file to write; with --sensor and --scene the folder, for NAME.model."
        ),
    ]
    archive: Annotated[
        Path | None, typer.Argument(help="The motion archive to learn from (.npz); none with --sensor.")
    ] = None
    view: Annotated[
        str, typer.Option(help="door, wheel, table, yaw:DEG, yaw:DEG,pitch:DEG, or a camera file; none for 2-D tracks.")
    ] = ""
    place: Place = ""
    facing: Facing = None
    scene: Annotated[
        Path | None,
        typer.Option(help="In place of --view: a model for each observer of this scene file, with its place, facing."),
    ] = None
    observers: Annotated[str, typer.Option(help="With --scene: only these observers, separated by commas.")] = ""
    sensor: Annotated[
        Texts,
        typer.Option(
            help="NAME=FILE.npz or NAME=FILE.npz@VIEW in place of ARCHIVE --view: what a sensor recorded, by default "
            "seen from the door; may be repeated: one model each, with the same movements."
        ),
    ] = None
    model: ModelKind = ""
    labels: Annotated[
        str, typer.Option(help="The movements to learn, separated by commas (default: all of the archive).")
    ] = ""
    subjects: Annotated[
        str, typer.Option(help="The people to learn from, separated by commas (default: all of the archive).")
    ] = ""
    body_parts: Annotated[
        str,
        typer.Option(
            help="The parts to learn from (default: all of the archive); auto: those that all movements show."
        ),
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
        typer.Option(help="Archives of other movements, separated by commas, to recognise something else."),
    ] = ""
    background_labels: Annotated[
        str, typer.Option(help="The movements to use of these archives, separated by commas (default: all).")
    ] = ""
    name: Annotated[str, typer.Option(help="A name for the vocabulary.")] = "movements"
    parameter: Parameters = None
    effort: Annotated[
        bool, typer.Option("--effort", help="Learn Effort instead of movements, from trials such as -1_0_1_1.")
    ] = False
    known_people: Annotated[
        bool,
        typer.Option(
            "--known-people",
            help="The archive has the people who will be judged: calibrate by leaving out recordings, not people.",
        ),
    ] = False
    reference: Annotated[
        str,
        typer.Option(
            help="Takes that show how it should be done, so that a running scene scores by them: all, or trials, "
            "movements or LABEL:TRIAL, separated by commas."
        ),
    ] = ""
    jobs: Annotated[
        int, typer.Option(min=0, max=1024, help="Processes to share the work of several --sensor; 0: one per core.")
    ] = 0

    @property
    def parts(self) -> tuple[str, ...]:
        """Body parts; empty: all of the archive."""
        return split_list("--body-parts", self.body_parts)

    @property
    def edits(self) -> bool:
        """Whether the model is not a new one of movements."""
        return self.effort or self.add_to is not None
