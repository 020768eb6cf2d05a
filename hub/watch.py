"""The verb `labanmesh watch`: a scene as a live picture, as plain lines, or as lines of JSON."""

import json
import sys
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Annotated

import typer
from rich.console import Console
from rich.live import Live

from common import SECOND_NS
from common.command_options import ForSeconds
from common.config import Scene, read_scene
from common.fall_messages import FallMessage
from common.lifecycle import stop_on_signals
from common.link import Link
from common.messages import JudgementMessage, VerdictMessage
from common.notify import Notifier
from hub.anticipation import NEVER, Anticipation, EarlyWord
from hub.scene_state import SceneState
from hub.session import SceneUpdate, listen
from hub.terminal import render
from hub.wording import clock_time, early_line, fall_line, judgement_line, label_words, score_words, verdict_line

REDRAW_S = 0.1
LINE_EVERY_S = 1.0
NOTICE_AFTER_S = 1.0
"""Without a judgement for this long after the start, watch says what is missing."""
BEGIN_FRAME, END_FRAME = "\x1b[?2026h", "\x1b[?2026l"
"""DEC mode 2026: what is written between the two appears at once. Terminals without it ignore them."""


def watch(
    scene: Annotated[Path, typer.Argument(help="The scene file, as given to observe and fuse.")],
    as_json: Annotated[bool, typer.Option("--json", help="Each judgement and verdict as a line of JSON.")] = False,
    for_s: ForSeconds = None,
) -> None:
    """Live view of a scene: each observer's posterior and weight, the fused posterior, and the verdicts.

    On a terminal it is a picture, elsewhere plain lines: each verdict, each revision of one, and one judgement a
    second, which says why a movement has no verdict yet. Movements more probable than hub.certainty are named before
    they are decided. Ctrl-C ends it.

    Example: labanmesh watch scene.toml

    Example: labanmesh watch scene.toml --json --for 60 | jq -c 'select(.kind == "verdict") | .label'
    """
    config = read_scene(scene)
    console, notice = Console(), StartNotice(config, scene)
    with stop_on_signals(for_s) as stop, Link.open(config.mesh, "hub", scene=config.scene, stop=stop) as link:
        updates = _supervised(listen(config, link, lambda: not stop.is_set()))
        if as_json:
            show_json(notice.to_stderr(updates), config.hub.certainty)
        elif console.is_terminal:
            show_live(updates, console, config.hub.certainty, notice)
        else:
            show_lines(notice.to_stderr(updates), config.hub.certainty)


@dataclass(slots=True)
class StartNotice:
    """Says what is missing while neither a judgement nor a stage of the watch for falls has been received.

    began_ns: the time of the first update.
    """

    scene: Scene
    file: Path
    began_ns: int = field(default=0, init=False)

    def text(self, state: SceneState) -> str:
        """One line; "" while there is nothing to say."""
        self.began_ns = self.began_ns or state.now_ns
        is_heard = state.judgement is not None or state.fall is not None
        if is_heard or state.now_ns - self.began_ns < NOTICE_AFTER_S * SECOND_NS:
            return ""
        where = f"scene {self.scene.scene} at {self.scene.mesh.endpoint}"
        if state.is_empty:
            return f"received nothing from {where}. Start the scene with: labanmesh up {self.file}"
        if not state.fusion_status:
            return f"received no judgement from {where}. Start fusion with: labanmesh fuse {self.file}"
        missing = [name for name in self.scene.roster if name not in state.observer_status]
        if missing:
            observe = f"labanmesh observe {self.file} {missing[0]}"
            return f"fusion runs in {where}, and no observer that judges. Start {missing[0]} with: {observe}"
        return f"no observer of {where} has learned a movement. Teach them with: labanmesh teach {self.file} MOVEMENT"

    def to_stderr(self, updates: Iterable[SceneUpdate]) -> Iterator[SceneUpdate]:
        """The same updates; the notice is printed once to stderr."""
        printed = False
        for update in updates:
            if not printed and (text := self.text(update.state)):
                printed = True
                print(text, file=sys.stderr, flush=True)
            yield update


def show_live(
    updates: Iterable[SceneUpdate], console: Console, certainty: float = NEVER, notice: StartNotice | None = None
) -> None:
    """Redraw the picture ten times a second on the alternate screen; at the end print the verdicts as plain lines.

    Each picture has the terminal's size at that moment and appears as a whole.
    """
    state: SceneState | None = None
    drawn_ns = 0
    anticipation = Anticipation(certainty)
    try:
        with Live(console=console, screen=True, auto_refresh=False) as live:
            for update in updates:
                state = update.state
                _early_words(anticipation, update)
                if state.now_ns - drawn_ns >= REDRAW_S * SECOND_NS or state.now_ns < drawn_ns:
                    drawn_ns = state.now_ns
                    text = notice.text(state) if notice else ""
                    with _one_frame(console):
                        live.update(render(state, *console.size, anticipation.open, text), refresh=True)
    finally:
        for verdict in reversed(state.verdicts if state else ()):
            console.out(verdict_line(verdict), highlight=False)


def show_lines(updates: Iterable[SceneUpdate], certainty: float = NEVER) -> None:
    """One line for each verdict, each revision and each score, each early word and its end, each stage of a fall, and
    for one judgement a second."""
    shown: dict[str, str] = {}
    shown_ns, scored = 0, ""
    anticipation = Anticipation(certainty)
    for update in updates:
        for word in _early_words(anticipation, update):
            print(early_line(word), flush=True)
        if isinstance(update.message, FallMessage):
            print(fall_line(update.message), flush=True)
        state = update.state
        match update.message:
            case VerdictMessage(id=verdict_id, label=label) as verdict if shown.get(verdict_id) != label:
                print(verdict_line(verdict), flush=True)
                shown[verdict_id] = label
                scored = verdict_id if score_words(verdict) else scored
            case VerdictMessage(id=verdict_id) as verdict if verdict_id != scored and score_words(verdict):
                ended = f"{label_words(verdict)} ended, {score_words(verdict)}"
                print(clock_time(verdict.began_ns), "score", ended, sep="  ", flush=True)
                scored = verdict_id
        due = abs(state.now_ns - shown_ns) >= LINE_EVERY_S * SECOND_NS
        if state.judgement and state.silence_s < LINE_EVERY_S and due:
            shown_ns = state.now_ns
            for judgement in state.people or [state.judgement]:
                print(judgement_line(judgement), flush=True)


def show_json(updates: Iterable[SceneUpdate], certainty: float = NEVER) -> None:
    """Print each judgement and verdict as one line of JSON: `kind`, then the fields of the wire.

    An early word is a line of the kind `early`, its end one of the kind `confirmed`, `corrected` or `withdrawn`. The
    stage of the watch for falls is one of the kind `fall` when it changes.
    """
    anticipation = Anticipation(certainty)
    for update in updates:
        for word in _early_words(anticipation, update):
            fields = asdict(word)
            print(json.dumps({"kind": fields.pop("stage"), **fields}), flush=True)
        if isinstance(update.message, FallMessage):
            print(json.dumps({"kind": "fall", **json.loads(update.message.model_dump_json())}), flush=True)
        if isinstance(update.message, JudgementMessage):
            kind = "verdict" if isinstance(update.message, VerdictMessage) else "judgement"
            # pydantic writes NaN as null; json would write NaN, which other languages cannot read.
            fields = json.loads(update.message.model_dump_json())
            print(json.dumps({"kind": kind, **fields}), flush=True)


def _early_words(anticipation: Anticipation, update: SceneUpdate) -> list[EarlyWord]:
    """The early words of one update; a judgement that only answers a query may be long past and gives none."""
    now_s, message = update.state.now_ns / SECOND_NS, update.message
    if isinstance(message, VerdictMessage) or (isinstance(message, JudgementMessage) and not update.state.silent):
        return anticipation.update(message, now_s)
    return anticipation.expire(now_s)


@contextmanager
def _one_frame(console: Console) -> Iterator[None]:
    """What is written inside appears at once, so that a redraw does not flicker."""
    if not console.is_terminal or console.legacy_windows:
        yield
        return
    console.file.write(BEGIN_FRAME)
    try:
        yield
    finally:
        console.file.write(END_FRAME)
        console.file.flush()


def _supervised(updates: Iterator[SceneUpdate]) -> Iterator[SceneUpdate]:
    with Notifier.from_environment() as supervisor:
        for update in updates:
            if update.message is not None:
                supervisor.alive()
            yield update
