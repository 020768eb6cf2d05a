"""The doctor's findings, the settings in force, and how they are shown: a page for people, JSON for programs. Pure."""

import json
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, field, replace
from typing import TYPE_CHECKING, Any, Literal, get_args

from common.config_input import PREFIX, Place
from common.message_types import printable
from common.text import plural, without_secrets

if TYPE_CHECKING:
    from common.config import Scene

Mark = Literal["ok", "hint", "warning", "error"]
Group = Literal["this machine", "the scene file", "cameras", "network", "security", "the mesh", "Home Assistant"]
GROUPS: tuple[Group, ...] = get_args(Group)
MARKS: tuple[Mark, ...] = get_args(Mark)
"""From good to bad."""
MARK_WIDTH = max(map(len, MARKS))
JSON_VERSION = 1
DEFAULT, FILE = "default", "file"


@dataclass(frozen=True, slots=True)
class Finding:
    """One finding. what: the state of affairs, one line. to_do: the way out, one line; "" for the mark "ok".

    group: None until all checks have run.
    """

    group: Group | None = field(default=None, kw_only=True)
    mark: Mark
    what: str
    to_do: str = ""


@dataclass(frozen=True, slots=True)
class EffectiveSetting:
    """One key. value: as the file would have it. origin: "default", "file", or the environment variable's name."""

    key: str
    value: str
    origin: str


def of_group(group: Group, findings: Iterable[Finding]) -> list[Finding]:
    """The findings under this heading, those under another one unchanged."""
    return [each if each.group else replace(each, group=group) for each in findings]


def ok(what: str) -> Finding:
    """All is well with `what`."""
    return Finding("ok", what)


def hint(what: str, to_do: str) -> Finding:
    """Everything works; there is something that the user may also want."""
    return Finding("hint", what, to_do)


def warning(what: str, to_do: str) -> Finding:
    """It works, or may work, but the user should know."""
    return Finding("warning", what, to_do)


def error(what: str, to_do: str) -> Finding:
    """It does not work until the user does `to_do`."""
    return Finding("error", what, to_do)


def from_fault(mark: Mark, fault: str, way_out: str) -> Finding:
    """A finding from the one line of a labanmesh error, "fault; way out"; `way_out` where that line names none."""
    line = " ".join(fault.split())
    what, separator, to_do = line.partition("; ")
    if separator:
        return Finding(mark, what, to_do)
    what, separator, to_do = line.rpartition(": ")
    if separator and to_do.startswith(("learn", "labanmesh")):
        return Finding(mark, what, to_do)
    return Finding(mark, line, way_out)


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
    counts = [(mark, sum(finding.mark == mark for finding in findings)) for mark in ("error", "warning")]
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


def settings_in_force(
    scene: "Scene", table: Mapping[str, Any], environment: Mapping[str, str]
) -> list[EffectiveSetting]:
    """Every key of `scene`, which was read from `table`, the file as TOML has it, and the environment."""
    settings = []
    for place, value in _leaves(scene.model_dump()):
        variable = PREFIX + "_".join(place).upper().replace("-", "_")
        origin = variable if variable in environment else FILE if _is_set(table, place) else DEFAULT
        settings.append(EffectiveSetting(".".join(place), _as_written(value), origin))
    return settings


def _leaves(table: Mapping[str, Any], place: Place = ()) -> Iterator[tuple[Place, object]]:
    for name, value in table.items():
        if isinstance(value, Mapping):
            yield from _leaves(value, (*place, name))
        else:
            yield (*place, name), value


def _is_set(table: object, place: Place) -> bool:
    for part in place:
        if not isinstance(table, Mapping) or part not in table:
            return False
        table = table[part]
    return True


def _as_written(value: object) -> str:
    if value is None:
        return "not set"
    return json.dumps(without_secrets(value) if isinstance(value, str) else value, ensure_ascii=False)
