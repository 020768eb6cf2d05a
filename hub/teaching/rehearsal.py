"""`labanmesh teach --rehearse`: a whole lesson without a camera, acted by a synthetic performer before virtual ones.

1. The performer and its cameras are a process of their own (studies/performer/cameras.py). The observers see network
   cameras, and track, learn and judge as always.
2. The performer learns of the lesson what a person does: what the screen shows.
3. After the lesson it performs what it taught in a random order, and the verdicts are counted.
"""

import json
import random
import signal
import subprocess
import sys
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from importlib.util import find_spec
from pathlib import Path
from threading import Event

from common.errors import BadInput, LabanmeshError
from common.text import plural
from hub.session import SceneListener
from hub.teaching.interface import Step
from hub.teaching.learning import next_verdict
from hub.teaching.terminal import Terminal
from hub.teaching.wording import outcome_line

REHEARSAL_FOLDER = Path("labanmesh-rehearsal")
REHEARSAL_LABELS = ("byebye", "maestro", "stretch")
"""Three movements of the performer that its cameras tell apart well."""
LENGTHS = {"takes": 4, "background_s": 45.0, "alarm_s": 12.0, "countdown": 1}
"""Of a lesson that a person watches to its end: two and a half minutes for REHEARSAL_LABELS. Ordinary life is long
enough for three of each kind."""
REHEARSED, REHEARSAL_REST_S = 6, 4.0
"""Performed after the lesson, in half a minute, and the seconds from a verdict to the next: a movement goes on for 2 s
after it, and rest tells where it ends."""
REHEARSAL_END_S = 2.0
TITLE = (
    "a rehearsal: a SYNTHETIC performer (a kinematic model, no recorded person) stands before two virtual cameras and "
    "does what this screen asks, as you would; all else is real. About three minutes; Ctrl-C ends it"
)
AFTER_REHEARSAL = (
    "the same again, without a lesson: labanmesh up {file}, and labanmesh watch {file} in another terminal\n"
    "with your own camera: labanmesh init, and then: labanmesh teach scene.toml wave point clap --up"
)


@dataclass(frozen=True, slots=True)
class Rehearsal:
    """A performer before its cameras.

    file: the scene file. labels: what it teaches. environment: variables by which the observers use these cameras.
    """

    file: Path
    labels: Sequence[str]
    environment: dict[str, str]
    process: "subprocess.Popen[str]"

    def ask(self, request: str) -> None:
        """Ask the performer for `act LABEL`, `live` or `rest`; raises LabanmeshError if it has ended."""
        try:
            print(request, file=self.process.stdin, flush=True)
        except OSError:
            raise LabanmeshError("the performer has ended; start the rehearsal again") from None


class RehearsalTerminal(Terminal):
    """A terminal that also tells the performer what is shown."""

    def __init__(self, rehearsal: Rehearsal, stop: Event, listener: SceneListener, keyboard: bool) -> None:
        super().__init__(stop, listener, keyboard)
        self._rehearsal, self._asked = rehearsal, ""

    def show(self, step: Step) -> None:
        """Show a step, and ask the performer for what it wants."""
        super().show(step)
        asks = {"now": f"act {step.label}", "other": "live", "alarms": "live"}.get(step.kind, "rest")
        if step.kind == "now" or asks != self._asked:
            self._rehearsal.ask(asks)
            self._asked = asks


@contextmanager
def rehearsed(labels: Sequence[str]) -> Iterator[Rehearsal]:
    """A performer that acts these movements, by default REHEARSAL_LABELS, while the context lasts.

    Raises BadInput for a movement that it does not know, and where the folder cannot be written.
    """
    if find_spec("cv2") is None:
        # The command line says which extra brings it.
        raise ModuleNotFoundError(name="cv2")
    labels = labels or REHEARSAL_LABELS
    # A session of its own: Ctrl-C is for the lesson. It ends when its input does.
    process = subprocess.Popen(  # noqa: S603 - the command line is ours
        [sys.executable, "-P", "-m", "studies.performer.cameras", str(REHEARSAL_FOLDER), *labels],
        stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, start_new_session=True,
    )  # fmt: skip
    try:
        line = process.stdout.readline() if process.stdout else ""
        if not line:
            faults = process.stderr.read().strip().splitlines() if process.stderr else []
            error = BadInput if process.wait() == BadInput.exit_status else LabanmeshError
            raise error(faults[-1] if faults else "the performer has ended; start the rehearsal again")
        print(TITLE, flush=True)
        answer = json.loads(line)
        sources = {f"LABANMESH_OBSERVERS_{name.upper()}_SOURCE": url for name, url in answer["cameras"].items()}
        yield Rehearsal(Path(answer["scene"]), labels, sources, process)
    finally:
        process.kill()
        process.communicate()


def show_recognition(acted: Rehearsal, interface: Terminal) -> None:
    """The performer does REHEARSED movements while `labanmesh watch` shows the scene; then the result is printed."""
    rounds = -(-REHEARSED // len(acted.labels))
    order = [label for _ in range(rounds) for label in random.sample(acted.labels, len(acted.labels))]
    command = [sys.executable, "-P", "-m", "labanmesh", "watch", str(acted.file)]
    acted.ask("rest")
    interface.say(f"now it does {plural(REHEARSED, 'movement')} in a random order, and labanmesh watch shows them")
    decided = []
    with subprocess.Popen(command) as view:  # noqa: S603 - it is ours
        try:
            for label in order[:REHEARSED]:
                interface.pause(REHEARSAL_REST_S)
                acted.ask(f"act {label}")
                decided.append((label, next_verdict(interface)))
        finally:
            view.send_signal(signal.SIGTERM)
            with suppress(subprocess.TimeoutExpired):
                view.wait(REHEARSAL_END_S)
    for label, verdict in decided:
        interface.say(outcome_line(label, verdict))
    right = sum(label == verdict for label, verdict in decided)
    interface.say(f"the performer did {plural(len(decided), 'movement')}; {right} recognised")
    interface.say(AFTER_REHEARSAL.format(file=acted.file))
