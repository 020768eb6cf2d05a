"""The run script of the Home Assistant app, without processes: what it starts, and what it says of faults."""

import importlib.util
import re
from pathlib import Path

import pytest
from app_stage import RUN, TOKEN, Supervisor, app_folders, simulated_supervisor, write_options
from played_scene import ROOT


@pytest.fixture
def root(tmp_path):
    return app_folders(tmp_path / "root")


@pytest.fixture(scope="module")
def run():
    """The run script as a module."""
    spec = importlib.util.spec_from_file_location("labanmesh_app", RUN)
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


@pytest.mark.parametrize(
    ("options", "line"),
    [
        ({}, "no camera: add one to the options, or put a scene file of your own"),
        ({"router": "tls/attic:7447", "certificates": "mine"}, "certificates: no folder 'mine' in the app's folder"),
        ({"cameras": [{"name": "a", "source": "0"}, {"name": "a", "source": "1"}]}, "cameras: two are called 'a'"),
    ],
)
def test_options_that_cannot_work_are_one_line(run, root, capsys, options, line):
    write_options(root, mqtt_host="broker.local", mqtt_username="anna", **options)
    assert run.main(root, "http://127.0.0.1:1") == 2
    error = capsys.readouterr().err
    assert error.count("\n") == 1 and line in error


@pytest.fixture
def started(run, monkeypatch):
    """What the app would start: the command of each job, and their environment."""
    started = {}

    class Recorded:
        def __init__(self, jobs, environment):
            started.update({job.name: job.command for job in jobs}, environment=environment)

        def run(self, stop):
            return 0

    monkeypatch.setattr(run, "Launcher", Recorded)
    return started


def test_without_a_router_everything_runs_here_and_an_own_scene_file_goes_first(run, root, started):
    write_options(
        root, mqtt_host="broker.local", cameras=[{"name": "sofa", "source": 'rtsp://a"b/ä'}, {"name": "shelf"}]
    )
    assert run.main(root, "") == 0
    assert set(started) == {"[fuse]", "sofa", "shelf", "[mqtt]", "[dashboard]", "environment"}
    made = run.read_scene(root / "data/scene.toml", started["environment"])
    assert made.observer("sofa").source == 'rtsp://a"b/ä' and made.hub.mqtt.host == "broker.local"
    assert made.taught_model("sofa").parent == root / "config/models" and made.hub.mqtt.movements == ("*",)
    (root / "config/scene.toml").write_text('scene = "mine"\n[observers.door]\nsource = "0"\n')
    started.clear()
    assert run.main(root, "") == 0 and "door" in started and "sofa" not in started
    assert str(root / "config/scene.toml") in started["[mqtt]"]


@pytest.mark.usefixtures("started")
def test_the_log_does_not_show_the_token_of_the_page(run, root, capsys):
    file = root / "config/token.txt"
    for own in ("", "", "correct-horse-battery", ""):
        before = file.read_text() if file.exists() else ""
        write_options(root, mqtt_host="broker.local", cameras=[{"name": "sofa"}], page_token=own)
        assert run.main(root, "") == 0
        token = file.read_text().strip()
        assert token == (own or before.strip() or token) and len(token) >= 16 and file.stat().st_mode & 0o777 == 0o600
        log = capsys.readouterr().out
        assert token not in log and "the option page_token, or the file token.txt" in log


def test_the_broker_is_the_one_that_the_supervisor_names_as_soon_as_it_does(run, root, capsys, monkeypatch):
    monkeypatch.setenv("SUPERVISOR_TOKEN", TOKEN)
    monkeypatch.setattr(run, "SUPERVISOR_RETRY_S", 0.01)
    service = {"host": "core-mosquitto", "port": 1883, "ssl": True, "username": "addons", "password": "s3cret"}
    with simulated_supervisor() as supervisor:
        Supervisor.service, Supervisor.known_after = service, 2
        environment = run._broker({}, root, supervisor, run.threading.Event())
    assert environment["LABANMESH_HUB_MQTT_HOST"] == "core-mosquitto"
    assert environment["LABANMESH_HUB_MQTT_TLS"] == "true"
    assert (root / "data/mqtt-password").read_text() == "s3cret"
    assert capsys.readouterr().out.count("waiting for the MQTT broker") == 1
    monkeypatch.setattr(run, "BROKER_TIMEOUT_S", 0.05)
    with simulated_supervisor() as supervisor, pytest.raises(run.LabanmeshError, match="Service not enabled; install"):
        run._broker({}, root, supervisor, run.threading.Event())


def test_the_app_has_the_version_of_labanmesh():
    version = re.search(r'^version = "(.+)"$', (ROOT / "pyproject.toml").read_text("utf-8"), re.MULTILINE)[1]
    assert f'\nversion: "{version}"\n' in (RUN.parent / "config.yaml").read_text("utf-8")
    assert Path(RUN).name in (RUN.parent / "Dockerfile").read_text("utf-8")
