"""Limits how often a log line is repeated, so that no fault, and no attack, fills a disk.

1. Lines are of one kind if logger, level and text without its values are the same. Up to WARNINGS, or INFOS, lines of
   a kind are written in PERIOD_S; the others are counted, and one line says how often the last of them was repeated.
2. Debug lines, and the lines about verdicts, which fusion bounds itself, are all written.
"""

import logging
import math
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass

from common.text import plural

PERIOD_S = 10.0
WARNINGS, INFOS = 10, 200
"""Lines of one kind in a period; a service of hundreds of scenes logs some about each of them at its start."""
KINDS_LIMIT = 500
"""Kinds of lines that are counted apart; all further ones share one count."""
QUOTED = 160
Kind = tuple[str, int, str]


@dataclass(slots=True)
class _Window:
    """The lines of one kind since `began_s`; text: of the newest that was not written."""

    began_s: float
    lines: int = 0
    text: str = ""


class LineLimit:
    """Decides which lines are written. Pure: time is passed in."""

    def __init__(self) -> None:
        self._windows: dict[Kind, _Window] = {}

    def admits(self, record: logging.LogRecord, now_s: float) -> bool:
        """Whether to write the line."""
        if record.levelno < logging.INFO or hasattr(record, "verdict"):
            return True
        kind = (record.name, record.levelno, str(record.msg))
        if kind not in self._windows and len(self._windows) >= KINDS_LIMIT:
            kind = ("", record.levelno, "")
        window = self._windows.setdefault(kind, _Window(now_s))
        window.lines += 1
        if window.lines <= _most(kind):
            return True
        window.text = record.getMessage()[:QUOTED]
        return False

    def ended(self, now_s: float) -> Iterator[tuple[Kind, str]]:
        """The kinds of lines whose period is over and of which some were not written, and what to write of them."""
        over = [kind for kind, window in self._windows.items() if not 0 <= now_s - window.began_s < PERIOD_S]
        for kind in over:
            window = self._windows.pop(kind)
            hidden = window.lines - _most(kind)
            if hidden > 0:
                yield kind, f"{window.text} ... repeated {plural(hidden, 'time')} in {PERIOD_S:g} s"


class LimitedHandler(logging.StreamHandler):  # type: ignore[type-arg]
    """Writes log lines to a stream, those of one kind no more often than LineLimit admits."""

    def __init__(self, *arguments: object, ticks: Callable[[], float] = time.monotonic) -> None:
        super().__init__(*arguments)
        self._limit, self._ticks = LineLimit(), ticks

    def emit(self, record: logging.LogRecord) -> None:
        """Write the line, unless it is repeated too often, and what is due about earlier ones."""
        now_s = self._ticks()
        self._write_ended(now_s)
        if self._limit.admits(record, now_s):
            super().emit(record)

    def close(self) -> None:
        """Write what is due at the end of the process."""
        self._write_ended(math.inf)
        super().close()

    def _write_ended(self, now_s: float) -> None:
        for (name, level, _), text in self._limit.ended(now_s):
            super().emit(logging.LogRecord(name, level, "", 0, text, None, None))


def _most(kind: Kind) -> int:
    return INFOS if kind[1] == logging.INFO else WARNINGS
