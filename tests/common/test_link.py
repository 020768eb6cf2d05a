"""Inbox, presence, and sockets of this process that would delay a close."""

import socket
import struct
import sys
import threading

import pytest
from hypothesis import given
from hypothesis import strategies as st
from processes import SOON_S

from common.inbox import Inbox, Presence
from common.open_links import end_lingering


@given(st.integers(1, 8), st.integers(0, 30))
def test_a_full_inbox_drops_the_oldest_and_counts_them(limit, count):
    inbox = Inbox(limit)
    for i in range(count):
        inbox.put("k", bytes([i]))
    assert [(arrival.key, arrival.payload[0]) for arrival in inbox.take(0)] == [("k", i) for i in range(count)][-limit:]
    assert inbox.dropped == max(0, count - limit) and inbox.take(0.001) == []


def test_wake_ends_a_wait():
    inbox, taken = Inbox(), threading.Event()
    waiting = threading.Thread(target=lambda: (inbox.take(60), taken.set()))
    waiting.start()
    inbox.wake()
    assert taken.wait(SOON_S)
    waiting.join(SOON_S)


def test_presence_waits_for_tokens_that_appear_and_go():
    presence = Presence()
    presence.note("a", alive=True)
    presence.note("a", alive=True)
    assert presence.wait_for(1, 0) and presence.alive == {"a"} and not presence.wait_for(2, 0.001)
    presence.note("a", alive=False)
    presence.note("unknown", alive=False)
    assert presence.wait_for(0, 0)


def test_one_key_cannot_fill_an_inbox_with_large_messages():
    inbox = Inbox(bytes_limit=400_000)
    for _ in range(1000):
        inbox.put("flood", b"x" * 10_000)
    inbox.put("verdict", b"y" * 5_000)
    inbox.put("flood", b"small")
    taken = [arrival.key for arrival in inbox.take(0)]
    assert taken == ["flood"] * 10 + ["verdict", "flood"] and inbox.dropped == 990
    inbox.put("flood", b"x" * 10_000)
    assert len(inbox.take(0)) == 1


def test_invented_processes_are_not_all_noted_and_expected_ones_always():
    presence = Presence(["laban/dojo/observer/cam1/alive"])
    for n in range(15_000):
        presence.note(f"laban/dojo/observer/x{n}/alive", alive=True)
    presence.note("laban/dojo/observer/cam1/alive", alive=True)
    assert len(presence.alive) == 257 and "laban/dojo/observer/cam1/alive" in presence.alive


@pytest.mark.skipif(sys.platform != "linux", reason="a process can list its own descriptors only on Linux")
def test_linger_is_switched_off_on_tcp_sockets_only():
    with socket.socket() as tcp, socket.socket(type=socket.SOCK_DGRAM) as udp, socket.socket() as other:
        tcp.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, struct.pack("ii", 1, 10))
        assert end_lingering() == 1
        assert tcp.getsockopt(socket.SOL_SOCKET, socket.SO_LINGER, 8)[:4] == bytes(4)
        assert end_lingering() == 0 and all(each.fileno() >= 0 for each in (tcp, udp, other))
