"""Progress of long tasks on stderr: a bar on a terminal, a few plain lines elsewhere."""

import sys
import threading
from typing import TYPE_CHECKING, Self

if TYPE_CHECKING:
    from rich.progress import Progress, TaskID

LINES = 4
"""Plain lines per task, at most, after that of its begin."""
BEGIN_S = 0.5
"""Seconds until a plain line says that a task has begun: less than the second after which people ask themselves
whether anything happens, and long enough for a wrong option to be reported alone."""


class ProgressBar:
    """A context manager; call it with the task, the steps done and the total.

    first: a task that begins with the context, and ends when another one begins.
    """

    def __init__(self, first: str = "") -> None:
        self._first = first
        self._rich: Progress | None = None
        self._tasks: dict[str, TaskID] = {}
        self._quarters: dict[str, int] = {}
        """Per task its last quarter that was printed."""
        self._begin: threading.Timer | None = None

    def __call__(self, what: str, done: int, total: int) -> None:
        """Show that `done` of `total` steps of `what` are done; total: 0 for a task whose steps are not known."""
        if self._rich is not None:
            self._draw(self._rich, what, done, total)
            return
        quarter = done * LINES // total if total else 0
        line = f"{what}: {done} of {total}" if total else what
        self._cancel_begin()
        # Also if it shrinks: the same task may start again.
        if quarter not in (0, self._quarters.get(what, 0)):
            print(line, file=sys.stderr, flush=True)
        elif what not in self._quarters:
            self._begin = threading.Timer(BEGIN_S, print, (line,), {"file": sys.stderr, "flush": True})
            self._begin.daemon = True
            self._begin.start()
        self._quarters[what] = quarter

    def _draw(self, bar: "Progress", what: str, done: int, total: int) -> None:
        if what not in self._tasks:
            for task in bar.tasks:
                # Its end is not known: it ends when another one begins.
                bar.update(task.id, visible=task.total is not None)
            self._tasks[what] = bar.add_task(what, total=total or None)
        bar.update(self._tasks[what], completed=done, total=total or None)

    def _cancel_begin(self) -> None:
        if self._begin is not None:
            self._begin.cancel()

    def __enter__(self) -> Self:
        if sys.stderr.isatty():
            from rich.console import Console
            from rich.progress import Progress

            self._rich = Progress(console=Console(stderr=True), transient=True)
            self._rich.start()
        if self._first:
            self(self._first, 0, 0)
        return self

    def __exit__(self, *_: object) -> None:
        self._cancel_begin()
        if self._rich is not None:
            self._rich.stop()
