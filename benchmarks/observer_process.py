"""A real `labanmesh observe` process that watches a film, and the posteriors that it publishes."""

import json
import os
import subprocess
import sys
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from tempfile import TemporaryDirectory

from benchmarks.bare_zenoh import LOOPBACK
from common.config import MeshConfig
from common.errors import LabanmeshError
from common.inbox import Inbox
from common.keys import SceneKeys
from common.link import Link

SCENE, OBSERVER = "bench", "cam1"
INBOX_LIMIT = 100_000
END_S = 60.0


@contextmanager
def observing(film: Path, model: Path, settings: Sequence[str] = ()) -> Iterator[tuple[int, Inbox]]:
    """An observer that watches `film` in a loop: its process id, and the inbox of its posteriors.

    settings: further lines of its section in the scene file.
    """
    with TemporaryDirectory() as folder, Link.open(MeshConfig(), "fusion", listen=[LOOPBACK]) as link:
        scene = Path(folder) / "scene.toml"
        source = [f"{key} = {json.dumps(str(path.absolute()))}" for key, path in (("source", film), ("model", model))]
        mesh = [f'scene = "{SCENE}"', "[mesh]", f'endpoint = "{link.locator}"']
        lines = [*mesh, f"[observers.{OBSERVER}]", *source, "loop = true", *settings]
        scene.write_text("\n".join(lines) + "\n", encoding="utf-8")
        inbox = link.inbox(SceneKeys(SCENE).posterior(OBSERVER), limit=INBOX_LIMIT)
        words = [sys.executable, "-P", "-m", "labanmesh", "observe", str(scene), OBSERVER]
        process = subprocess.Popen(words, env={**os.environ, "LABANMESH_LOG": "warning"})  # noqa: S603 - our verbs
        try:
            yield process.pid, inbox
        finally:
            process.terminate()
            process.wait(END_S)


def await_first(inbox: Inbox, timeout_s: float) -> None:
    """Wait for the first posterior; raises LabanmeshError if none arrives within `timeout_s`."""
    if not inbox.take(timeout_s):
        raise LabanmeshError("labanmesh observe published nothing; its output above says why")
