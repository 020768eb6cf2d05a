"""The verbs `labanmesh watch` and `labanmesh capture`: who listens, at the command line."""

import math
import signal
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Annotated

import typer
from rich.console import Console

from common.config import read_scene
from common.link import Link
from common.notify import Notifier
from hub.session import Heard, listen
from hub.views import show_json, show_lines, show_live


def watch(
    scene: Annotated[Path, typer.Argument(help="The scene file, as given to observe and fuse.")],
    json: Annotated[bool, typer.Option("--json", help="Each judgement and verdict as a line of JSON.")] = False,
    for_s: Annotated[
        float | None, typer.Option("--for", metavar="SECONDS", min=0, help="End by itself after so long.")
    ] = None,
) -> None:
    """Live view of a scene: every judge in its corner, what the referee makes of it, and the verdicts.

    On a terminal it is a picture, else plain lines: each verdict, and a judgement a second. Movements that are likelier
    than hub.certainty are named before they are decided. Ctrl-C ends it.

    Example: labanmesh watch scene.toml

    Example: labanmesh watch scene.toml --json --for 60 | jq -c 'select(.kind == "verdict") | .label'
    """
    named = read_scene(scene)
    end_s = math.inf if for_s is None else time.monotonic() + for_s
    console = Console()
    with _termination() as terminated, Link.open(named.mesh, "hub", scene=named.scene) as link:
        heard = _noted(listen(named, link, lambda: not terminated.is_set() and time.monotonic() < end_s))
        if json:
            show_json(heard, named.hub.certainty)
        elif console.is_terminal:
            show_live(heard, console, named.hub.certainty)
        else:
            show_lines(heard, named.hub.certainty)


def capture(
    scene: Annotated[Path, typer.Argument(help="The scene file, as given to observe and fuse.")],
    output: Annotated[Path, typer.Option("--output", "-o", help="The file to write (.mcap); a new one.")],
    for_s: Annotated[
        float | None, typer.Option("--for", metavar="SECONDS", min=0, help="End by itself after so long.")
    ] = None,
) -> None:
    """All that is said in a scene, with its times, into a file for `labanmesh replay`. Ctrl-C ends it.

    The file stays readable when this process is killed or the disk is full; an existing one is not overwritten.

    Example: labanmesh capture scene.toml -o monday.mcap --for 3600
    """
    from common.capture_file import CaptureWriter
    from common.lifecycle import stop_on_signals
    from hub.capture import capture as write_down

    named = read_scene(scene)
    text = scene.read_text(encoding="utf-8")
    end_s = math.inf if for_s is None else time.monotonic() + for_s
    with stop_on_signals() as stop, Link.open(named.mesh, "hub", scene=named.scene) as link:
        with CaptureWriter(output, named, text, time.time_ns()) as writer:
            account = write_down(named, link, writer, lambda: not stop.is_set() and time.monotonic() < end_s)
        print(f"{output}: {account}", flush=True)
        if not account.messages:
            print(f"nothing was heard at {named.mesh.endpoint}; does the scene run there?", flush=True)


def _noted(heard: Iterator[Heard]) -> Iterator[Heard]:
    """The same; whoever supervises the process learns that something is heard."""
    with Notifier.from_environment() as supervisor:
        for each in heard:
            if each.message is not None:
                supervisor.alive()
            yield each


@contextmanager
def _termination() -> Iterator[threading.Event]:
    """An event that SIGTERM sets, so that the terminal is left as it was found."""
    terminated = threading.Event()
    before = signal.signal(signal.SIGTERM, lambda *_: terminated.set())
    try:
        yield terminated
    finally:
        signal.signal(signal.SIGTERM, before)
