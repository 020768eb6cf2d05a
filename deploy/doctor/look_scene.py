"""Reads a scene file, and has its observers examined by a process that may import their room."""

import json
import os
import subprocess
import sys
import tomllib
from collections.abc import Sequence
from pathlib import Path

from common.config import Scene, read_scene
from common.errors import BadInput
from deploy.doctor.origin import settings
from deploy.doctor.scene_file import Examined, SceneFacts

EXAMINATION_S = 10.0
"""Four observers take 1 to 2 s on two free cores, and several times that on a busy or a small machine."""


def look_at_scene(path: Path, scene: Scene, named: Sequence[str] | None) -> SceneFacts:
    """The facts of a scene that was read from `path`; named: this machine's observers, None where nobody said.

    Raises BadInput for an observer that the scene has not.
    """
    for name in named or ():
        scene.observer(name)
    here = scene.roster if named is None else tuple(named)
    table = tomllib.loads(path.read_text(encoding="utf-8"))
    examined, trouble = _examined(path, here)
    certain = named is not None or scene.mesh.mode != "router"
    return SceneFacts(str(path), scene, settings(scene, table, os.environ), here, certain, examined, trouble)


def readable_scene(path: Path) -> Scene:
    """As `read_scene`; where there is no such file at all BadInput is raised by this name, for a wrong command line."""
    if not path.exists():
        raise NoScene(f"{path}: no such file; name a scene file, or make one: labanmesh init {path}")
    return read_scene(path)


class NoScene(BadInput):
    """The scene file that a person named is not there: bad input, and no finding."""


def _examined(path: Path, observers: Sequence[str]) -> tuple[dict[str, Examined], str]:
    """Per observer what was found in time, and why some were not examined."""
    if not observers:
        return {}, ""
    command = [sys.executable, "-P", "-m", "observer.runtime.preflight", str(path), *observers]
    try:
        done = subprocess.run(  # noqa: S603 - the command line is ours
            command, stdin=subprocess.DEVNULL, capture_output=True, timeout=EXAMINATION_S, check=False
        )
    except subprocess.TimeoutExpired as late:
        return _read(late.stdout or b""), f"it took longer than {EXAMINATION_S:g} s"
    except OSError as error:
        return {}, f"no process could be started: {error.strerror}"
    last = done.stderr.decode(errors="replace").strip().rpartition("\n")[2]
    return _read(done.stdout), last if done.returncode else ""


def _read(lines: bytes) -> dict[str, Examined]:
    found = [Examined(**json.loads(line)) for line in lines.splitlines(keepends=True) if line.endswith(b"\n")]
    return {each.observer: each for each in found}
