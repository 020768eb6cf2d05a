"""Fifty browsers on one dashboard, one real and one that never reads: no verdict is lost, and memory stays flat."""

import asyncio
import json
import socket
import time
from concurrent.futures import ThreadPoolExecutor
from urllib.parse import urlsplit

import httpx

BROWSERS, VERDICTS, EVERY_S = 50, 120, 0.05
GROWTH_KB = 12_000
SOON_S = 60.0


async def listen(client, url, wanted, connected):
    """The ids of all verdicts that one browser was told, until it has them all; and how many states."""
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


async def fifty(url, referee, memory_kb):
    wanted = {f"v{i}" for i in range(VERDICTS)}
    limits, connected = httpx.Limits(max_connections=BROWSERS), asyncio.Semaphore(0)
    async with httpx.AsyncClient(timeout=SOON_S, limits=limits) as client:
        tasks = [asyncio.create_task(listen(client, url, wanted, connected)) for _ in range(BROWSERS)]
        for _ in range(BROWSERS):
            await asyncio.wait_for(connected.acquire(), SOON_S)
        memory, tick_s = [], time.monotonic()
        for i in range(VERDICTS):
            await asyncio.to_thread(referee.say, f"v{i}")
            tick_s += EVERY_S
            await asyncio.sleep(max(0.0, tick_s - time.monotonic()))
            memory.append(memory_kb())
        return await asyncio.wait_for(asyncio.gather(*tasks), SOON_S), memory


def sleeper(url):
    """A browser that asks for the events and never reads them."""
    where = urlsplit(url)
    line = socket.create_connection((where.hostname, where.port))
    line.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4096)
    line.sendall(f"GET /events HTTP/1.1\r\nHost: {where.netloc}\r\n\r\n".encode())
    return line


def test_fifty_browsers_lose_no_verdict_and_memory_is_flat(theatre, look):
    referee, dashboard = theatre()
    page = look(dashboard.url)
    page.wait_for_selector(".observer")
    # In a thread of its own: playwright has an event loop in this one.
    with sleeper(dashboard.url), ThreadPoolExecutor(1) as pool:
        told = pool.submit(lambda: asyncio.run(fifty(dashboard.url, referee, dashboard.memory_kb)))
        heard, memory = told.result()
    page.wait_for_function("() => document.querySelector('#more').textContent === 'Show all 100'")
    third = VERDICTS // 3
    grown = max(memory[-5:]) - max(memory[third - 5 : third])
    states = sorted(count for _, count in heard)
    print(f"{len(heard)} browsers, {VERDICTS} verdicts each, states {states[0]} to {states[-1]}; ", end="")
    print(f"memory {memory[third] / 1000:.1f} MB after a third, {memory[-1] / 1000:.1f} MB at the end")
    assert all(len(known) == VERDICTS for known, _ in heard)
    assert grown < GROWTH_KB, memory
