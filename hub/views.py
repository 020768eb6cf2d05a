"""Three ways to show what is heard: a live picture, plain lines, lines of JSON. `certainty`: hub/anticipation.py."""

import json
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from dataclasses import asdict

from rich.console import Console
from rich.live import Live

from common.messages import JudgementMessage, VerdictMessage
from hub.anticipation import NEVER, Anticipation, Word
from hub.scene_state import SceneState
from hub.session import Heard
from hub.terminal import render
from hub.wording import judgement_line, verdict_line, word_line

REDRAW_S = 0.1
LINE_EVERY_S = 1.0
BEGIN_AT_ONCE, END_AT_ONCE = "\x1b[?2026h", "\x1b[?2026l"


def show_live(heard: Iterable[Heard], console: Console, certainty: float = NEVER) -> None:
    """Redraw the picture ten times a second on the alternate screen; at the end the verdicts stay as plain lines.

    Each picture has the size that the terminal has then, and appears as a whole.
    """
    state: SceneState | None = None
    drawn_ns = 0
    foresight = Anticipation(certainty)
    try:
        with Live(console=console, screen=True, auto_refresh=False) as live:
            for each in heard:
                state = each.state
                _words(foresight, each)
                if state.now_ns - drawn_ns >= REDRAW_S * 1e9 or state.now_ns < drawn_ns:
                    drawn_ns = state.now_ns
                    with _at_once(console):
                        live.update(render(state, *console.size, early=foresight.open), refresh=True)
    finally:
        for verdict in reversed(state.verdicts if state else ()):
            console.out(verdict_line(verdict), highlight=False)


@contextmanager
def _at_once(console: Console) -> Iterator[None]:
    """What is written meanwhile appears in one go, without half a picture: DEC mode 2026, ignored by who lacks it."""
    if not console.is_terminal or console.legacy_windows:
        yield
        return
    console.file.write(BEGIN_AT_ONCE)
    try:
        yield
    finally:
        console.file.write(END_AT_ONCE)
        console.file.flush()


def show_lines(heard: Iterable[Heard], certainty: float = NEVER) -> None:
    """One line for each verdict when it is first heard, for each early word and its end, and a judgement a second."""
    told: set[str] = set()
    said_ns = 0
    foresight = Anticipation(certainty)
    for each in heard:
        for word in _words(foresight, each):
            print(word_line(word), flush=True)
        match each.message:
            case VerdictMessage(id=verdict_id) as verdict if verdict_id not in told:
                told.add(verdict_id)
                print(verdict_line(verdict), flush=True)
        state = each.state
        if state.judgement and state.silence_s < LINE_EVERY_S and abs(state.now_ns - said_ns) >= LINE_EVERY_S * 1e9:
            said_ns = state.now_ns
            print(judgement_line(state.judgement), flush=True)


def show_json(heard: Iterable[Heard], certainty: float = NEVER) -> None:
    """Each judgement and verdict as one line of JSON: the wire's field names, and `kind` before them.

    An early word is a line of the kind `early`, its end one of the kind `confirmed`, `corrected` or `withdrawn`.
    """
    foresight = Anticipation(certainty)
    for each in heard:
        for word in _words(foresight, each):
            fields = asdict(word)
            print(json.dumps({"kind": fields.pop("stage"), **fields}), flush=True)
        if isinstance(each.message, JudgementMessage):
            kind = "verdict" if isinstance(each.message, VerdictMessage) else "judgement"
            # pydantic says a number that is none as null; json would write NaN, which no other language reads.
            fields = json.loads(each.message.model_dump_json())
            print(json.dumps({"kind": kind, **fields}), flush=True)


def _words(foresight: Anticipation, heard: Heard) -> list[Word]:
    """What is said early, or became of it; what was only told on asking may be long past."""
    now_s, message = heard.state.now_ns / 1e9, heard.message
    if isinstance(message, VerdictMessage) or (isinstance(message, JudgementMessage) and not heard.state.silent):
        return foresight.hear(message, now_s)
    return foresight.wait(now_s)
