"""The processes of a run: publishers, fusion, listeners; the same loops over every transport."""

import asyncio
import contextlib
import os
import socket
import struct
import time
from collections.abc import Callable, Coroutine
from dataclasses import dataclass
from multiprocessing.connection import Connection
from pathlib import Path
from typing import Any

import msgpack

from benchmarks.transports.kinds import KINDS, Put
from benchmarks.transports.orders import Orders, Plan

MURMUR_S = 0.005
MURMUR_AFTER_S = 0.05
BATCH = 64
"""Messages between two looks at the clock, when they are put as fast as may be."""


@dataclass(frozen=True, slots=True)
class Part:
    """Who is to do what. payloads: a publisher's murmur and then what it puts; for the referee the judgement's bytes.

    pause_s: the referee judges each lot, but not more often. processors: where it may run; None is everywhere.
    """

    kind: str
    role: str
    name: str
    place: str = ""
    payloads: tuple[bytes, ...] = ()
    pause_s: float = 0.0
    processors: frozenset[int] | None = None

    def __str__(self) -> str:
        return f"{self.name} over {KINDS[self.kind].name}"


@dataclass(frozen=True, slots=True)
class Ready:
    """Said when others can begin. began_ns: when the process began to load its transport."""

    began_ns: int
    meeting_point: str = ""


@dataclass(frozen=True, slots=True)
class Spoken:
    """What a publisher put: when each (if that is noted), how many, and the CPU time and bytes that took."""

    put_ns: list[int]
    count: int
    cpu_s: float
    sent_bytes: int


@dataclass(frozen=True, slots=True)
class Heard:
    """What a listener heard: per judgement when, and the newest it names of each; when it first heard of each."""

    judgements: list[tuple[int, dict[str, int]]]
    first_ns: dict[str, int]


def act(part: Part, pipe: Connection) -> None:
    """A whole process."""
    orders, began_ns = Orders(pipe), time.monotonic_ns()
    if part.processors is not None:
        # Before the library is loaded: its threads inherit it.
        os.sched_setaffinity(0, part.processors)
    asyncio.run(ROLES[part.role](part, orders, began_ns))


async def publish(part: Part, orders: Orders, began_ns: int) -> None:
    """Murmur, put what the plan says, murmur until stopped."""
    murmur, *payloads = part.payloads
    async with KINDS[part.kind].load().publisher(part.place, part.name) as put:
        orders.say(Ready(began_ns))
        pause_s = MURMUR_S
        while not orders.stopped.is_set():
            await put(murmur)
            await asyncio.sleep(pause_s)
            if not orders.plans.empty():
                orders.say(await _spoken(put, payloads, orders.plans.get()))
                pause_s = MURMUR_AFTER_S
    orders.say("ended")


async def _spoken(put: Put, payloads: list[bytes], plan: Plan) -> Spoken:
    await asyncio.sleep(max(plan.begin_s - time.monotonic(), 0.0))
    sent_bytes, cpu_s = sent(), time.process_time()
    put_ns, count = await (_paced(put, payloads, plan) if plan.rate_hz else _flat_out(put, payloads, plan))
    # The last one has left, too, when it is told what was sent.
    await asyncio.sleep(max(plan.begin_s + plan.seconds - time.monotonic(), 0.0))
    return Spoken(put_ns, count, time.process_time() - cpu_s, sent() - sent_bytes)


async def _paced(put: Put, payloads: list[bytes], plan: Plan) -> tuple[list[int], int]:
    """What is due at the same time is put at once."""
    put_ns: list[int] = []
    count, total = 0, round(plan.seconds * plan.rate_hz)
    each = max(round(plan.rate_hz * plan.tick_s), 1)
    while count < total:
        await asyncio.sleep(max(plan.begin_s + count / plan.rate_hz - time.monotonic(), 0.0))
        for number in range(count, min(count + each, total)):
            if plan.noted:
                put_ns.append(time.monotonic_ns())
            await put(payloads[number % len(payloads)])
        count += each
    return put_ns, total


async def _flat_out(put: Put, payloads: list[bytes], plan: Plan) -> tuple[list[int], int]:
    count, end_s = 0, plan.begin_s + plan.seconds
    while time.monotonic() < end_s:
        for number in range(BATCH):
            await put(payloads[number % len(payloads)])
        count += BATCH
        # Where asyncio does the writing it must have its turn.
        await asyncio.sleep(0)
    return [], count


async def judge(part: Part, orders: Orders, began_ns: int) -> None:
    """Take lots, unpack each posterior, put a judgement that names the newest of each publisher."""
    judgement: dict[str, Any] = msgpack.unpackb(part.payloads[0])
    due_s = 0.0
    async with KINDS[part.kind].load().referee(part.place) as seat:
        orders.say(Ready(began_ns, seat.meeting_point))
        heard: dict[str, int] = {}
        while not orders.stopped.is_set():
            taken = 0
            for payload in await seat.take():
                said = msgpack.unpackb(payload)
                heard[said["observer"]] = said["seq"]
                taken += said["seq"] > 0
            orders.messages += taken
            if not part.pause_s or time.monotonic() >= due_s:
                due_s = time.monotonic() + part.pause_s
                await seat.put(msgpack.packb(judgement | {"heard": heard}))
                heard = {}
    orders.say("ended")


async def listen(part: Part, orders: Orders, began_ns: int) -> None:
    """Take judgements and note when each came; `messages` counts the publishers that were heard of."""
    account = Heard([], {})
    async with KINDS[part.kind].load().listener(part.place) as take:
        orders.say(Ready(began_ns))
        while not orders.stopped.is_set():
            lot = await take()
            now_ns = time.monotonic_ns()
            for payload in lot:
                newest: dict[str, int] = msgpack.unpackb(payload)["heard"]
                for name in newest.keys() - account.first_ns.keys():
                    account.first_ns[name] = now_ns
                if any(newest.values()):
                    account.judgements.append((now_ns, newest))
            orders.messages = len(account.first_ns)
    orders.say(account)


ROLES: dict[str, Callable[[Part, Orders, int], Coroutine[Any, Any, None]]] = {
    "publisher": publish,
    "referee": judge,
    "listener": listen,
}


BYTES_SENT = 200
"""Where struct tcp_info has tcpi_bytes_sent, 64 bit, since Linux 4.19."""


def sent() -> int:
    """Payload of all TCP connections that are open now, frames of the transport included, headers of TCP and IP not."""
    total = 0
    with contextlib.suppress(OSError):
        for entry in Path("/proc/self/fd").iterdir():
            with contextlib.suppress(OSError, ValueError, struct.error):
                if str(entry.readlink()).startswith("socket:"):
                    total += _sent_by(int(entry.name))
    return total


def _sent_by(descriptor: int) -> int:
    with socket.socket(fileno=os.dup(descriptor)) as held:
        if held.type != socket.SOCK_STREAM or held.family not in (socket.AF_INET, socket.AF_INET6):
            return 0
        told: int = struct.unpack_from("Q", held.getsockopt(socket.IPPROTO_TCP, socket.TCP_INFO, 256), BYTES_SENT)[0]
        return told
