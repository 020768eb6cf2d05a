"""Fifty browsers on one dashboard, one of them real and one that never reads: no verdict is lost, memory is flat."""

import asyncio
import json
import socket
import time
from concurrent.futures import ThreadPoolExecutor
from urllib.parse import urlsplit

import httpx
from processes import SOON_S

BROWSERS, VERDICTS, EVERY_S = 50, 120, 0.05
GROWTH_KB = 12_000


async def listen(client, url, wanted, connected):
    """The ids of all verdicts that one browser received, once it has them all, and how many states."""
    known, states, kind = set(), 0, ""
    async with client.stream("GET", f"{url}events") as answer:
        async for line in answer.aiter_lines():
            if line.startswith("event: "):
                kind = line[7:]
            elif line.startswith("data: "):
                if kind == "state":
                    states += 1
                    continue
                fields = json.loads(line[6:])
                known |= {each["id"] for each in fields["verdicts"]} if kind == "snapshot" else {fields["id"]}
                if kind == "snapshot":
                    connected.release()
                if wanted <= known:
                    return known, states
    raise AssertionError("the dashboard hung up")


async def fifty(url, scene, memory_kb):
    wanted = {f"room-{i}" for i in range(VERDICTS)}
    limits, connected = httpx.Limits(max_connections=BROWSERS), asyncio.Semaphore(0)
    async with httpx.AsyncClient(timeout=SOON_S, limits=limits) as client:
        tasks = [asyncio.create_task(listen(client, url, wanted, connected)) for _ in range(BROWSERS)]
        for _ in range(BROWSERS):
            await asyncio.wait_for(connected.acquire(), SOON_S)
        memory, tick_s = [], time.monotonic()
        for i in range(VERDICTS):
            await asyncio.to_thread(scene.publish, i)
            tick_s += EVERY_S
            await asyncio.sleep(max(0.0, tick_s - time.monotonic()))
            memory.append(memory_kb())
        return await asyncio.wait_for(asyncio.gather(*tasks), SOON_S), memory


def sleeper(url):
    """A connection that requests the events and never reads them."""
    where = urlsplit(url)
    connection = socket.create_connection((where.hostname, where.port))
    connection.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4096)
    connection.sendall(f"GET /events HTTP/1.1\r\nHost: {where.netloc}\r\n\r\n".encode())
    return connection


def test_fifty_browsers_lose_no_verdict_and_memory_is_flat(play, look):
    scene, dashboard = play()
    page = look(dashboard.url)
    # In its own thread: playwright has an event loop in this one.
    with sleeper(dashboard.url), ThreadPoolExecutor(1) as pool:
        future = pool.submit(lambda: asyncio.run(fifty(dashboard.url, scene, dashboard.memory_kb)))
        received, memory = future.result()
    page.wait_for_function("() => document.querySelector('#more').textContent === 'Show all 100'")
    third = VERDICTS // 3
    grown = max(memory[-5:]) - max(memory[third - 5 : third])
    states = sorted(count for _, count in received)
    print(f"{len(received)} browsers, {VERDICTS} verdicts each, states {states[0]} to {states[-1]}; ", end="")
    print(f"memory {memory[third] / 1000:.1f} MB after a third, {memory[-1] / 1000:.1f} MB at the end")
    assert all(len(known) == VERDICTS for known, _ in received)
    assert grown < GROWTH_KB, memory
