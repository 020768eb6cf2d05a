"""The command line: it imports the package of a verb only when the verb is called, so that `--help` is fast."""
# ruff: noqa: E402 - Ctrl-C has to be handled before the imports that take a moment

import atexit
import importlib
import importlib.util
import os
import signal
import sys

IS_PROGRAM = os.path.basename(sys.argv[0]).startswith("labanmesh")  # noqa: PTH119 - pathlib would slow down --help
"""Whether this process is the command, not a program of others that imports this module."""
TAKES_CTRL_C = IS_PROGRAM and signal.getsignal(signal.SIGINT) is signal.default_int_handler  # not ignored
if TAKES_CTRL_C:
    # Until a verb runs nothing has to be cleaned up.
    signal.signal(signal.SIGINT, lambda *_: os._exit(130))

from collections.abc import Callable, Sequence
from contextlib import nullcontext, suppress
from dataclasses import dataclass
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    import typer

__version__ = "0.1.0"
PACKAGES = ("common", "observer", "fusion", "hub", "studies", "deploy")
"""Our top-level packages, which lie beside this file."""


@dataclass(frozen=True, slots=True)
class Verb:
    """The function behind a verb, and its purpose in one line."""

    module: str
    function: str
    purpose: str

    def load(self) -> Callable[..., object]:
        """Import the function's module."""
        function: Callable[..., object] = getattr(importlib.import_module(self.module), self.function)
        return function


VERBS = {
    "demo": Verb("studies.demo", "demo", "run the whole system on this machine with the data in the package"),
    "init": Verb("deploy.first_scene.commands", "init", "write a commented scene file for the cameras of this machine"),
    "up": Verb("deploy.commands", "up", "start and supervise all processes of a scene file"),
    "teach": Verb("hub.teaching.commands", "teach", "teach all observers of a running scene your own movements"),
    "doctor": Verb("deploy.doctor.commands", "doctor", "find what is wrong with the machine, the scene and the mesh"),
    "watch": Verb("hub.watch", "watch", "show posteriors, weights and verdicts live in the terminal"),
    "dashboard": Verb("hub.dashboard.commands", "dashboard", "show a scene live in the browser"),
    "count": Verb("hub.counting.commands", "count", "count the repetitions of a movement live, with a target"),
    "history": Verb("hub.history.commands", "history", "list what happened in a scene, also as CSV or JSON"),
    "notify": Verb("hub.notify.notifying", "notify", "list whom a scene tells of movements and falls; send a test"),
    "hub": Verb("hub.mqtt.commands", "hub", "pass scenes on: to Home Assistant, to notifications, to a file"),
    "capture": Verb("hub.capture", "capture", "write all messages of a scene into a capture file"),
    "replay": Verb("studies.replay.commands", "replay", "fuse a capture again, or play it back onto a mesh"),
    "camera": Verb("observer.camera.commands", "camera", "look through a camera, calibrate it, record with several"),
    "phone": Verb("hub.phone.commands", "phone", "let a phone be the camera of an observer: only tracks leave it"),
    "import": Verb("observer.motion.commands", "import_recordings", "convert other recordings to a motion archive"),
    "learn": Verb("observer.learning.commands", "learn", "learn an observer's model for its view from recordings"),
    "forget": Verb("hub.teaching.memory_commands", "forget", "forget a person or a movement everywhere in a scene"),
    "score": Verb("studies.scoring.commands", "score", "score performances against takes that show how it is done"),
    "evaluate": Verb("studies.commands", "evaluate", "measure accuracy, earliness and calibration on a motion archive"),
    "observe": Verb("observer.commands", "observe", "run one observer: it publishes its posterior over the movements"),
    "fuse": Verb("fusion.commands", "fuse", "run the fusion service: it pools posteriors and publishes verdicts"),
    "router": Verb("deploy.security.routing", "router", "run a Zenoh router for a mesh of several machines"),
    "secure": Verb("deploy.security.commands", "secure", "issue certificates and access rules for machines"),
    "completion": Verb("deploy.completion.commands", "completion", "print a script by which Tab completes commands"),
    "new": Verb("deploy.new_package.commands", "new", "write a package of your own: observer, hub or fusion rule"),
}
HEADINGS = {
    "demo": "to begin",
    "watch": "what happens in a scene",
    "camera": "cameras, recordings, models",
    "observe": "on several machines",
    "completion": "about the command",
}
"""Above the verbs of one kind in `labanmesh --help`, by the first of them."""

OTHER_FORMS = {
    ("doctor", "--ready"): Verb("deploy.doctor.ready", "ready", "whether a process does its work, for containers"),
    ("evaluate", "--paper"): Verb("studies.commands", "paper", "the paper's experiments beside the paper's tables"),
    ("evaluate", "--effort"): Verb("studies.effort", "effort", "Effort, on actions that were not learned"),
    ("forget", "--labels"): Verb("observer.learning.commands", "forget", "remove movements from a model"),
    ("teach", "--film"): Verb("observer.teaching.commands", "teach_from_films", "teach an observer from films"),
}
"""Verbs that an option turns into another command."""

RENAMED = {
    **{verb: f"camera {verb}" for verb in ("look", "calibrate", "place", "record")},
    "paper": "evaluate --paper",
    "effort": "evaluate --effort",
    "healthcheck": "doctor --ready",
}
"""Verbs that have moved. Their old names answer for one release."""

ERROR_LINE_LIMIT = 2000
INTERRUPTED = 130


def main(arguments: Sequence[str] | None = None) -> int:
    """Run one verb; returns the exit status: 0, 1 for a failure at run time, 2 for bad input, 130 for Ctrl-C.

    arguments: by default those of the process, which then ends here if it has used Zenoh.
    """
    status = _status_of(list(sys.argv[1:] if arguments is None else arguments))
    if arguments is None and ("zenoh" in sys.modules or status == INTERRUPTED):
        end_process(status)
    return status


def end_process(status: int) -> None:
    """End without the interpreter's own end, which waits for every thread.

    Zenoh's threads let go of callbacks some time after their session was closed. If the interpreter is being torn down
    at that moment, the C library aborts the process ("exception not rethrown", status -6).
    """
    atexit._run_exitfuncs()
    for stream in (sys.stdout, sys.stderr):
        with suppress(OSError, ValueError):
            stream.flush()
    os._exit(status)


def _status_of(words: Sequence[str]) -> int:
    """What `main` returns."""
    shadow = shadowed()
    if shadow:
        print(f"labanmesh: {shadow}", file=sys.stderr)
        return 2
    from common.errors import LabanmeshError, machine_fault, with_scene_file

    if IS_PROGRAM and (sys.stdout.isatty() or sys.stderr.isatty()):
        from common.terminal import wrap_on_terminals

        wrap_on_terminals()

    try:
        status = _dispatch(words)
        # Flushed here, because a closed pipe could no longer be handled at the interpreter's exit.
        sys.stdout.flush()
        return status
    except LabanmeshError as error:
        # A value that is quoted may be of any length.
        print(f"labanmesh: {with_scene_file(str(error), words)}"[:ERROR_LINE_LIMIT], file=sys.stderr)
        return error.exit_status
    except KeyboardInterrupt:
        return INTERRUPTED
    except BrokenPipeError:
        # The reader of our output has closed it.
        _discard_output()
        return 0
    except BaseException as error:
        if not (fault := machine_fault(error)):
            raise
        with suppress(OSError):
            _discard_output()
        print(f"labanmesh: {fault}", file=sys.stderr)
        return 1


def _discard_output() -> None:
    """Send buffered output to /dev/null, which keeps the interpreter from complaining at exit."""
    os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())


def shadowed() -> str:
    """One line if another folder or module hides one of our packages, as in `python -m labanmesh`; "" if none does."""
    home = os.path.dirname(os.path.realpath(__file__))  # noqa: PTH120 - importing pathlib would slow down --help
    for name in PACKAGES:
        spec = importlib.util.find_spec(name)
        if spec is None:
            continue
        place = os.path.realpath(next(iter(spec.submodule_search_locations or ()), spec.origin or ""))
        if os.path.dirname(place) != home or not spec.submodule_search_locations:  # noqa: PTH120
            return (
                f"{place} hides the package {name!r} of labanmesh; run the command `labanmesh` or "
                "`python -P -m labanmesh`, or rename it, or remove its folder from PYTHONPATH"
            )
    return ""


def _dispatch(words: Sequence[str]) -> int:
    if not words or words[0] in ("--help", "-h", "help"):
        print(overview())
        return 0
    if words[0] in ("--version", "-V"):
        print(f"labanmesh {__version__}")
        return 0
    if words[0] in RENAMED:
        replacement = RENAMED[words[0]]
        print(
            f"labanmesh: {words[0]} is now `labanmesh {replacement}`; the old name goes with the next release",
            file=sys.stderr,
        )
        words = [*replacement.split(), *words[1:]]
    if words[0] not in VERBS and words[0] not in _installed_verbs():
        from common.errors import BadInput
        from common.text import nearest

        raise BadInput(f"{words[0]!r}: unknown verb; {nearest(words[0], (*VERBS, *_installed_verbs()))}")
    try:
        return _run(words[0], words[1:])
    except ImportError as error:
        from common.errors import LabanmeshError
        from common.missing_library import missing_library

        if fault := missing_library(error):
            raise LabanmeshError(f"{words[0]}: {fault}") from None
        raise


def overview() -> str:
    """The text of `labanmesh --help`, made without importing the package of any verb."""
    installed = _installed_verbs()
    headings = HEADINGS | dict.fromkeys([*installed][:1], "of other packages")
    width, lines = max(map(len, VERBS | installed)), []
    for name, verb in (VERBS | installed).items():
        lines += [f"\n{headings[name]}:"] if name in headings else []
        lines.append(f"  {name:<{width}}  {verb.purpose}")
    head = "labanmesh: several cameras recognise one person's movement, over Eclipse Zenoh\n\nusage: labanmesh VERB ..."
    begin = "begin with `labanmesh demo`, which needs no camera, or with `labanmesh init`, which finds yours."
    return "\n".join([head, *lines, "", begin, "labanmesh VERB --help explains a verb and shows an example."])


def _installed_verbs() -> dict[str, Verb]:
    """The verbs of installed packages, from their entry points (docs/design/extend.md)."""
    from common.plugins import plugins

    entries = {name: each for name, each in plugins("verbs").items() if name not in VERBS}
    return {
        name: Verb(each.module, each.attr, f"of the package {each.dist.name}" if each.dist else "of another package")
        for name, each in entries.items()
    }


def app_of(verb: str, words: Sequence[str] = ()) -> "typer.Typer":
    """The command line of a verb, followed by `words`: its function, or the Typer application of its sub-verbs."""
    import typer

    from common.text import with_whole_examples

    forms = [OTHER_FORMS[key] for word in words if (key := (verb, word.partition("=")[0])) in OTHER_FORMS]
    loaded = [*forms, VERBS.get(verb) or _installed_verbs()[verb]][0].load()
    if isinstance(loaded, typer.Typer):
        for each in loaded.registered_commands:
            # Typer would cut it off where the line ends.
            text = each.callback.__doc__ or ""
            each.short_help, each.help = text.partition("\n")[0], with_whole_examples(text)
        return loaded
    # Without markup Typer breaks help between words and cuts no option short.
    app = typer.Typer(add_completion=False, pretty_exceptions_enable=False, rich_markup_mode=None)
    app.command(verb, help=with_whole_examples(loaded.__doc__))(loaded)
    return app


def _run(verb: str, words: Sequence[str]) -> int:
    # Before NumPy is loaded: our products of matrices are small, and threads would fight over them, also with those of
    # other processes, for the cores.
    for library in ("OMP", "OPENBLAS", "MKL"):
        os.environ.setdefault(f"{library}_NUM_THREADS", "1")
    from common.command_options import call_command
    from common.files import require_open_files
    from common.interrupt import interruptible

    app = app_of(verb, words)
    require_open_files()
    with interruptible() if TAKES_CTRL_C else nullcontext():
        return call_command(app, words, f"labanmesh {verb}", verb, lambda option: _of_another_form(verb, words, option))


def _of_another_form(verb: str, words: Sequence[str], option: str) -> str:
    """`--process: only with --ready`, or `not with`, if another form of the verb has the option; else ""."""
    from typer.main import get_command

    forms = [form for of_verb, form in OTHER_FORMS if of_verb == verb]
    chosen = [form for form in forms if form in words]
    for form in [""] if chosen else forms:
        if option in (each for parameter in get_command(app_of(verb, [form])).params for each in parameter.opts):
            return f"{option}: {f'not with {chosen[0]}' if chosen else f'only with {form}'}"
    return ""


if __name__ == "__main__":
    sys.exit(main())
