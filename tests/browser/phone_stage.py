"""A phone as a camera: a real observer, the server of phones, and Chromium whose camera is a film."""

import base64
import contextlib
import json
import os
import re
import shutil
import socket
import ssl
import subprocess
import threading
import time
from pathlib import Path

import cv2
import pytest
from played_scene import ROOT, environment
from processes import labanmesh, until
from websockets.exceptions import ConnectionClosed
from websockets.sync.client import connect

from benchmarks.timing import free_port
from common.config import read_scene
from common.link import Link
from common.vocabulary import Vocabulary
from observer.geometry.views import parse_view
from observer.learning.learn import learn_view
from observer.model.model_file import write_model
from studies.performer import perform

BUSY_S = 60.0
LABELS = ("byebye", "nthrow", "lunging")


def film_of_wave(folder):
    """A film that Chromium takes for a camera: a person who waves; the test is skipped without recordings."""
    source = Path(os.environ.get("LABANMESH_DATA", "")) / "wave_webcam" / "wave.mp4"
    if not source.is_file():
        pytest.skip("LABANMESH_DATA names no recordings: a film of a person is needed")
    film, pictures = folder / "wave.mjpeg", cv2.VideoCapture(str(source))
    with film.open("wb") as file:
        # Chromium shows a picture of such a film every 33 ms; this one was taken at 10 Hz.
        while (read := pictures.read())[0]:
            file.write(cv2.imencode(".jpg", read[1])[1].tobytes() * 3)
    return film


def pictures_of(name, first=0, last=None):
    """Pictures of a film of the recordings, as JPEG in base64; the test is skipped without recordings."""
    source = Path(os.environ.get("LABANMESH_DATA", "")) / "wave_webcam" / f"{name}.mp4"
    if not source.is_file():
        pytest.skip("LABANMESH_DATA names no recordings: films of a person are needed")
    pictures, film = [], cv2.VideoCapture(str(source))
    while (read := film.read())[0]:
        pictures.append(base64.b64encode(cv2.imencode(".jpg", read[1])[1].tobytes()).decode())
    return pictures[first:last]


# In place of the phone's camera: a person who stands, and does what the lesson, or `performs`, asks.
PERFORMER = """
window.performs = "";
const FILM_MS = 100, REACTION_MS = 300;
navigator.mediaDevices.getUserMedia = async () => {
  const films = {};
  for (const [name, pictures] of Object.entries(PICTURES)) {
    films[name] = await Promise.all(pictures.map(async (picture) => {
      const bytes = Uint8Array.from(atob(picture), (letter) => letter.charCodeAt(0));
      return createImageBitmap(new Blob([bytes], { type: "image/jpeg" }));
    }));
  }
  const canvas = document.createElement("canvas"), [first] = films[""];
  [canvas.width, canvas.height] = [first.width, first.height];
  const pen = canvas.getContext("2d");
  let queue = [], done = "", stands = 0;
  const begin = (name) => { queue = [...Array(REACTION_MS / FILM_MS).fill(first), ...films[name]]; };
  setInterval(() => {
    const stage = document.getElementById("stage"), isNow = stage.dataset.kind === "now" && !stage.closest("[hidden]");
    const text = stage.textContent, asked = isNow ? Object.keys(films).find((name) => name && text.includes(name)) : "";
    if (asked && done !== text.split("Now!")[0]) begin(asked);
    done = isNow ? text.split("Now!")[0] || done : "";
    if (window.performs) { begin(window.performs); window.performs = ""; }
    pen.drawImage(queue.shift() ?? films[""][stands++ % films[""].length], 0, 0);
  }, FILM_MS);
  return canvas.captureStream(30);
};
"""


def performer():
    """A script for a page: its camera shows a man who waves one hand or both when the lesson asks him to."""
    films = {"": pictures_of("stand"), "wave": pictures_of("wave", 0, 24), "both": pictures_of("wave", 46, 70)}
    return f"(() => {{ const PICTURES = {json.dumps(films)};{PERFORMER} }})()"


class PhoneScene:
    """A scene whose one observer sees through a phone: its processes, and what they publish. A context manager. labels:
    the movements that it knows at the beginning. is_secured: over a router, each process with a certificate."""

    def __init__(self, folder, labels=LABELS, is_secured=False):
        self.file, self._folder, self._is_secured = folder / "scene.toml", folder, is_secured
        scheme, mode = ("tls", 'mode = "router"\n') if is_secured else ("tcp", "")
        self.file.write_text(
            f'scene = "dojo"\n[mesh]\n{mode}endpoint = "{scheme}/127.0.0.1:{free_port()}"\n'
            '[observers.phone1]\nsource = "phone"\nview = "door"\n'
        )
        if labels:
            archive, view = perform(("1", "2"), labels, trials=2), parse_view("door")
            write_model(folder / "phone1.model", learn_view(archive, view, Vocabulary(labels), kind="phase"))
        self._processes, self._readers, self.lines, self.link = [], [], [], ""

    def __enter__(self):
        if self._is_secured:
            self._secure()
            self._start("router", "router", "--scene", self.file)
            self._start("fusion", "fuse", self.file)
            self._start("phone1", "observe", self.file, "phone1")
        else:
            self._start("", "up", self.file)
        self._start("phones", "phone", self.file, "--listen", "127.0.0.1:0")
        until(lambda: self.link, lambda: "\n".join(self.lines) or "the server says nothing", BUSY_S)
        self.scene = read_scene(self.file, self._credentials("hub"))
        self.mesh = Link.open(self.scene.mesh, "hub")
        keys = self.scene.keys
        self.tracks = self.mesh.inbox(keys.tracks("phone1"))
        self.posteriors = self.mesh.inbox(keys.posterior("phone1"))
        return self

    def _secure(self):
        """A certificate for each process; that of the phones may show codes, publish for the observer, and teach."""
        roles = {"phones": ("--hub", "--observer", "phone1", "--teach")}
        for words in (("init",), *(("add", name) for name in ("router", "fusion", "phone1", "hub", "phones"))):
            more = roles.get(words[-1], ())
            command = labanmesh("secure", words[0], self.file, *words[1:], *more)
            subprocess.run(command, env=environment(), cwd=ROOT, check=True, capture_output=True)

    def _credentials(self, certificate):
        """What a process with that certificate has in its environment."""
        folder = self._folder / "secure" / f"{certificate}.1"
        return {"LABANMESH_MESH_CREDENTIALS": str(folder)} if self._is_secured else {}

    def __exit__(self, *_):
        self.mesh.close()
        for process in self._processes:
            process.terminate()
        for process, reader in zip(self._processes, self._readers, strict=True):
            process.wait(BUSY_S)
            reader.join(BUSY_S)
            process.stdout.close()

    def _start(self, certificate, *words):
        process = subprocess.Popen(
            labanmesh(*words), env=environment() | self._credentials(certificate), cwd=ROOT, stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT, text=True,
        )  # fmt: skip
        self._processes.append(process)
        self._readers.append(threading.Thread(target=self._read, args=(process,), daemon=True))
        self._readers[-1].start()

    def _read(self, process):
        for line in process.stdout:
            self.lines.append(line.rstrip())
            if found := re.search(r"https://\S+#\S+", line):
                self.link = found[0]

    def revoke(self):
        subprocess.run(labanmesh("phone", self.file, "--revoke", "phone1"), env=environment(), cwd=ROOT, check=True)

    def taken(self):
        """The tracks that have arrived since the last call: when (ns), and the line."""
        return [(each.arrived_ns, json.loads(each.payload)) for each in self.tracks.take(0.0)]


class Cable:
    """A line to a server that can be cut: TCP, this machine alone. A context manager. sent: bytes to the server."""

    def __init__(self, port):
        self._target, self._listener, self._open = port, None, []
        self.port, self.sent = free_port(), 0

    def __enter__(self):
        self.mend()
        return self

    def __exit__(self, *_):
        self.cut()

    def mend(self):
        self._listener = socket.create_server(("127.0.0.1", self.port), reuse_port=True)
        threading.Thread(target=self._accept, args=(self._listener,), daemon=True).start()

    def cut(self):
        listener, self._listener = self._listener, None
        for each in [listener, *self._open]:
            if each is not None:
                with contextlib.suppress(OSError):
                    each.shutdown(socket.SHUT_RDWR)
                each.close()
        self._open = []

    def _accept(self, listener):
        while True:
            try:
                near, _ = listener.accept()
            except OSError:
                return
            far = socket.create_connection(("127.0.0.1", self._target))
            self._open += [near, far]
            for pair in ((near, far, True), (far, near, False)):
                threading.Thread(target=self._pump, args=pair, daemon=True).start()

    def _pump(self, source, target, is_sent):
        try:
            while piece := source.recv(65536):
                self.sent += is_sent * len(piece)
                target.sendall(piece)
        except OSError:
            pass
        finally:
            for each in (source, target):
                with contextlib.suppress(OSError):
                    each.shutdown(socket.SHUT_RDWR)


def ages_ms(arrived):
    """How old the tracks were that `PhoneScene.taken` gave."""
    return [(at_ns - line["captured_ns"]) / 1e6 for at_ns, line in arrived]


def with_port(link, port):
    """The same address at another port."""
    return re.sub(r":\d+/", f":{port}/", link)


def port_of(link):
    return int(re.search(r":(\d+)/", link)[1])


def phone_browser(driver, film):
    """Chromium with a film for a camera."""
    path = shutil.which("chromium") or shutil.which("chromium-browser") or shutil.which("google-chrome")
    words = ["--use-fake-device-for-media-stream", "--use-fake-ui-for-media-stream"]
    return driver.launch(
        executable_path=path, args=["--no-sandbox", *words, f"--use-file-for-fake-video-capture={film}"]
    )


class Sniffer:
    """All that leaves a page: its requests, and the messages on its WebSockets."""

    def __init__(self, page):
        self.requests, self.sent = [], []
        page.on("request", lambda request: self.requests.append((request.method, request.url, request.post_data)))
        page.on("websocket", lambda ws: ws.on("framesent", lambda text: self.sent.append(text)))


class Intruder:
    """A program that speaks to the server of phones as it likes. link: of the phones' page."""

    PLACE = (1.25, 2.5, 0.75)
    """Where every part lies that it sends; no person has all parts in one place."""

    def __init__(self, link):
        self._address = re.sub(r"^https(.*)/#.*", r"wss\1/socket", link)

    def tracks(self, **more):
        return {"at_ms": time.time() * 1000, "parts": {"head": self.PLACE, "left_hand": self.PLACE}, **more}

    def made(self, line):
        return tuple(line["parts"]["head"] or ()) == self.PLACE

    def ending(self, **first):
        """Sends a message; the words with which the server ends the connection."""
        context = ssl.create_default_context()
        context.check_hostname, context.verify_mode = False, ssl.CERT_NONE
        with connect(self._address, ssl=context) as socket_:
            socket_.send(json.dumps(first))
            words = ""
            with contextlib.suppress(ConnectionClosed):
                while True:
                    words = json.loads(socket_.recv(BUSY_S)).get("ended", words)
            return words
