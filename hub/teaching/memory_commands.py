"""`labanmesh teach --was`, `--earlier` and `labanmesh forget`: correct, restore and delete what observers remember."""

import secrets
import sys
import time
from collections.abc import Collection, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import Annotated

import typer

from common import SECOND_NS
from common.config import Scene, read_scene
from common.errors import BadInput, LabanmeshError
from common.lifecycle import stop_on_signals
from common.link import Link
from common.teaching_messages import TeachRequest, Unwanted, require_person
from common.vocabulary import LABEL, LABEL_RULE
from hub.history.history_file import forget_in_history, note_corrections
from hub.session import SceneListener
from hub.teaching.correcting import clock_offsets, correct, correction_of, fusion_ns, learn_corrections
from hub.teaching.forgetting import clip_keepers_of, list_earlier, restore, untouched_line
from hub.teaching.forgetting import forget as forget_everywhere
from hub.teaching.interface import LessonInterface
from hub.teaching.participants import Participants
from hub.teaching.teaching_client import TeachingClient, find_observers, names_of
from hub.teaching.terminal import Terminal
from hub.teaching.wording import NO_RIGHT

OBSERVERS_READY_S = 3.0
"""So long the last verdicts are waited for."""


@dataclass(frozen=True, slots=True)
class TaughtScene:
    """A running scene. missing: observers that do not run, or do not answer."""

    scene: Scene
    participants: Participants
    interface: LessonInterface
    listener: SceneListener
    missing: Collection[str]


@contextmanager
def _opened(file: Path) -> Iterator[TaughtScene]:
    scene, teacher = read_scene(file), secrets.token_hex(8)
    with stop_on_signals() as stop, Link.open(scene.mesh, "hub", scene=scene.scene, stop=stop) as link:
        present = names_of(find_observers(scene, link, stop), scene)
        if not present:
            raise LabanmeshError(f"no observer of {scene.scene} runs; start them: labanmesh up {file}")
        with SceneListener(scene, link) as listener:
            interface, ask = Terminal(stop, listener, keyboard=False), TeachingClient(link, scene.keys).ask
            replies = ask(TeachRequest(command="status", teacher=teacher), present).replies
            if not replies:
                raise LabanmeshError(NO_RIGHT)
            missing = [name for name in scene.roster if name not in replies]
            participants = Participants(teacher, interface, ask, list(replies), add=True)
            try:
                yield TaughtScene(scene, participants, interface, listener, missing)
            finally:
                ask(TeachRequest(command="leave", teacher=teacher), list(replies))


def correct_verdicts(file: Path, when: Sequence[str], labels: Sequence[str], person: str, *, learn_now: bool) -> None:
    """Each of `labels` is what somebody did at the moment of `when` in the same place; then all learn, or later.

    Without any, all learn what was corrected before. Raises BadInput, and LabanmeshError if nothing could be done.
    """
    if len(when) != len(labels):
        raise BadInput(
            f"--was {len(when)} times, and {len(labels)} labels: each --was WHEN is followed by what it was, e.g. "
            "--was last wave --was 20:14:03 nothing"
        )
    require_person(person)
    with _opened(file) as taught:
        for name in taught.missing:
            taught.interface.say(f"{name}: does not answer; the others go on")
        begun_s = taught.interface.now_s()
        while not taught.listener.ready and taught.interface.now_s() - begun_s < OBSERVERS_READY_S:
            taught.listener.check()
            taught.interface.pause(0.05)
        state = taught.listener.state
        now = datetime.fromtimestamp(fusion_ns(state, time.time_ns()) / SECOND_NS, UTC).astimezone()
        pairs = zip(when, labels, strict=True)
        corrections = [correction_of(moment, label, state.verdicts, now) for moment, label in pairs]
        observers = list(taught.participants.observers)
        if corrections:
            made = correct(taught.participants, corrections, clock_offsets(state), person)
            note_corrections(taught.scene, {each.id: each.label for each in corrections})
            observers = [name for name, count in made.items() if count]
        if learn_now:
            learn_corrections(taught.participants, observers)
        else:
            taught.interface.say(f"nothing is learned yet: labanmesh teach {file} --learn now")


def earlier_takes(file: Path, wanted: str = "") -> None:
    """List the takes that the observers have set aside, or make those with the id `wanted` the takes of now."""
    with _opened(file) as taught:
        if wanted:
            restore(taught.participants, wanted, str(file))
        else:
            list_earlier(taught.participants, str(file))


def forget(
    scene: Annotated[Path, typer.Argument(help="The scene file; its observers run, wherever they are.")],
    person: Annotated[str, typer.Option(help="All takes of this person.")] = "",
    label: Annotated[str, typer.Option(help="All takes of this movement; it is recognised no more.")] = "",
    everything: Annotated[bool, typer.Option("--all", help="All that teaching left, and the models.")] = False,
    clips: Annotated[bool, typer.Option("--clips", help="Also the observers' clips: of --label, else all.")] = False,
    yes: Annotated[bool, typer.Option("--yes", help="Do not ask whether that is meant.")] = False,
) -> None:
    """Make all observers of a running scene forget a person or a movement: takes, old models, what they remember now;
    then they learn anew without it. Or remove movements from one model file (MODEL --labels A,B -o MODEL).

    Example: labanmesh forget scene.toml --person anna

    Example: labanmesh forget sofa.model --labels wave -o sofa.model
    """
    if bool(person) + bool(label) + everything != 1:
        raise BadInput("what is to be forgotten? name one of --person NAME, --label LABEL, --all")
    require_person(person)
    if label and not LABEL.match(label):
        raise BadInput(f"--label {label[:64]!r}: {LABEL_RULE}")
    what = "everything that was taught" if everything else f"all takes {'by ' + person if person else 'of ' + label}"
    what += f" and all clips{f' of {label}' if label else ''}" if clips else ""
    if not yes:
        if not sys.stdin.isatty():
            raise BadInput(f"{what} cannot be brought back; add --yes")
        typer.confirm(f"forget {what}? It cannot be brought back", abort=True)
    with _opened(scene) as taught:
        try:
            forget_everywhere(taught.participants, Unwanted(person, label, everything), taught.missing, clips=clips)
        finally:
            taught.interface.say(untouched_line(clip_keepers_of(taught.scene), clips=clips))
        if line := forget_in_history(taught.scene, Unwanted(person, label, everything)):
            taught.interface.say(line)
