"""The options that several studies have, each once: what is judged, by whom it was learned, where the result goes."""

from pathlib import Path
from typing import Annotated

import typer

Archive = Annotated[Path, typer.Argument(help="The motion archive (.npz).")]
Views = Annotated[str, typer.Option(help="door, wheel, table, yaw:DEG[,pitch:DEG], camera files; by commas.")]
Labels = Annotated[str, typer.Option(help="Movements to tell apart, or AS1, AS2, AS3; by commas; all.")]
LabelSets = Annotated[
    list[str] | None, typer.Option(help="Movements by commas, or a set as AS1; repeat for several sets; all.")
]
TrainSubjects = Annotated[str, typer.Option(help="People to learn from; every other one.")]
TestSubjects = Annotated[str, typer.Option(help="People to judge; those not learned from.")]
LeaveOneOut = Annotated[bool, typer.Option("--leave-one-subject-out", help="Judge each in turn.")]
Model = Annotated[str, typer.Option(help="phase, phase-symbols or frame-table.")]
RuleName = Annotated[str, typer.Option(help="Name of the fusion rule.")]
Parameters = Annotated[
    list[str] | None, typer.Option(help="NAME=NUMBER of the model instead of its default; may be repeated.")
]
Turn = Annotated[str, typer.Option(help="Degrees the performer is turned in test, or random.")]
Faults = Annotated[list[str] | None, typer.Option(help="VIEW=wrong|noise|silent|late|hidden; may be repeated.")]
Facings = Annotated[
    int, typer.Option(min=0, help="Directions that the model knows; 1 for a known turn, 12 for a random one.")
]
Temperature = Annotated[float, typer.Option(min=0.1, help="Of the fused belief: [fusion] temperature.")]
Uncalibrated = Annotated[bool, typer.Option("--uncalibrated", help="Observers as sure as their evidence.")]
Unlearned = Annotated[
    str, typer.Option(help="With --stream: movements shown without having been learned, by commas; or others.")
]
BackgroundLabels = Annotated[
    str,
    typer.Option(
        help="Movements learned as something else, by commas; a number: so many of --unlearned, shown no more; "
        "blends: none, mixtures of those learned alone."
    ),
]
BodyParts = Annotated[str, typer.Option(help="Parts to use, by commas; all of the archive's.")]
OnsetKind = Annotated[str, typer.Option(help="known: as cut out. unknown: idle around it, any tempo.")]
Stream = Annotated[bool, typer.Option("--stream", help="Judge continuously too: spotting in a stream.")]
LearningCurve = Annotated[
    bool, typer.Option("--learning-curve", help="Also from fewer people, and fewer recordings of each.")
]
Through = Annotated[
    str, typer.Option(help="process; mesh: over real Zenoh sessions; pixels: filmed and tracked by camshift.")
]
Background = Annotated[str, typer.Option(help="With pixels: plain, cluttered or skin_toned.")]
Seed = Annotated[int, typer.Option(min=0, help="Seeds all chance.")]
ReportFolder = Annotated[Path | None, typer.Option(help="Folder for tables and figures.")]
JsonFile = Annotated[Path | None, typer.Option(help="File for the figures as JSON.")]
