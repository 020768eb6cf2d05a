"""The command `labanmesh teach`: own movements for all observers of a scene, without stopping anything."""

import secrets
import threading
from collections.abc import Sequence
from contextlib import ExitStack
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

import typer

from common.command_options import takes_options
from common.config import Scene, read_scene
from common.errors import BadInput
from common.inbox import Presence
from common.lifecycle import stop_on_signals
from common.link import Link
from common.score import LEAST_REFERENCES
from common.teaching_messages import SOMEONE, require_person
from common.vocabulary import Vocabulary, require_teachable
from hub.teaching.lesson import LessonPlan
from hub.teaching.memory_commands import correct_verdicts, earlier_takes
from hub.teaching.teaching_client import find_observers, presence_of
from hub.teaching.terminal import agrees, wait
from hub.teaching.terminal_lesson import run_lesson, scene_here
from hub.watch import watch

if TYPE_CHECKING:
    from hub.teaching.rehearsal import Rehearsal

NO_FILE = Path()


@dataclass(frozen=True, slots=True)
class TeachOptions:
    """The options of `labanmesh teach`, as they were typed."""

    scene: Annotated[
        Path,
        typer.Argument(
            help="The scene file; its observers run, wherever they are. --rehearse needs none.", show_default=False
        ),
    ] = NO_FILE
    labels: Annotated[
        list[str] | None, typer.Argument(help="The movements: lower case letters, digits, underscores; at least two.")
    ] = None
    takes: Annotated[
        int | None, typer.Option(min=2, max=100, help="How often each movement is recorded; default 5.")
    ] = None
    background_minutes: Annotated[
        float | None,
        typer.Option(
            min=0, max=600, help="Minutes of ordinary life, from which observers learn what is no movement; default 2."
        ),
    ] = None
    person: Annotated[
        str, typer.Option(help="Who performs; by default someone, and with --was the only person who was taught.")
    ] = ""
    add: Annotated[bool, typer.Option("--add", help="Keep the movements that were taught before.")] = False
    reference: Annotated[
        bool,
        typer.Option(
            "--reference", help="These takes show how it should be done: the scene scores each movement by them."
        ),
    ] = False
    seconds: Annotated[
        float | None,
        typer.Option(min=0.5, max=600, help="Length of each take; by default until the person stands still."),
    ] = None
    countdown: Annotated[int | None, typer.Option(min=0, max=10, help="Seconds before each take; default 3.")] = None
    test: Annotated[bool, typer.Option("--test/--no-test", help="At the end do each movement once more.")] = True
    alarm_minutes: Annotated[
        float | None,
        typer.Option(
            min=0, max=600, help="And then so many minutes of anything else: verdicts are false alarms; default 0.5."
        ),
    ] = None
    begin: Annotated[
        Literal["still", "clap", "key", "now"],
        typer.Option(help="What begins a movement's takes: you stand still, clap once, or press a key."),
    ] = "still"
    up: Annotated[
        bool, typer.Option("--up", help="If nothing runs yet, run the scene here too, and show it after the lesson.")
    ] = False
    rehearse: Annotated[
        bool,
        typer.Option(
            "--rehearse",
            help="Without a camera and a scene file: a synthetic performer acts a shorter lesson, and what it taught.",
        ),
    ] = False
    was: Annotated[
        list[str] | None,
        typer.Option(
            metavar="WHEN",
            help="Correct a verdict instead, a LABEL or `nothing` for each: its id, last, 20:14:03, two times with .., "
            "30s or 2min ago.",
        ),
    ] = None
    learn: Annotated[
        Literal["now", "later"] | None,
        typer.Option(help="With --was: learn now, the default, or later; alone: learn corrections."),
    ] = None
    earlier: Annotated[
        bool, typer.Option("--earlier", help="List the takes that were set aside when another lesson began.")
    ] = False
    restore: Annotated[
        str, typer.Option(metavar="ID", help="Make these earlier takes those of now, which are set aside.")
    ] = ""


@takes_options
def teach(options: TeachOptions) -> None:
    """Teach all observers of a scene some movements: it counts down, you perform, they learn and go on.

    Each observer records its own tracks of the same takes, and learns on its own machine; then all change their
    vocabulary together, and the fusion service follows. Stand still before and after each movement. The takes of a
    movement begin when you stand still before a camera, so that no keyboard is needed. Keys: r repeats a take, d drops
    it, s ends the ordinary life. Ctrl-C ends it; the same command goes on where it stopped.

    Example: labanmesh teach scene.toml wave point clap

    Example: labanmesh teach scene.toml wave point --up --begin clap

    Example: labanmesh teach scene.toml nod --add --takes 8

    Example: labanmesh teach --rehearse

    Example: labanmesh teach scene.toml --film wave=wave.mp4 --film clap=clap.mp4

    Example: labanmesh teach scene.toml --was last nothing --was 20:14:03 wave

    Example: labanmesh teach scene.toml --earlier
    """
    if options.rehearse and (options.was or options.learn is not None or options.earlier or options.restore):
        raise BadInput("--rehearse: is a lesson; correct verdicts of a scene that runs, without --rehearse")
    if options.scene == NO_FILE and not options.rehearse:
        raise BadInput(
            "teach: name the scene file, e.g. labanmesh teach scene.toml wave point clap; or see a lesson without a "
            "camera: labanmesh teach --rehearse"
        )
    if options.was or options.learn is not None:
        learn_now = options.learn != "later"
        correct_verdicts(options.scene, options.was or [], options.labels or [], options.person, learn_now=learn_now)
        return
    if options.earlier or options.restore:
        earlier_takes(options.scene, options.restore)
        return
    with ExitStack() as here:
        rehearsal = None
        if options.rehearse:
            from hub.teaching.rehearsal import rehearsed

            words = [str(options.scene)] if options.scene != NO_FILE else []
            rehearsal = here.enter_context(rehearsed([*words, *(options.labels or [])]))
            options = replace(options, scene=rehearsal.file, labels=list(rehearsal.labels), up=True)
        _teach(options, rehearsal, here)


def _teach(options: TeachOptions, rehearsal: "Rehearsal | None", here: ExitStack) -> None:
    """The lesson, and what is shown after it; whatever is started for it ends with `here`."""
    config = read_scene(options.scene)
    _require_teachable(config, options, options.labels or [])
    with stop_on_signals() as stop, Link.open(config.mesh, "hub", scene=config.scene, stop=stop) as link:
        # Of a rehearsal's scene nothing runs yet: its endpoint is its own.
        presence = presence_of(config, link) if rehearsal else find_observers(config, link, stop)
        log = _started_here(options, config, presence, stop, rehearsal, here)
        run_lesson(_plan(options), config, link, presence, stop, rehearsal, options.scene)
    if rehearsal is not None:
        return
    if log is None:
        print("see it: labanmesh watch", options.scene)
        return
    print(f"the scene runs until Ctrl-C ends it (its log: {log}); later: labanmesh up {options.scene}", flush=True)
    watch(options.scene)


def _plan(options: TeachOptions) -> LessonPlan:
    """The lesson as typed; what was not typed is shorter in a rehearsal."""
    from hub.teaching.rehearsal import LENGTHS

    background, alarms = options.background_minutes, options.alarm_minutes
    typed: dict[str, Any] = {
        "takes": options.takes,
        "background_s": None if background is None else background * 60,
        "alarm_s": None if alarms is None else alarms * 60,
        "countdown": options.countdown,
    }
    lengths = LENGTHS if options.rehearse else {"alarm_s": 30.0}
    plan = LessonPlan(
        options.labels or [], secrets.token_hex(8), options.person or SOMEONE, seconds=options.seconds,
        add=options.add, test=options.test, begin=options.begin, reference=options.reference,
    )  # fmt: skip
    return replace(plan, **{**lengths, **{name: value for name, value in typed.items() if value is not None}})


def _started_here(
    options: TeachOptions,
    config: Scene,
    presence: Presence,
    stop: threading.Event,
    rehearsal: "Rehearsal | None",
    here: ExitStack,
) -> Path | None:
    """Start the scene in `here` if nothing of it runs and the person wants it; the path of its log, None if not."""
    if presence.alive or config.mesh.mode != "machine":
        return None
    if not (options.up or agrees(f"no observer of {config.scene} runs. Start them here, for the lesson?", stop)):
        return None
    print(f"starting {config.scene}: {', '.join(config.roster)}", flush=True)
    environment = rehearsal.environment if rehearsal else {}
    return here.enter_context(
        scene_here(
            options.scene, lambda: len(presence.alive) >= len(config.roster), lambda s: wait(s, stop), environment
        )
    )


def _require_teachable(scene: Scene, options: TeachOptions, labels: Sequence[str]) -> None:
    if not labels:
        raise BadInput(
            f"teach {options.scene}: name the movements, e.g. labanmesh teach {options.scene} wave point clap"
        )
    require_teachable(labels)
    require_person(options.person)
    if options.reference and options.takes is not None and options.takes < LEAST_REFERENCES:
        raise BadInput(f"--reference --takes {options.takes}: a score needs at least {LEAST_REFERENCES} takes")
    if len(labels) == 1 and not options.add:
        raise BadInput(
            f"{labels[0]}: one movement alone cannot be told from another; name at least two, or add it with --add to "
            "those that were taught"
        )
    if not options.add:
        Vocabulary(tuple(labels))
    elif len(set(labels)) != len(labels):
        raise BadInput("a movement is named twice; name each once")
    if scene.vocabulary is not None:
        raise BadInput(
            f"{options.scene}: vocabulary names the movements, which can then not be taught; remove that line, the "
            "models bring theirs"
        )
