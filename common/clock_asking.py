"""Asking other processes over the mesh what time it is there: their status says it (at_ns)."""

from collections import deque
from collections.abc import Callable

from common.branch import Branch
from common.clock_skew import SECOND_NS, Reading
from common.messages import StatusMessage
from common.wire import BadMessage, decode

EVERY_S = 1.0
ANSWER_S = 1.0
"""An answer that takes longer says nothing of a clock."""


class ClockAsker:
    """Asks all statuses under `key`; wake: called when an answer has come, from the mesh's thread."""

    def __init__(
        self,
        link: Branch,
        key: str,
        clock: Callable[[], int],
        wake: Callable[[], None] = lambda: None,
        every_s: float = EVERY_S,
    ) -> None:
        self._link, self._key, self._clock, self._wake = link, key, clock, wake
        self._every_ns = round(every_s * SECOND_NS)
        self._answers: deque[tuple[bytes, int, int]] = deque(maxlen=4096)
        self._asked_ns: int | None = None

    def ask_if_due(self) -> bool:
        """To be called in a loop; returns at once, and whether it asked."""
        now_ns = self._clock()
        if self._asked_ns is not None and abs(now_ns - self._asked_ns) < self._every_ns:
            return False
        self._asked_ns = now_ns

        def answered(key: str, payload: bytes) -> None:
            self._answers.append((payload, now_ns, self._clock()))
            self._wake()

        self._link.request(self._key, answered, ANSWER_S)
        return True

    def readings(self) -> list[tuple[str, Reading]]:
        """What was answered since the last call: each process's id and its clock."""
        read = []
        while self._answers:
            payload, asked_ns, answered_ns = self._answers.popleft()
            try:
                status = decode(StatusMessage, payload)
            except BadMessage:
                continue
            if status.at_ns is not None:
                read.append((status.id, Reading(asked_ns, status.at_ns, answered_ns)))
        return read
