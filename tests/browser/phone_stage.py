"""A phone as a camera: a real observer, the server of phones, and Chromium whose camera is a film."""

import contextlib
import json
import os
import re
import shutil
import socket
import subprocess
import threading
from pathlib import Path

import cv2
import pytest
from played_scene import ROOT, environment
from processes import labanmesh, until

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


class PhoneScene:
    """A scene whose one observer sees through a phone: its processes, and what they publish. A context manager."""

    def __init__(self, folder):
        self.file = folder / "scene.toml"
        self.file.write_text(
            f'scene = "dojo"\n[mesh]\nendpoint = "tcp/127.0.0.1:{free_port()}"\n'
            '[observers.phone1]\nsource = "phone"\nview = "door"\n'
        )
        archive = perform(("1", "2"), LABELS, trials=2)
        write_model(folder / "phone1.model", learn_view(archive, parse_view("door"), Vocabulary(LABELS), kind="phase"))
        self.scene = read_scene(self.file, {})
        self._processes, self._readers, self.lines, self.link = [], [], [], ""

    def __enter__(self):
        self._start("up", self.file)
        self._start("phone", self.file, "--listen", "127.0.0.1:0")
        until(lambda: self.link, lambda: "\n".join(self.lines) or "the server says nothing", BUSY_S)
        self.mesh = Link.open(self.scene.mesh, "hub")
        keys = self.scene.keys
        self.tracks = self.mesh.inbox(keys.tracks("phone1"))
        self.posteriors = self.mesh.inbox(keys.posterior("phone1"))
        return self

    def __exit__(self, *_):
        self.mesh.close()
        for process in self._processes:
            process.terminate()
        for process, reader in zip(self._processes, self._readers, strict=True):
            process.wait(BUSY_S)
            reader.join(BUSY_S)
            process.stdout.close()

    def _start(self, *words):
        process = subprocess.Popen(
            labanmesh(*words), env=environment(), cwd=ROOT, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True
        )
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
    """A line to a server that can be cut: TCP, this machine alone. A context manager."""

    def __init__(self, port):
        self._target, self._listener, self._open = port, None, []
        self.port = free_port()

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
            for pair in ((near, far), (far, near)):
                threading.Thread(target=self._pump, args=pair, daemon=True).start()

    @staticmethod
    def _pump(source, target):
        try:
            while piece := source.recv(65536):
                target.sendall(piece)
        except OSError:
            pass
        finally:
            for each in (source, target):
                with contextlib.suppress(OSError):
                    each.shutdown(socket.SHUT_RDWR)


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
