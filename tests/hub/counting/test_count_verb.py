"""`labanmesh count` as a process, on a real mesh."""

import json
import subprocess
import time
from contextlib import suppress

from played_scene import ROOT, PlayedScene, environment
from processes import SOON_S, labanmesh


def test_it_counts_what_is_published_and_ends_at_the_target(tmp_path):
    with PlayedScene() as scene:
        file = scene.scene_file(tmp_path / "scene.toml")
        command = labanmesh("count", str(file), "ok", "--target", "3", "--once", "--json")
        process = subprocess.Popen(command, cwd=ROOT, env=environment(), stdout=subprocess.PIPE, text=True)
        number, end_s = 0, time.monotonic() + SOON_S
        try:
            # Movements that began before it listens do not count.
            while process.poll() is None and time.monotonic() < end_s:
                number += 1
                scene.publish_verdict("ok", number, ended=True, repetitions=3, partial_repetitions=1)
                with suppress(subprocess.TimeoutExpired):
                    process.wait(0.2)
            rows = [json.loads(line) for line in process.stdout]
        finally:
            process.kill()
            process.communicate()
    assert process.returncode == 0 and [row["kind"] for row in rows][:2] == ["count", "target"]
    assert rows[0]["count"] == 3 and rows[0]["partial"] == 1 and rows[1]["sets"] == 1
