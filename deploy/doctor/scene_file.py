"""A scene file and the files that it names: can they be read, do they fit each other. The checks are pure.

In a scene over a router observers may run elsewhere: unless the user says which run here, a fault of one of them is a
warning and no error.
"""

import json
import os
import shlex
import subprocess
import sys
import tomllib
from collections.abc import Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path

from common.config import MODELS_VARIABLE, Scene, sound_part
from common.errors import BadInput, Faults, reason_of
from common.message_checks import largest_judgement, require_fits
from common.text import plural
from common.vocabulary import Vocabulary
from common.wire import SIZE_LIMIT
from deploy.doctor.findings import (
    DEFAULT,
    FILE,
    EffectiveSetting,
    Finding,
    Mark,
    error,
    from_fault,
    hint,
    ok,
    settings_in_force,
    warning,
)
from deploy.hubs import hub_words

PREFLIGHT = (sys.executable, "-P", "-m")
PREFLIGHT_S = 30.0
"""Four observers take 1 to 2 s on two free cores; 10 s were too few at a load of 13 on cores of half that speed."""
SCENE_WAY_OUT = "correct the scene file; docs/reference/scene.md has every key"
NEARLY_FULL = 0.75
"""Of a message's size: from here on one more observer or movement may be too much."""
NOT_HERE = "if it runs on another machine, name this one's: --observers ID,ID (or none)"


@dataclass(frozen=True, slots=True)
class PreflightReport:
    """One observer's report: `observer/runtime/preflight.py`. Packages that it lacks are findings on the machine."""

    observer: str
    source: str
    reads: str
    labels: Sequence[str]
    rate_hz: float | None
    faults: Sequence[str]
    doubts: Sequence[str]
    lacks: Sequence[str] = ()
    kind: str = ""
    taught_from: str = ""
    tracker: str = ""
    lacks_tracker: str = ""
    blends_only: bool = False


@dataclass(frozen=True, slots=True)
class FolderFacts:
    """Where an observer keeps its clips, or what it was taught, and whether this user can write there."""

    path: Path
    writable: bool


@dataclass(frozen=True, slots=True)
class SceneFacts:
    """A scene file that could be read. path: its name. here: the observers of this machine; certain: the user said so.

    trouble: why observers have no report; "" where all have one. clip_folders: of the observers that keep clips.
    taught_folders: of the observers that can be taught. fusion: why the scene cannot be fused; "" if it can.
    """

    path: str
    scene: Scene
    settings: Sequence[EffectiveSetting]
    here: Sequence[str]
    certain: bool
    reports: Mapping[str, PreflightReport] = field(default_factory=dict)
    trouble: str = ""
    clip_folders: Mapping[str, FolderFacts] = field(default_factory=dict)
    taught_folders: Mapping[str, FolderFacts] = field(default_factory=dict)
    fusion: str = ""


def scenes_in(folder: Path) -> Iterator[Finding]:
    """A hint for each scene file in a folder, where none was named."""
    for path in sorted(folder.glob("*.toml")):
        with suppress(OSError, UnicodeDecodeError):
            if "[observers" in path.read_text(encoding="utf-8"):
                yield hint(
                    f"{path.name} is in this folder, and was not examined", f"labanmesh doctor {shlex.quote(path.name)}"
                )


def scene_facts(path: Path, scene: Scene, here: Sequence[str] | None) -> SceneFacts:
    """The facts of a scene that was read from `path`; here: this machine's observers, None for all."""
    observers = scene.roster if here is None else tuple(here)
    table = tomllib.loads(path.read_text(encoding="utf-8"))
    with subprocess.Popen(  # noqa: S603 - the command line is ours
        [*PREFLIGHT, "fusion.preflight", str(path)],
        stdin=subprocess.DEVNULL, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True,
    ) as fusing:  # fmt: skip
        reports, trouble = _preflight(path, observers)
        fusion = fusing.communicate()[0].strip()
    certain = here is not None or scene.mesh.mode != "router"
    settings = settings_in_force(scene, table, os.environ)
    places = {name: scene.place(folder) for name in observers if (folder := scene.observer(name).clips.folder)}
    clips = {name: FolderFacts(place, _may_write(place)) for name, place in places.items()}
    # Teaching does not make the folder of an observer's takes and its model.
    folders = {} if scene.vocabulary else {name: scene.taught_model(name).parent for name in observers}
    taught = {name: FolderFacts(each, each.is_dir() and _may_write(each)) for name, each in folders.items()}
    return SceneFacts(str(path), scene, settings, observers, certain, reports, trouble, clips, taught, fusion)


def _preflight(path: Path, observers: Sequence[str]) -> tuple[dict[str, PreflightReport], str]:
    """The reports that arrived in time, by observer, and why others did not. A process of its own makes them."""
    if not observers:
        return {}, ""
    command = [*PREFLIGHT, "observer.runtime.preflight", str(path), *observers]
    try:
        done = subprocess.run(  # noqa: S603 - the command line is ours
            command, stdin=subprocess.DEVNULL, capture_output=True, timeout=PREFLIGHT_S, check=False
        )
    except subprocess.TimeoutExpired as late:
        return _reports(late.stdout or b""), f"it took longer than {PREFLIGHT_S:g} s"
    except OSError as error:
        return {}, f"no process could be started: {reason_of(error)}"
    last = done.stderr.decode(errors="replace").strip().rpartition("\n")[2]
    return _reports(done.stdout), last if done.returncode else ""


def _reports(lines: bytes) -> dict[str, PreflightReport]:
    whole = [line for line in lines.splitlines(keepends=True) if line.endswith(b"\n")]
    return {report.observer: report for report in (PreflightReport(**json.loads(line)) for line in whole)}


def check_scene(facts: SceneFacts) -> list[Finding]:
    """The findings on a scene file."""
    checks = (
        *(_whole(facts), _overridden(facts.settings), _hubs(facts.scene), _observers(facts), _shared(facts)),
        *(_taught(facts), _vocabularies(facts), _other_motion(facts), _message_size(facts)),
    )
    return [finding for findings in checks for finding in findings]


def check_refused(path: Path, fault: BadInput, here: Sequence[str] | None) -> list[Finding]:
    """The findings on a file that `read_scene` refuses: why, and what is wrong with the parts that it could read."""
    faults = fault.faults if isinstance(fault, Faults) else [str(fault)]
    findings = [from_fault("error", each, SCENE_WAY_OUT) for each in faults]
    if scene := sound_part(path):
        observers = [name for name in scene.roster if here is None or name in here]
        findings += [each for each in check_scene(scene_facts(path, scene, observers)) if each.mark == "error"]
    return findings


def _whole(facts: SceneFacts) -> Iterator[Finding]:
    scene = facts.scene
    observers = f"{plural(len(scene.roster), 'observer')} ({', '.join(scene.roster)})"
    yield ok(f"{facts.path}: scene {scene.scene}, {observers}, mesh {scene.mesh.mode}")
    if scene.mesh.mode == "process":
        what = 'mesh.mode = "process": several processes cannot meet in this mode; it is for tests'
        yield error(what, 'choose mode = "machine" or "router" under [mesh]')
    if facts.fusion:
        yield from_fault("error", facts.fusion, SCENE_WAY_OUT)


def _overridden(settings: Sequence[EffectiveSetting]) -> Iterator[Finding]:
    for setting in settings:
        if setting.origin not in (DEFAULT, FILE):
            yield ok(f"{setting.key} = {setting.value}, by the environment variable {setting.origin}")


def _hubs(scene: Scene) -> Iterator[Finding]:
    for name in scene.hub.start:
        try:
            hub_words(name)
        except BadInput as fault:
            yield from_fault("error", str(fault), SCENE_WAY_OUT)


def _observers(facts: SceneFacts) -> Iterator[Finding]:
    mark: Mark = "error" if facts.certain else "warning"
    for observer in facts.here:
        report = facts.reports.get(observer)
        if report is None:
            reason = facts.trouble or "it took too long"
            yield warning(f"{observer}: not examined: {reason}", f"labanmesh observe {facts.path} {observer}")
            continue
        for fault in report.faults:
            yield from_fault(mark, f"{observer}: {fault}", SCENE_WAY_OUT)
        for doubt in report.doubts:
            yield from_fault("warning", f"{observer}: {doubt}", SCENE_WAY_OUT)
        if report.lacks_tracker:
            lacks, _, install = report.lacks_tracker.partition(": ")
            to_do = f'{install}; or choose camshift: tracker = "{report.tracker}"'
            yield warning(f"{observer}: tracker camshift: {lacks}", to_do)
        if not report.faults and not report.lacks:
            rate = f" at {report.rate_hz:g} Hz" if report.rate_hz else ""
            model = f"model of {plural(len(report.labels), 'movement')}{rate}" if report.labels else "no model yet"
            tracker = f", tracker {report.tracker}" if report.tracker else ""
            kind = f" ({report.kind})" if report.kind else ""
            yield ok(f"{observer}: {report.source}{tracker}, {model}{kind}")
        if report.taught_from:
            camera = report.taught_from
            yield ok(f"{observer}: its model is for {camera} as it stands: teach it again when the camera moves")
    if not facts.certain and any(report.faults or report.lacks for report in facts.reports.values()):
        yield warning("observers lack something here, and may be meant for other machines", NOT_HERE)


def _shared(facts: SceneFacts) -> Iterator[Finding]:
    for observer in facts.here:
        section, folder = facts.scene.observer(observer), facts.clip_folders.get(observer)
        if section.picture_hz:
            askers = "hubs with the right to pictures" if facts.scene.mesh.credentials else "any process of the mesh"
            what = f"{observer}: live pictures are on: {askers} may ask for {section.picture_hz:g} a second"
            yield ok(f"{what} (picture_hz = 0 ends it)")
        if folder is not None:
            clips = section.clips
            limits = f"for {clips.keep_days:g} days, at most {clips.keep_mb:g} MB"
            yield ok(f"{observer}: clips are on: a film of each verdict in {folder.path}, {limits}")
        if folder is not None and not folder.writable:
            what = f"{observer}: this user cannot write to {folder.path}, so no clips are kept"
            yield warning(what, "choose another clips.folder, or make the observer's user its owner")


def _taught(facts: SceneFacts) -> Iterator[Finding]:
    closed: dict[Path, list[str]] = {}
    for observer, folder in facts.taught_folders.items():
        if not folder.writable:
            closed.setdefault(folder.path, []).append(observer)
    for path, observers in closed.items():
        what = f"{', '.join(observers)}: this user cannot write to {path}, so teaching would fail"
        yield warning(what, f"make the observer's user its owner, or set {MODELS_VARIABLE} to a folder of that user")


def _may_write(folder: Path) -> bool:
    existing = next(each for each in (folder, *folder.parents) if each.exists())
    return existing.is_dir() and os.access(existing, os.W_OK | os.X_OK)


def _vocabularies(facts: SceneFacts) -> Iterator[Finding]:
    """Whether the models name the same movements; the preflight compares each with a vocabulary of the scene's own."""
    observers_by_labels = _observers_by_labels(facts)
    if facts.scene.named_vocabulary is not None or not observers_by_labels:
        return
    if len(observers_by_labels) == 1:
        (labels,) = observers_by_labels
        yield ok(f"vocabulary of the models: {', '.join(labels)} ({Vocabulary(labels).digest})")
        return
    (most, (first, *_)), *others = sorted(observers_by_labels.items(), key=lambda pair: -len(pair[1]))
    for labels, names in others:
        what = f"{', '.join(names)}: learned for [{', '.join(labels)}], {first} for [{', '.join(most)}]"
        yield error(what, "learn all models from the same movements: labanmesh learn")


def _other_motion(facts: SceneFacts) -> Iterator[Finding]:
    observers = [name for name, report in facts.reports.items() if report.blends_only]
    if observers:
        what = f"{', '.join(observers)}: recordings of ordinary life would teach what else people do"
        yield hint(what, "learn again with labanmesh learn ... --background life.npz")


def _observers_by_labels(facts: SceneFacts) -> dict[tuple[str, ...], list[str]]:
    observers_by_labels: dict[tuple[str, ...], list[str]] = {}
    for name, report in facts.reports.items():
        if report.labels:
            observers_by_labels.setdefault(tuple(report.labels), []).append(name)
    return observers_by_labels


def _message_size(facts: SceneFacts) -> Iterator[Finding]:
    """Whether the scene's judgements fit into a message, without the detail that is left out of long ones."""
    scene = facts.scene
    labels = max(_observers_by_labels(facts), key=len, default=None)
    vocabulary = scene.named_vocabulary or (Vocabulary(labels) if labels else None)
    if vocabulary is None:
        return
    try:
        require_fits(scene, vocabulary)
    except BadInput as fault:
        yield from_fault("error", str(fault), SCENE_WAY_OUT)
        return
    size = largest_judgement(scene.scene, scene.roster, vocabulary, scene.fusion.rule)
    what = f"judgements take up to {size / 1024:.1f} KiB, a message holds {SIZE_LIMIT // 1024}"
    if size < NEARLY_FULL * SIZE_LIMIT:
        yield ok(what)
    else:
        yield warning(what, "before you add observers or movements, shorten names or make several scenes")
