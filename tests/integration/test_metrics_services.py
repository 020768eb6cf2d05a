"""/metrics, /healthz and /readyz of observer, fusion and hub: real loops between real Zenoh peers, asked over HTTP."""

import json
import logging
import re
import time
import urllib.error
import urllib.request
from itertools import count

import pytest
from mesh_stage import NAMED, FakePipeline, believed
from processes import SOON_S, until
from prometheus_client.openmetrics.parser import text_string_to_metric_families as openmetrics
from prometheus_client.parser import text_string_to_metric_families as plain

from common.config import read_scene
from common.errors import BadInput, LabanmeshError
from common.link import Link
from deploy.doctor import ready
from fusion.server import serve as serve_fusion
from hub.instrumentation import instrumented
from hub.session import listen
from labanmesh_testing.mesh import Mesh, running
from observer.runtime.service import serve as serve_observer
from observer.tracks import Frame

OBSERVERS = ("cam1", "cam2")


class FakeCamera:
    """Gives the newest content 50 times a second until it is stopped; none while it is frozen."""

    def __init__(self):
        self.content, self.frozen = believed((0.999, 0.001), 0.0), False

    def frames(self, stop):
        while not stop.wait(0.02):
            if not self.frozen:
                yield Frame(time.time_ns(), self.content)


@pytest.fixture
def log():
    """The records of all rooms, from the first to the last; caplog begins anew with each phase of a test."""
    logger, records = logging.getLogger("labanmesh"), []
    handler, before = logging.Handler(), logger.level
    handler.emit = records.append
    logger.addHandler(handler)
    logger.setLevel(logging.INFO)
    yield records
    logger.removeHandler(handler)
    logger.setLevel(before)


@pytest.fixture
def next_address(log):
    """The address of /metrics of the next process, in the order in which they start."""
    numbers = count()

    def addresses():
        lines = (re.search(r"health at http://(\S+)", record.getMessage()) for record in list(log))
        return [match[1] for match in lines if match]

    def wait():
        number = next(numbers)
        return until(lambda: addresses()[number:])[0]

    return wait


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
        text += f'[metrics]\nlisten = "{listen}"\n[fusion]\nstep_hz = 50\nhold_s = 0.1\nstart_s = 60\n'
        text += "".join(f'[observers.{name}]\nsource = "m.npz"\n' for name in OBSERVERS)
        (tmp_path / "s.toml").write_text(text)
        return read_scene(tmp_path / "s.toml", {})

    return written


@pytest.fixture
def stage(scene, next_address):
    """A fusion service and two observers: their addresses, the cameras, a hub's link, and the scene."""
    read = scene(NAMED)
    mesh = Mesh(read.mesh)
    mesh.run(serve_fusion, [read], read.fusion.id, mesh.meeting)
    at, cameras = {"fusion": next_address(), "mesh": mesh.meeting.locator}, {}
    for name in OBSERVERS:
        cameras[name] = FakeCamera()
        mesh.run(serve_observer, read, name, FakePipeline(), cameras[name], mesh.peer("observer"))
        at[name] = next_address()
    yield at, cameras, mesh.peer(), read
    mesh.close()


def test_the_metrics_of_observers_and_fusion(stage, log):
    at, cameras, *_ = stage
    until(lambda: metrics(at["fusion"]).get(("labanmesh_votes", "state=counted")) == 2)
    until(lambda: any(hasattr(record, "verdict") for record in list(log)))
    for camera in cameras.values():
        camera.content = believed((0.999, 0.001), 1.0)
    decided = ("labanmesh_verdicts_total", "label=bowing")
    fusion = until(lambda: (m := metrics(at["fusion"]))[decided] and m[("labanmesh_agreeing_observers",)] == 2 and m)
    assert fusion["labanmesh_verdicts_total", "label=lunging"] == 0
    assert fusion[("labanmesh_leading",)] == 1
    weights = [fusion["labanmesh_observer_weight_ratio", f"observer={name}"] for name in OBSERVERS]
    assert sum(weights) == pytest.approx(1) and weights[0] == pytest.approx(weights[1])
    assert 0 <= fusion["labanmesh_observer_entropy_bits", "observer=cam1"] < 0.1
    assert fusion[("labanmesh_entropy_bits",)] < 0.2
    assert 0 <= fusion["labanmesh_observer_age_seconds", "observer=cam1"] < 2
    assert fusion[("labanmesh_verdict_delay_seconds_count",)] == 1
    assert fusion["labanmesh_state", "state=running"] == 1 and fusion["labanmesh_state", "state=failed"] == 0
    observer = metrics(at["cam2"])
    frames = observer["labanmesh_frames_total", "observer=cam2"]
    # Read while the loop goes on.
    assert observer["labanmesh_posteriors_total", "observer=cam2"] == pytest.approx(frames, abs=1) and frames > 1
    assert observer["labanmesh_frame_age_seconds_bucket", "le=5.0", "observer=cam2"] == pytest.approx(frames, abs=1)
    assert observer[("process_resident_memory_bytes",)] > 1e6
    verdicts = [r for r in list(log) if getattr(r, "verdict", None)]
    assert [(r.label, r.agree, r.heard, r.ended) for r in verdicts] == [("bowing", 2, 2, False), ("bowing", 2, 2, True)]
    assert len({r.verdict for r in verdicts}) == 1
    status, text = ask(at["fusion"], "/metrics", "application/openmetrics-text; version=1.0.0")
    assert status == 200 and {"labanmesh_verdicts", "labanmesh_leading"} <= {f.name for f in openmetrics(text)}
    assert ask(at["fusion"], "/")[0] == ask(at["fusion"], "/secrets")[0] == 404


def test_an_observer_without_frames_is_alive_and_not_ready(stage):
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


def test_fusion_without_a_vocabulary_is_alive_and_not_ready(scene, next_address):
    read = scene()
    with Link.open(read.mesh, "fusion") as link, running(serve_fusion, [read], read.fusion.id, link):
        at = next_address()
        assert ask(at, "/healthz")[0] == 200 and ask(at, "/metrics")[0] == 200
        status, text = ask(at, "/readyz")
        assert (status, json.loads(text)["reason"]) == (503, "asking the observers for their vocabulary")


def test_a_hub_counts_messages_and_reports_its_connection(stage, next_address):
    _, _, hub, read = stage
    with instrumented([read], "mqtt") as instrumentation:
        own = next_address()

        def record(stop):
            for update in listen(read, hub, lambda: not stop.is_set()):
                instrumentation.record(update)

        instrumentation.record_connection("the broker 127.0.0.1:1883", "connection refused")
        with running(record):
            until(lambda: metrics(own).get(("labanmesh_messages_heard_total", "kind=judgement"), 0) > 3)
            assert metrics(own)[("labanmesh_connected",)] == 0
            assert json.loads(ask(own, "/readyz")[1])["reason"] == "the broker 127.0.0.1:1883: connection refused"
            instrumentation.record_connection("the broker")
            until(lambda: ask(own, "/readyz")[0] == 200)
            values = metrics(own)
            assert values[("labanmesh_connected",)] == values[("labanmesh_connections_total",)] == 1
            assert values[("labanmesh_messages_rejected_total",)] == 0


def test_a_port_that_is_taken_is_one_line_and_the_process_goes_on(stage, scene, log):
    at = stage[0]["cam1"]
    with instrumented([scene(listen=at)], "mqtt") as instrumentation:
        instrumentation.record_connection("the broker")
    (line,) = [r.getMessage() for r in list(log) if r.levelno >= logging.WARNING and "metrics" in r.getMessage()]
    assert line.startswith(f"metrics.listen = '{at}': address already in use; going on without metrics; ")
    assert "\n" not in line and json.loads(ask(at, "/readyz")[1])["process"] == "cam1"


def test_ready_asks_the_process_or_the_mesh(stage, scene, tmp_path, capsys, monkeypatch):
    at, cameras, *_ = stage
    until(lambda: ask(at["cam1"], "/readyz")[0] == 200)
    path = tmp_path / "s.toml"
    scene(listen=at["cam1"])
    ready.ready(path)
    assert capsys.readouterr().out == f"dojo, observer cam1 at {at['cam1']}: ready\n"
    scene(listen=at["fusion"])
    monkeypatch.setattr(
        ready.Address, "after", lambda self, n: self.parse(at[("fusion", "cam1", "cam2")[min(n, 2)]], "")
    )
    ready.ready(path, "cam2")
    assert capsys.readouterr().out == f"dojo, observer cam2 at {at['cam2']}: ready\n"
    with pytest.raises(LabanmeshError, match=r"^mqtt does not answer at .*; is it running"):
        ready.ready(path, "mqtt")
    cameras["cam1"].frozen = True
    until(lambda: ask(at["cam1"], "/readyz")[0] == 503)
    with pytest.raises(LabanmeshError, match=r"^dojo, observer cam1 at \S+: not ready: no frame for 2 s$"):
        ready.ready(path, "cam1")
    scene(listen="", endpoint=at["mesh"])
    ready.ready(path, "cam2")
    assert capsys.readouterr().out == "dojo: cam2 running\n"
    with pytest.raises(LabanmeshError, match=r"^dojo: cam1: degraded, no frame for \d s$"):
        ready.ready(path)
    with pytest.raises(BadInput, match=r"^--process dashboard: .*; set metrics.listen$"):
        ready.ready(path, "dashboard")
    with pytest.raises(BadInput, match=r"^--process cam3: not in .*; known: cam1, cam2, fusion, .*, events$"):
        ready.ready(path, "cam3")
