"""Scores in a running scene, with real processes: learn with references, play a performance, read the ended verdict."""

import json
import subprocess

from e2e_stage import SOON_S, free_endpoint, run, write_scene
from processes import labanmesh

from labanmesh import main
from observer.motion.archive import MotionArchive
from observer.motion.archive_file import write_archive
from studies.performer import perform, perform_continuously

VIEWS = {"door": "door", "corner": "yaw:45"}


def test_the_ended_verdict_of_a_performance_has_a_score(tmp_path, capsys):
    shown = perform(people=("2", "3", "4"), movements=("byebye", "lunging"), trials=2)
    write_archive(tmp_path / "shown.npz", shown)
    played = MotionArchive(
        shown.body_parts, (perform_continuously("1", ("byebye", "lunging", "byebye"), rest_s=(0.6, 0.7)),)
    )
    write_archive(tmp_path / "motion.npz", played)
    observers = {name: f'source = "motion.npz"\nview = "{view}"\n' for name, view in VIEWS.items()}
    for name, view in VIEWS.items():
        words = (str(tmp_path / "shown.npz"), "--view", view, "-o", str(tmp_path / f"{name}.model"))
        assert main(["learn", *words, "--reference", "byebye", "--parameter", "kernels=336"]) == 0
        assert "scores byebye by 6 reference takes" in capsys.readouterr().out
        observers[name] += f'model = "{name}.model"\n'
    path = write_scene(tmp_path / "scene.toml", free_endpoint(), observers)
    with (tmp_path / "lines.json").open("w") as out:
        # A pipe that nobody reads would soon be full.
        watching = labanmesh("watch", path, "--json", "--for", SOON_S)
        with subprocess.Popen(watching, cwd=tmp_path, stdout=out, stderr=subprocess.DEVNULL) as watch:
            ran = run(tmp_path, "up", path, "--exit-when-done", timeout_s=SOON_S)
            watch.terminate()
    lines = [json.loads(line) for line in (tmp_path / "lines.json").read_text().splitlines()]
    assert ran.returncode == 0, ran.stderr
    ended = {each["id"]: each for each in lines if each["kind"] == "verdict" and each["stage"] == "ended"}
    by_label = [(each["label"], each["score"], each["scores"]) for each in ended.values()]
    scored = [(score, scores) for label, score, scores in by_label if label == "byebye"]
    assert any(score is not None for score, _ in scored), f"{by_label} of {len(lines)} lines\n{ran.stderr}"
    assert all(0 <= score <= 10 and {*scores} <= {*VIEWS} for score, scores in scored if score is not None)
    assert all(score is None for label, score, _ in by_label if label != "byebye")
