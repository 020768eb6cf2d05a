"""What a scene file's facts mean: does it hang together with the files that it names. Pure.

In a scene over a router observers may run elsewhere: unless somebody says which run here, what one of them lacks is a
warning and no error.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Final

from common.vocabulary import Vocabulary
from deploy.doctor.finding import Finding, Mark, error, ok, told, warning
from deploy.doctor.origin import DEFAULT, FILE, Setting

if TYPE_CHECKING:
    from common.config import Scene

GROUP: Final = "the scene file"
WAY_OUT = "correct the scene file; docs/reference/scene.md has every key"
ELSEWHERE = "if it runs on another machine, name this one's: --observers ID,ID (or none)"


@dataclass(frozen=True, slots=True)
class Examined:
    """One observer, as the observer room found it: `observer/runtime/preflight.py`."""

    observer: str
    source: str
    reads: str
    labels: Sequence[str]
    rate_hz: float | None
    faults: Sequence[str]
    doubts: Sequence[str]
    lacks: Sequence[str] = ()


@dataclass(frozen=True, slots=True)
class SceneFacts:
    """A scene file that could be read. path: its name. here: the observers of this machine; certain: somebody said so.

    trouble: why observers were not examined; "" where all were.
    """

    path: str
    scene: "Scene"
    settings: Sequence[Setting]
    here: Sequence[str]
    certain: bool
    examined: Mapping[str, Examined] = field(default_factory=dict)
    trouble: str = ""


def findings(facts: SceneFacts) -> list[Finding]:
    """All that is to be said of a scene file."""
    return [*_whole(facts), *_overridden(facts.settings), *_observers(facts), *_vocabularies(facts)]


def unreadable(fault: str) -> Finding:
    """What is said of a file that is no scene file, in the one line of the error."""
    return told(GROUP, "error", fault, WAY_OUT)


def _whole(facts: SceneFacts) -> Iterator[Finding]:
    scene = facts.scene
    many = f"{len(scene.roster)} observer{'s' * (len(scene.roster) != 1)}"
    yield ok(GROUP, f"{facts.path}: scene {scene.scene}, {many} ({', '.join(scene.roster)}), mesh {scene.mesh.mode}")
    if scene.mesh.mode == "process":
        what = 'mesh.mode = "process": several processes cannot meet so; it is for tests'
        yield error(GROUP, what, 'choose mode = "machine" or "router" under [mesh]')


def _overridden(settings: Sequence[Setting]) -> Iterator[Finding]:
    for setting in settings:
        if setting.origin not in (DEFAULT, FILE):
            yield ok(GROUP, f"{setting.key} = {setting.value}, by the environment variable {setting.origin}")


def _observers(facts: SceneFacts) -> Iterator[Finding]:
    mark: Mark = "error" if facts.certain else "warning"
    for observer in facts.here:
        found = facts.examined.get(observer)
        if found is None:
            why = facts.trouble or "it took too long"
            yield warning(GROUP, f"{observer}: not examined: {why}", f"labanmesh observe {facts.path} {observer}")
            continue
        for fault in found.faults:
            yield told(GROUP, mark, f"{observer}: {fault}", WAY_OUT)
        for doubt in found.doubts:
            yield told(GROUP, "warning", f"{observer}: {doubt}", WAY_OUT)
        if not found.faults and not found.lacks:
            rate = f" at {found.rate_hz:g} Hz" if found.rate_hz else ""
            yield ok(GROUP, f"{observer}: {found.source}, model of {len(found.labels)} movements{rate}")
    if not facts.certain and any(found.faults or found.lacks for found in facts.examined.values()):
        yield warning(GROUP, "observers lack something here, and may be meant for other machines", ELSEWHERE)


def _vocabularies(facts: SceneFacts) -> Iterator[Finding]:
    """Whether the models speak of the same movements; each against the scene's own is the examination's affair."""
    speaking: dict[tuple[str, ...], list[str]] = {}
    for name, found in facts.examined.items():
        if found.labels:
            speaking.setdefault(tuple(found.labels), []).append(name)
    if facts.scene.named_vocabulary is not None or not speaking:
        return
    if len(speaking) == 1:
        (labels,) = speaking
        yield ok(GROUP, f"vocabulary of the models: {', '.join(labels)} ({Vocabulary(labels).digest})")
        return
    (most, _), *others = sorted(speaking.items(), key=lambda pair: -len(pair[1]))
    for labels, names in others:
        what = f"{', '.join(names)}: learned for [{', '.join(labels)}], {speaking[most][0]} for [{', '.join(most)}]"
        yield error(GROUP, what, "learn all models from the same movements: labanmesh learn")
