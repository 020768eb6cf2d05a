"""Progress of long tasks on stderr: a bar on a terminal, a few plain lines elsewhere."""

import sys
from typing import TYPE_CHECKING, Self

if TYPE_CHECKING:
    from rich.progress import Progress

LINES = 4
"""Plain lines per task, at most."""


class ProgressBar:
    """A context manager; call it with the task, the steps done and the total."""

    def __init__(self) -> None:
        self._rich: Progress | None = None
        self._state: dict[str, int] = {}
        """Per task its number on the terminal, or its last quarter that was printed."""

    def __call__(self, what: str, done: int, total: int) -> None:
        """Show that `done` of `total` steps of `what` are done."""
        if self._rich is not None:
            if what not in self._state:
                self._state[what] = self._rich.add_task(what, total=total)
            self._rich.update(self._rich.task_ids[self._state[what]], completed=done, total=total)
            return
        quarter = done * LINES // max(total, 1)
        # Also if it shrinks: the same task may start again.
        if quarter not in (0, self._state.get(what, 0)):
            print(f"{what}: {done} of {total}", file=sys.stderr, flush=True)
        self._state[what] = quarter

    def __enter__(self) -> Self:
        if sys.stderr.isatty():
            from rich.console import Console
            from rich.progress import Progress

            self._rich = Progress(console=Console(stderr=True), transient=True)
            self._rich.start()
        return self

    def __exit__(self, *_: object) -> None:
        if self._rich is not None:
            self._rich.stop()
