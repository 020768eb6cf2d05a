"""The command `labanmesh teach`: own movements for all observers of a scene, without stopping anything."""

import secrets
import threading
from collections.abc import Sequence
from contextlib import ExitStack
from dataclasses import dataclass
from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from common.command_options import takes_options
from common.errors import BadInput, LabanmeshError
from common.vocabulary import Vocabulary, require_teachable

if TYPE_CHECKING:
    from common.config import Scene
    from common.inbox import Presence
    from common.link import Link
    from hub.teaching.teaching_client import TeachingClient
    from hub.teaching.terminal import Terminal

LOOK_S, PICTURES_S = 0.2, 6.0
CAMERAS_S = 20.0
"""So long the lesson waits for a first camera; for the others PICTURES_S."""


class BeginOption(StrEnum):
    """With what the takes of a movement begin."""

    STILL = "still"
    CLAP = "clap"
    KEY = "key"
    NOW = "now"


class LearnWhen(StrEnum):
    """When observers learn from corrections."""

    NOW = "now"
    LATER = "later"


@dataclass(frozen=True, slots=True)
class TeachOptions:
    """As typed on the command line."""

    scene: Annotated[Path, typer.Argument(help="The scene file; its observers run, wherever they are.")]
    labels: Annotated[
        list[str] | None, typer.Argument(help="The movements: lower case letters, digits, underscores; at least two.")
    ] = None
    takes: Annotated[int, typer.Option(min=2, max=100, help="How often each movement is recorded.")] = 5
    background_minutes: Annotated[
        float,
        typer.Option(min=0, max=600, help="Minutes of ordinary life, from which observers learn what is no movement."),
    ] = 2.0
    person: Annotated[
        str,
        typer.Option(help="Who performs; by default someone, and with --was the only person who was taught."),
    ] = ""
    add: Annotated[bool, typer.Option("--add", help="Keep the movements that were taught before.")] = False
    seconds: Annotated[
        float | None,
        typer.Option(min=0.5, max=600, help="Length of each take; by default until the person stands still."),
    ] = None
    countdown: Annotated[int, typer.Option(min=0, max=10, help="Seconds before each take.")] = 3
    test: Annotated[bool, typer.Option("--test/--no-test", help="At the end do each movement once more.")] = True
    alarm_minutes: Annotated[
        float,
        typer.Option(min=0, max=600, help="And then so many minutes of anything else: verdicts are false alarms."),
    ] = 0.5
    begin: Annotated[
        BeginOption,
        typer.Option(help="What begins a movement's takes: you stand still, clap once, or press a key."),
    ] = BeginOption.STILL
    beep: Annotated[bool, typer.Option("--beep/--no-beep", help="Beep while it counts down.")] = True
    up: Annotated[
        bool, typer.Option("--up", help="If nothing runs yet, run the scene here too, and show it after the lesson.")
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
        LearnWhen | None, typer.Option(help="With --was: learn now, the default, or later; alone: learn corrections.")
    ] = None


@takes_options
def teach(options: TeachOptions) -> None:
    """Teach all observers of a scene some movements: it counts down, you perform, they learn and go on.

    Each observer records its own tracks of the same takes, and learns on its own machine; then all change their
    vocabulary together, and the fusion service follows. Stand still before and after each movement. The takes of a
    movement begin when you stand still before a camera, so that no keyboard is needed. Keys: r repeats a take, d drops
    it, s skips something else. Ctrl-C ends it; the same command goes on where it stopped.

    Example: labanmesh teach scene.toml wave point clap

    Example: labanmesh teach scene.toml wave point --up --begin clap

    Example: labanmesh teach scene.toml nod --add --takes 8

    Example: labanmesh teach scene.toml --was last nothing --was 20:14:03 wave
    """
    if options.was or options.learn is not None:
        from hub.teaching.memory_commands import correct_verdicts

        learn_now = options.learn is not LearnWhen.LATER
        correct_verdicts(options.scene, options.was or [], options.labels or [], options.person, learn_now=learn_now)
        return
    from common.config import read_scene
    from common.lifecycle import stop_on_signals
    from common.link import Link
    from hub.teaching.teaching_client import find_observers

    config = read_scene(options.scene)
    _require_teachable(config, options, options.labels or [])
    with ExitStack() as here:
        with stop_on_signals() as stop, Link.open(config.mesh, "hub", scene=config.scene, stop=stop) as link:
            presence = find_observers(config, link, stop)
            log = _started_here(options, config, presence, stop, here)
            present = _present(config, options.scene, presence)
            _lesson(options, config, link, present, stop)
        if log is None:
            print("see it: labanmesh watch", options.scene)
            return
        from hub.watch import watch

        print(f"the scene runs until Ctrl-C ends it (its log: {log}); later: labanmesh up {options.scene}", flush=True)
        watch(options.scene)


def _lesson(
    options: TeachOptions, config: "Scene", link: "Link", present: Sequence[str], stop: threading.Event
) -> None:
    from common.teaching_messages import SOMEONE
    from hub.session import SceneListener
    from hub.teaching.lesson import Lesson, LessonPlan
    from hub.teaching.teaching_client import TeachingClient
    from hub.teaching.terminal import Terminal, single_keys

    plan = LessonPlan(
        options.labels or [], secrets.token_hex(8), options.person or SOMEONE, options.takes,
        options.background_minutes * 60, options.seconds, options.countdown, options.add, options.test,
        options.alarm_minutes * 60, options.begin.value,
    )  # fmt: skip
    client = TeachingClient(link, config.keys)
    with SceneListener(config, link, lambda _: None) as listener, single_keys() as keyboard:
        if options.begin is BeginOption.KEY and not keyboard:
            raise BadInput("--begin key: there is no keyboard here; take still, clap or now")
        interface = Terminal(stop, listener, keyboard, options.beep)
        observers = _teachable(client, plan.teacher, present, interface, options.scene)
        Lesson(plan, interface, client.ask, observers).run()


def _started_here(
    options: TeachOptions, config: "Scene", presence: "Presence", stop: threading.Event, here: ExitStack
) -> Path | None:
    """Start the scene in `here` if nothing of it runs and the person wants it; the path of its log, None if not."""
    from hub.teaching.scene_here import scene_here
    from hub.teaching.terminal import agrees, wait

    if presence.alive or config.mesh.mode != "machine":
        return None
    if not (options.up or agrees(f"no observer of {config.scene} runs. Start them here, for the lesson?", stop)):
        return None
    print(f"starting {config.scene}: {', '.join(config.roster)}", flush=True)
    return here.enter_context(
        scene_here(options.scene, lambda: len(presence.alive) >= len(config.roster), lambda s: wait(s, stop))
    )


def _require_teachable(scene: "Scene", options: TeachOptions, labels: Sequence[str]) -> None:
    from common.teaching_messages import require_person

    if not labels:
        raise BadInput(
            f"teach {options.scene}: name the movements, e.g. labanmesh teach {options.scene} wave point clap"
        )
    require_teachable(labels)
    require_person(options.person)
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


def _present(scene: "Scene", file: Path, presence: "Presence") -> list[str]:
    """The observers of the scene file that run; raises LabanmeshError without any."""
    from hub.teaching.teaching_client import names_of

    present = names_of(presence, scene)
    if not present:
        raise LabanmeshError(f"no observer of {scene.scene} runs; start them: labanmesh up {file} (or teach with --up)")
    for name in scene.roster:
        if name not in present:
            print(f"{name}: does not run; the others are taught without it", flush=True)
    return present


def _teachable(
    client: "TeachingClient", teacher: str, present: Sequence[str], interface: "Terminal", file: Path
) -> list[str]:
    """The observers that answer; raises LabanmeshError if none does, or none has pictures."""
    from common.teaching_messages import TeachRequest
    from hub.teaching.wording import NO_RIGHT

    status = TeachRequest(command="status", teacher=teacher)
    answers, begun_s, waits = client.ask(status, present), interface.now_s(), False
    # A scene that has just been started has no pictures yet.
    while not all(reply.pictures for reply in answers.replies.values()):
        waited_s = interface.now_s() - begun_s
        if waited_s >= (PICTURES_S if any(reply.pictures for reply in answers.replies.values()) else CAMERAS_S):
            break
        if waited_s >= PICTURES_S and not waits:
            interface.say("waiting for the cameras ...")
            waits = True
        interface.pause(LOOK_S)
        answers = client.ask(status, present)
    if not answers.replies:
        raise LabanmeshError(NO_RIGHT)
    if not any(reply.pictures for reply in answers.replies.values()):
        raise LabanmeshError(
            f"no pictures from {', '.join(answers.replies)}: are the cameras plugged in and switched on? "
            f"labanmesh doctor {file} says why; without a webcam let the source be a film or a phone: "
            "docs/guide/cameras.md"
        )
    for name in answers.silent:
        interface.say(f"{name}: does not answer a request to teach; the others are taught without it")
    return list(answers.replies)
