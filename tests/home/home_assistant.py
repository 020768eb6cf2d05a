"""A Home Assistant with one integration, MQTT: its states over HTTP, and what its pages do over the websocket."""

import json
import subprocess
import urllib.error
import urllib.request
from pathlib import Path

from processes import SOON_S, until

from benchmarks.timing import free_port

UP_S = 300.0
"""Its first start installs what its integrations require."""
OWN = ("zone.", "person.", "automation.", "input_boolean.", "input_text.", "scene.", "light.")
ANNA = ("anna", "secret")
MORE = """input_boolean: {curtain: {}, called: {}, alarm: {}, late: {}}
input_text: {each: {}, third: {}}
scene: [{name: Cinema, entities: {input_boolean.curtain: "on"}}]
"""
"""What automations of the tests act on."""


class HomeAssistant:
    """`program` with a folder of its own; a context manager."""

    def __init__(self, program, place, broker_port, automation=""):
        self._program, self._place, self._port = str(Path(program).absolute()), place, free_port()
        self._process, self._token = None, ""
        (place / ".storage").mkdir(parents=True)
        (place / "configuration.yaml").write_text(
            "homeassistant:\n  name: test\n  auth_providers:\n    - type: homeassistant\n"
            f"http:\n  server_host: 127.0.0.1\n  server_port: {self._port}\napi:\nlogger:\n  default: warning\n"
            "automation: !include automations.yaml\nconfig:\n" + MORE
        )
        (place / "automations.yaml").write_text(automation)
        broker = {"broker": "127.0.0.1", "port": broker_port, "discovery": True, "discovery_prefix": "homeassistant"}
        entry = {
            "entry_id": "broker", "version": 1, "minor_version": 1, "domain": "mqtt", "title": "broker",
            "data": broker,
            "options": {}, "pref_disable_new_entities": False, "pref_disable_polling": False, "source": "user",
            "unique_id": None, "disabled_by": None,
        }  # fmt: skip
        store = {"version": 1, "minor_version": 1, "key": "core.config_entries", "data": {"entries": [entry]}}
        (place / ".storage" / "core.config_entries").write_text(json.dumps(store))
        self._run("--script", "auth", "-c", place, "add", *ANNA)

    def start(self):
        with (self._place / "hass.log").open("ab") as log:
            self._process = subprocess.Popen([self._program, "-c", self._place], stdout=log, stderr=log)
        until(self._log_in, lambda: (self._place / "hass.log").read_text(), UP_S)
        return self

    def stop(self):
        self._process.terminate()
        self._process.wait(60.0)

    def states(self):
        """Every entity of the scene by its id: state and attributes."""
        states = self._ask("/api/states")
        return {each["entity_id"]: each for each in states if not each["entity_id"].startswith(OWN)}

    def attributes(self, entity):
        """One entity's attributes."""
        return self._ask(f"/api/states/{entity}")["attributes"]

    def state(self, entity):
        """One entity's state, None where there is no such entity."""
        try:
            return self._ask(f"/api/states/{entity}")["state"]
        except urllib.error.HTTPError:
            return None

    def wait_for_state(self, entity, state, seconds=SOON_S):
        until(lambda: self.state(entity) == state, lambda: f"{entity} is {self.state(entity)}, not {state}", seconds)

    def send(self, *commands):
        """The results of commands to the websocket; every one must succeed."""
        program = Path(self._program).with_name("python")
        script = Path(__file__).with_name("websocket_commands.py")
        url = f"ws://127.0.0.1:{self._port}/api/websocket"
        done = subprocess.run(
            [program, script, url, self._token], input=json.dumps(commands), capture_output=True, text=True, timeout=60
        )
        answers = json.loads(done.stdout or "[]")
        assert done.returncode == 0 and all(each["success"] for each in answers), done.stderr or answers
        return [each["result"] for each in answers]

    def offered(self, name):
        """What the editor offers as triggers of the device with this name, by the movement."""
        (devices,) = self.send({"type": "config/device_registry/list"})
        ours = [device["id"] for device in devices if device["name"] == name]
        found = self.send(*({"type": "device_automation/trigger/list", "device_id": each} for each in ours))
        return {each["subtype"]: each for triggers in found for each in triggers if each.get("type") == "recognised"}

    def save_automation(self, name, fields):
        """Make an automation as the editor does; it runs when this returns. name: also its id."""
        self._ask(f"/api/config/automation/config/{name}", {"alias": name, **fields})
        until(lambda: self.state(f"automation.{name}") == "on", f"automation.{name}")

    def call(self, domain, service, **fields):
        """Call a service, as a button or a field of its pages does."""
        self._ask(f"/api/services/{domain}/{service}", fields)

    def devices(self):
        """Its devices by their name."""
        self.stop()
        store = json.loads((self._place / ".storage" / "core.device_registry").read_text())
        self.start()
        return {each["name"]: each for each in store["data"]["devices"]}

    def log(self):
        return (self._place / "hass.log").read_text()

    def _run(self, *words):
        subprocess.run([self._program, *map(str, words)], check=True, capture_output=True, timeout=UP_S)

    def _log_in(self):
        assert self._process.poll() is None, self.log()
        client = f"http://127.0.0.1:{self._port}/"
        try:
            ask = {"client_id": client, "handler": ["homeassistant", None], "redirect_uri": client}
            flow = self._ask("/auth/login_flow", ask)["flow_id"]
            answer = {"client_id": client, "username": ANNA[0], "password": ANNA[1]}
            code = self._ask(f"/auth/login_flow/{flow}", answer)["result"]
            form = f"grant_type=authorization_code&code={code}&client_id={client}".encode()
            self._token = self._ask("/auth/token", form)["access_token"]
            return self._ask("/api/config")["state"] == "RUNNING"
        except OSError:
            return False

    def _ask(self, path, fields=None):
        body = json.dumps(fields).encode() if isinstance(fields, dict) else fields
        kind = "application/json" if isinstance(fields, dict) else "application/x-www-form-urlencoded"
        headers = {"Content-Type": kind} | ({"Authorization": f"Bearer {self._token}"} if self._token else {})
        request = urllib.request.Request(f"http://127.0.0.1:{self._port}{path}", body, headers)
        with urllib.request.urlopen(request, timeout=10.0) as answer:  # noqa: S310 - our own address
            return json.load(answer)

    def __enter__(self):
        return self.start()

    def __exit__(self, *_):
        self.stop()
