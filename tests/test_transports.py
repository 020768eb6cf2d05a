"""The comparison of transports: what its figures and its table say, and, where the tools are, real runs over each."""

import importlib.util
import os
from pathlib import Path

import msgpack
import pytest

from benchmarks.comparisons.transports import clients
from benchmarks.comparisons.transports.actors import ReceivedJudgement
from benchmarks.comparisons.transports.clients import KINDS, AvailableKinds, available
from benchmarks.comparisons.transports.stage import (
    LADDER_HZ,
    flooded,
    judgement,
    latencies,
    names,
    paced,
    posteriors,
)
from common.messages import JudgementMessage, PosteriorMessage
from common.wire import decode

ROOT = Path(__file__).parents[1]
LONG = "LABANMESH_TRANSPORTS" in os.environ
long_only = pytest.mark.skipif(not LONG, reason="many processes: make test-transports runs it")


def test_latency_is_the_time_to_the_first_judgement_with_a_message_or_a_later_one():
    put_ns = {"cam1": [100, 200, 300, 400], "cam2": [150, 250]}
    received = [(90, {"cam1": 0}), (110, {"cam1": 1, "cam9": 7}), (320, {"cam1": 3, "cam2": 1}), (330, {"cam1": 2})]
    # cam1's fourth and cam2's second are in no judgement; a keep-alive, 0, and an older number are nothing new.
    assert latencies(put_ns, [ReceivedJudgement(*one) for one in received]) == [10, 120, 20, 170]


def test_the_traffic_is_posteriors_and_a_judgement_of_the_wire():
    messages = [decode(PosteriorMessage, payload) for payload in posteriors("cam2", 3)]
    assert [(one.observer, one.seq, len(one.p)) for one in messages] == [("cam2", seq, 20) for seq in range(4)]
    assert len({tuple(one.p) for one in messages}) == 4
    assert set(decode(JudgementMessage, judgement(4)).votes) == set(names(4))
    assert "newest" not in msgpack.unpackb(judgement(4)), "the benchmark adds this key; the wire must not have it"


def test_a_transport_that_lacks_something_is_left_out_and_says_how_to_get_it(monkeypatch):
    monkeypatch.setattr(importlib.util, "find_spec", lambda name: None if name == "zmq" else object())
    monkeypatch.setattr(clients, "program", lambda name: None if name == "nats-server" else name)
    assert available(list(KINDS)) == AvailableKinds(
        ["ours", "zenoh", "mqtt"],
        [
            "NATS is left out: nats-server is not installed; apt-get install nats-server",
            "ZeroMQ is left out: Python finds no zmq; pip install 'labanmesh[transports]'",
        ],
    )


def require(name):
    if KINDS[name].lacks:
        pytest.skip(KINDS[name].lacks)


@pytest.mark.parametrize("name", ["ours", *(pytest.param(n, marks=long_only) for n in KINDS if n != "ours")])
def test_every_posterior_at_60_hz_is_judged_over_each_transport(name):
    require(name)
    measured = paced(name, 2, 1, 12)
    assert measured["arrived"] == 1.0
    assert 0 < measured["median_ms"] <= measured["p99_ms"] < 5_000
    assert 0 < measured["link_ms"] < measured["start_ms"]
    # No framing is free, none is as long as the message.
    size = len(posteriors("cam1", 1)[1])
    assert size < measured["sent_bytes"] < 2 * size


@long_only
@pytest.mark.parametrize("name", KINDS)
def test_as_fast_as_they_can_over_each_transport(name, monkeypatch):
    require(name)
    monkeypatch.setattr("benchmarks.comparisons.transports.stage.LADDER_HZ", (500.0,))
    measured = flooded(name, 2, 0.5)
    assert measured["whole_hz"] in (0.0, 500.0) and LADDER_HZ[0] > 500
    assert 0 < measured["arrived"] <= 1.0
    assert measured["taken_hz"] > 0
    assert measured["receiver_us"] > 0 and measured["publisher_us"] > 0
    assert ("broker_us" in measured) == bool(KINDS[name].broker)
