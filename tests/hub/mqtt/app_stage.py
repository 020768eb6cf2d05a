"""What the tests of the Home Assistant app share: its folders, and a SIMULATED supervisor."""

import contextlib
import http.server
import json
import threading

from played_scene import ROOT

RUN = ROOT / "deploy" / "home-assistant" / "labanmesh" / "run.py"
TOKEN = "given by the supervisor"  # noqa: S105 - of the simulation


class Supervisor(http.server.BaseHTTPRequestHandler):
    """Answers one question of the app: `service`, once it has been asked more than `known_after` times."""

    service, asked, known_after = None, 0, 0

    def do_GET(self):
        type(self).asked += 1
        assert self.path == "/services/mqtt" and self.headers["Authorization"] == f"Bearer {TOKEN}"
        found = self.service is not None and self.asked > self.known_after
        body = (
            {"result": "ok", "data": self.service} if found else {"result": "error", "message": "Service not enabled"}
        )
        self.send_response(200 if found else 400)
        self.end_headers()
        self.wfile.write(json.dumps(body).encode())

    def log_message(self, *_):
        pass


@contextlib.contextmanager
def simulated_supervisor():
    """Its address; `Supervisor` says what it knows."""
    Supervisor.service, Supervisor.asked, Supervisor.known_after = None, 0, 0
    with http.server.ThreadingHTTPServer(("127.0.0.1", 0), Supervisor) as server:
        threading.Thread(target=server.serve_forever, args=(0.01,), daemon=True).start()
        yield f"http://127.0.0.1:{server.server_port}"
        server.shutdown()


def app_folders(place):
    """The folders of an app below `place`: data, config, homeassistant."""
    for folder in ("data", "config", "homeassistant"):
        (place / folder).mkdir(parents=True)
    return place


def write_options(root, **options):
    (root / "data/options.json").write_text(json.dumps({"scene": "room", "cameras": [], "blueprints": True, **options}))
