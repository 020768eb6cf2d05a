"""The link between real Zenoh sessions on the loopback."""

import json
import os
import signal
import subprocess
import sys
import threading
import time

import pytest

from common.config import MeshConfig
from common.errors import LabanmeshError
from common.link import Link

SOON_S = 10.0
FREE = "tcp/127.0.0.1:0"


@pytest.fixture
def fusion():
    with Link.open(MeshConfig(endpoint=FREE), "fusion") as link:
        yield link


@pytest.fixture
def peer(fusion):
    mesh = MeshConfig(endpoint=fusion.locator)
    opened = []

    def another(role="observer"):
        opened.append(Link.open(mesh, role))
        return opened[-1]

    yield another
    for link in opened:
        link.close()


def test_what_a_peer_says_arrives_with_key_and_time(fusion, peer):
    inbox = fusion.inbox("x/*/posterior")
    publisher = peer().publisher("x/cam1/posterior")
    assert publisher.wait_for_subscriber(SOON_S)
    publisher.put(b"\x00one")
    (arrival,) = inbox.take(SOON_S)
    assert (arrival.key, arrival.payload) == ("x/cam1/posterior", b"\x00one")
    assert arrival.arrived_ns > 1_600_000_000_000_000_000


def test_peers_that_know_only_fusion_hear_each_other(peer):
    hub = peer("hub")
    inbox = hub.inbox("x/**")
    publisher = peer().publisher("x/a")
    assert publisher.wait_for_subscriber(SOON_S)
    publisher.put(b"1")
    assert [arrival.payload for arrival in inbox.take(SOON_S)] == [b"1"]


def test_one_inbox_takes_several_keys(fusion, peer):
    inbox = fusion.inbox("x/a", "x/b")
    other = peer()
    for key in ("x/a", "x/b"):
        publisher = other.publisher(key)
        assert publisher.wait_for_subscriber(SOON_S)
        publisher.put(key.encode())
    seen = inbox.take(SOON_S)
    seen += inbox.take(SOON_S) if len(seen) == 1 else []
    assert {arrival.key for arrival in seen} == {"x/a", "x/b"}


def test_nobody_listens(peer):
    assert not peer().publisher("x/nobody").wait_for_subscriber(0.05)


def test_the_order_of_starting_does_not_matter():
    with Link.open(MeshConfig(endpoint=FREE), "fusion") as first:
        mesh = MeshConfig(endpoint=first.locator)
    with Link.open(mesh, "observer") as early:
        publisher = early.publisher("x/a")
        assert not publisher.wait_for_subscriber(0.05)
        with Link.open(mesh, "fusion") as fusion:
            inbox = fusion.inbox("x/a")
            assert publisher.wait_for_subscriber(SOON_S)
            publisher.put(b"1")
            assert len(inbox.take(SOON_S)) == 1
        with Link.open(mesh, "fusion") as again:
            inbox = again.inbox("x/a")
            assert publisher.wait_for_subscriber(SOON_S)


def test_what_was_said_before_close_still_arrives(fusion, peer):
    inbox = fusion.inbox("x/a")
    other = peer()
    publisher = other.publisher("x/a")
    assert publisher.wait_for_subscriber(SOON_S)
    for i in range(200):
        publisher.put(bytes([i]))
    other.close()
    seen = []
    while len(seen) < 200 and (more := inbox.take(SOON_S)):
        seen += more
    assert [arrival.payload[0] for arrival in seen] == list(range(200))


def test_presence_sees_who_was_there_before_and_who_leaves(fusion, peer):
    other = peer()
    other.announce("x/cam1/alive")
    assert fusion.presence("x/*/alive").wait_for(1, SOON_S)
    presence = fusion.presence("x/*/alive")
    assert presence.wait_for(1, SOON_S) and presence.alive == {"x/cam1/alive"}
    peer().announce("x/cam2/alive")
    assert presence.wait_for(2, SOON_S)
    other.close()
    assert presence.wait_for(1, SOON_S) and presence.alive == {"x/cam2/alive"}


KILLED = """
import sys
from common.config import MeshConfig
from common.link import Link
link = Link.open(MeshConfig(endpoint=sys.argv[1]), "observer")
link.announce("x/doomed/alive")
sys.stdin.read()
"""


def test_a_killed_process_is_missed(fusion):
    presence = fusion.presence("x/*/alive")
    command = [sys.executable, "-c", KILLED, fusion.locator]
    with subprocess.Popen(command, stdin=subprocess.PIPE) as process:
        assert presence.wait_for(1, SOON_S)
        os.kill(process.pid, signal.SIGKILL)
        assert presence.wait_for(0, SOON_S)


def test_a_late_joiner_asks_for_the_last_values(fusion, peer):
    said = {"x/judgement": b"j", "x/verdict": None}
    fusion.answer("x/judgement", lambda: said["x/judgement"])
    fusion.answer("x/verdict", lambda: said["x/verdict"])
    late = peer("hub")
    assert late.ask("x/*", SOON_S) == {"x/judgement": b"j"}
    said["x/verdict"] = b"v"
    assert late.ask("x/*", SOON_S) == {"x/judgement": b"j", "x/verdict": b"v"}
    assert late.ask("x/verdict", SOON_S) == {"x/verdict": b"v"}


def test_nobody_answers(peer):
    assert peer().ask("x/nothing", 0.1) == {}


def test_an_answer_that_raises_is_no_answer(fusion, peer):
    fusion.answer("x/broken", lambda: json.loads("{"))
    assert peer().ask("x/broken", 0.1) == {}


def test_clients_meet_at_a_router():
    with Link.open(MeshConfig(mode="router", endpoint=FREE), "router") as router:
        mesh = MeshConfig(mode="router", endpoint=router.locator)
        with Link.open(mesh, "fusion") as fusion, Link.open(mesh, "observer") as observer:
            inbox = fusion.inbox("x/**")
            fusion.answer("x/judgement", lambda: b"j")
            presence = fusion.presence("x/*/alive")
            observer.announce("x/cam1/alive")
            publisher = observer.publisher("x/cam1")
            assert publisher.wait_for_subscriber(SOON_S)
            publisher.put(b"1")
            assert len(inbox.take(SOON_S)) == 1
            assert presence.wait_for(1, SOON_S)
            assert observer.ask("x/judgement", SOON_S) == {"x/judgement": b"j"}
            with pytest.raises(LabanmeshError, match="does not listen"):
                _ = observer.locator


def test_a_router_that_is_not_there_is_one_line():
    with Link.open(MeshConfig(endpoint=FREE), "fusion") as gone:
        endpoint = gone.locator
    with pytest.raises(LabanmeshError, match=r"no router answers there; start it with `labanmesh router`") as caught:
        Link.open(MeshConfig(mode="router", endpoint=endpoint), "observer", timeout_s=0.1)
    assert "\n" not in str(caught.value)


def test_an_endpoint_in_use_is_one_line(fusion):
    with pytest.raises(LabanmeshError, match="already in use; stop what listens there or choose another port"):
        Link.open(MeshConfig(endpoint=fusion.locator), "fusion")


@pytest.mark.parametrize("endpoint", ["banana", "foo/127.0.0.1:1", "tcp/no-such-host.invalid:1"])
def test_an_endpoint_that_cannot_be_is_one_line(endpoint):
    with pytest.raises(LabanmeshError, match="cannot be used") as caught:
        Link.open(MeshConfig(), "fusion", listen=[endpoint])
    assert "\n" not in str(caught.value) and ".cargo" not in str(caught.value)


def test_close_twice_and_from_a_waiting_loop(fusion):
    inbox = fusion.inbox("x/a")
    woken = threading.Event()
    waiting = threading.Thread(target=lambda: (inbox.take(60), woken.set()))
    waiting.start()
    fusion.close()
    fusion.close()
    assert woken.wait(SOON_S)
    waiting.join(SOON_S)


def test_saying_something_on_a_closed_link_is_one_line(peer):
    link = peer()
    publisher = link.publisher("x/a")
    link.close()
    with pytest.raises(LabanmeshError, match="closed"):
        publisher.put(b"1")


def test_a_session_that_does_not_close_is_left_behind(monkeypatch, caplog):
    monkeypatch.setattr("common.link.CLOSE_TIMEOUT_S", 0.05)
    release = threading.Event()

    class Stuck:
        def close(self):
            release.wait(30)

    link = Link(Stuck(), "tcp/127.0.0.1:1", "peer")
    closing = threading.Thread(target=link.close)
    closing.start()
    closing.join(SOON_S)
    assert not closing.is_alive()
    release.set()
    assert "did not close" in caplog.text


def test_a_polled_branch_gives_everything_when_it_is_asked_and_nothing_before(fusion, peer):
    hub = peer("hub")
    branch = hub.sub_session(polled=True)
    inbox, presence = branch.inbox("x/a", ring=2), branch.presence("x/*/alive")
    fusion.answer("x/question", lambda: b"answer")
    fusion.announce("x/cam/alive")
    voice = fusion.publisher("x/a")
    assert voice.wait_for_subscriber(SOON_S)
    for payload in (b"1", b"2", b"3"):
        voice.put(payload)
    assert hub.ask("x/question", SOON_S) == {"x/question": b"answer"}
    assert inbox.take(0) == [] and presence.alive == frozenset()
    answers, ends, end_s = [], [], time.monotonic() + SOON_S
    branch.request("x/question", lambda key, said: answers.append((key, said)), SOON_S, lambda: ends.append(1))
    # By now the answer has come, and its end too: nothing of it may be lost until somebody polls.
    assert hub.ask("x/question", SOON_S)
    while not ends and time.monotonic() < end_s:
        branch.poll()
    assert answers == [("x/question", b"answer")] and ends == [1]
    # A ring keeps the newest.
    assert [arrival.payload for arrival in inbox.take(0)] == [b"2", b"3"]
    assert presence.alive == {"x/cam/alive"}
    branch.close()
    voice.put(b"4")
    assert hub.ask("x/question", SOON_S)
    branch.poll()
    assert inbox.take(0) == []


def test_a_request_is_answered_under_its_exact_key_and_a_listeners_query_is_not(fusion, peer):
    one, two = fusion, peer()
    asked = []
    one.answer_requests("laban/dojo/fusion/a/handover", lambda payload: asked.append(payload) or b"state")
    # Declarations arrive in order: once this one is known, so is the one before.
    one.answer("x/ready", lambda: b"yes")
    assert two.ask("x/ready", SOON_S)
    replies, finished = [], threading.Event()
    two.request("laban/dojo/fusion/a/handover", lambda key, payload: replies.append(payload), 2.0, finished.set, b"b")
    assert finished.wait(SOON_S)
    assert (asked, replies) == ([b"b"], [b"state"])
    assert two.ask("laban/dojo/**", 0.2) == {}
    assert two.ask("laban/dojo/fusion/a/handover", 0.2) == {} and asked == [b"b"]


def test_an_inbox_can_leave_out_what_its_own_process_publishes(fusion, peer):
    one, two = fusion, peer()
    inbox = one.inbox("laban/dojo/judgement", remote=True)
    own, other = one.publisher("laban/dojo/judgement"), two.publisher("laban/dojo/judgement")
    assert other.wait_for_subscriber(SOON_S)
    own.put(b"own")
    other.put(b"other")
    assert [arrival.payload for arrival in inbox.take(SOON_S)] == [b"other"]
