"""What strangers do to the page: connections without end, no descriptors left, guesses at the token."""

import asyncio
import contextlib
import errno
import threading
from types import SimpleNamespace

import pytest
from asgi_answers import answers_of
from processes import SOON_S

from common.address import Address
from hub.dashboard import connections, serving
from hub.dashboard.access import COOKIE, AccessControl
from hub.dashboard.application import application
from hub.dashboard.connections import ConnectionTable, accept_connections, table_for_this_process
from hub.dashboard.guesses import ADDRESSES_LIMIT, GUESSES, WINDOW_S, GuessLimit, address_group
from hub.dashboard.serving import ServingRun
from hub.lan import bound_socket

TOKEN = "a-word-of-sixteen-and-more"  # noqa: S105 - a test
HOME, STRANGER = "192.168.1.5", "10.9.8.7"


class Browser:
    def __init__(self, idle=True):
        self.idle, self.ended = idle, False

    def end(self):
        self.ended = True


def test_the_connection_that_was_idle_for_longest_makes_room():
    table = ConnectionTable(limit=3, address_limit=2)
    reading, first, second = Browser(idle=False), Browser(), Browser()
    for browser, address in ((reading, HOME), (first, STRANGER), (second, STRANGER)):
        assert table.make_room(address)
        table.add(browser, address)
    assert table.make_room(HOME) and first.ended and not second.ended
    table.add(Browser(idle=False), HOME)
    assert not table.make_room(HOME), "its own are all busy"
    table.remove(second)
    table.remove(second)
    assert table.make_room(STRANGER) and len(table) == 2 and not reading.ended


def test_a_process_with_few_descriptors_keeps_some(monkeypatch):
    monkeypatch.setattr(connections.resource, "getrlimit", lambda kind: (300, 300))
    table = table_for_this_process()
    assert 1 <= table.limit < 300 - connections.DESCRIPTORS_KEPT and 1 <= table.address_limit <= table.limit


async def get(port, path="/", idle=False):
    """The first line of the answer; idle: nothing is asked, and the connection is returned."""
    reader, writer = await asyncio.open_connection("127.0.0.1", port)
    if idle:
        return reader, writer
    writer.write(f"GET {path} HTTP/1.1\r\nHost: 127.0.0.1\r\nConnection: close\r\n\r\n".encode())
    answer = await reader.readline()
    writer.close()
    return answer


def test_idle_connections_neither_fill_the_page_nor_stay(monkeypatch):
    monkeypatch.setattr(connections, "CONNECTIONS_LIMIT", 20)
    monkeypatch.setattr(connections.BrowserConnection, "request_s", 0.5)

    async def main():
        app = application(AccessControl(None), lambda head: None, lambda: False)
        with bound_socket(Address("127.0.0.1", 0), "--listen") as port:
            number, run = port.getsockname()[1], ServingRun(threading.Event())
            server = asyncio.create_task(serving._serve(app, port, run, lambda: None))
            crowd = [await get(number, idle=True) for _ in range(100)]
            assert b"200" in await get(number)
            # Half a request is none.
            crowd[-1][1].write(b"GET / HTTP/1.1\r\nHost:")
            # All are closed: the first ones for the others, the last ones after their time.
            for reader, writer in crowd:
                with contextlib.suppress(ConnectionResetError):
                    assert await asyncio.wait_for(reader.read(), SOON_S) == b""
                writer.close()
            run.stop.set()
            await server

    asyncio.run(main())


def test_without_descriptors_it_waits_before_it_accepts_again(monkeypatch, caplog):
    monkeypatch.setattr(connections, "ACCEPT_BACK_OFF_S", 0.01)
    attempts = []

    async def main():
        loop = asyncio.get_running_loop()

        async def no_descriptors(port):
            attempts.append(port)
            if len(attempts) == 3:
                raise asyncio.CancelledError
            raise OSError(errno.EMFILE, "Too many open files")

        monkeypatch.setattr(loop, "sock_accept", no_descriptors)
        port = SimpleNamespace(setblocking=lambda on: None)
        began_s = loop.time()
        with pytest.raises(asyncio.CancelledError):
            await accept_connections(port, ConnectionTable(), asyncio.Protocol)
        return loop.time() - began_s

    assert asyncio.run(main()) >= 0.02 and len(attempts) == 3
    assert [record.getMessage() for record in caplog.records] == [
        "cannot accept a browser: too many open files; trying again in 0.01 s"
    ] * 2


def test_guesses_of_one_address_are_limited_and_no_other_is_concerned():
    limit, now_s = GuessLimit(), 1000.0
    for n in range(GUESSES):
        assert limit.wait_s(STRANGER, now_s) == 0
        limit.wrong(STRANGER, f"guess {n}", now_s + n)
        limit.wrong(HOME, "an old cookie", now_s + n)
    assert limit.wait_s(STRANGER, now_s + 10) == WINDOW_S - 10 and limit.wait_s(HOME, now_s + 10) == 0
    assert limit.wait_s(STRANGER, now_s + WINDOW_S) == 0
    limit.wrong(STRANGER, "one more", now_s + WINDOW_S)
    assert limit.wait_s(STRANGER, now_s + WINDOW_S) == 1
    for n in range(ADDRESSES_LIMIT):
        limit.wrong(f"10.0.{n // 256}.{n % 256}", "guess", now_s)
    assert limit.wait_s(STRANGER, now_s + WINDOW_S) == 0, "forgotten: memory is bounded"


@pytest.mark.parametrize(
    ("one", "other", "same"),
    [("2001:db8::1", "2001:db8::ffff:1", True), ("2001:db8::1", "2001:db8:0:1::1", False),
     ("::ffff:10.0.0.1", "10.0.0.1", True), ("10.0.0.1", "10.0.0.2", False), ("fe80::1%eth0", "fe80::2", True),
     ("", "", True)],
)  # fmt: skip
def test_addresses_of_one_household_count_as_one(one, other, same):
    assert (address_group(one) == address_group(other)) == same


def ask(access, address, *requests):
    app = application(access, lambda head: None, lambda: False)
    return answers_of(app, *requests, host="dojo.local", client=address)


def test_who_guesses_at_the_token_is_answered_429_and_the_household_goes_on(monkeypatch):
    monkeypatch.setattr("hub.dashboard.application.WRONG_TOKEN_S", 0.0)
    clock = SimpleNamespace(now_s=0.0)
    access = AccessControl(TOKEN, ticks=lambda: clock.now_s)
    right = {"headers": {"authorization": f"Bearer {TOKEN}"}}
    kinds = [
        lambda n: ("GET", "/page.js", {"headers": {"authorization": f"Bearer {n}"}}),
        lambda n: ("GET", "/", {"headers": {"cookie": f"{COOKIE}={n}"}}),
        lambda n: ("POST", "/enter", {"data": {"token": str(n)}}),
    ]
    wrong = ask(access, STRANGER, *(kinds[n % 3](n) for n in range(GUESSES)))
    assert {answer.status_code for answer in wrong} == {401}
    form = ("POST", "/enter", {"data": {"token": TOKEN}})
    for answer in ask(access, STRANGER, ("GET", "/page.js", right), ("GET", "/", {}), form):
        assert answer.status_code == 429 and answer.headers["retry-after"] == str(int(WINDOW_S))
        assert answer.text == "Too many wrong tokens came from your address. Try again in 60 s.\n"
    cookie = {"headers": {"cookie": f"{COOKIE}={access.cookie}"}}
    assert [answer.status_code for answer in ask(access, HOME, ("GET", "/", cookie), ("GET", "/page.js", right))] == [
        200
    ] * 2
    clock.now_s = WINDOW_S
    assert ask(access, STRANGER, ("GET", "/page.js", right))[0].status_code == 200


def test_a_form_that_never_ends_is_given_up(monkeypatch):
    monkeypatch.setattr("hub.dashboard.access.BODY_S", 0.05)

    async def slow():
        yield b"token="
        await asyncio.sleep(5)

    assert ask(AccessControl(TOKEN), HOME, ("POST", "/enter", {"content": slow()}))[0].status_code == 408
