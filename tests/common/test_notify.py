"""Notifications to a supervisor: systemd's protocol on a real datagram socket, and a heartbeat file."""

import os
import socket
import sys
import threading
from contextlib import contextmanager, suppress
from itertools import pairwise

import pytest
from hypothesis import given
from hypothesis import strategies as st
from processes import SOON_S

from common.notify import ALIVE_EVERY_S, Notifier


@contextmanager
def supervisor(address):
    """A socket as systemd opens it."""
    name = "\0" + address[1:] if address.startswith("@") else address
    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as receiver:
        receiver.bind(name)
        receiver.settimeout(SOON_S)
        yield receiver


def received(receiver):
    """The notifications so far; a datagram has arrived when `sendto` returns."""
    receiver.setblocking(False)
    notifications = []
    with suppress(BlockingIOError):
        while True:
            notifications.append(receiver.recv(4096).decode())
    return notifications


class Clock:
    def __init__(self):
        self.now_s = 0.0

    def __call__(self):
        return self.now_s


@pytest.fixture
def address(tmp_path):
    return str(tmp_path / "notify")


def test_the_notifications_are_systemds(address):
    with supervisor(address) as receiver:
        notifier = Notifier.from_environment({"NOTIFY_SOCKET": address})
        notifier.ready("judging dojo")
        notifier.status("running")
        notifier.alive()
        notifier.stopping()
        assert received(receiver) == ["READY=1\nSTATUS=judging dojo", "STATUS=running", "WATCHDOG=1", "STOPPING=1"]


@pytest.mark.skipif(sys.platform != "linux", reason="abstract sockets are Linux's")
def test_an_abstract_socket_is_found():
    address = f"@labanmesh-test-{os.getpid()}"
    with supervisor(address) as receiver:
        Notifier(address).ready()
        assert receiver.recv(100) == b"READY=1"


def test_a_notifier_is_ready_in_its_context_and_stopping_after(address):
    with supervisor(address) as receiver:
        with pytest.raises(KeyError), Notifier(address):
            assert received(receiver) == ["READY=1"]
            raise KeyError
        assert received(receiver) == ["STOPPING=1"]


@given(st.lists(st.floats(0, 0.4), max_size=50))
def test_alive_is_sent_at_most_twice_a_second(pauses):
    clock, sent = Clock(), []
    notifier = Notifier("unused", ticks=clock)
    notifier._send = lambda text, timeout_s: sent.append((clock.now_s, text))
    for pause_s in pauses:
        notifier.alive()
        clock.now_s += pause_s
    times = [at_s for at_s, _ in sent]
    assert all(later - earlier >= ALIVE_EVERY_S for earlier, later in pairwise(times))
    # And often enough: ongoing work is never silent for longer than the limit and one pause.
    ends = [*times, clock.now_s] if times else []
    assert all(later - earlier < ALIVE_EVERY_S + 0.4 + 1e-9 for earlier, later in pairwise(ends))


def test_a_status_is_one_line_and_sent_when_it_changes(address):
    with supervisor(address) as receiver:
        notifier = Notifier(address)
        notifier.status("degraded: no\nREADY=1 picture")
        notifier.status("degraded: no\nREADY=1 picture")
        notifier.status("running")
        assert received(receiver) == ["STATUS=degraded: no READY=1 picture", "STATUS=running"]


def test_without_a_supervisor_nothing_happens(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    for notifier in (Notifier.from_environment({}), Notifier(str(tmp_path / "nobody")), Notifier("@" + "x" * 200)):
        notifier.ready()
        notifier.status("running")
        notifier.alive()
        notifier.stopping()
    assert list(tmp_path.iterdir()) == []


def test_a_full_queue_does_not_block_the_work(address):
    with supervisor(address):
        clock = Clock()
        notifier = Notifier(address, ticks=clock)

        def work():
            for _ in range(5000):  # far more than a queue of datagrams holds
                notifier.alive()
                clock.now_s += 1

        working = threading.Thread(target=work, daemon=True)
        working.start()
        working.join(SOON_S)
        assert not working.is_alive()


def test_the_heartbeat_file_is_touched_while_work_is_done(tmp_path):
    file, clock = tmp_path / "alive", Clock()
    notifier = Notifier(heartbeat=file, ticks=clock)
    assert not file.exists()
    notifier.ready()
    for later_s, is_touched in ((0, True), (0.4, False), (0.2, True)):
        os.utime(file, (0, 0))
        clock.now_s += later_s
        notifier.alive()
        assert (file.stat().st_mtime > 0) == is_touched
    notifier.stopping()
    assert not file.exists()


def test_a_heartbeat_that_cannot_be_written_is_logged_once(tmp_path, caplog):
    notifier = Notifier.from_environment({"LABANMESH_HEARTBEAT": str(tmp_path / "nowhere" / "alive")})
    notifier.ready()
    notifier.alive()
    assert [r.levelname for r in caplog.records] == ["WARNING"]
    assert "cannot write LABANMESH_HEARTBEAT" in caplog.text and "Choose a folder" in caplog.text
