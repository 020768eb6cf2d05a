"""The options of `labanmesh evaluate`, and those that other commands share with it."""

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import typer

from observer.learning.learn_options import Facing, ModelKind, Parameters, Place, Texts

LabelSets = Annotated[Texts, typer.Option(help="Movements separated by commas, or a set as AS1; repeat for more sets.")]
BodyParts = Annotated[str, typer.Option(help="Parts to use, separated by commas; default: all that are recorded.")]
TrainSubjects = Annotated[str, typer.Option(help="People to learn from; default: every other one.")]
TestSubjects = Annotated[str, typer.Option(help="People to judge; default: those not learned from.")]
LeaveOneSubjectOut = Annotated[
    bool, typer.Option("--leave-one-subject-out", help="Judge each person by models of all others.")
]
JsonFile = Annotated[Path | None, typer.Option(help="File for the figures as JSON.")]


@dataclass(frozen=True, slots=True)
class EvaluateOptions:
    """The options of `labanmesh evaluate`, as they were typed."""

    archive: Annotated[Path | None, typer.Argument(help="The motion archive (.npz); none with --sensor.")] = None
    views: Annotated[
        str, typer.Option(help="door, wheel, table, yaw:DEG[,pitch:DEG] or camera files, separated by commas.")
    ] = ""
    place: Place = ""
    facing: Facing = None
    sensor: Annotated[
        Texts,
        typer.Option(
            help="NAME=FILE.npz or NAME=FILE.npz@VIEW in place of ARCHIVE --views: a sensor that recorded the same "
            "performances, by default seen from the door; two or more."
        ),
    ] = None
    labels: Annotated[str, typer.Option(help="Movements, or AS1, AS2, AS3; separated by commas; default: all.")] = ""
    train_subjects: TrainSubjects = ""
    test_subjects: TestSubjects = ""
    leave_one_subject_out: LeaveOneSubjectOut = False
    model: ModelKind = "stacked"
    rule: Annotated[str, typer.Option(help="The fusion rule.")] = "guarded_product"
    parameter: Parameters = None
    turn: Annotated[str, typer.Option(help="Degrees by which the performer is turned in test, or random.")] = "0"
    fault: Annotated[Texts, typer.Option(help="VIEW=wrong|noise|silent|late|hidden; may be repeated.")] = None
    uncalibrated: Annotated[
        bool, typer.Option("--uncalibrated", help="Observers do not scale their certainty by how often they are right.")
    ] = False
    unlearned: Annotated[
        str, typer.Option(help="With --stream: movements shown but not learned, separated by commas; or others.")
    ] = ""
    background_labels: Annotated[
        str,
        typer.Option(
            help="Movements learned as `something else`, separated by commas; a number: that many of --unlearned, "
            "then not shown."
        ),
    ] = ""
    body_parts: BodyParts = ""
    onset: Annotated[str, typer.Option(help="known: as cut out. unknown: with rest around, any tempo.")] = "known"
    stream: Annotated[bool, typer.Option("--stream", help="Also judge continuous streams.")] = False
    background: Annotated[
        str, typer.Option(help="Archives (.npz) to learn `something else` from, separated by commas.")
    ] = ""
    background_subjects: Annotated[
        str, typer.Option(help="The people of these archives to learn from; default: all.")
    ] = ""
    other_motion: Annotated[
        list[Path] | None,
        typer.Option(
            help="An archive in which no learned movement happens, to count false verdicts; people of --background "
            "in the same file are left out; may be repeated."
        ),
    ] = None
    jobs: Annotated[int, typer.Option(min=0, max=1024, help="Processes to share the work; 0: one per core.")] = 0
    seed: Annotated[int, typer.Option(min=0, max=2**63 - 1, help="Seed of all random choices.")] = 0
    report: Annotated[Path | None, typer.Option(help="Folder for tables and figures.")] = None
    json: JsonFile = None
    # The command line runs other commands with these two (labanmesh.py:OTHER_FORMS); here they are for --help.
    paper: Annotated[
        bool, typer.Option("--paper", help="Repeat the paper's three experiments instead: evaluate --paper --help.")
    ] = False
    effort: Annotated[
        bool, typer.Option("--effort", help="Evaluate Effort instead of movements: evaluate --effort --help.")
    ] = False
