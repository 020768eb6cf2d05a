"""What waits for one browser: bounded, however slow it is. Pure.

1. Of states only the newest waits.
2. Verdicts wait all, in order. When one too many waits, none of them is dropped quietly: the browser is behind, and
   gets a whole snapshot, in which they are.
"""

from collections.abc import Callable

LIMIT = 32


class Outbox:
    """Filled by `state` and `verdict`, emptied by `take`; begins behind, so the first thing taken is a snapshot."""

    def __init__(self, limit: int = LIMIT) -> None:
        self._limit = limit
        self._state: bytes | None = None
        self._verdicts: list[bytes] = []
        self._behind = True

    def state(self, payload: bytes) -> None:
        """The scene's newest state."""
        if not self._behind:
            self._state = payload

    def verdict(self, payload: bytes) -> None:
        """A verdict, said or said again."""
        if self._behind:
            return
        if len(self._verdicts) == self._limit:
            self._state, self._behind = None, True
            self._verdicts.clear()
        else:
            self._verdicts.append(payload)

    def take(self, snapshot: Callable[[], bytes]) -> list[bytes]:
        """All that waits, oldest first, or a snapshot made now; may be empty."""
        if self._behind:
            self._behind = False
            return [snapshot()]
        waiting = [*self._verdicts, *([] if self._state is None else [self._state])]
        self._state = None
        self._verdicts.clear()
        return waiting
