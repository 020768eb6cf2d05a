"""The findings as a page for people, and as JSON for programs. Pure."""

import json
from collections.abc import Iterator, Sequence

from deploy.doctor.finding import GROUPS, MARKS, Finding, Mark, worst
from deploy.doctor.origin import Setting

WIDTH = max(map(len, MARKS))
VERSION = 1
"""Of the JSON's form."""


def page(findings: Sequence[Finding], settings: Sequence[Setting] = ()) -> Iterator[tuple[str, Mark | None]]:
    """The lines, each with the mark that it stands for, if any: group by group, last what it comes to."""
    for group in GROUPS:
        of_group = [finding for finding in findings if finding.group == group]
        if of_group:
            yield group, None
        for finding in of_group:
            yield f"  {finding.mark:<{WIDTH}}  {printable(finding.what)}", finding.mark
            if finding.to_do:
                yield f"  {'':<{WIDTH}}  -> {printable(finding.to_do)}", None
    if settings:
        yield "what counts, and where it came from", None
        width = max(len(setting.key) for setting in settings)
        for setting in settings:
            yield f"  {setting.key:<{width}} = {printable(setting.value)}  ({setting.origin})", None
    yield summary(findings), worst(findings)


def summary(findings: Sequence[Finding]) -> str:
    """`1 error, 2 warnings`, or that all is well."""
    counted = [(mark, sum(finding.mark == mark for finding in findings)) for mark in reversed(MARKS[1:])]
    said = [f"{count} {mark}{'s' * (count != 1)}" for mark, count in counted if count]
    return ", ".join(said) or "all is well"


def as_json(findings: Sequence[Finding], labanmesh: str, settings: Sequence[Setting] = ()) -> str:
    """One JSON object: version, labanmesh, worst, findings (group, mark, what, to_do), settings (key, value, origin).

    version is that of this form, labanmesh that of the program.
    """
    said = {
        "version": VERSION,
        "labanmesh": labanmesh,
        "worst": worst(findings),
        "findings": [
            {"group": each.group, "mark": each.mark, "what": each.what, "to_do": each.to_do} for each in findings
        ],
        "settings": [{"key": each.key, "value": each.value, "origin": each.origin} for each in settings],
    }
    return json.dumps(said, indent=2)


def printable(text: str) -> str:
    """`text` without characters that could steer a terminal: strangers' words are shown, never obeyed."""
    return "".join(character if character.isprintable() else "?" for character in text)
