"""The processes of a run: publishers, fusion, listeners; the same loops over every transport.

Publishers put keep-alive messages with sequence number 0 before and after their order, so that all processes find each
other and no queue blocks for ever. Times are time.monotonic_ns, one clock for all processes of a machine.
"""

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

from benchmarks.comparisons.transports.clients import EACH_POSTERIOR, JUDGEMENT, KINDS, Put, Role, posterior_key
from benchmarks.comparisons.transports.orders import OrderReader, PublishOrder

KEEP_ALIVE_S = 0.005
LEAVES_S = 5.0
"""A busy machine sends the last message of a publisher that is paced within this time."""
KEEP_ALIVE_AFTER_S = 0.05
BATCH = 64
"""Messages between two looks at the clock when publishing as fast as possible."""
BYTES_SENT = 200
"""Offset of tcpi_bytes_sent, 64 bit, in struct tcp_info since Linux 4.19."""


@dataclass(frozen=True, slots=True)
class ActorRole:
    """The role of a process. payloads: a publisher's keep-alive and its messages; for fusion the judgement's bytes.

    pause_s: fusion judges each batch, but not more often. processors: where it may run; None is everywhere.
    """

    kind: str
    role: Role
    name: str
    place: str = ""
    payloads: tuple[bytes, ...] = ()
    pause_s: float = 0.0
    processors: frozenset[int] | None = None

    def __str__(self) -> str:
        return f"{self.name} over {KINDS[self.kind].name}"


@dataclass(frozen=True, slots=True)
class Ready:
    """Sent when others can begin. began_ns: when the process began to load its transport."""

    began_ns: int
    meeting_point: str = ""


@dataclass(frozen=True, slots=True)
class PublisherReport:
    """When each message was put (if timed), how many, and the processor time and bytes that took."""

    put_ns: list[int]
    count: int
    cpu_s: float
    sent_bytes: int


@dataclass(frozen=True, slots=True)
class ReceivedJudgement:
    """When a judgement arrived, and the newest sequence number that it contains of each publisher."""

    arrived_ns: int
    newest: dict[str, int]


@dataclass(frozen=True, slots=True)
class ListenerReport:
    """The judgements of a listener; first_ns: when each publisher first appeared in one."""

    judgements: list[ReceivedJudgement]
    first_ns: dict[str, int]


def act(role: ActorRole, pipe: Connection) -> None:
    """A whole process."""
    reader, began_ns = OrderReader(pipe), time.monotonic_ns()
    if role.processors is not None:
        # Before the library is loaded: its threads inherit it.
        os.sched_setaffinity(0, role.processors)
    asyncio.run(ROLES[role.role](role, reader, began_ns))


async def publish(role: ActorRole, reader: OrderReader, began_ns: int) -> None:
    """Put keep-alives, execute orders, and put keep-alives again until stopped."""
    keep_alive, *payloads = role.payloads
    async with KINDS[role.kind].connect("publisher", role.place) as client:
        put = client.put(posterior_key(role.name))
        reader.reply(Ready(began_ns))
        pause_s = KEEP_ALIVE_S
        while not reader.stopped.is_set():
            await put(keep_alive)
            await asyncio.sleep(pause_s)
            if not reader.orders.empty():
                reader.reply(await _execute(put, payloads, reader.orders.get()))
                pause_s = KEEP_ALIVE_AFTER_S
    reader.reply("ended")


async def _execute(put: Put, payloads: list[bytes], order: PublishOrder) -> PublisherReport:
    await asyncio.sleep(max(order.begin_s - time.monotonic(), 0.0))
    before, cpu_s = sent_bytes(), time.process_time()
    put_ns: list[int] = []
    if order.rate_hz:
        count = await _paced(put, payloads, order, put_ns)
    else:
        count = await _flat_out(put, payloads, order)
    await asyncio.sleep(max(order.begin_s + order.seconds - time.monotonic(), 0.0))
    cpu_s = time.process_time() - cpu_s
    # The last message has left the socket when its bytes are counted; of those put as fast as they can some never do.
    until_s, least = time.monotonic() + LEAVES_S, count * len(payloads[0]) if order.rate_hz else 0
    while sent_bytes() - before < least and time.monotonic() < until_s:
        await asyncio.sleep(KEEP_ALIVE_S)
    return PublisherReport(put_ns, count, cpu_s, sent_bytes() - before)


async def _paced(put: Put, payloads: list[bytes], order: PublishOrder, put_ns: list[int]) -> int:
    """Put at order.rate_hz; messages that are due together are put together."""
    count, total = 0, round(order.seconds * order.rate_hz)
    each = max(round(order.rate_hz * order.tick_s), 1)
    while count < total:
        await asyncio.sleep(max(order.begin_s + count / order.rate_hz - time.monotonic(), 0.0))
        for number in range(count, min(count + each, total)):
            if order.timed:
                put_ns.append(time.monotonic_ns())
            await put(payloads[number % len(payloads)])
        count += each
    return total


async def _flat_out(put: Put, payloads: list[bytes], order: PublishOrder) -> int:
    count, end_s = 0, order.begin_s + order.seconds
    while time.monotonic() < end_s:
        for number in range(BATCH):
            await put(payloads[number % len(payloads)])
        count += BATCH
        # Transports that write in asyncio need their turn.
        await asyncio.sleep(0)
    return count


async def fuse(role: ActorRole, reader: OrderReader, began_ns: int) -> None:
    """Take batches, unpack each posterior, put a judgement with the newest number of each publisher."""
    judgement: dict[str, Any] = msgpack.unpackb(role.payloads[0])
    due_s = 0.0
    async with KINDS[role.kind].connect("fusion", role.place) as client:
        take, put = await client.take(EACH_POSTERIOR), client.put(JUDGEMENT)
        reader.reply(Ready(began_ns, client.meeting_point()))
        newest: dict[str, int] = {}
        while not reader.stopped.is_set():
            taken = 0
            for payload in await take():
                posterior = msgpack.unpackb(payload)
                newest[posterior["observer"]] = posterior["seq"]
                taken += posterior["seq"] > 0
            reader.messages += taken
            if not role.pause_s or time.monotonic() >= due_s:
                due_s = time.monotonic() + role.pause_s
                await put(msgpack.packb(judgement | {"newest": newest}))
                newest = {}
    reader.reply("ended")


async def listen(role: ActorRole, reader: OrderReader, began_ns: int) -> None:
    """Take judgements and record when each arrived; `messages` counts the publishers that appeared."""
    report = ListenerReport([], {})
    async with KINDS[role.kind].connect("listener", role.place) as client:
        take = await client.take(JUDGEMENT)
        reader.reply(Ready(began_ns))
        while not reader.stopped.is_set():
            batch = await take()
            now_ns = time.monotonic_ns()
            for payload in batch:
                newest: dict[str, int] = msgpack.unpackb(payload)["newest"]
                for name in newest.keys() - report.first_ns.keys():
                    report.first_ns[name] = now_ns
                if any(newest.values()):
                    report.judgements.append(ReceivedJudgement(now_ns, newest))
            reader.messages = len(report.first_ns)
    reader.reply(report)


ROLES: dict[str, Callable[[ActorRole, OrderReader, int], Coroutine[Any, Any, None]]] = {
    "publisher": publish,
    "fusion": fuse,
    "listener": listen,
}


def sent_bytes() -> int:
    """Payload that the open TCP connections of this process have sent, without TCP and IP headers. Linux only."""
    total = 0
    with contextlib.suppress(OSError):
        for entry in Path("/proc/self/fd").iterdir():
            with contextlib.suppress(OSError, ValueError, struct.error):
                if str(entry.readlink()).startswith("socket:"):
                    total += _sent_by(int(entry.name))
    return total


def _sent_by(descriptor: int) -> int:
    with socket.socket(fileno=os.dup(descriptor)) as own:
        if own.type != socket.SOCK_STREAM or own.family not in (socket.AF_INET, socket.AF_INET6):
            return 0
        count: int = struct.unpack_from("Q", own.getsockopt(socket.IPPROTO_TCP, socket.TCP_INFO, 256), BYTES_SENT)[0]
        return count
