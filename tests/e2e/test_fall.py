"""A simulated fall through real processes: observers that nobody has taught, fusion, history, a webhook, `watch`."""

import json
import subprocess
from dataclasses import replace

from e2e_stage import SOON_S, free_endpoint, run, write_scene
from processes import labanmesh
from webhook_server import WebhookServer

from benchmarks.simulated_falls import fall
from observer.motion.archive import MotionArchive
from observer.motion.archive_file import write_archive
from observer.tracks import WHOLE_BODY
from studies.performer.perform import PEOPLE


def test_a_fall_is_seen_kept_and_told(tmp_path):
    shown = fall(PEOPLE[0], 45, slow=False).recording
    # A second less before the fall, and one after it: the film takes its time.
    shown = replace(shown, positions=shown.positions[30:-30])
    write_archive(tmp_path / "fall.npz", MotionArchive(WHOLE_BODY, (shown,)))
    with WebhookServer() as server:
        observers = {name: f'source = "fall.npz"\nview = "{name}"\n' for name in ("door", "wheel")}
        more = '[watch.fallen]\n[history]\nfile = "history.db"\n[notify.phone]\n'
        path = write_scene(tmp_path / "scene.toml", free_endpoint(), observers)
        path.write_text(path.read_text() + f'{more}url = "{server.url}"\n')
        watcher = subprocess.Popen(labanmesh("watch", path, "--json", "--for", SOON_S), cwd=tmp_path, text=True,
                                   stdout=subprocess.PIPE, stderr=subprocess.DEVNULL)  # fmt: skip
        with watcher:
            ran = run(tmp_path, "up", path, "--exit-when-done", timeout_s=SOON_S)
            watcher.terminate()
            lines = [json.loads(line) for line in watcher.stdout]
        assert ran.returncode == 0, ran.stderr
        stages = [line["stage"] for line in lines if line["kind"] == "fall"]
        assert stages[-3:] == ["up", "low", "fallen"], ran.stderr
        assert "2 of 2 observers see the person lie" in ran.stderr
        (row,) = map(json.loads, run(tmp_path, "history", path, "--json").stdout.splitlines())
        assert (row["kind"], row["agree"], row["of"], row["ended"]) == ("fall", 2, 2, None)
        assert server.texts == ["somebody has fallen"]
