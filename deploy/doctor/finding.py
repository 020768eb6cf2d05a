"""What doctor has found, one thing at a time: how it is, what it is, what to do about it. Pure."""

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Literal, get_args

Mark = Literal["ok", "warning", "error"]
Group = Literal["this machine", "the scene file", "cameras", "network", "security", "the mesh"]
GROUPS: tuple[Group, ...] = get_args(Group)
MARKS: tuple[Mark, ...] = get_args(Mark)
"""From good to bad."""


@dataclass(frozen=True, slots=True)
class Finding:
    """One thing. what: how it is, one line. to_do: the way out, one line; "" where nothing need be done."""

    group: Group
    mark: Mark
    what: str
    to_do: str = ""


def ok(group: Group, what: str) -> Finding:
    """All is well with `what`."""
    return Finding(group, "ok", what)


def warning(group: Group, what: str, to_do: str) -> Finding:
    """It works, or may, and somebody should know."""
    return Finding(group, "warning", what, to_do)


def error(group: Group, what: str, to_do: str) -> Finding:
    """It does not work."""
    return Finding(group, "error", what, to_do)


def told(group: Group, mark: Mark, fault: str, way_out: str) -> Finding:
    """A fault in the one line that labanmesh's errors have, "value: rule; way out"; `way_out` where it names none."""
    line = " ".join(fault.split())
    what, found, to_do = line.partition("; ")
    if found:
        return Finding(group, mark, what, to_do)
    what, found, to_do = line.rpartition(": ")
    if found and to_do.startswith(("learn", "labanmesh")):
        return Finding(group, mark, what, to_do)
    return Finding(group, mark, line, way_out)


def worst(findings: Iterable[Finding]) -> Mark:
    """The worst mark; "ok" where there is none."""
    return max((finding.mark for finding in findings), key=MARKS.index, default="ok")
