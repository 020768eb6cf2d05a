"""/metrics, /healthz and /readyz of observer, fusion and hub: real loops between real Zenoh peers, asked over HTTP."""

import json
import logging
import re
import threading
import time
import urllib.error
import urllib.request
from contextlib import ExitStack
from itertools import count

import pytest
from mesh_stage import NAMED, SOON_S, FakePipeline, believed, running
from prometheus_client.openmetrics.parser import text_string_to_metric_families as openmetrics
from prometheus_client.parser import text_string_to_metric_families as plain

from common.config import MeshConfig, read_scene
from common.errors import BadInput, LabanmeshError
from common.link import Link
from fusion.server import serve as serve_fusion
from hub import healthcheck as hub_healthcheck
from hub.healthcheck import healthcheck
from hub.instrumentation import instrumented
from hub.session import listen
from observer.runtime.service import serve as serve_observer
from observer.tracks import Frame

OBSERVERS = ("cam1", "cam2")


class FakeCamera:
    """Gives the newest content 50 times a second until it is told to stop; `frozen` gives nothing."""

    def __init__(self):
        self.content, self.frozen = believed((0.999, 0.001), 0.0), False

    def frames(self, stop):
        while not stop.wait(0.02):
            if not self.frozen:
                yield Frame(time.time_ns(), self.content)


class Kept(logging.Handler):
    """What was logged."""

    def __init__(self):
        super().__init__()
        self.records = []

    def emit(self, record):
        self.records.append(record)


@pytest.fixture
def log():
    """The records of all rooms, from the first to the last; caplog begins anew with each phase of a test."""
    logger, kept = logging.getLogger("labanmesh"), Kept()
    before = logger.level
    logger.addHandler(kept)
    logger.setLevel(logging.INFO)
    yield kept.records
    logger.removeHandler(kept)
    logger.setLevel(before)


@pytest.fixture
def ports(log):
    """Where the next process, by the order in which they began, says that it answers."""
    numbers = count()

    def said():
        lines = (re.search(r"health at http://(\S+)", record.getMessage()) for record in list(log))
        return [found[1] for found in lines if found]

    def following():
        number = next(numbers)
        return until(lambda: said()[number:])[0]

    return following


def until(condition):
    """Look again, for a while, until it holds; returns what it gave."""
    waiting, last = threading.Event(), None
    for _ in range(int(SOON_S / 0.02)):
        last = condition()
        if last:
            return last
        waiting.wait(0.02)
    raise AssertionError("it never came to be so")


def ask(address, path, accept="text/plain"):
    request = urllib.request.Request(f"http://{address}{path}", headers={"Accept": accept})
    try:
        with urllib.request.urlopen(request, timeout=SOON_S) as answer:  # noqa: S310 - http, ours
            return answer.status, answer.read().decode()
    except urllib.error.HTTPError as error:
        with error:
            return error.code, error.read().decode()


def metrics(address):
    """name{label=value,...} -> value."""
    status, text = ask(address, "/metrics")
    assert status == 200
    return {
        (s.name, *(f"{k}={v}" for k, v in sorted(s.labels.items()) if k not in ("scene", "fusion", "hub"))): s.value
        for family in plain(text)
        for s in family.samples
    }


@pytest.fixture
def scene(tmp_path):
    def written(extra="", listen="127.0.0.1:0", mode="process", endpoint="tcp/127.0.0.1:0"):
        text = f'scene = "dojo"\n{extra}[mesh]\nmode = "{mode}"\nendpoint = "{endpoint}"\n'
        text += f'[metrics]\nlisten = "{listen}"\n[fusion]\nstep_hz = 50\nhold_s = 0.1\n'
        text += "".join(f'[observers.{name}]\nsource = "m.npz"\n' for name in OBSERVERS)
        (tmp_path / "s.toml").write_text(text)
        return read_scene(tmp_path / "s.toml", {})

    return written


@pytest.fixture
def stage(scene, ports):
    """A referee and two observers; gives where they answer, the cameras, and a further link."""
    read = scene(NAMED)
    with ExitStack() as opened:
        meeting = opened.enter_context(Link.open(read.mesh, "fusion"))
        mesh = MeshConfig(mode="process", endpoint=meeting.locator)
        opened.enter_context(running(serve_fusion, [read], read.fusion.id, meeting))
        at, cameras = {"fusion": ports(), "mesh": meeting.locator}, {}
        for name in OBSERVERS:
            link = opened.enter_context(Link.open(mesh, "observer"))
            cameras[name] = FakeCamera()
            opened.enter_context(running(serve_observer, read, name, FakePipeline(), cameras[name], link))
            at[name] = ports()
        hub = opened.enter_context(Link.open(mesh, "hub"))
        yield at, cameras, hub, read


def test_what_observers_and_the_referee_tell(stage, log):
    at, cameras, *_ = stage
    until(lambda: metrics(at["fusion"]).get(("labanmesh_votes", "state=counted")) == 2)
    until(lambda: any(hasattr(record, "verdict") for record in list(log)))
    for camera in cameras.values():
        camera.content = believed((0.999, 0.001), 1.0)
    decided = ("labanmesh_verdicts_total", "label=bowing")
    heard = until(lambda: (m := metrics(at["fusion"]))[decided] and m[("labanmesh_agreeing_observers",)] == 2 and m)
    assert heard["labanmesh_verdicts_total", "label=lunging"] == 0
    assert heard[("labanmesh_leading",)] == 1
    weights = [heard["labanmesh_observer_weight_ratio", f"observer={name}"] for name in OBSERVERS]
    assert sum(weights) == pytest.approx(1) and weights[0] == pytest.approx(weights[1])
    assert 0 <= heard["labanmesh_observer_entropy_bits", "observer=cam1"] < 0.1
    assert heard[("labanmesh_entropy_bits",)] < 0.2
    assert 0 <= heard["labanmesh_observer_age_seconds", "observer=cam1"] < 2
    assert heard[("labanmesh_verdict_delay_seconds_count",)] == 1
    assert heard["labanmesh_state", "state=running"] == 1 and heard["labanmesh_state", "state=failed"] == 0
    seen = metrics(at["cam2"])
    frames = seen["labanmesh_frames_total", "observer=cam2"]
    # Read while the loop goes on.
    assert seen["labanmesh_posteriors_total", "observer=cam2"] == pytest.approx(frames, abs=1) and frames > 1
    assert seen["labanmesh_frame_age_seconds_bucket", "le=5.0", "observer=cam2"] == pytest.approx(frames, abs=1)
    assert seen[("process_resident_memory_bytes",)] > 1e6
    verdicts = [r for r in list(log) if getattr(r, "verdict", None)]
    assert [(r.label, r.agree, r.heard, r.ended) for r in verdicts] == [("bowing", 2, 2, False), ("bowing", 2, 2, True)]
    assert len({r.verdict for r in verdicts}) == 1


def test_what_is_refused_is_counted_and_invented_names_are_one(stage):
    at, _, hub, read = stage
    for name in ("cam1", "stranger1", "stranger2"):
        mouth = hub.publisher(read.keys.posterior(name))
        assert mouth.wait_for_subscriber(SOON_S)
        mouth.put(b"nonsense")
    refused = "labanmesh_posteriors_rejected_total"
    told = until(
        lambda: (m := metrics(at["fusion"])).get((refused, "observer=(others)", "reason=not_msgpack")) == 2 and m
    )
    assert told[refused, "observer=cam1", "reason=not_msgpack"] == 1
    assert not [key for key in told if "stranger" in str(key)]


def test_the_text_is_prometheus_and_open_metrics(stage):
    at = stage[0]["fusion"]
    until(lambda: ("labanmesh_votes", "state=counted") in metrics(at))
    status, text = ask(at, "/metrics", "application/openmetrics-text; version=1.0.0")
    assert status == 200 and {"labanmesh_verdicts", "labanmesh_leading"} <= {f.name for f in openmetrics(text)}
    assert ask(at, "/")[0] == ask(at, "/secrets")[0] == 404


def test_alive_and_ready_and_why_not(stage):
    at, cameras, _, _ = stage
    until(lambda: ask(at["cam1"], "/readyz")[0] == 200)
    assert json.loads(ask(at["cam1"], "/readyz")[1]) == {
        "ok": True, "reason": "", "scene": "dojo", "role": "observer", "process": "cam1",
    }  # fmt: skip
    cameras["cam1"].frozen = True
    _, text = until(lambda: (a := ask(at["cam1"], "/readyz"))[0] == 503 and a)
    assert json.loads(text)["reason"].startswith("no frame for")
    assert ask(at["cam1"], "/healthz")[0] == 200, "two seconds without a frame are no reason to start it anew"
    assert ask(at["cam2"], "/readyz")[0] == ask(at["fusion"], "/readyz")[0] == 200


def test_fusion_without_a_vocabulary_is_alive_and_not_ready(scene, ports):
    read = scene()
    with Link.open(read.mesh, "fusion") as link, running(serve_fusion, [read], read.fusion.id, link):
        at = ports()
        assert ask(at, "/healthz")[0] == 200 and ask(at, "/metrics")[0] == 200
        status, text = ask(at, "/readyz")
        assert (status, json.loads(text)["reason"]) == (503, "asking the observers for their vocabulary")


def test_a_hub_tells_what_it_heard_and_what_it_reaches(stage, ports):
    _, _, hub, read = stage
    stop = threading.Event()
    with instrumented([read], "mqtt") as teller:
        own = ports()

        def hear():
            for heard in listen(read, hub, lambda: not stop.is_set()):
                teller.record(heard)

        teller.record_connection("the broker 127.0.0.1:1883", "connection refused")
        thread = threading.Thread(target=hear)
        thread.start()
        until(lambda: metrics(own).get(("labanmesh_messages_heard_total", "kind=judgement"), 0) > 3)
        assert metrics(own)[("labanmesh_connected",)] == 0
        assert json.loads(ask(own, "/readyz")[1])["reason"] == "the broker 127.0.0.1:1883: connection refused"
        teller.record_connection("the broker")
        until(lambda: ask(own, "/readyz")[0] == 200)
        told = metrics(own)
        assert told[("labanmesh_connected",)] == told[("labanmesh_connections_total",)] == 1
        assert told[("labanmesh_messages_rejected_total",)] == 0
        stop.set()
        thread.join(SOON_S)


def test_a_port_that_is_taken_is_one_line_and_the_process_goes_on(stage, scene, log):
    at = stage[0]["cam1"]
    with instrumented([scene(listen=at)], "mqtt") as teller:
        teller.record_connection("the broker")
    (line,) = [r.getMessage() for r in list(log) if r.levelno >= logging.WARNING and "metrics" in r.getMessage()]
    assert line.startswith(f"metrics.listen = '{at}': address already in use; going on without metrics; ")
    assert "\n" not in line and json.loads(ask(at, "/readyz")[1])["process"] == "cam1"


def test_healthcheck_asks_the_process_or_the_mesh(stage, scene, tmp_path, capsys, monkeypatch):
    at, cameras, *_ = stage
    until(lambda: ask(at["cam1"], "/readyz")[0] == 200)
    path = tmp_path / "s.toml"
    scene(listen=at["cam1"])
    healthcheck(path)
    assert capsys.readouterr().out == f"dojo, observer cam1 at {at['cam1']}: ready\n"
    scene(listen=at["fusion"])
    monkeypatch.setattr(
        hub_healthcheck.Address, "after", lambda self, n: self.parse(at[("fusion", "cam1", "cam2")[min(n, 2)]], "")
    )
    healthcheck(path, "cam2")
    assert capsys.readouterr().out == f"dojo, observer cam2 at {at['cam2']}: ready\n"
    with pytest.raises(LabanmeshError, match=r"^mqtt does not answer at .*; is it running"):
        healthcheck(path, "mqtt")
    cameras["cam1"].frozen = True
    until(lambda: ask(at["cam1"], "/readyz")[0] == 503)
    with pytest.raises(LabanmeshError, match=r"^dojo, observer cam1 at \S+: not ready: no frame for 2 s$"):
        healthcheck(path, "cam1")
    scene(listen="", endpoint=at["mesh"])
    healthcheck(path, "cam2")
    assert capsys.readouterr().out == "dojo: cam2 running\n"
    with pytest.raises(LabanmeshError, match=r"^dojo: cam1: degraded, no frame for \d s$"):
        healthcheck(path)
    with pytest.raises(BadInput, match=r"^--process dashboard: .*; set metrics.listen$"):
        healthcheck(path, "dashboard")
    with pytest.raises(BadInput, match=r"^--process cam3: not in .*; known: cam1, cam2, fusion, mqtt, dashboard$"):
        healthcheck(path, "cam3")
