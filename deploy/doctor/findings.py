"""The doctor's findings, and how they are shown: a page for people, JSON for programs. Pure."""

import json
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import asdict, dataclass
from typing import Literal, get_args

from common.text import plural
from deploy.doctor.settings import EffectiveSetting

Mark = Literal["ok", "warning", "error"]
Group = Literal["this machine", "the scene file", "cameras", "network", "security", "the mesh"]
GROUPS: tuple[Group, ...] = get_args(Group)
MARKS: tuple[Mark, ...] = get_args(Mark)
"""From good to bad."""
MARK_WIDTH = max(map(len, MARKS))
JSON_VERSION = 1


@dataclass(frozen=True, slots=True)
class Finding:
    """One finding. what: the state of affairs, one line. to_do: the way out, one line; "" for the mark "ok"."""

    group: Group
    mark: Mark
    what: str
    to_do: str = ""


def ok(group: Group, what: str) -> Finding:
    """All is well with `what`."""
    return Finding(group, "ok", what)


def warning(group: Group, what: str, to_do: str) -> Finding:
    """It works, or may work, and somebody should know."""
    return Finding(group, "warning", what, to_do)


def error(group: Group, what: str, to_do: str) -> Finding:
    """It does not work."""
    return Finding(group, "error", what, to_do)


def from_fault(group: Group, mark: Mark, fault: str, way_out: str) -> Finding:
    """A finding from the one line of a labanmesh error, "fault; way out"; `way_out` where that line names none."""
    line = " ".join(fault.split())
    what, separator, to_do = line.partition("; ")
    if separator:
        return Finding(group, mark, what, to_do)
    what, separator, to_do = line.rpartition(": ")
    if separator and to_do.startswith(("learn", "labanmesh")):
        return Finding(group, mark, what, to_do)
    return Finding(group, mark, line, way_out)


def worst(findings: Iterable[Finding]) -> Mark:
    """The worst mark; "ok" where there is none."""
    return max((finding.mark for finding in findings), key=MARKS.index, default="ok")


def page(findings: Sequence[Finding], settings: Sequence[EffectiveSetting] = ()) -> Iterator[tuple[str, Mark | None]]:
    """The lines for people, each with its mark, if it has one: group by group, the summary last."""
    for group in GROUPS:
        of_group = [finding for finding in findings if finding.group == group]
        if of_group:
            yield group, None
        for finding in of_group:
            yield f"  {finding.mark:<{MARK_WIDTH}}  {printable(finding.what)}", finding.mark
            if finding.to_do:
                yield f"  {'':<{MARK_WIDTH}}  -> {printable(finding.to_do)}", None
    if settings:
        yield "settings in force, and where each came from", None
        width = max(len(setting.key) for setting in settings)
        for setting in settings:
            yield f"  {setting.key:<{width}} = {printable(setting.value)}  ({setting.origin})", None
    yield summary(findings), worst(findings)


def summary(findings: Sequence[Finding]) -> str:
    """`1 error, 2 warnings`, or that all is well."""
    counts = [(mark, sum(finding.mark == mark for finding in findings)) for mark in reversed(MARKS[1:])]
    return ", ".join(plural(count, mark) for mark, count in counts if count) or "all is well"


def as_json(findings: Sequence[Finding], labanmesh: str, settings: Sequence[EffectiveSetting] = ()) -> str:
    """One JSON object: version, labanmesh, worst, findings (group, mark, what, to_do), settings (key, value, origin).

    version is that of this form, labanmesh that of the program.
    """
    report = {
        "version": JSON_VERSION,
        "labanmesh": labanmesh,
        "worst": worst(findings),
        "findings": [asdict(finding) for finding in findings],
        "settings": [asdict(setting) for setting in settings],
    }
    return json.dumps(report, indent=2)


def printable(text: str) -> str:
    """`text` without characters that could steer a terminal: it may come from strangers."""
    return "".join(character if character.isprintable() else "?" for character in text)
