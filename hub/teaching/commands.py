"""The command `labanmesh teach`: own movements for all observers of a scene, without stopping anything."""

import secrets
import select
import sys
import threading
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from common.command_options import takes_options
from common.errors import BadInput, LabanmeshError
from common.vocabulary import Vocabulary

if TYPE_CHECKING:
    from common.config import Scene
    from common.link import Link
    from hub.session import SceneListener
    from hub.teaching.classroom import Classroom
    from hub.teaching.room import Action, Step

FIND_S = 3.0
"""Observers that run are found within milliseconds."""


@dataclass(frozen=True, slots=True)
class TeachOptions:
    """As typed on the command line."""

    scene: Annotated[Path, typer.Argument(help="The scene file; its observers run, wherever they are.")]
    labels: Annotated[
        list[str], typer.Argument(help="The movements: lower case letters, digits, underscores; at least two.")
    ]
    takes: Annotated[int, typer.Option(min=2, help="How often each movement is recorded.")] = 5
    background_minutes: Annotated[
        float, typer.Option(min=0, help="Minutes of ordinary life, from which observers learn what is no movement.")
    ] = 2.0
    person: Annotated[str, typer.Option(help="Who performs.")] = "someone"
    add: Annotated[bool, typer.Option("--add", help="Keep the movements that were taught before.")] = False
    seconds: Annotated[
        float | None, typer.Option(min=0.5, help="Length of each take; by default until the person stands still.")
    ] = None
    countdown: Annotated[int, typer.Option(min=0, max=10, help="Seconds before each take.")] = 3
    test: Annotated[bool, typer.Option("--test/--no-test", help="At the end do each movement once more.")] = True


@takes_options
def teach(options: TeachOptions) -> None:
    """Teach all observers of a running scene some movements: it counts down, you perform, they learn and go on.

    Each observer records its own tracks of the same takes, and learns on its own machine; then all change their
    vocabulary together, and the fusion service follows. Stand still before and after each movement. Keys: r repeats a
    take, d drops it. Ctrl-C ends it; the same command goes on where it stopped.

    Example: labanmesh teach scene.toml wave point clap

    Example: labanmesh teach scene.toml nod --add --takes 8
    """
    from common.config import read_scene
    from common.lifecycle import stop_on_signals
    from common.link import Link
    from hub.session import SceneListener
    from hub.teaching.classroom import Classroom
    from hub.teaching.lesson import Lesson, LessonPlan

    config = read_scene(options.scene)
    _require_teachable(config, options)
    plan = LessonPlan(
        options.labels, secrets.token_hex(8), options.person, options.takes, options.background_minutes * 60,
        options.seconds, options.countdown, options.add, options.test,
    )  # fmt: skip
    with stop_on_signals() as stop, Link.open(config.mesh, "hub", scene=config.scene) as link:
        classroom = Classroom(link, config.keys)
        present = _present(config, options.scene, link)
        with SceneListener(config, link, lambda _: None) as listener, _keyboard() as keyboard:
            room = Terminal(stop, listener, keyboard)
            observers = _teachable(classroom, plan.teacher, present, room)
            Lesson(plan, room, classroom.ask, observers).run()
    print("see it: labanmesh watch", options.scene)


def _require_teachable(scene: "Scene", options: TeachOptions) -> None:
    if not options.add:
        Vocabulary(tuple(options.labels))
    elif len(set(options.labels)) != len(options.labels):
        raise BadInput("a movement is named twice; name each once")
    if scene.vocabulary is not None:
        raise BadInput(
            f"{options.scene}: vocabulary names the movements, which can then not be taught; remove that line, the "
            "models bring theirs"
        )


def _present(scene: "Scene", file: Path, link: "Link") -> list[str]:
    """The observers of the scene file that run; raises LabanmeshError without any."""
    from common.keys import observer_of

    presence = link.presence(scene.keys.observer_alive(), map(scene.keys.observer_alive, scene.roster))
    presence.wait_for(len(scene.roster), FIND_S)
    names = {observer_of(key) for key in presence.alive}
    present = [name for name in scene.roster if name in names]
    for name in set(scene.roster) - names:
        print(f"{name}: does not run; the others are taught without it", flush=True)
    if not present:
        raise LabanmeshError(f"no observer of {scene.scene} runs; start them: labanmesh up {file}")
    return present


def _teachable(classroom: "Classroom", teacher: str, present: Sequence[str], room: "Terminal") -> list[str]:
    from common.teaching_messages import TeachRequest
    from hub.teaching.wording import NO_RIGHT

    answers = classroom.ask(TeachRequest(command="status", teacher=teacher), present)
    if not answers.replies:
        raise LabanmeshError(NO_RIGHT)
    for name in answers.silent:
        room.say(f"{name}: does not answer a request to teach; the others are taught without it")
    return list(answers.replies)


class Terminal:
    """The teacher's terminal: lines, one line that changes, and single keys where there is a keyboard."""

    def __init__(self, stop: threading.Event, listener: "SceneListener", keyboard: bool) -> None:
        self._stop, self._listener, self._keyboard = stop, listener, keyboard
        self._changing = sys.stdout.isatty()
        self._shown = ""

    def now_s(self) -> float:
        """Seconds of a monotonic clock."""
        return time.monotonic()

    def pause(self, seconds: float) -> None:
        """Wait; raises KeyboardInterrupt after Ctrl-C."""
        if self._stop.wait(seconds):
            self.say("ended; what was recorded is kept: the same command goes on where this one stops")
            raise KeyboardInterrupt

    def say(self, line: str) -> None:
        """A line of its own."""
        print(("\r\x1b[K" if self._changing else "") + line, flush=True)

    def show(self, step: "Step") -> None:
        """The line that changes; elsewhere than on a terminal only the signal to begin."""
        from hub.teaching.wording import step_line

        line = step_line(step)
        if line and self._changing:
            bell = "\a" if step.kind == "now" else ""
            print(f"\r\x1b[K\x1b[1m{line}{bell}\x1b[0m", end="", flush=True)
        elif step.kind == "now":
            print(line, flush=True)

    def between(self, step: "Step", seconds: float) -> "Action":
        """What the key pressed within so many seconds means."""
        from hub.teaching.room import GO, Action

        return {"r": Action("repeat"), "d": Action("drop")}.get(self._key(seconds), GO)

    def ready(self, step: "Step") -> "Action":
        """Whoever performs is away from the keyboard: the lesson goes on."""
        from hub.teaching.room import GO

        return GO

    def _key(self, seconds: float) -> str:
        """The key pressed within so many seconds; "" without one, or without a keyboard."""
        end_s = time.monotonic() + seconds
        while self._keyboard and (left_s := end_s - time.monotonic()) > 0:
            if select.select([sys.stdin], [], [], min(left_s, 0.1))[0]:
                return sys.stdin.read(1).lower()
            self.pause(0.0)
        if not self._keyboard:
            self.pause(seconds)
        return ""

    def fused_labels(self) -> Sequence[str]:
        """The movements that the fusion service judges now."""
        self._listener.check()
        return self._listener.state.labels

    def verdicts(self) -> Sequence[str]:
        """The labels of the verdicts since the last call; each movement has one."""
        from hub.teaching.verdicts import newly_decided

        return newly_decided(self._listener.verdicts)


@contextmanager
def _keyboard() -> Iterator[bool]:
    """Whether single keys can be read, which then need no Enter."""
    if not sys.stdin.isatty():
        yield False
        return
    import termios
    import tty

    before = termios.tcgetattr(sys.stdin)
    tty.setcbreak(sys.stdin)
    try:
        yield True
    finally:
        termios.tcsetattr(sys.stdin, termios.TCSADRAIN, before)
