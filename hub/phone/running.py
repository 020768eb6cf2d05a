"""Runs the server of phones of one scene: ports, mesh, certificate, codes, and the lesson on the phones' pages.

Whoever was admitted as a camera may teach: its tracks decide what the observer believes anyhow. Forgetting and
corrections stay with the Teach page and the terminal.
"""

import asyncio
import logging
import secrets
import socket
import threading
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path

from common.address import Address
from common.config import Scene
from common.errors import BadInput
from common.lifecycle import log_to_stderr, stop_on_signals
from common.link import Link
from common.notify import Notifier
from hub.instrumentation import instrumented
from hub.lan import bound_socket
from hub.phone.pages import Answer, ShownCodes, StaticPages, code_page, terminal_code
from hub.phone.phone_messages import LessonRequest
from hub.phone.phone_session import scene_words
from hub.phone.pose_model_file import data_folder, read_files
from hub.phone.register_file import RegisterFile
from hub.phone.serving import PhoneServer, serve_files
from hub.phone.web_certificate_file import WebCertificate, given_certificate, own_certificate
from hub.session import SceneListener, SceneUpdate, has_right
from hub.teaching.lesson_data import action_of, lesson_server_data, plan_of
from hub.teaching.lesson_server import TEACHER_LEASE_S, LessonServer
from hub.teaching.wording import known_labels

log = logging.getLogger("labanmesh.hub")
STOP_CHECK_S = 0.1
"""How often what the pages show is looked at: a third of the time in which a person reacts to the lesson's "now"."""


@dataclass(slots=True)
class PhoneLessons:
    """clock: seconds of a monotonic clock."""

    server: "LessonServer"
    clock: Callable[[], float] = time.monotonic
    _looked_s: float = field(default=float("-inf"), init=False)

    def ask(self, request: LessonRequest) -> str:
        """Do what a phone asks; why that cannot be done, one line, or ""."""
        try:
            self._do(request)
        except BadInput as error:
            return str(error)
        return ""

    def data(self) -> Mapping[str, object] | None:
        """What the pages show; None while nobody looks at a lesson."""
        return lesson_server_data(self.server) if self.clock() - self._looked_s < TEACHER_LEASE_S else None

    def _do(self, request: LessonRequest) -> None:
        self._looked_s = self.clock()
        self.server.looked()
        if request.ask == "start":
            self.server.start(plan_of(request.plan, known_labels(self.server.observers), secrets.token_hex(8)))
        elif request.ask == "press":
            self.server.press(request.lesson, request.number, action_of(request.model_dump()))
        elif request.ask == "stop":
            self.server.stop(request.lesson)


@dataclass(frozen=True, slots=True)
class PhoneRun:
    """hosts: names and addresses of this machine, the one for the code first. certificate: of `labanmesh secure`.

    teaches: whether phones may teach.
    """

    scene: Scene
    observers: tuple[str, ...]
    file: RegisterFile
    listen: Address
    hosts: tuple[str, ...]
    certificate: Path | None = None
    for_s: float | None = None
    teaches: bool = True


def run_phones(run: PhoneRun) -> None:
    """Serve until Ctrl-C; raises LabanmeshError, one line, where that is not possible."""
    log_to_stderr()
    model, scene = read_files(data_folder()), run.scene
    web = (
        given_certificate(run.certificate)
        if run.certificate
        else own_certificate(data_folder() / "authority", run.hosts)
    )
    # The page with the codes has any free port if the phones' page has.
    above = run.listen.port + 1 if 0 < run.listen.port < 65535 else 0
    with (
        bound_socket(run.listen, "--listen") as port,
        bound_socket(Address("127.0.0.1", above), "the port above --listen") as local,
        stop_on_signals(run.for_s) as stop,
        Notifier.from_environment() as supervisor,
        instrumented([scene], "phone") as instrumentation,
        Link.open(scene.mesh, "hub", scene=scene.scene, stop=stop) as link,
        _lessons(run, link) as lessons,
    ):

        def note(update: SceneUpdate) -> None:
            instrumentation.record(update)
            supervisor.alive()
            if lessons is not None:
                lessons.server.note(update)

        with SceneListener(scene, link, note) as listener:
            pages = StaticPages(model, web.authority, {"fingerprint": web.fingerprint, "scene": scene.scene})
            server = _server(run, link, listener, lessons, pages.answer)
            codes = ShownCodes(run.file, run.observers, f"https://{Address(run.hosts[0], port.getsockname()[1])}/")
            page_port = local.getsockname()[1]
            _show(codes, f"http://127.0.0.1:{page_port}/")
            with run.file.naming_page(page_port):
                asyncio.run(_serve(server, codes, (port, local), web, stop, listener.check))


@contextmanager
def _lessons(run: PhoneRun, link: Link) -> Iterator[PhoneLessons | None]:
    """What phones may ask of lessons; None where nothing can be taught from here."""
    if not run.teaches or run.scene.vocabulary is not None or not has_right(run.scene, "teach"):
        yield None
        return
    server = LessonServer(run.scene, link)
    try:
        yield PhoneLessons(server)
    finally:
        server.close()


def _server(
    run: PhoneRun,
    link: Link,
    listener: SceneListener,
    lessons: PhoneLessons | None,
    answer: Callable[[str, str], Answer],
) -> PhoneServer:
    scene = run.scene
    publishers = {name: link.publisher(scene.keys.tracks(name)) for name in scene.roster}

    def words_of(observer: str) -> Mapping[str, object]:
        more = {"file": scene.file, "teaches": lessons is not None, "lesson": lessons and lessons.data()}
        return {**scene_words(listener.state, observer), **more}

    server = PhoneServer(scene.scene, run.file, lambda observer, line: publishers[observer].put(line), answer, words_of)
    if lessons is not None:
        server.ask = lessons.ask
    return server


async def _serve(
    server: PhoneServer,
    codes: ShownCodes,
    ports: tuple[socket.socket, socket.socket],
    web: WebCertificate,
    stop: threading.Event,
    check: Callable[[], None],
) -> None:
    """Serve until `stop` is set, or `check` raises."""
    ended = asyncio.Event()
    on_screen = partial(code_page, codes, lambda: server.live)
    tasks = [
        asyncio.create_task(server.run(ports[0], web.context, ended)),
        asyncio.create_task(serve_files(ports[1], on_screen, ended)),
    ]
    while not (stop.is_set() or any(task.done() for task in tasks)):
        await asyncio.sleep(STOP_CHECK_S)
        check()
        server.show()
    ended.set()
    await asyncio.gather(*tasks)


def _show(codes: ShownCodes, page: str) -> None:
    for observer in codes.observers:
        if (link := codes.link(observer)) is None:
            name = codes.phone(observer) or "(no name)"
            print(f"{observer}: its phone is {name}; open {codes.address} on it", flush=True)
        else:
            print(f"{terminal_code(link)}{observer}: scan this with the phone's camera, or open {link}", flush=True)
    print(f"the codes on this machine's screen: {page}", flush=True)
