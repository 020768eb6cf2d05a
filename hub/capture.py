"""Capturing a scene: all that is said below its root, who comes and who goes, from the mesh into a capture file.

1. The mesh only fills an inbox; one loop empties it into the file and flushes each time, ten times a second or more.
2. What is only said when asked (the vocabulary) is asked for at the beginning, and again after somebody has come.
"""

import sys
import time
from collections import Counter
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from types import TracebackType
from typing import TYPE_CHECKING, Self

from common.capture_file import APPEARED, GONE, CaptureKind, CaptureRecord, CaptureWriter

if TYPE_CHECKING:
    from rich.status import Status

    from common.config import Scene
    from common.link import Link

TAKE_S = 0.1
"""How long one look into the inbox waits: so much at most is lost when this process is killed."""
ASK_S = 0.3
ASK_AGAIN_NS = 2_000_000_000
INBOX_LIMIT = 65_536
"""Messages that wait while the disk is slow; a scene of four cameras says about 200 a second."""
TELL_S = 10.0
MEGABYTE = 1_000_000


@dataclass(frozen=True, slots=True)
class Account:
    """What was captured: messages and bytes, seconds, per kind of message how many, and how many came too fast."""

    messages: int
    size: int
    seconds: float
    kinds: Mapping[str, int]
    left_out: int

    def __str__(self) -> str:
        """One line for people."""
        kinds = ", ".join(f"{count} {kind}" for kind, count in sorted(self.kinds.items()))
        lost = f"; {self.left_out} came too fast and were left out" if self.left_out else ""
        head = f"{self.messages} messages, {self.size / MEGABYTE:.1f} MB in {self.seconds:.0f} s"
        return f"{head}{f' ({kinds})' if kinds else ''}{lost}"


class Capture:
    """One scene on its way into a file; `lap` as long as it should go on."""

    def __init__(self, scene: "Scene", link: "Link", writer: CaptureWriter, clock: Callable[[], int]) -> None:
        self._keys, self._link, self._writer, self._clock = scene.keys, link, writer, clock
        self._kinds: Counter[str] = Counter()
        self._tokens: frozenset[str] = frozenset()
        self._told: frozenset[tuple[str, bytes]] = frozenset()
        self._inbox = link.inbox(f"{self._keys.root}/**", limit=INBOX_LIMIT)
        self._presence = link.presence(f"{self._keys.root}/**/alive")
        self._began_ns = self._asked_ns = clock()
        self._unanswered = False
        self._ask()

    @property
    def account(self) -> Account:
        """What was captured so far."""
        seconds = (self._clock() - self._began_ns) / 1e9
        left_out = self._inbox.dropped + self._writer.left_out
        return Account(self._writer.messages, self._writer.size, seconds, dict(self._kinds), left_out)

    def lap(self) -> None:
        """Write what has come, at the latest after a tenth of a second; raises LabanmeshError when the disk refuses."""
        for arrival in self._inbox.take(TAKE_S):
            self._write("put", arrival.key, arrival.payload, arrival.arrived_ns)
        # After their last words, as the referee hears it.
        self._note_tokens()
        if self._unanswered and self._clock() - self._asked_ns > ASK_AGAIN_NS:
            self._ask()
        self._writer.flush()

    def _note_tokens(self) -> None:
        alive, now_ns = self._presence.alive, self._clock()
        for key in sorted(self._tokens - alive):
            self._write("token", key, GONE, now_ns)
        come = sorted(alive - self._tokens)
        for key in come:
            self._write("token", key, APPEARED, now_ns)
        self._tokens = alive
        if come:
            self._ask()

    def _ask(self) -> None:
        answers = self._link.ask_each(f"{self._keys.root}/**", ASK_S)
        self._asked_ns = self._clock()
        # Somebody who has come may bring his vocabulary a little later; while nobody is there it is not missed.
        known = any(key == self._keys.vocabulary for key, _ in answers)
        self._unanswered = not known and bool(self._presence.alive)
        for key, payload in answers:
            if (key, payload) not in self._told:
                self._write("answer", key, payload, self._asked_ns)
        self._told = frozenset(answers)

    def _write(self, kind: CaptureKind, key: str, payload: bytes, arrived_ns: int) -> None:
        self._writer.write(CaptureRecord(kind, key, payload, arrived_ns))
        self._kinds[key.rsplit("/", 1)[-1] if kind == "put" else kind] += 1


class Teller:
    """Says on stderr how it goes: a line that changes on a terminal, else one every ten seconds; a context manager."""

    def __init__(self, name: str) -> None:
        self._name, self._said_s = name, time.monotonic()
        self._status: Status | None = None

    def __call__(self, account: Account) -> None:
        """Tell it, if it is time."""
        line = f"{self._name}: {account}"
        if self._status is not None:
            self._status.update(line)
        elif time.monotonic() - self._said_s >= TELL_S:
            self._said_s = time.monotonic()
            print(line, file=sys.stderr, flush=True)

    def __enter__(self) -> Self:
        if sys.stderr.isatty():
            from rich.console import Console

            self._status = Console(stderr=True).status(f"{self._name}: listening")
            self._status.start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if self._status is not None:
            self._status.stop()


def capture(scene: "Scene", link: "Link", writer: CaptureWriter, go_on: Callable[[], bool]) -> Account:
    """Write into `writer` all that is said in `scene` while `go_on()`; returns what that was."""
    with Teller(str(writer.path)) as tell:
        ear = Capture(scene, link, writer, time.time_ns)
        while go_on():
            ear.lap()
            tell(ear.account)
        ear.lap()
        return ear.account
