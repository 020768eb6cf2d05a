"""Whether an installed version is one that labanmesh asks for: the simple part of Python's requirement lines. Pure."""

import re
from collections.abc import Iterable, Iterator
from dataclasses import dataclass

REQUIREMENT = re.compile(r"(?P<name>[\w.-]+)(\[[^]]*\])?\s*(?P<bounds>[^;]*?)\s*(;\s*(?P<marker>.*))?\Z")
BOUND = re.compile(r"(<=|>=|==|!=|<|>)\s*([\d.]+)")
EXTRA = re.compile(r"""extra\s*==\s*["']([\w-]+)["']""")
PYTHON = re.compile(r"""python_version\s*(<=|>=|==|!=|<|>)\s*["']([\d.]+)["']""")


@dataclass(frozen=True, slots=True)
class Requirement:
    """One distribution that is asked for, within `bounds` ("<2,>=1.6"); extra: "" for the plain install."""

    name: str
    bounds: str
    extra: str = ""


def requirements(lines: Iterable[str], python: str) -> Iterator[Requirement]:
    """What the lines of a distribution's metadata ask for on this `python` ("3.11"), labanmesh itself left out."""
    for line in lines:
        found = REQUIREMENT.match(line.strip())
        if found is None or found["name"] == "labanmesh":
            continue
        marker = found["marker"] or ""
        extra = EXTRA.search(marker)
        if all(_holds(python, *bound) for bound in PYTHON.findall(marker)):
            yield Requirement(found["name"], found["bounds"], extra[1] if extra else "")


def fits(version: str, bounds: str) -> bool:
    """Whether the numbers of `version` are within `bounds`; what stands behind them (rc1, +local) is not looked at."""
    return all(_holds(version, *bound) for bound in BOUND.findall(bounds))


def _holds(version: str, relation: str, limit: str) -> bool:
    here, there = _numbers(version), _numbers(limit)
    longest = max(len(here), len(there))
    a, b = (numbers + (0,) * (longest - len(numbers)) for numbers in (here, there))
    return {"<": a < b, "<=": a <= b, ">": a > b, ">=": a >= b, "==": a == b, "!=": a != b}[relation]


def _numbers(version: str) -> tuple[int, ...]:
    found = re.match(r"\d+(\.\d+)*", version)
    return tuple(int(part) for part in found[0].split(".")) if found else ()
