"""A capture played to one browser: each has a playhead of its own, and nobody moves another's."""

import asyncio
from collections.abc import AsyncIterator
from dataclasses import dataclass

from hub.dashboard import picture
from hub.dashboard.events import event
from hub.dashboard.tape import Tape

STEP_S = 0.1
FASTEST = 64.0


@dataclass(frozen=True, slots=True)
class Playhead:
    """From where, in seconds from the beginning, and how fast; 0 stands still."""

    at_s: float = 0.0
    speed: float = 1.0


async def play(tape: Tape, hall: picture.Hall, head: Playhead) -> AsyncIterator[bytes]:
    """What a browser is sent: a snapshot of that moment, then what follows, at the end the event `end`."""
    loop = asyncio.get_running_loop()
    began_s = loop.time()
    at_ns = _moment(tape, head.at_s)
    whole = picture.snapshot(hall, tape.chronicle(at_ns, with_minute=True))
    yield event("snapshot", {**whole, "head": _head_s(tape, at_ns), "marks": tape.moments_s})
    while head.speed > 0 and at_ns < tape.ended_ns:
        await asyncio.sleep(STEP_S)
        before_ns, at_ns = at_ns, _moment(tape, head.at_s + (loop.time() - began_s) * head.speed)
        chronicle = tape.chronicle(at_ns)
        for said in tape.verdicts_between(before_ns, at_ns):
            yield event("verdict", picture.verdict(said, chronicle, hall.quorum))
        yield event("state", {**picture.state(chronicle), "head": _head_s(tape, at_ns)})
    if head.speed > 0:
        yield event("end", {"head": _head_s(tape, at_ns)})
    await asyncio.Event().wait()


def _moment(tape: Tape, at_s: float) -> int:
    return min(tape.ended_ns, tape.began_ns + int(max(0.0, at_s) * 1e9))


def _head_s(tape: Tape, at_ns: int) -> float:
    return round((at_ns - tape.began_ns) / 1e9, 2)
