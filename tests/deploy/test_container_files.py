"""The container files by their own tools (docker compose, hadolint), and against the tree and the command line."""

import json
import os
import re
import shlex
import shutil
import subprocess
import sys
import time
from pathlib import Path

import pytest
import typer
from processes import SOON_S

from common.config import MODELS_VARIABLE, read_scene
from common.notify import HEARTBEAT, Notifier
from labanmesh import app_of

ROOT = Path(__file__).parents[2]
FOLDER = ROOT / "deploy" / "container"
CONTAINERFILE, COMPOSE, SECURED = (FOLDER / name for name in ("Containerfile", "compose.yaml", "compose.secured.yaml"))
TARGETS = {"router", "fusion", "observer", "hub"}
SCENE = "/etc/labanmesh/scene.toml"


def tool(name):
    """A tool of the development environment, which need not be activated."""
    path = shutil.which(name, path=f"{Path(sys.executable).parent}{os.pathsep}{os.environ.get('PATH', '')}")
    if path is None:
        pytest.skip(f"{name} is not installed on this kind of machine")
    return path


def composed(*files):
    """The files as docker compose merges them; every fault in them is an error of docker compose."""
    command = [tool("docker-compose"), *(f"--file={file}" for file in files), "config", "--format", "json"]
    done = subprocess.run(command, capture_output=True, text=True, timeout=SOON_S, env={"PATH": "", "HOME": "/"})
    assert (done.returncode, done.stderr) == (0, "")
    return json.loads(done.stdout)


@pytest.fixture(scope="module")
def plain():
    return composed(COMPOSE)["services"]


@pytest.fixture(scope="module")
def secured():
    return composed(COMPOSE, SECURED)["services"]


def instructions(word):
    """The arguments of an instruction of the Containerfile, continued lines joined."""
    text = CONTAINERFILE.read_text("utf-8").replace("\\\n", " ")
    return re.findall(rf"^{word} +(.*)$", text, re.MULTILINE)


def understood(words):
    verb, *rest = words
    typer.main.get_command(app_of(verb)).make_context(verb, rest, resilient_parsing="--help" in rest)


def test_hadolint_has_no_complaint():
    app = ROOT / "deploy" / "home-assistant" / "labanmesh" / "Dockerfile"
    command = [tool("hadolint"), "--no-color", CONTAINERFILE, app]
    done = subprocess.run(command, capture_output=True, text=True, timeout=SOON_S)
    assert (done.returncode, done.stdout) == (0, "")


def test_the_image_gets_all_of_the_program():
    copied = {name for line in instructions("COPY") if "--from" not in line for name in line.split()[:-1]}
    assert all((ROOT / name).exists() for name in copied)
    packages = {path.parent.name for path in ROOT.glob("*/__init__.py")} - {"benchmarks"}
    assert packages <= copied
    kept = (FOLDER / "Containerfile.dockerignore").read_text("utf-8")
    assert set(re.findall(r"^!(\S+)$", kept, re.MULTILINE)) == copied


def test_the_images_start_existing_verbs():
    for line in instructions("CMD"):
        understood(json.loads(line))
    assert instructions("ENTRYPOINT") == ['["labanmesh"]']


def test_no_image_runs_as_root():
    user_of = {"python:3.11-slim": "0:0"}
    for line in CONTAINERFILE.read_text("utf-8").splitlines():
        if line.startswith("FROM "):
            _, base, _, stage = line.split()
            user_of[stage] = user_of[base]
        elif line.startswith("USER "):
            user_of[stage] = line.split()[1]
    assert {user_of[target] for target in TARGETS} == {"10001:10001"}


@pytest.mark.parametrize("files", ["plain", "secured"])
def test_every_service_starts_an_existing_verb(files, request):
    for service in request.getfixturevalue(files).values():
        if service.get("command"):
            understood(service["command"])


def test_without_certificates_only_this_machine_reaches_the_router(plain):
    assert [port["host_ip"] for service in plain.values() for port in service.get("ports", [])] == ["127.0.0.1"]
    assert '["router"]' in instructions("CMD"), "by default it listens on loopback"


def test_every_service_is_monitored_and_confined(plain):
    (health,) = instructions("HEALTHCHECK")
    test_of_the_image = ["CMD", *json.loads(re.search(r"CMD (.*)$", health)[1])]
    for service in plain.values():
        # A dollar sign is doubled in what compose prints.
        assert [word.replace("$$", "$") for word in service["healthcheck"]["test"]] == test_of_the_image
        assert service["restart"] == "unless-stopped" and service["init"] and service["read_only"]
        assert service["cap_drop"] == ["ALL"] and service["security_opt"] == ["no-new-privileges:true"]
        assert any(line.startswith("/run/labanmesh:") for line in service["tmpfs"])


@pytest.mark.parametrize("files", ["plain", "secured"])
def test_scene_and_credentials_are_read_only_and_meet_at_the_router(files, request, tmp_path):
    (tmp_path / "scene.toml").write_text('scene = "dojo"\n[observers.sofa]\nsource = "0"\n')
    services = request.getfixturevalue(files)
    for name, service in services.items():
        mounted = {volume["target"]: volume for volume in service.get("volumes", [])}
        state = mounted.pop("/var/lib/labanmesh", None)
        assert (state is None) == (name not in {"fusion", "sofa", "shelf"})
        assert state is None or not state.get("read_only"), "what an observer is taught is written there"
        assert all(volume.get("read_only") for volume in mounted.values())
        wanted = {"/etc/labanmesh"} if files == "plain" else {"/etc/labanmesh", "/run/credentials"}
        assert set(mounted) == (set() if (name, files) == ("router", "plain") else wanted)
        if service.get("environment") and name != "router":
            mesh = read_scene(tmp_path / "scene.toml", service["environment"]).mesh
            protocol = "tcp" if files == "plain" else "tls"
            assert (mesh.mode, mesh.endpoint) == ("router", f"{protocol}/router:7447")
            assert mesh.credentials == ("" if files == "plain" else "/run/credentials")
        places = {word for word in service.get("command") or [] if word.startswith("/")}
        assert places <= ({"/etc/labanmesh/router.json5"} if name == "router" else {SCENE})


def test_an_observer_keeps_what_it_is_taught_in_its_state_folder():
    environment = [word for line in instructions("ENV") for word in shlex.split(line)]
    assert f"{MODELS_VARIABLE}=/var/lib/labanmesh" in environment


def test_the_health_check_follows_the_heartbeat(tmp_path):
    (health,) = instructions("HEALTHCHECK")
    command = json.loads(re.search(r"CMD (.*)$", health)[1])
    (place,) = {word for line in instructions("ENV") for word in shlex.split(line) if word.startswith(HEARTBEAT)}
    in_the_image = place.partition("=")[2]
    file = tmp_path / "alive"
    assert in_the_image in command[-1]
    command[-1] = command[-1].replace(in_the_image, str(file))

    def healthy():
        done = subprocess.run(command, capture_output=True, timeout=SOON_S)
        return done.returncode == 0

    if "GNU" not in subprocess.run(["find", "--version"], capture_output=True, text=True).stdout:
        pytest.skip("the images have GNU find, this machine has another")
    assert not healthy()
    notifier = Notifier.from_environment({HEARTBEAT: str(file)})
    notifier.ready()
    assert healthy()
    minute_ago = time.time() - 60
    os.utime(file, (minute_ago, minute_ago))
    assert not healthy()
    notifier.alive()
    assert healthy()
    notifier.stopping()
    assert not healthy()
