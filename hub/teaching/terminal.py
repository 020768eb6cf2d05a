"""The teacher's terminal: lines, large letters and beeps that are noticed from the other side of a room, and keys."""

import select
import shutil
import sys
import threading
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager

from common.messages import VerdictMessage
from hub.session import SceneListener, newly_decided
from hub.teaching.big_letters import big
from hub.teaching.interface import GO, Action, Step
from hub.teaching.wording import KEY_HINTS, reworded, step_line

BEEPS = {"countdown": 1, "now": 2, "kept": 1, "failed": 3, "doubt": 3, "test": 1}
"""Beeps of the terminal's bell: one while it counts down, two to begin, one for a take that is kept, else three."""
BEEP_S = 0.15
"""Between two beeps, or terminals make one of them."""
LARGE_WORDS = {"now": "now", "kept": "kept", "failed": "again"}
LARGE_SIGNS = {"now": "", "key": "key", "clap": "clap", "still": "still"}
REPEAT, DROP, SKIP = "r", "d", "s"


class Terminal:
    """A `LessonInterface` in a terminal: lines that stay above, and below them what changes. Elsewhere only lines.

    keyboard: single keys can be read.
    """

    def __init__(self, stop: threading.Event, listener: SceneListener, keyboard: bool) -> None:
        self._stop, self._listener, self._keyboard = stop, listener, keyboard
        self._changing = sys.stdout.isatty()
        self._shown = 0
        self._kind = ""

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
        print(self._cleared() + (line if self._keyboard else reworded(line, KEY_HINTS)), flush=True)

    def show(self, step: Step) -> None:
        """Show a step, a signal in large letters. Without a terminal print only the signal to begin."""
        line, is_new = step_line(step), step.kind != self._kind
        self._kind = step.kind
        if is_new and step.kind == "waiting":
            self._forget_keys()
        if not self._changing and step.kind == "now":
            print(line, flush=True)
        if not self._changing or not line:
            return
        size = shutil.get_terminal_size()
        letters = big(_large(step), size.columns - 1, size.lines - 3)
        rows = [*letters, f"\x1b[1m{line[: size.columns - 1]}\x1b[0m"]
        print(self._cleared() + "\n".join(rows), end="", flush=True)
        self._shown = len(rows)
        if is_new or step.kind == "countdown":
            self._beep(BEEPS.get(step.kind, 0))

    def between(self, step: Step, seconds: float) -> Action:
        """What the key pressed within so many seconds means."""
        key = self._key(seconds)
        if not key:
            return GO
        if step.kind == "waiting":
            return Action("begin")
        if step.kind in ("other", "alarms"):
            return Action("skip") if key == SKIP else GO
        return {REPEAT: Action("repeat"), DROP: Action("drop")}.get(key, GO)

    def ready(self, step: Step) -> Action:
        """Go on at once: the performer is away from the keyboard."""
        return GO

    def fused_labels(self) -> Sequence[str]:
        """The movements that the fusion service judges now."""
        self._listener.check()
        return self._listener.state.labels

    def verdicts(self) -> Sequence[VerdictMessage]:
        """What was decided since the last call."""
        return newly_decided(self._listener.verdicts)

    def _cleared(self) -> str:
        if not self._changing:
            return ""
        up, self._shown = max(self._shown - 1, 0), 0
        return "\r" + (f"\x1b[{up}A" if up else "") + "\x1b[J"

    def _beep(self, times: int) -> None:
        for n in range(times):
            if n:
                self.pause(BEEP_S)
            print("\a", end="", flush=True)

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

    def _forget_keys(self) -> None:
        """Discard keys that were pressed earlier, so that none of them counts as the sign to begin."""
        if self._keyboard:
            import termios

            termios.tcflush(sys.stdin, termios.TCIFLUSH)


def _large(step: Step) -> str:
    if step.kind in ("countdown", "other", "alarms"):
        return f"{step.left_s:.0f}"
    return LARGE_SIGNS[step.how] if step.kind == "waiting" else LARGE_WORDS.get(step.kind, "")


def wait(seconds: float, stop: threading.Event) -> None:
    """Wait; raises KeyboardInterrupt after Ctrl-C."""
    if stop.wait(seconds):
        raise KeyboardInterrupt


def agrees(question: str, stop: threading.Event) -> bool:
    """Whether a person answers yes, or presses Enter; False where there is no terminal."""
    with single_keys() as keyboard:
        if not keyboard or not sys.stdout.isatty():
            return False
        print(f"{question} [Y/n] ", end="", flush=True)
        while not select.select([sys.stdin], [], [], 0.1)[0]:
            wait(0.0, stop)
        answer = sys.stdin.read(1).lower()
        print(flush=True)
        return answer in ("y", "\n", "\r")


@contextmanager
def single_keys() -> Iterator[bool]:
    """While the context lasts a key is read without Enter; yields whether the input is a terminal, where that works."""
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
