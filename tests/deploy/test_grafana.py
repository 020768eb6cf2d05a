"""The Grafana dashboard against the metrics of the processes: names, labels, and the places of panels."""

import json
import re
from pathlib import Path

ROOT = Path(__file__).parents[2]
DASHBOARD = json.loads((ROOT / "deploy" / "grafana" / "labanmesh.json").read_text("utf-8"))
PANELS = [panel for panel in DASHBOARD["panels"] if panel["type"] != "row"]
EXPRESSIONS = [target["expr"] for panel in PANELS for target in panel["targets"]]
SUFFIXES = ("_bucket", "_count", "_sum")
NAME = r"\b(?:labanmesh|process|python)_\w+"
OF_THE_CLIENT = {"process_cpu_seconds_total", "process_resident_memory_bytes"}


def documented():
    """Every metric with its labels, as the page has them; another test compares the page with the processes."""
    page = (ROOT / "docs" / "reference" / "metrics.md").read_text("utf-8")
    rows = re.findall(r"^\| `(labanmesh_\w+)` \| (\w+) \| ([\w, ]+) \| ([\w, ]*) ?\|", page, re.MULTILINE)
    return {
        name: {"scene", *roles.split(", "), *filter(None, labels.strip().split(", "))}
        for name, _, roles, labels in rows
    }


def names_in(expression):
    """The metrics of an expression, without the words in its label matchers."""
    names = re.findall(NAME, re.sub(r"\{[^}]*\}", "", expression))
    return [next((name.removesuffix(end) for end in SUFFIXES if name.endswith(end)), name) for name in names]


def test_every_expression_is_about_metrics_that_exist():
    assert len(EXPRESSIONS) >= 20
    for expression in EXPRESSIONS:
        names = names_in(expression)
        assert names, expression
        assert set(names) <= {*documented(), *OF_THE_CLIENT}, expression


def test_labels_in_legends_and_matchers_are_carried():
    labels = documented()
    for panel in PANELS:
        for target in panel["targets"]:
            known = set().union({"le", "instance"}, *(labels.get(name, set()) for name in names_in(target["expr"])))
            asked = re.findall(r"\{\{(\w+)\}\}", target["legendFormat"]) + re.findall(r"(\w+)=~?\"", target["expr"])
            asked += [
                w
                for inside in re.findall(r"(?:by|on|group_left) \(([^)]*)\)", target["expr"])
                for w in inside.split(", ")
            ]
            assert set(asked) <= known, (panel["title"], set(asked) - known)
