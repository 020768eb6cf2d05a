"""What people see of a scene: the verdicts as a page gets them, and as an MQTT broker does."""

import json
import re
import threading
from contextlib import ExitStack, suppress
from datetime import datetime

import httpx
from fault_processes import Process
from mqtt_stage import Broker, Listener, mosquitto
from processes import SOON_S, labanmesh

MS = 1_000_000


class Page:
    """A dashboard and a browser that follows it; `verdicts`: what it was sent, as `aftermath` reads verdicts."""

    def __init__(self, scene_file):
        self.process, self.verdicts = Process(labanmesh("dashboard", scene_file, "--listen", "127.0.0.1:0")), []
        self._opened = threading.Event()

    def open(self):
        """Start both; returns when the browser has its snapshot."""
        self.process.start().wait_for("shows scene")
        url = re.search(r"http://127\.0\.0\.1:\d+/", self.process.log)[0]
        threading.Thread(target=self._follow, args=(url,), daemon=True).start()
        assert self._opened.wait(SOON_S), self.process.log
        return self

    def _follow(self, url):
        # It ends with the dashboard.
        with suppress(httpx.HTTPError), httpx.stream("GET", f"{url}events", timeout=SOON_S) as answer:
            kind = ""
            for line in answer.iter_lines():
                self._opened.set()
                if line.startswith("event: "):
                    kind = line[7:]
                elif line.startswith("data: ") and kind == "verdict":
                    self.verdicts.append(_of_page(json.loads(line[6:])))

    def close(self):
        self.process.kill()


def _of_page(fields):
    times = {f"{name}_ns": fields[name] and fields[name] * MS for name in ("began", "decided", "ended")}
    return {"id": fields["id"], "label": fields["label"], "stage": fields["stage"], **times}


class Home:
    """A broker, a hub that publishes to it, and who listens there; `verdicts` as Page has them."""

    def __init__(self, scene_file, folder, scene):
        self._scene, self._open = scene, ExitStack()
        self._file, self._folder = scene_file, folder

    def open(self):
        """Start them; returns when the hub is connected."""
        broker = self._open.enter_context(Broker(self._folder))
        port = {"LABANMESH_HUB_MQTT_PORT": str(broker.port)}
        hub = Process(labanmesh("hub", "mqtt", self._file), environment=port)
        self._open.callback(hub.kill)
        self._listener = self._open.enter_context(Listener(broker.port))
        hub.start().wait_for("connected to")
        return self

    @property
    def verdicts(self):
        topics = {f"labanmesh/{self._scene}/{kind}" for kind in ("verdict", "ended")}
        return [_of_home(json.loads(text)) for _, topic, text, _ in list(self._listener.messages) if topic in topics]

    def close(self):
        self._open.close()


def _of_home(fields):
    times = {f"{name}_ns": fields[name] and _ns(fields[name]) for name in ("began", "decided", "ended")}
    return {"id": fields["id"], "label": fields["event_type"], "stage": fields["stage"], **times}


def _ns(text):
    return round(datetime.fromisoformat(text).timestamp() * 1e9)


def listeners(scene_file, folder, scene):
    """A page, and a home where there is a broker, by name; none of them started."""
    homes = {"mqtt": Home(scene_file, folder, scene)} if mosquitto() else {}
    return {"page": Page(scene_file), **homes}
