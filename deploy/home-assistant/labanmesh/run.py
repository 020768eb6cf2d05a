"""Starts labanmesh as an app of Home Assistant, as the options of its page say.

1. /data/options.json has the options (config.yaml). The supervisor tells where the MQTT broker is, unless they do.
2. The scene file is scene.toml in the app's folder, /config. Without it, one is made of the options at each start.
3. Without a router everything runs here. With one: the MQTT hub, the page, and observers of the cameras with a source.
4. Options that cannot work end the app with one line and status 2; a process that fails is started again.

Arguments, for tests: the folder that stands for /, and the supervisor's address.
"""

import json
import os
import secrets
import shutil
import sys
import threading
import time
import urllib.error
import urllib.request
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import deploy
from common.config import MODELS_VARIABLE, Scene, read_scene
from common.errors import BadInput, LabanmeshError
from common.lifecycle import stop_on_signals
from deploy.commands import jobs
from deploy.hubs import HUBS
from deploy.launcher import Job, Launcher

SUPERVISOR = "http://supervisor"
BROKER_TIMEOUT_S = 120.0
"""At the start of the machine the broker may come up after this app."""
SUPERVISOR_RETRY_S = 0.5
PAGE = "0.0.0.0:8420"
"""The container's port, which config.yaml publishes; the page asks for a token."""
OTHER_MACHINE = "elsewhere"
"""The source of a camera at another computer, which no process here opens."""
Options = Mapping[str, Any]


def main(root: Path, supervisor: str) -> int:
    """Run until SIGTERM; returns the exit status."""
    try:
        options = json.loads((root / "data/options.json").read_text("utf-8"))
        folder = root / "config"
        with stop_on_signals() as stop:
            environment = {**_mesh(options, folder), **_broker(options, root, supervisor, stop)}
            # What a process keeps over a restart.
            environment |= {MODELS_VARIABLE: str(_made(folder / "models")), "STATE_DIRECTORY": str(root / "data")}
            token = _token(options, folder)
            path = _scene_file(options, root)
            scene = read_scene(path, {**os.environ, **environment})
            if options["blueprints"]:
                _put_blueprints(root / "homeassistant")
            # Whoever may read the log, or a copy of it in a report, may not teach.
            places = "the option page_token, or the file token.txt in the app's folder"
            print(f"the page is at port 8420 of this machine; its token: {places}", flush=True)
            return Launcher(_jobs(path, scene, options, token), environment=environment).run(stop)
    except LabanmeshError as error:
        print(error, file=sys.stderr, flush=True)
        return 2 if isinstance(error, BadInput) else 1


def _jobs(path: Path, scene: Scene, options: Options, token: Path) -> list[Job]:
    here = {camera["name"] for camera in options["cameras"] if camera.get("source")}
    started = [job for job in jobs(path, scene) if not options.get("router") or job.name in here]
    python = [sys.executable, "-P", "-m", "labanmesh"]
    page = ["--listen", os.environ.get("LABANMESH_HUB_DASHBOARD_LISTEN", PAGE), "--teach", "--token-file", str(token)]
    hubs = [
        Job("[mqtt]", [*python, *HUBS["mqtt"], str(path)], lasting=True),
        Job("[dashboard]", [*python, *HUBS["dashboard"], str(path), *page], lasting=True),
    ]
    return [*(job for job in started if job.name not in {hub.name for hub in hubs}), *hubs]


def _scene_file(options: Options, root: Path) -> Path:
    own = root / "config/scene.toml"
    if own.exists():
        return own
    if not options["cameras"]:
        raise BadInput(
            f"no camera: add one to the options, or put a scene file of your own into the app's folder ({own})"
        )
    names = [camera["name"] for camera in options["cameras"]]
    if twice := [name for name in names if names.count(name) > 1]:
        raise BadInput(f"cameras: two are called {twice[0]!r}; give each a name of its own")
    made = root / "data/scene.toml"
    made.write_text(scene_text(options["scene"], options["cameras"]), "utf-8")
    return made


def scene_text(name: str, cameras: Sequence[Mapping[str, str]]) -> str:
    """The scene file (TOML) for these cameras; each is taught from its own pictures, wherever it stands."""
    text = f'scene = "{name}"\n[hub.mqtt]\nmovements = ["*"]\n'
    for camera in cameras:
        # A JSON string is a TOML string.
        source = json.dumps(camera.get("source") or OTHER_MACHINE, ensure_ascii=False)
        text += f'[observers.{camera["name"]}]\nsource = {source}\nview = "camera"\n'
    return text


def _mesh(options: Options, folder: Path) -> dict[str, str]:
    certificates, router = options.get("certificates"), options.get("router")
    if not router:
        return {}
    if certificates and not (folder / certificates).is_dir():
        raise BadInput(
            f"certificates: no folder {certificates!r} in the app's folder; copy it there, or clear the option"
        )
    credentials = {"LABANMESH_MESH_CREDENTIALS": str(folder / certificates)} if certificates else {}
    return {"LABANMESH_MESH_MODE": "router", "LABANMESH_MESH_ENDPOINT": router, **credentials}


def _broker(options: Options, root: Path, supervisor: str, stop: threading.Event) -> dict[str, str]:
    if options.get("mqtt_host"):
        broker: Options = {
            name.removeprefix("mqtt_"): value for name, value in options.items() if name.startswith("mqtt_")
        }
    else:
        broker = _broker_service(supervisor, stop)
    password = root / "data/mqtt-password"
    password.touch(0o600)
    password.write_text(broker.get("password") or "", "utf-8")
    settings = {
        "HOST": broker["host"],
        "PORT": broker.get("port"),
        "USERNAME": broker.get("username"),
        "PASSWORD_FILE": broker.get("password") and password,
        "TLS": str(bool(broker.get("ssl"))).lower(),
    }
    return {f"LABANMESH_HUB_MQTT_{key}": str(value) for key, value in settings.items() if value}


def _broker_service(supervisor: str, stop: threading.Event) -> Options:
    """What the supervisor says about the MQTT service; waits for it for a while."""
    token = os.environ.get("SUPERVISOR_TOKEN", "")
    request = urllib.request.Request(  # noqa: S310 - the supervisor's own address
        f"{supervisor}/services/mqtt", headers={"Authorization": f"Bearer {token}"}
    )
    end_s, fault = time.monotonic() + BROKER_TIMEOUT_S, ""
    while time.monotonic() < end_s and not stop.is_set():
        try:
            with urllib.request.urlopen(request, timeout=10.0) as answer:  # noqa: S310 - as above
                return dict(json.load(answer)["data"])
        except (OSError, ValueError, KeyError) as error:
            if not fault:
                print("waiting for the MQTT broker: is the app Mosquitto broker installed and started?", flush=True)
            fault = _reason(error)
        stop.wait(SUPERVISOR_RETRY_S)
    raise LabanmeshError(f"no MQTT broker: {fault}; install and start the app Mosquitto broker, or set mqtt_host")


def _reason(error: Exception) -> str:
    if isinstance(error, urllib.error.HTTPError):
        try:
            return str(json.load(error)["message"])
        except (ValueError, KeyError, TypeError):
            return f"the supervisor answers {error.code}"
    return f"no answer of the supervisor ({error})"


def _token(options: Options, folder: Path) -> Path:
    path, own = folder / "token.txt", options.get("page_token")
    if own or not path.exists():
        path.touch(0o600)
        path.write_text(f"{own or secrets.token_hex(8)}\n", "utf-8")
    return path


def _put_blueprints(home_assistant: Path) -> None:
    """Put the blueprints where Home Assistant looks for them, if its folder is mapped."""
    source = Path(deploy.__path__[0]) / "home-assistant/blueprints/automation/labanmesh"
    target = home_assistant / "blueprints/automation/labanmesh"
    try:
        if home_assistant.is_dir():
            shutil.copytree(source, target, dirs_exist_ok=True)
    except OSError as error:
        print(f"cannot write the blueprints to {target}: {error}; copy them there yourself", flush=True)


def _made(folder: Path) -> Path:
    folder.mkdir(parents=True, exist_ok=True)
    return folder


if __name__ == "__main__":
    _, *arguments = sys.argv
    root, supervisor = arguments or ("/", SUPERVISOR)
    sys.exit(main(Path(root), supervisor))
