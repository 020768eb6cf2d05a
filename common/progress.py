"""Progress of long work: a bar on a terminal, a plain line now and then elsewhere; always on stderr."""

import sys
from types import TracebackType
from typing import TYPE_CHECKING, Self

if TYPE_CHECKING:
    from rich.progress import Progress

LINES = 4
"""So many plain lines a task at most, where nobody watches a bar grow."""


class ProgressBar:
    """A context manager; called with what is done, how much of it, and how much there is."""

    def __init__(self) -> None:
        self._rich: Progress | None = None
        self._said: dict[str, int] = {}

    def __call__(self, what: str, done: int, total: int) -> None:
        """Show that `done` of `total` steps of `what` are done."""
        if self._rich is not None:
            if what not in self._said:
                self._said[what] = self._rich.add_task(what, total=total)
            self._rich.update(self._rich.task_ids[self._said[what]], completed=done, total=total)
            return
        quarter = done * LINES // max(total, 1)
        # Not only when it grows: the same task may begin again.
        if quarter not in (0, self._said.get(what, 0)):
            print(f"{what}: {done} of {total}", file=sys.stderr, flush=True)
        self._said[what] = quarter

    def __enter__(self) -> Self:
        if sys.stderr.isatty():
            from rich.console import Console
            from rich.progress import Progress

            self._rich = Progress(console=Console(stderr=True), transient=True)
            self._rich.start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if self._rich is not None:
            self._rich.stop()
