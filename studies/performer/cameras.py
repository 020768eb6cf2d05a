"""Two network cameras that film the synthetic performer, for `labanmesh teach --rehearse`.

`hub` may not import this room and runs it as a process, `python -m studies.performer.cameras FOLDER LABEL ...`:

1. It writes a scene into the folder, and prints one line of JSON: the scene file, and for each observer the address of
   its camera, which is Motion JPEG over HTTP as most network cameras have it.
2. Each line of its standard input is a request: `act LABEL`, `live` (ordinary life) or `rest`. It ends with its input.

The scene's own sources are a recording of the same movements, so that it runs again without this process.
"""

import json
import sys
import threading
import time
from collections.abc import Sequence
from functools import partial
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path

from common.errors import BadInput, LabanmeshError
from common.vocabulary import Vocabulary
from observer.geometry.views import parse_view
from observer.motion.archive import MotionArchive, Recording
from observer.motion.archive_file import write_archive
from observer.motion.playback import RecordedMotion
from observer.preview.small_picture import encode_jpeg
from observer.rendering.scenery import WEBCAM_NOISE, Scenery
from observer.rendering.virtual_camera import Renderer, VirtualCamera
from observer.runtime.scene_inputs import use_one_thread
from observer.tracks import BODY_PARTS, Floats
from studies.demo_scene import free_port
from studies.output_files import make_folder, write_text
from studies.performer.live import LivePerformer
from studies.performer.perform import perform_continuously
from studies.performer.repertoire import SCORES

PERSON = "1"
FILM_VIEWS = {"door": "door", "shelf": "yaw:15,pitch:15"}
"""Two views from which the tracker still finds the face."""
FILM_HZ, SIZE_PX, MOST_BYTES = 15.0, (480, 360), 50_000
"""Pictures per second, their size, the sensor's noise in grey levels, and the most bytes of a JPEG, which takes a third
of them. In smaller pictures the tracker finds no face. Both cameras take 0.2 of a core."""
FILM_REST_S = (2.0, 3.0)
"""Between two movements of the recording."""
ANOTHER_FOLDER = "cd"


class Camera:
    """The newest picture of one view, as JPEG; `picture` waits for a newer one than the last that it gave."""

    def __init__(self, renderer: Renderer) -> None:
        self._renderer = renderer
        self._changed = threading.Condition()
        self._number, self._jpeg = 0, b""

    def film(self, positions: Floats, number: int) -> None:
        """Render and keep a picture; number: of the picture, from 1."""
        picture = self._renderer.picture(positions, number)
        jpeg = encode_jpeg(picture, MOST_BYTES)[0]
        with self._changed:
            self._number, self._jpeg = number, jpeg
            self._changed.notify_all()

    def picture(self, after: int) -> tuple[int, bytes]:
        """Number and JPEG of the newest picture, which is newer than number `after`."""
        with self._changed:
            self._changed.wait_for(lambda: self._number > after)
            return self._number, self._jpeg


class PictureStream(BaseHTTPRequestHandler):
    """Sends the pictures of the camera that the path names, until the other side has gone."""

    def __init__(self, cameras: dict[str, Camera], *arguments: object) -> None:
        self._cameras = cameras
        super().__init__(*arguments)  # type: ignore[arg-type]

    def do_GET(self) -> None:
        """The answer: a part for each picture."""
        camera, sent = self._cameras.get(self.path.strip("/")), 0
        if camera is None:
            self.send_error(404)
            return
        self.send_response(200)
        self.send_header("Content-Type", "multipart/x-mixed-replace; boundary=frame")
        self.end_headers()
        try:
            while True:
                sent, jpeg = camera.picture(sent)
                head = f"--frame\r\nContent-Type: image/jpeg\r\nContent-Length: {len(jpeg)}\r\n\r\n"
                self.wfile.write(head.encode() + jpeg + b"\r\n")
        except OSError:
            return

    def log_message(self, *_: object) -> None:
        """Nothing: standard error is for faults."""


class Server(ThreadingHTTPServer):
    """Listens on a free port of this machine only."""

    daemon_threads = True

    def __init__(self, cameras: dict[str, Camera]) -> None:
        super().__init__(("127.0.0.1", 0), partial(PictureStream, cameras))

    def handle_error(self, *_: object) -> None:
        """Nothing: an observer that ends closes its connection."""


def film(performer: LivePerformer, cameras: Sequence[Camera], stop: threading.Event) -> None:
    """Film in real time until `stop` is set; on a machine that is too slow with fewer pictures a second."""
    begun_s, number = time.monotonic(), 0
    while not stop.wait(max(0.0, begun_s + number / FILM_HZ - time.monotonic())):
        now_s = time.monotonic()
        positions = performer.positions(now_s)
        for camera in cameras:
            camera.film(positions, number + 1)
        number = max(number + 1, round((time.monotonic() - begun_s) * FILM_HZ))


def performance(labels: Sequence[str]) -> Recording:
    """Each movement twice, with rest between."""
    return perform_continuously(PERSON, list(labels) * 2, FILM_HZ, seed=1, rest_s=FILM_REST_S)


def write_scene(folder: Path, shown: Recording) -> Path:
    """Write the scene file, and the recording that is its source; returns the scene file. Raises BadInput."""
    make_folder(folder, ANOTHER_FOLDER)
    write_archive(folder / "performance.npz", MotionArchive(BODY_PARTS, (shown,)))
    lines = [
        "# Written by labanmesh teach --rehearse: two virtual cameras film the SYNTHETIC performer, again and again.",
        'scene = "rehearsal"',
        "",
        "[mesh]",
        f'endpoint = "tcp/127.0.0.1:{free_port()}"',
    ]
    for name, view in FILM_VIEWS.items():
        lines += ["", f"[observers.{name}]", 'source = "performance.npz"', "loop = true", f'view = "{view}"']
        lines += ['tracker = "camshift"', f"rate_hz = {FILM_HZ}", f"size_px = {list(SIZE_PX)}"]
        # Not by what a run costs: that is little, and seems much on a machine with other work to do.
        lines += [f"max_hz = {FILM_HZ}", f"idle_hz = {FILM_HZ}"]
    return write_text(folder / "scene.toml", "\n".join(lines) + "\n", ANOTHER_FOLDER)


def require_known(labels: Sequence[str]) -> None:
    """Raise BadInput, one line, for a movement that the performer cannot act."""
    Vocabulary(tuple(labels))
    for label in labels:
        if label not in SCORES:
            raise BadInput(f"{label}: the performer of a rehearsal cannot act it; known: {', '.join(SCORES)}")


def run(folder: Path, labels: Sequence[str]) -> None:
    """Film until standard input ends; raises BadInput."""
    require_known(labels)
    shown = performance(labels)
    file = write_scene(folder, shown)
    motion, performer = RecordedMotion(BODY_PARTS, (shown,)), LivePerformer(PERSON, seed=time.time_ns())
    cameras = {
        name: Camera(VirtualCamera(motion, parse_view(view), SIZE_PX, Scenery(noise=WEBCAM_NOISE)).renderer(shown))
        for name, view in FILM_VIEWS.items()
    }
    stop = threading.Event()
    with Server(cameras) as server:
        for target in (server.serve_forever, partial(film, performer, list(cameras.values()), stop)):
            threading.Thread(target=target, daemon=True).start()
        port = server.server_address[1]
        addresses = {name: f"http://127.0.0.1:{port}/{name}" for name in cameras}
        print(json.dumps({"scene": str(file), "cameras": addresses}), flush=True)
        for line in sys.stdin:
            request, _, label = line.strip().partition(" ")
            if request == "act":
                performer.act(SCORES[label], time.monotonic())
            elif request == "live":
                performer.live(time.monotonic())
            else:
                performer.rest()
        stop.set()
        server.shutdown()


def main(words: Sequence[str]) -> int:
    """The exit status."""
    use_one_thread()
    try:
        run(Path(words[0]), words[1:])
    except LabanmeshError as error:
        print(error, file=sys.stderr)
        return error.exit_status
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
