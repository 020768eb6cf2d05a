"""The small HTTP server of every process, when strangers connect to it."""

import errno
import socket
import threading
import time
from types import SimpleNamespace

import pytest
from processes import SOON_S

from common import health_server
from common.address import Address
from common.health import ProcessHealth


@pytest.fixture
def server():
    process = ProcessHealth("dojo", "observer", "cam1", time.monotonic())
    metrics = SimpleNamespace(exposition=lambda accept: (b"", "text/plain"))
    with health_server.HealthServer(Address("127.0.0.1", 0), process, metrics) as server:
        thread = threading.Thread(target=server.serve_forever, args=(0.01,))
        thread.start()
        yield server
        server.shutdown()
        thread.join()


def ask(server):
    with socket.create_connection(server.server_address[:2], 5) as connection:
        connection.sendall(b"GET /healthz HTTP/1.0\r\n\r\n")
        try:
            return connection.recv(16)
        except ConnectionResetError:
            return b""


def test_idle_connections_take_no_more_than_a_few_threads(server):
    before = threading.active_count()
    idle = [socket.create_connection(server.server_address[:2], 5) for _ in range(health_server.REQUESTS_LIMIT + 10)]
    for connection in idle[health_server.REQUESTS_LIMIT :]:
        assert connection.recv(1) == b"", "closed, because no thread is free"
    assert threading.active_count() - before <= health_server.REQUESTS_LIMIT
    for connection in idle:
        connection.close()
    end_s = time.monotonic() + 5
    while not (answer := ask(server)).startswith(b"HTTP/1.0 200") and time.monotonic() < end_s:
        pass
    assert answer.startswith(b"HTTP/1.0 200")


def test_without_descriptors_it_does_not_spin(server, monkeypatch, caplog):
    paused = threading.Event()
    attempts = []
    monkeypatch.setattr(health_server, "BACK_OFF_S", 0.02)

    def no_descriptors():
        attempts.append(time.monotonic())
        if len(attempts) == 3:
            monkeypatch.undo()
            paused.set()
        raise OSError(errno.EMFILE, "Too many open files")

    monkeypatch.setattr(health_server.TCPServer, "get_request", lambda self: no_descriptors())
    with socket.create_connection(server.server_address[:2], SOON_S):
        assert paused.wait(SOON_S)
    assert attempts[2] - attempts[0] >= 0.04
    assert "cannot accept a connection: too many open files" in caplog.text
