"""The server of phones before real WebSocket clients in this process."""

import asyncio
import json
import socket
import threading
import time
import urllib.error
import urllib.request
from contextlib import contextmanager

import pytest
from processes import SOON_S, until

pytest.importorskip("websockets")
pytest.importorskip("segno")

from websockets.exceptions import ConnectionClosed, InvalidStatus
from websockets.sync.client import connect

from hub.phone import serving
from hub.phone.pages import StaticPages
from hub.phone.phone_session import BURST, MOST_HZ
from hub.phone.register_file import RegisterFile
from hub.phone.serving import BROKEN, REFUSED, REPLACED, PhoneServer
from observer.foreign import frame_of_line
from observer.tracks import WHOLE_BODY

MODEL = {"pose_full.task": b"model" * 1000, "vision_bundle.mjs": b"export default 1;" * 100}


class Running:
    """A server in a thread of its own, without TLS."""

    def __init__(self, folder):
        self.file, self.lines, self.words = RegisterFile(folder / "dojo.phones.json"), [], {"verdict": None}
        pages = StaticPages(MODEL, b"authority", {"fingerprint": "AB CD", "scene": "dojo"})
        self.published_s = []
        self.server = PhoneServer("dojo", self.file, self._publish, pages.answer, lambda observer: self.words)
        self.port = socket.create_server(("127.0.0.1", 0))
        self.place = f"127.0.0.1:{self.port.getsockname()[1]}"
        self.thread = threading.Thread(target=lambda: asyncio.run(self._main()))
        self.ready = threading.Event()

    def _publish(self, observer, line):
        self.lines.append((observer, line)), self.published_s.append(time.monotonic())

    async def _main(self):
        self.loop, self.ended = asyncio.get_running_loop(), asyncio.Event()
        self.ready.set()
        await self.server.run(self.port, None, self.ended)

    def __enter__(self):
        self.thread.start()
        self.ready.wait(SOON_S)
        return self

    def __exit__(self, *_):
        self.loop.call_soon_threadsafe(self.ended.set)
        self.thread.join(SOON_S)

    def show(self, **words):
        self.words = words
        self.loop.call_soon_threadsafe(self.server.show)

    @contextmanager
    def phone(self, **first):
        """A client that has sent its first message, and knows how to answer the clock."""
        with connect(f"ws://{self.place}/socket") as socket_:
            client = Client(socket_)
            client.send(**first)
            yield client

    @contextmanager
    def joined(self, observer="phone1"):
        with self.phone(join={"code": self.file.new_code(observer), "name": "test"}) as client:
            client.secret = client.until("welcome")["secret"]
            client.until("clock")
            yield client


class Client:
    def __init__(self, socket_):
        self.socket, self.secret, self.ahead_ms = socket_, "", 0.0

    @property
    def now_ms(self):
        return time.time() * 1000 + self.ahead_ms

    def send(self, **message):
        self.socket.send(json.dumps(message))

    def until(self, kind):
        """The content of the next message of this kind; the clock is answered meanwhile."""
        end_s = time.monotonic() + SOON_S
        while time.monotonic() < end_s:
            message = json.loads(self.socket.recv(SOON_S))
            if "clock" in message:
                self.send(clock={"number": message["clock"], "now_ms": self.now_ms})
            if kind in message:
                return message[kind]
        raise AssertionError(f"no {kind}")

    def track(self, **parts):
        at_ms = self.now_ms
        self.send(tracks={"at_ms": at_ms, "parts": parts or {"head": [1.0, 2.0, 0.9]}})
        self.until("taken")
        return at_ms

    def ending(self):
        """The code and the words with which the server ends the connection."""
        words = ""
        with pytest.raises(ConnectionClosed) as closed:
            while True:
                words = json.loads(self.socket.recv(SOON_S)).get("ended", words)
        return closed.value.rcvd.code, words


@pytest.fixture
def running(tmp_path):
    with Running(tmp_path) as server:
        yield server


@pytest.mark.parametrize("ahead_s", [0, -7200, 30])
def test_tracks_reach_the_observer_in_our_time(running, ahead_s):
    with running.phone(join={"code": running.file.new_code("phone1")}) as phone:
        phone.ahead_ms = 1000 * ahead_s
        phone.until("clock")
        at_ms = phone.track(left_hand=[3.5, 4, 0.8])
    [(observer, line)] = running.lines
    frame = frame_of_line(line, WHOLE_BODY, 0)
    assert observer == "phone1" and frame.content[0].tolist() == [3.5, 4, 0.8]
    assert abs(frame.captured_ns / 1e6 - (at_ms - 1000 * ahead_s)) < 5_000


def test_two_phones_with_one_code(running):
    code = running.file.new_code("phone1")
    with running.phone(join={"code": code}) as first, running.phone(join={"code": code}) as second:
        first.until("welcome")
        status, words = second.ending()
        assert status == REFUSED and "used already" in words
        first.until("clock")
        first.track()


@pytest.mark.parametrize("first", [
    {"join": {"code": "forged"}}, {"resume": {"secret": "forged"}}, {"tracks": {"at_ms": 1, "parts": {"head": None}}},
])  # fmt: skip
def test_who_has_no_code_is_refused_in_one_line(running, first):
    with running.phone(**first) as stranger:
        status, words = stranger.ending()
    assert status == REFUSED and words and "\n" not in words and not running.lines


def test_a_phone_comes_back_with_its_secret(running):
    with running.joined() as phone:
        secret = phone.secret
    with running.phone(resume={"secret": secret}) as again:
        assert again.until("welcome")["observer"] == "phone1"
        again.until("clock")
        again.track()
    assert len(running.lines) == 1


def test_a_new_connection_of_the_same_phone_ends_the_old_one(running):
    with running.joined() as old, running.phone(resume={"secret": old.secret}) as new:
        new.until("welcome")
        assert old.ending()[0] == REPLACED


def test_a_revoked_phone_is_ended_and_stays_out(running):
    with running.joined() as phone:
        # As `labanmesh phone --revoke` does, in another process.
        RegisterFile(running.file.path).revoke("phone1")
        status, words = phone.ending()
        assert status == REFUSED and "revoked" in words
        with running.phone(resume={"secret": phone.secret}) as again:
            assert again.ending()[0] == REFUSED


def test_a_new_code_gives_the_place_to_another_phone(running):
    with running.joined() as old, running.joined() as new:
        assert old.ending()[0] == REFUSED
        new.track()


def test_ten_thousand_tracks_end_the_connection_and_the_server_goes_on(running):
    with pytest.raises(ConnectionClosed), running.joined() as flood:
        for _ in range(10_000):
            flood.send(tracks={"at_ms": flood.now_ms, "parts": {"head": None}})
        while True:
            flood.socket.recv(SOON_S)
    with running.joined("phone2") as calm:
        calm.track()
    passed_s = running.published_s[-2] - running.published_s[0]
    assert sum(observer == "phone1" for observer, _ in running.lines) <= BURST + MOST_HZ * passed_s


@pytest.mark.parametrize("message", [
    '{"tracks": {"at_ms": NaN, "parts": {"head": null}}}', '{"tracks": {"at_ms": 1, "parts": {"head": [NaN, 1, 1]}}}',
    '{"tracks": {"at_ms": 1, "parts": {"head": [1e300, 1, 1]}}}', "junk", b"\0\1", '{"picture": "AAAA"}', "x" * 5000,
])  # fmt: skip
def test_bad_messages_end_the_connection(running, message):
    with running.joined() as phone:
        phone.socket.send(message)
        with pytest.raises(ConnectionClosed) as closed:
            while True:
                phone.socket.recv(SOON_S)
    assert closed.value.rcvd.code in (BROKEN, 1009) and not running.lines


def test_the_page_is_shown_what_is_new(running):
    with running.joined() as phone:
        running.show(verdict={"label": "wave"})
        while phone.until("words") != {"verdict": {"label": "wave"}}:
            pass


def test_a_phone_that_says_nothing_is_cut_off(running, monkeypatch):
    monkeypatch.setattr(serving, "SILENT_S", 0.2)
    monkeypatch.setattr(serving, "PING_EVERY_S", 0.05)
    with running.joined() as phone:
        with pytest.raises(ConnectionClosed):
            while True:
                phone.socket.recv(SOON_S)
        until(lambda: not running.server.live)


def test_what_a_lesson_refuses_is_one_line_on_the_phone(running):
    asked = []
    running.server.ask = lambda request: asked.append(request.ask) or ("name two" if request.ask == "start" else "")
    with running.joined() as phone:
        phone.send(lesson={"ask": "start", "plan": {"labels": ["wave"]}})
        assert phone.until("complaint") == "name two"
        phone.send(lesson={"ask": "look"})
        phone.send(lesson={"ask": "stop", "lesson": "x"})
        assert phone.until("complaint") == "" and asked == ["start", "look", "stop"]


def test_a_page_from_elsewhere_cannot_open_the_socket(running):
    with (
        pytest.raises(InvalidStatus) as refused,
        connect(f"ws://{running.place}/socket", origin="https://evil.example"),
    ):
        pass
    assert refused.value.response.status_code == 403
    with connect(f"ws://{running.place}/socket", origin=f"https://{running.place}"):
        pass


def get(running, path):
    with urllib.request.urlopen(f"http://{running.place}{path}", timeout=SOON_S) as answer:
        return answer.headers, answer.read()


def test_the_files_come_from_here_and_nothing_from_elsewhere(running):
    headers, page = get(running, "/")
    assert b"phone.js" in page and headers["x-frame-options"] == "DENY"
    policy = headers["content-security-policy"]
    assert "default-src 'none'" in policy and f"connect-src 'self' wss://{running.place};" in policy
    assert get(running, "/model/pose_full.task")[1] == MODEL["pose_full.task"]
    assert get(running, "/model/vision_bundle.mjs")[0]["content-encoding"] == "gzip"
    assert get(running, "/authority.crt")[1] == b"authority"
    assert b"AB CD" in get(running, "/trust")[1]
    for path in ("/../labanmesh.py", "/static/phone.js", "/model/../register.py", "/dojo.phones.json"):
        with pytest.raises(urllib.error.HTTPError, match="404"):
            get(running, path)
