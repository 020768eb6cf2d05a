"""The inbox and the presence between the mesh's threads and a loop."""

import threading

from hypothesis import given
from hypothesis import strategies as st

from common.inbox import Inbox, Presence


def test_an_empty_inbox_gives_nothing_after_the_timeout():
    assert Inbox().take(0.001) == []


def test_arrivals_come_oldest_first_and_once():
    inbox = Inbox()
    inbox.put("a", b"1")
    inbox.put("b", b"2")
    assert [(arrival.key, arrival.payload) for arrival in inbox.take(1)] == [("a", b"1"), ("b", b"2")]
    assert inbox.take(0) == []


@given(st.integers(1, 8), st.integers(0, 30))
def test_a_full_inbox_loses_the_oldest_and_counts_them(limit, count):
    inbox = Inbox(limit)
    for i in range(count):
        inbox.put("k", bytes([i]))
    kept = [arrival.payload[0] for arrival in inbox.take(0)]
    assert kept == list(range(count))[-limit:]
    assert inbox.dropped == max(0, count - limit)


def test_wake_ends_a_wait():
    inbox, taken = Inbox(), threading.Event()
    waiting = threading.Thread(target=lambda: (inbox.take(60), taken.set()))
    waiting.start()
    inbox.wake()
    assert taken.wait(5)
    waiting.join(5)


def test_presence_waits_for_coming_and_going():
    presence = Presence()
    presence.note("a", alive=True)
    presence.note("a", alive=True)
    assert presence.wait_for(1, 0) and presence.alive == {"a"}
    assert not presence.wait_for(2, 0.001)
    presence.note("a", alive=False)
    presence.note("never-came", alive=False)
    assert presence.wait_for(0, 0)
