"""Metrics of every process, which docs/reference/metrics.md lists, and JSON log lines."""

import json
import logging
import re
import sys
from pathlib import Path
from types import SimpleNamespace

import pytest
from message_stage import NAMES, judgement, status, verdict
from prometheus_client.parser import text_string_to_metric_families

from common import SECOND_NS
from common.errors import BadInput
from common.lifecycle import JsonLines, as_json_line, formatter, log_to_stderr, set_log_identity
from common.messages import ObserverStatistics
from deploy.commands import with_ports
from deploy.launcher import Job
from fusion.instrumentation import ServerStep
from fusion.metrics import FusionMetrics
from hub.metrics import HubMetrics
from hub.scene_state import SceneState
from observer.runtime.metrics import ObserverMetrics

ROOT = Path(__file__).parents[2]
LABELS = {
    *("scene", "observer", "fusion", "hub", "role", "version", "state", "label", "reason", "kind", "le"),
    *("implementation", "major", "minor", "patchlevel", "generation"),
}


def test_each_job_has_the_next_port():
    jobs = [Job("[fuse]", ["fuse"]), Job("cam1", ["observe"], environment={"A": "b"}), Job("cam2", ["observe"])]
    listen = [job.environment.get("LABANMESH_METRICS_LISTEN") for job in with_ports(jobs, "0.0.0.0:9464")]
    assert listen == ["0.0.0.0:9464", "0.0.0.0:9465", "0.0.0.0:9466"]
    assert with_ports(jobs, "0.0.0.0:9464")[1].environment["A"] == "b"
    assert with_ports(jobs, "") == jobs
    with pytest.raises(BadInput, match="choose a lower port"):
        with_ports(jobs, "127.0.0.1:65534")
    assert {job.environment["LABANMESH_METRICS_LISTEN"] for job in with_ports(jobs, "[::1]:0")} == {"[::1]:0"}


def record(message, *arguments, **more):
    record = logging.LogRecord("labanmesh.fusion", logging.INFO, __file__, 1, message, arguments, None)
    record.__dict__.update(more)
    return record


def test_a_json_line_names_process_and_verdict():
    lines = JsonLines()
    lines.identity = {"scene": "dojo", "fusion": "first"}
    fields = json.loads(
        lines.format(record("verdict %s\n", "v1", verdict="v1", label="ok", agree=2, heard=3, ended=True))
    )
    assert re.match(r"\d{4}-\d\d-\d\dT\d\d:\d\d:\d\d\.\d{3}\+00:00$", fields.pop("at"))
    assert fields == {
        "level": "info", "logger": "labanmesh.fusion", "message": "verdict v1\n", "scene": "dojo", "fusion": "first",
        "verdict": "v1", "label": "ok", "agree": 2, "heard": 3, "ended": True,
    }  # fmt: skip
    assert "\n" not in lines.format(record("a stranger's\nword"))
    try:
        raise ValueError("wrong")
    except ValueError:
        failed = record("it broke")
        failed.exc_info = sys.exc_info()
    assert json.loads(lines.format(failed))["exception"].endswith("ValueError: wrong")


def test_the_environment_selects_the_log_format(monkeypatch, capsys):
    root = logging.getLogger()
    before, level = root.handlers[:], root.level
    try:
        text = r"\d\d:\d\d:\d\d WARNING labanmesh: hello"
        for form, begins in (("json", '{"at": "'), ("text", text), ("xml", text)):
            root.handlers[:] = []
            monkeypatch.setenv("LABANMESH_LOG_FORMAT", form)
            log_to_stderr()
            set_log_identity("dojo", "observer", "cam1")
            logging.getLogger("labanmesh").warning("hello")
            *warned, line = capsys.readouterr().err.splitlines()
            assert re.match(begins, line) and bool(warned) == (form == "xml")
            if form == "json":
                assert json.loads(line)["observer"] == "cam1" and json.loads(line)["scene"] == "dojo"
    finally:
        root.handlers[:] = before
        root.setLevel(level)


def test_a_line_of_output_becomes_json_unless_it_is():
    own = formatter("json").format(record("hello"))
    assert as_json_line("cam1", own) == own
    assert json.loads(as_json_line("cam1", "Traceback: {")) == {"process": "cam1", "message": "Traceback: {"}
    assert json.loads(as_json_line("cam1", "3")) == {"process": "cam1", "message": "3"}
    assert json.loads(as_json_line("cam1", "[" * 100_000))["process"] == "cam1"


OBSERVERS = {
    "cam1": ObserverStatistics(skew_s=0.01, rejected={"malformed": 2}),
    "x1": ObserverStatistics(rejected={"malformed": 3}),
}


def full_status():
    return status(last_frame_ns=SECOND_NS, skew_s=0.01, version="1", observers=OBSERVERS)


def every_metric():
    """Every metric of observer, fusion and hub as Prometheus parses it, by role."""
    observer = ObserverMetrics("dojo", "cam1", full_status)
    observer.record_frame(0.1, 0.01, sent=True, skipped=2)
    last, later_ns = judgement(), 2 * SECOND_NS
    member = SimpleNamespace(
        scene=SimpleNamespace(scene="dojo"),
        worker=SimpleNamespace(judgement=last),
        vocabulary=NAMES,
        status=SimpleNamespace(status=lambda now_ns: full_status()),
    )
    fusion, shared = FusionMetrics("fusion", member), FusionMetrics("north", None)
    words = [
        verdict(label="lunge", began_ns=0, decided_ns=SECOND_NS),
        verdict(stage="revised", revises="lunge", began_ns=0, decided_ns=later_ns),
        verdict(revises="lunge", began_ns=0, decided_ns=later_ns, ended_ns=later_ns),
    ]
    for metrics in (fusion, shared):
        metrics.record(ServerStep(words, 1, 1, 1, 4, 0.01))
    hub = HubMetrics("mqtt")
    hub.record(SceneState("dojo").fold(last, SECOND_NS), last)
    hub.record_connection(True)
    roles = {"observer": observer, "fusion": fusion, "fusion of many scenes": shared, "hub": hub}
    return {role: list(text_string_to_metric_families(m.exposition("")[0].decode())) for role, m in roles.items()}


def test_the_docs_list_every_metric_of_every_role():
    page = (ROOT / "docs/reference/metrics.md").read_text()
    rows = re.findall(r"^\| `(labanmesh_\w+)` \| (\w+) \| ([\w, ]+) \|", page, re.M)
    documented = {(role, name, kind) for name, kind, roles in rows for role in roles.split(", ")}
    exported = {
        (role, family.name + ("_total" if family.type == "counter" else ""), family.type)
        for role, families in every_metric().items()
        for family in families
        if family.name.startswith("labanmesh_") and not family.name.endswith("_created")
    }
    assert documented == exported


def test_labels_are_from_the_scene_and_fixed_sets():
    for families in every_metric().values():
        for family in families:
            for sample in family.samples:
                assert family.name.startswith(("labanmesh_", "process_", "python_"))
                assert set(sample.labels) <= LABELS
                assert sample.labels.get("observer", "cam1") in ("cam1", "(others)")


def test_values_are_those_that_were_recorded():
    values = {
        (s.name, s.labels.get("observer"), s.labels.get("label") or s.labels.get("reason")): s.value
        for family in every_metric()["fusion"]
        for s in family.samples
    }
    assert values["labanmesh_verdicts_total", None, "bow"] == 1
    assert values["labanmesh_verdicts_total", None, "lunge"] == 0
    assert values["labanmesh_verdicts_total", None, "abstain"] == 0
    assert values["labanmesh_posteriors_rejected_total", "cam1", "malformed"] == 2
    assert values["labanmesh_posteriors_rejected_total", "(others)", "malformed"] == 3
    assert values["labanmesh_posteriors_dropped_total", None, None] == 4
    assert values["labanmesh_observer_entropy_bits", "cam1", None] == 0.5
    assert values["labanmesh_verdict_delay_seconds_sum", None, None] == 1.0, "until the first word"
    assert values["labanmesh_verdicts_revised_total", None, None] == 1
    assert values["labanmesh_movements_ended_total", None, None] == 1


def test_connections_count_each_time_the_broker_is_reached():
    hub = HubMetrics("mqtt")
    for now in (True, True, False, False, True):
        hub.record_connection(now)
    assert b'labanmesh_connections_total{hub="mqtt"} 2.0' in hub.exposition("")[0]
