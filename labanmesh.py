"""The front door: the command line, which imports a room only when its verb is called."""

import importlib
import os
import sys
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

from common.errors import LabanmeshError

if TYPE_CHECKING:
    import typer

__version__ = "0.1.0"


@dataclass(frozen=True, slots=True)
class Verb:
    """Where a verb lives and what it is for."""

    module: str
    function: str
    purpose: str

    def load(self) -> Callable[..., object]:
        """Import the room of this verb, and nothing else."""
        loaded: Callable[..., object] = getattr(importlib.import_module(self.module), self.function)
        return loaded


VERBS = {
    "demo": Verb("studies.demo", "demo", "the whole system on this machine, on what the package carries"),
    "init": Verb("deploy.init", "init", "a commented scene file for the cameras of this machine"),
    "up": Verb("deploy.commands", "up", "all processes that a scene file names, supervised"),
    "observe": Verb("observer.commands", "observe", "one observer: its view becomes a judge on the mesh"),
    "fuse": Verb("fusion.commands", "fuse", "the referee: weighs the observers, publishes judgements and verdicts"),
    "doctor": Verb("deploy.doctor.commands", "doctor", "what is wrong here and on the mesh, and what to do"),
    "healthcheck": Verb("hub.healthcheck", "healthcheck", "whether a process does its work: for containers"),
    "secure": Verb("deploy.security.commands", "secure", "certificates and access rules for named machines"),
    "router": Verb("deploy.commands", "router", "a Zenoh router for a mesh of several machines"),
    "watch": Verb("hub.watch", "watch", "live view of beliefs, weights and verdicts in the terminal"),
    "capture": Verb("hub.capture", "capture", "all that is said in a scene -> a capture file"),
    "replay": Verb("studies.replay.commands", "replay", "a capture judged anew, or played back onto a mesh"),
    "hub": Verb("hub.mqtt.commands", "hub", "what homes get from a scene: Home Assistant through an MQTT broker"),
    "dashboard": Verb("hub.dashboard.commands", "dashboard", "the same as watch, as a page in the browser"),
    "import": Verb("observer.commands", "import_recordings", "recordings of others -> motion archive"),
    "calibrate": Verb(
        "observer.calibration.commands", "calibrate", "boards, known points, others' files -> camera files"
    ),
    "look": Verb("observer.preview.commands", "look", "one look at a source: what a tracker makes out in it"),
    "record": Verb("observer.recording.commands", "record", "several calibrated cameras -> motion archive"),
    "learn": Verb("observer.learning.commands", "learn", "motion archive -> one observer's model for its view"),
    "forget": Verb(
        "observer.learning.commands", "forget", "a model without some of its movements, nothing learned again"
    ),
    "paper": Verb("studies.commands", "paper", "the paper's three experiments, beside the paper's tables"),
    "evaluate": Verb("studies.commands", "evaluate", "accuracy, confusion, earliness and calibration on an archive"),
    "effort": Verb("studies.effort", "effort", "Effort told apart in actions that taught nothing of it"),
}

EXTRAS = {
    "cv2": "observer",
    "scipy": "observer",
    "matplotlib": "report",
    "mcap": "capture",
    "aiomqtt": "mqtt",
    **dict.fromkeys(("starlette", "uvicorn", "sse_starlette"), "dashboard"),
}
"""What a plain install has not, and the extra that brings it."""


def main(arguments: Sequence[str] | None = None) -> int:
    """Run one verb; returns the exit status: 0, 1 at run time, 2 for bad input, 130 on Ctrl-C."""
    try:
        status = _answer(list(sys.argv[1:] if arguments is None else arguments))
        # Here and not at the interpreter's exit, where a reader who has left could not be forgiven any more.
        sys.stdout.flush()
        return status
    except LabanmeshError as error:
        print(f"labanmesh: {error}", file=sys.stderr)
        return error.exit_status
    except KeyboardInterrupt:
        return 130
    except BrokenPipeError:
        # Whoever read our output has seen enough; silence the interpreter's own complaint at exit.
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return 0


def _answer(words: Sequence[str]) -> int:
    if not words or words[0] in ("--help", "-h", "help"):
        print(overview())
        return 0
    if words[0] in ("--version", "-V"):
        print(f"labanmesh {__version__}")
        return 0
    if words[0] not in VERBS:
        raise _unknown(words[0])
    try:
        return _run(words[0], words[1:])
    except ModuleNotFoundError as error:
        package = (error.name or "").partition(".")[0]
        if package not in EXTRAS:
            raise
        way_out = f"pip install 'labanmesh[{EXTRAS[package]}]'"
        raise LabanmeshError(f"{words[0]}: {package} is not installed on this machine; {way_out}") from None


def overview() -> str:
    """The text of `labanmesh --help`, made from the table of verbs without importing any room."""
    width = max(map(len, VERBS))
    lines = [f"  {name:<{width}}  {verb.purpose}" for name, verb in VERBS.items()]
    head = "labanmesh: several cameras judge one person's movement, over Eclipse Zenoh\n\nusage: labanmesh VERB ...\n"
    return "\n".join([head, *lines, "", "labanmesh VERB --help explains a verb and shows an example."])


def _unknown(verb: str) -> LabanmeshError:
    from common.errors import BadInput
    from common.text import nearest

    return BadInput(f"{verb!r}: unknown verb; {nearest(verb, VERBS)}")


def app_of(verb: str) -> "typer.Typer":
    """The command line of a verb: of its one function, or of its sub-verbs where the room made one itself."""
    import typer

    loaded = VERBS[verb].load()
    if isinstance(loaded, typer.Typer):
        return loaded
    app = typer.Typer(add_completion=False, pretty_exceptions_enable=False)
    app.command(verb)(loaded)
    return app


def _run(verb: str, words: Sequence[str]) -> int:
    import shlex

    import typer
    from typer.exceptions import TyperException

    from common.errors import BadInput

    try:
        status = typer.main.get_command(app_of(verb)).main(words, f"labanmesh {verb}", standalone_mode=False)
    except TyperException as error:
        text = " ".join(error.format_message().split()) if hasattr(error, "format_message") else str(error)
        # Typer names the parameter and the rule; the value stands in what was typed.
        typed = shlex.join([verb, *words]) if isinstance(error, typer.BadParameter) else verb
        raise BadInput(f"{typed}: {text.rstrip('.')}; see labanmesh {verb} --help") from None
    except typer.Abort:
        raise KeyboardInterrupt from None
    return status if isinstance(status, int) else 0


if __name__ == "__main__":
    sys.exit(main())
