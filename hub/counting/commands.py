"""The verb `labanmesh count`: one movement's repetitions, large in the terminal, as lines, or as lines of JSON."""

import json
import sys
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Annotated

import typer
from rich.align import Align
from rich.console import Console, Group
from rich.live import Live
from rich.text import Text

from common.command_options import ForSeconds
from common.config import Scene, read_scene
from common.errors import BadInput
from common.lifecycle import stop_on_signals
from common.link import Link
from common.messages import JudgementMessage
from common.text import nearest
from hub.counting.tally import MovementTally, RepetitionTally, tally_words
from hub.session import SceneUpdate, listen
from hub.teaching.big_letters import big
from hub.watch import StartNotice

BELL = "\a"
EDGE_LINES = 6
"""Lines beside the large number: the movement, the words, and space."""


def count(
    scene: Annotated[Path, typer.Argument(help="The scene file, as given to observe and fuse.")],
    movement: Annotated[str, typer.Argument(help="The movement to count, as in the scene's vocabulary.")],
    target: Annotated[int, typer.Option(min=0, max=100_000, help="Repetitions of one set; 0: no target.")] = 0,
    once: Annotated[bool, typer.Option("--once", help="End when the target is reached.")] = False,
    as_json: Annotated[bool, typer.Option("--json", help="Each count and each target as a line of JSON.")] = False,
    for_s: ForSeconds = None,
) -> None:
    """Count how often a movement is done, from now on: live, with the partial repetitions, and a bell at the target.

    A movement whose takes are repetitions (waving, squats in a row) counts while it goes on; any other once for each
    verdict. Ctrl-C ends it.

    Example: labanmesh count scene.toml squat --target 10
    """
    if once and not target:
        raise BadInput("--once: there is no target to wait for; give one, e.g. --target 10")
    config = read_scene(scene)
    require_movement(config, movement, () if config.named_vocabulary is None else config.named_vocabulary.labels)
    tally = RepetitionTally(movement, target)
    console, notice = Console(), StartNotice(config, scene)
    with stop_on_signals(for_s) as stop, Link.open(config.mesh, "hub", scene=config.scene, stop=stop) as link:

        def go_on() -> bool:
            return not stop.is_set() and not (once and tally.reached)

        updates = _checked(config, movement, listen(config, link, go_on))
        if as_json or not console.is_terminal:
            show_counts(notice.to_stderr(updates), tally, as_json)
        else:
            show_large(updates, tally, console, notice)


def require_movement(config: Scene, movement: str, labels: Iterable[str]) -> None:
    """Raises BadInput unless the movement is one of the labels, as far as they are known."""
    known = tuple(labels)
    if known and movement not in known:
        raise BadInput(f"{movement!r} is no movement of {config.scene}; {nearest(movement, known)}")


def _checked(config: Scene, movement: str, updates: Iterable[SceneUpdate]) -> Iterator[SceneUpdate]:
    for update in updates:
        require_movement(config, movement, update.state.labels)
        yield update


def show_counts(updates: Iterable[SceneUpdate], tally: RepetitionTally, as_json: bool = False) -> None:
    """Print a line for each count, and one for each target that is reached."""
    reached = 0
    for update in updates:
        message = update.message
        if update.answered or not isinstance(message, JudgementMessage) or not tally.update(message):
            continue
        print(_json("count", tally.now, message) if as_json else _line(tally.now), flush=True)
        if tally.reached > reached:
            reached = tally.reached
            print(_json("target", tally.now, message) if as_json else "target reached", flush=True)


def _line(tally: MovementTally) -> str:
    return f"{tally.movement}: {tally_words(tally)}"


def _json(kind: str, tally: MovementTally, message: JudgementMessage) -> str:
    fields = {
        "kind": kind, "movement": tally.movement, "count": tally.done, "partial": tally.partial,
        "target": tally.target or None, "sets": tally.sets, "at_ns": message.at_ns,
    }  # fmt: skip
    return json.dumps(fields)


def show_large(
    updates: Iterable[SceneUpdate], tally: RepetitionTally, console: Console, notice: StartNotice | None = None
) -> None:
    """The count in letters as large as the terminal; at the target a bell. At the end the count as a line."""
    reached, shown = 0, ""
    try:
        with Live(console=console, screen=True, auto_refresh=False) as live:
            for update in updates:
                if isinstance(update.message, JudgementMessage) and not update.answered:
                    tally.update(update.message)
                text = notice.text(update.state) if notice else ""
                if (now := f"{tally.now}{console.size}{text}") != shown:
                    shown = now
                    live.update(picture(tally.now, *console.size, text), refresh=True)
                if tally.reached > reached:
                    reached = tally.reached
                    console.file.write(BELL)
                    console.file.flush()
    finally:
        print(_line(tally.now), file=sys.stdout, flush=True)


def picture(tally: MovementTally, width: int, height: int, notice: str = "") -> Align:
    """The number as large as fits, the movement above, the words below; green once the set is complete."""
    style = "bold green" if tally.is_complete else "bold"
    number = big(str(tally.in_set), width, max(height - EDGE_LINES, 1)) or [str(tally.in_set)]
    broad = max(map(len, number))
    space = [Text("")] if height > EDGE_LINES + len(number) else []
    lines = [Text(tally.movement.replace("_", " "), style="bold", justify="center"), *space]
    lines += [Text(row.ljust(broad), style=style, justify="center", no_wrap=True) for row in number]
    lines += [*space, Text(notice or tally_words(tally), justify="center")]
    return Align.center(Group(*lines), vertical="middle", height=height)
