"""The Grafana dashboard against the metrics of the processes: names, labels, and the places of panels."""

import json
import re
from itertools import combinations
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


def test_counters_are_shown_as_rates_and_parentheses_close():
    for expression in EXPRESSIONS:
        assert expression.count("(") == expression.count(")") and expression.count("{") == expression.count("}")
        for name in re.findall(r"\w+_total|\w+_bucket", expression):
            assert re.search(rf"(rate|increase)\({name}", expression), expression


def test_panels_do_not_overlap_and_each_has_a_name():
    assert len({panel["title"] for panel in PANELS}) == len(PANELS)
    assert len({panel["id"] for panel in DASHBOARD["panels"]}) == len(DASHBOARD["panels"])
    for one, other in combinations([panel["gridPos"] for panel in DASHBOARD["panels"]], 2):
        beside = one["x"] + one["w"] <= other["x"] or other["x"] + other["w"] <= one["x"]
        assert beside or one["y"] + one["h"] <= other["y"] or other["y"] + other["h"] <= one["y"]
    assert all(panel["gridPos"]["x"] + panel["gridPos"]["w"] <= 24 for panel in PANELS)


def test_the_data_source_and_the_scene_are_chosen_by_the_reader():
    names = {variable["name"]: variable for variable in DASHBOARD["templating"]["list"]}
    assert set(names) == {"datasource", "scene"} and names["scene"]["allValue"] == ".*"
    for panel in PANELS:
        assert {target["datasource"]["uid"] for target in panel["targets"]} == {"${datasource}"}
