"""`labanmesh doctor`: a taken port and a missing model; what init writes. Of health: test_up.py."""

import contextlib
import socket

import pytest
from e2e_stage import findings_in, marks, played, write_scene
from processes import SOON_S

from labanmesh import main


@pytest.fixture
def labanmesh(stage, capsys):
    """A command in this process: its exit status, output and errors."""

    def call(*words):
        with contextlib.chdir(stage):
            status = main(list(map(str, words)))
        return status, *capsys.readouterr()

    return call


@pytest.fixture
def doctor(labanmesh, monkeypatch):
    """The doctor's exit status, and findings as (mark, what, to do)."""
    # It leaves out what takes long; a busy machine starts the process that reads the models late.
    monkeypatch.setattr("deploy.doctor.scene_file.PREFLIGHT_S", SOON_S)
    monkeypatch.setattr("deploy.doctor.commands.SCENE_S", SOON_S)

    def examine(*words):
        status, out, err = labanmesh("doctor", *words, "--json")
        assert out, err
        return status, findings_in(out)

    return examine


def test_a_port_that_is_taken_and_a_model_that_is_missing(stage, doctor):
    with socket.create_server(("127.0.0.1", 0)) as taken:
        observers = played("door", "wheel", more="loop = true\n")
        observers["wheel"] += 'model = "lost.model"\n'
        path = write_scene(stage / "broken.toml", f"tcp/127.0.0.1:{taken.getsockname()[1]}", observers)
        status, findings = doctor(path)
    assert status == 1
    assert marks(findings, "taken by ") == {"error"}
    assert marks(findings, "lost.model: no such model file -> make one with labanmesh learn") == {"error"}
    assert marks(findings, "model of 4 movements at 15 Hz") == {"ok"}


def test_what_init_writes_lacks_its_model_alone(labanmesh, doctor, tmp_path):
    status, _, err = labanmesh("init", tmp_path / "dojo.toml")
    assert status == 0, err
    _, findings = doctor(tmp_path / "dojo.toml", "--for", "0.5")
    errors = [what for mark, what, _ in findings if mark == "error" and what.startswith("cam1: ")]
    assert marks(findings, "cam1.model: no such model file -> teach it while it runs: labanmesh teach") == {"warning"}
    assert all("/dev/video" in what for what in errors)
