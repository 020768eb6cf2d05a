"""`python -m benchmarks.taught`: what models taught from 2-D tracks are worth, on recorded people."""

import sys
from dataclasses import dataclass
from enum import StrEnum
from functools import partial
from typing import Annotated

import typer

from benchmarks.command_line import recordings_folder, run_command
from benchmarks.taught import corrections, few_takes, life
from benchmarks.taught.households import ROOMS, Draws
from benchmarks.taught.judging import TaughtModels
from common.command_options import takes_options
from common.progress import ProgressBar
from common.text import named_numbers
from observer.model.registry import DEFAULT_MODEL


class Row(StrEnum):
    """What is measured. few-takes: five takes by one person. corrections: wrong verdicts that become examples.

    life: false verdicts in ordinary life.
    """

    FEW_TAKES = "few-takes"
    CORRECTIONS = "corrections"
    LIFE = "life"


class People(StrEnum):
    """Whose movements: gestures (MSR Action3D, Florence 3D Actions), or whole-body movements (nw_ucla)."""

    MSR = "msr"
    NW_UCLA = "nw_ucla"
    FLORENCE3D = "florence3d"


@dataclass(frozen=True, slots=True)
class TaughtOptions:
    """As typed on the command line."""

    row: Annotated[Row, typer.Argument(help="What is measured.")]
    model: Annotated[str, typer.Option(help="The kind of model.")] = DEFAULT_MODEL
    parameter: Annotated[list[str] | None, typer.Option(help="NAME=NUMBER of the model; may be repeated.")] = None
    data: Annotated[People, typer.Option(help="few-takes, corrections: the recordings.")] = People.MSR
    people: Annotated[str, typer.Option(help="corrections: households of these people, e.g. 1,3,5.")] = ""
    life: Annotated[bool, typer.Option("--life", help="few-takes: learn storytelling as something else.")] = False
    whole_body: Annotated[bool, typer.Option("--whole-body", help="All recorded body parts, not hands and head.")] = (
        False
    )
    draws: Annotated[
        int, typer.Option(min=1, help="few-takes, corrections, life: how many people with their movements.")
    ] = 10
    seed: Annotated[int, typer.Option(min=0, help="Of the draws.")] = 0
    jobs: Annotated[int, typer.Option(min=0, help="Processes to share the work; 0: one per core.")] = 0


@takes_options
def taught(options: TaughtOptions) -> None:
    """Print how well models taught from 2-D tracks recognise takes that they have not learned.

    LABANMESH_DATA names the folder of recordings.

    Example: python -m benchmarks.taught few-takes --data nw_ucla
    """
    data = recordings_folder()
    parameters = named_numbers("--parameter", options.parameter or [])
    if options.row is Row.CORRECTIONS:
        with ProgressBar() as bar:
            models = TaughtModels(options.model, parameters)
            people = options.people.split(",") if options.people else []
            homes = Draws(options.data.value, people, options.draws, options.seed, options.whole_body)
            print("\n".join(corrections.rows(data, models, homes, options.jobs, partial(bar, "draws"))))
        return
    room = ROOMS[options.data.value](data, options.whole_body)
    learned_life = few_takes.life_in(room, data) if options.life and options.row is Row.FEW_TAKES else {}
    teaching, seeds = TaughtModels(options.model, parameters, learned_life), (options.draws, options.seed, options.jobs)
    with ProgressBar() as bar:
        draws = partial(bar, "draws")
        if options.row is Row.LIFE:
            print("\n".join(life.rows(room, teaching, data, *seeds, draws)))
        else:
            print("\n".join(few_takes.rows(room, teaching, *seeds, draws)))


if __name__ == "__main__":
    sys.exit(run_command(taught, "taught"))
