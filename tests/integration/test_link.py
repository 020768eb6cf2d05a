"""The link between real Zenoh sessions on the loopback."""

import json
import os
import signal
import socket
import subprocess
import sys
import threading
import time
from contextlib import suppress
from pathlib import Path

import pytest
from processes import SOON_S, until

from common import link
from common.config import MeshConfig
from common.errors import LabanmeshError
from common.link import Link
from common.open_links import LOOKS, LostPeers
from labanmesh_testing.mesh import Mesh

FREE = MeshConfig(endpoint="tcp/127.0.0.1:0")


@pytest.fixture
def mesh():
    opened = Mesh(FREE)
    yield opened
    opened.close()


@pytest.fixture
def fusion(mesh):
    return mesh.meeting


@pytest.fixture
def peer(mesh):
    return lambda role="observer": mesh.peer(role)


def publisher_to(link, key):
    """A publisher that somebody receives."""
    publisher = link.publisher(key)
    assert publisher.wait_for_subscriber(SOON_S)
    return publisher


def payloads(inbox, count=1):
    """The first `count` payloads."""
    arrivals = []
    while len(arrivals) < count and (more := inbox.take(SOON_S)):
        arrivals += more
    return [arrival.payload for arrival in arrivals]


def test_a_message_arrives_with_its_key_and_time(fusion, peer):
    inbox = fusion.inbox("x/*/posterior")
    publisher_to(peer(), "x/cam1/posterior").put(b"\x00one")
    (arrival,) = inbox.take(SOON_S)
    assert (arrival.key, arrival.payload) == ("x/cam1/posterior", b"\x00one")
    assert arrival.arrived_ns > 1_600_000_000_000_000_000


def test_peers_that_know_only_fusion_receive_from_each_other(peer):
    inbox = peer("hub").inbox("x/**")
    publisher_to(peer(), "x/a").put(b"1")
    assert payloads(inbox) == [b"1"]


def ends_but(port, cut=False):
    """The number of this process's ends of TCP connections of which neither end has this port; cut: cut them."""
    ends = 0
    for file in Path("/proc/self/fd").iterdir():
        with suppress(OSError, ValueError), socket.socket(fileno=os.dup(int(file.name))) as each:
            if each.family == socket.AF_INET and port not in (each.getpeername()[1], each.getsockname()[1]):
                ends += 1
                if cut:
                    each.shutdown(socket.SHUT_RDWR)
    return ends


def test_peers_that_have_lost_each_other_alone_find_each_other_again(fusion, peer, monkeypatch):
    """As after a stall of one of them that ends between two leases."""
    looks = []

    class Looked(LostPeers):
        def note(self, linked):
            looks.append(set(linked))
            return super().note(looks[-1])

    monkeypatch.setattr(link, "LostPeers", Looked)
    monkeypatch.setattr(link, "CONNECTION_CHECK_S", 0.05)
    inbox = peer("hub").inbox("x/**")
    publisher = publisher_to(peer(), "x/a")
    until(lambda: looks and len(looks[-1]) == 2)
    port = int(fusion.locator.rpartition(":")[2])
    until(lambda: ends_but(port) >= 2)
    ends_but(port, cut=True)
    until(lambda: publisher.put(b"1") or inbox.take(0.05))


def test_a_peer_counts_as_lost_once_and_only_after_some_looks():
    peers = LostPeers()
    assert not peers.note("ab") and not any(peers.note("b") for _ in range(LOOKS - 1))
    assert peers.note("b") == {"a"} and not any(peers.note("b") for _ in range(10))
    # One that comes back was not lost, and may be lost again.
    assert not any(peers.note(linked) for linked in ("ab", "b", "ab", *"bb", "ab"))
    assert [peers.note("b") for _ in range(LOOKS)][-1] == {"a"}


def test_one_inbox_takes_several_keys(fusion, peer):
    inbox, other = fusion.inbox("x/a", "x/b"), peer()
    for key in ("x/a", "x/b"):
        publisher_to(other, key).put(key.encode())
    assert sorted(payloads(inbox, 2)) == [b"x/a", b"x/b"]


def test_the_order_of_starting_does_not_matter():
    with Link.open(FREE, "fusion") as closed:
        mesh = FREE.at(closed.locator)
    with Link.open(mesh, "observer") as early:
        publisher = early.publisher("x/a")
        assert not publisher.wait_for_subscriber(0.05), "there is none"
        for _ in range(2):
            with Link.open(mesh, "fusion") as fusion:
                inbox = fusion.inbox("x/a")
                assert publisher.wait_for_subscriber(SOON_S)
                # The subscriber that matches may still be the one that was closed: nobody receives the first messages.
                arrivals = []
                while not arrivals:
                    publisher.put(b"1")
                    arrivals = inbox.take(0.1)
                assert {arrival.payload for arrival in arrivals} == {b"1"}


def test_messages_published_before_close_still_arrive(fusion, peer):
    inbox, other = fusion.inbox("x/a"), peer()
    publisher = publisher_to(other, "x/a")
    for i in range(200):
        publisher.put(bytes([i]))
    other.close()
    assert payloads(inbox, 200) == [bytes([i]) for i in range(200)]


def test_presence_knows_earlier_peers_and_those_that_leave(fusion, peer):
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


def test_the_token_of_a_killed_process_disappears(fusion):
    presence = fusion.presence("x/*/alive")
    command = [sys.executable, "-c", KILLED, fusion.locator]
    with subprocess.Popen(command, stdin=subprocess.PIPE) as process:
        assert presence.wait_for(1, SOON_S)
        os.kill(process.pid, signal.SIGKILL)
        assert presence.wait_for(0, SOON_S)


def test_a_late_joiner_queries_the_last_values(fusion, peer):
    values = {"x/judgement": b"j", "x/verdict": None}
    fusion.answer("x/judgement", lambda: values["x/judgement"])
    fusion.answer("x/verdict", lambda: values["x/verdict"])
    fusion.answer("y/broken", lambda: json.loads("{"))
    late = peer("hub")
    assert late.ask("x/*", SOON_S) == {"x/judgement": b"j"}
    values["x/verdict"] = b"v"
    assert late.ask("x/*", SOON_S) == {"x/judgement": b"j", "x/verdict": b"v"}
    assert late.ask("x/verdict", SOON_S) == {"x/verdict": b"v"}
    assert late.ask("x/nothing", 0.1) == {}
    assert late.ask("y/broken", 0.1) == {}, "an answer that raises is no answer"


def test_clients_meet_at_a_router():
    config = MeshConfig(mode="router", endpoint=FREE.endpoint)
    with Link.open(config, "router") as router:
        mesh = config.at(router.locator)
        with Link.open(mesh, "fusion") as fusion, Link.open(mesh, "observer") as observer:
            inbox = fusion.inbox("x/**")
            fusion.answer("x/judgement", lambda: b"j")
            presence = fusion.presence("x/*/alive")
            observer.announce("x/cam1/alive")
            publisher_to(observer, "x/cam1").put(b"1")
            assert payloads(inbox) == [b"1"] and presence.wait_for(1, SOON_S)
            assert observer.ask("x/judgement", SOON_S) == {"x/judgement": b"j"}
            with pytest.raises(LabanmeshError, match="does not listen"):
                _ = observer.locator


ROUTER = """
import sys
from common.config import MeshConfig
from common.link import Link
with Link.open(MeshConfig(mode="router", endpoint="tcp/127.0.0.1:0"), "router") as router:
    print(router.locator, flush=True)
    sys.stdin.read()
"""


def test_a_frozen_router_drops_what_comes_often_and_keeps_what_is_rare():
    """What fits into no buffer is dropped, and a verdict, which waits in a queue of its own, arrives."""
    pipes = {"stdin": subprocess.PIPE, "stdout": subprocess.PIPE, "text": True}
    with subprocess.Popen([sys.executable, "-c", ROUTER], **pipes) as router:
        mesh = MeshConfig(mode="router", endpoint=router.stdout.readline().strip())
        with Link.open(mesh, "fusion") as fusion, Link.open(mesh, "hub") as hub:
            often, rare = hub.inbox("x/often"), hub.inbox("x/rare")
            judgements, verdicts = publisher_to(fusion, "x/often"), fusion.publisher("x/rare", priority="high")
            assert verdicts.wait_for_subscriber(SOON_S)
            os.kill(router.pid, signal.SIGSTOP)
            for number in range(20):
                for _ in range(40):
                    judgements.put(bytes(60_000))
                verdicts.put(bytes([number]))
            os.kill(router.pid, signal.SIGCONT)
            assert payloads(rare, 20) == [bytes([number]) for number in range(20)]
            assert len(often.take(0)) < 20 * 40
        router.stdin.close()


def mesh_without_router():
    with Link.open(FREE, "fusion") as closed:
        return MeshConfig(mode="router", endpoint=closed.locator)


def no_router():
    Link.open(mesh_without_router(), "observer", timeout_s=0.1)


def endpoint_in_use():
    with Link.open(FREE, "fusion") as fusion:
        Link.open(FREE.at(fusion.locator), "fusion")


def closed_link():
    link = Link.open(FREE, "fusion")
    publisher = link.publisher("x/a")
    link.close()
    publisher.put(b"1")


@pytest.mark.parametrize(
    ("fail", "line"),
    [
        (no_router, "no router answers there; start it with `labanmesh router --scene SCENE`"),
        (endpoint_in_use, "already in use; stop what listens there or choose another port"),
        (closed_link, "closed"),
        *((lambda endpoint=endpoint: Link.open(MeshConfig(), "fusion", listen=[endpoint]), "cannot be used")
          for endpoint in ("banana", "foo/127.0.0.1:1", "tcp/no-such-host.invalid:1")),
    ],
)  # fmt: skip
def test_each_fault_of_a_link_is_one_line(fail, line):
    with pytest.raises(LabanmeshError, match=line) as caught:
        fail()
    assert "\n" not in str(caught.value) and ".cargo" not in str(caught.value)


def test_a_client_says_what_it_waits_for_long_before_it_gives_up_and_ends_at_once_when_it_shall_stop(caplog):
    class StopWhenSaid(threading.Event):
        def is_set(self):
            return "trying for" in caplog.text

    begun_s = time.monotonic()
    with pytest.raises(KeyboardInterrupt):
        Link.open(mesh_without_router(), "hub", timeout_s=60, stop=StopWhenSaid())
    assert time.monotonic() - begun_s < SOON_S
    (line,) = caplog.messages
    assert "no router answers there; start it with `labanmesh router --scene SCENE`" in line and line.endswith(
        "; trying for 60 s"
    )


def test_a_process_says_that_its_router_has_gone_and_that_it_is_back(monkeypatch, caplog):
    monkeypatch.setattr("common.link.CONNECTION_CHECK_S", 0.05)
    config = MeshConfig(mode="router", endpoint=FREE.endpoint)
    with Link.open(config, "router") as router:
        mesh = config.at(router.locator)
        observer, hub = (Link.open(mesh, role) for role in ("observer", "hub"))
    with observer, hub:
        until(lambda: "no router answers any more" in caplog.text)
        with Link.open(mesh, "router"):
            until(lambda: "a router answers again" in caplog.text)
    assert len(caplog.messages) == 2, "once each, and a hub shows it itself"


def test_a_link_may_be_closed_twice_and_wakes_a_waiting_loop(fusion):
    inbox, woken = fusion.inbox("x/a"), threading.Event()
    waiting = threading.Thread(target=lambda: (inbox.take(60), woken.set()))
    waiting.start()
    fusion.close()
    fusion.close()
    assert woken.wait(SOON_S)
    waiting.join(SOON_S)


ENDING = """
import sys, threading
from common.config import MeshConfig
from common.link import Link
link = Link.open(MeshConfig(endpoint=sys.argv[1]), "hub")
inbox, publisher = link.inbox("x/a"), link.publisher("x/a")
begun = threading.Event()
def repeat(call):
    while True:
        call()
        begun.set()
def stops(call):
    threading.Thread(target=repeat, args=(call,), daemon=True).start()
    begun.wait()
def works():
    assert not link._closed.wait(0.3) and link.ask("x/answer", 5)
    begun.set()
"""


ENDS = (
    "link.request('x/answer', lambda *_: None, 1)",
    "stops(lambda: publisher.put(b'1'))",
    "stops(lambda: link.ask('x/answer', 5)); link.close()",
    "1 / 0",
    "threading.Thread(target=works).start()",
)


def test_a_program_that_leaves_its_link_open_ends_in_order_whatever_arrives(fusion):
    """The interpreter's end meets no thread within Zenoh, waits for none that waits for messages, and cuts none off."""
    fusion.answer("x/answer", lambda: [b"answer"] * 100)
    publisher, commands = (
        fusion.publisher("x/a"),
        [[sys.executable, "-c", ENDING + end, fusion.locator] for end in ENDS],
    )
    programs = [subprocess.Popen(command, stderr=subprocess.PIPE, text=True) for command in commands]
    while any(program.poll() is None for program in programs):
        publisher.put(b"1")
    for end, program in zip(ENDS, programs, strict=True):
        errors = program.communicate()[1]
        assert program.returncode == (end == "1 / 0") and "not rethrown" not in errors, errors


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


def test_a_polled_sub_session_delivers_only_when_it_is_polled(fusion, peer, monkeypatch):
    monkeypatch.setattr("common.subsession.RING", 2)
    hub = peer("hub")
    polled = hub.sub_session(polled=True)
    inbox, presence = polled.inbox("x/a"), polled.presence("x/*/alive")
    fusion.answer("x/question", lambda: b"answer")
    fusion.announce("x/cam/alive")
    publisher = publisher_to(fusion, "x/a")
    for payload in (b"1", b"2", b"3"):
        publisher.put(payload)
    assert hub.ask("x/question", SOON_S) == {"x/question": b"answer"}
    assert inbox.take(0) == [] and presence.alive == frozenset()
    answers, ends = [], []
    polled.request("x/question", lambda key, payload: answers.append((key, payload)), SOON_S, lambda: ends.append(1))
    # By now the answer and its end have arrived: neither may be lost before the next poll.
    assert hub.ask("x/question", SOON_S)
    until(lambda: polled.poll() or ends)
    assert answers == [("x/question", b"answer")] and ends == [1]
    # A ring keeps the newest.
    assert [arrival.payload for arrival in inbox.take(0)] == [b"2", b"3"]
    assert presence.alive == {"x/cam/alive"}
    polled.close()
    publisher.put(b"4")
    assert hub.ask("x/question", SOON_S)
    polled.poll()
    assert inbox.take(0) == []


def test_a_request_is_answered_under_its_exact_key_and_a_query_for_everything_is_not(fusion, peer):
    other, requests, key = peer(), [], "laban/dojo/fusion/a/handover"
    fusion.answer_requests(key, lambda payload: requests.append(payload) or b"state")
    # Declarations arrive in order: once this one is known, so is the one before.
    fusion.answer("x/ready", lambda: b"yes")
    assert other.ask("x/ready", SOON_S)
    replies, finished = [], threading.Event()
    other.request(key, lambda key, payload: replies.append(payload), SOON_S, finished.set, b"b")
    assert finished.wait(SOON_S)
    assert (requests, replies) == ([b"b"], [b"state"])
    assert other.ask("laban/dojo/**", 0.2) == {} == other.ask(key, 0.2) and requests == [b"b"]


def test_an_inbox_can_leave_out_what_its_own_process_publishes(fusion, peer):
    inbox = fusion.inbox("laban/dojo/judgement", remote=True)
    own, other = fusion.publisher("laban/dojo/judgement"), peer().publisher("laban/dojo/judgement")
    assert other.wait_for_subscriber(SOON_S)
    own.put(b"own")
    other.put(b"other")
    assert payloads(inbox) == [b"other"]


def test_a_flood_of_answers_to_a_polled_query_holds_up_nothing_else(fusion, peer):
    other, flooding = peer(), peer()
    flooding.answer("x/flood/status", lambda: [b"a" * 100] * 5_000)
    session, inbox, answers = fusion.sub_session(polled=True), fusion.inbox("x/posterior"), []
    assert until(lambda: fusion.ask("x/flood/status", 0.2))
    session.request("x/*/status", lambda key, payload: answers.append(payload), SOON_S)
    publisher_to(other, "x/posterior").put(b"judged")
    flooding.publisher("x/posterior").put(b"after the answers")
    # Nobody polls: the session goes on all the same.
    assert set(payloads(inbox, 2)) == {b"judged", b"after the answers"}
    # Answers and puts take ways of their own: on a busy machine the puts may be first.
    assert until(lambda: session.poll() or answers)
    assert len(answers) <= 256


def test_of_a_flood_of_answers_a_listener_keeps_only_so_much(fusion, peer, monkeypatch):
    monkeypatch.setattr("common.subsession.ANSWERS_BYTES", 100_000)
    peer().answer("x/status", lambda: [b"a" * 60_000] * 20 + [b"b" * 70_000])
    assert [len(payload) for _, payload in until(lambda: fusion.ask_each("x/status", SOON_S))] == [60_000] * 2
