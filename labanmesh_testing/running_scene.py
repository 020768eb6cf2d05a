"""A scene that runs in the test's process: a real fusion service, stub observers, real messages on a real mesh."""

import json
import threading
from collections.abc import Mapping, Sequence
from contextlib import ExitStack
from pathlib import Path

from common.config import read_scene
from common.link import Link, MeshRole
from common.vocabulary import Vocabulary
from common.zenoh_settings import LOOPBACK
from fusion.server import serve
from labanmesh_testing.mesh import Mesh
from labanmesh_testing.stub_observer import StubObserver
from labanmesh_testing.verdict_listener import listening

STUB_RATE_HZ = 30.0
"""Posteriors of each stub observer in a second: those of a webcam."""
SCENE_READY_S = 20.0
"""A scene is ready within half a second; a machine that is busy with other tests needs longer."""
OBSERVERS = ("sofa", "shelf", "door")


class RunningScene:
    """file: the scene file, for the program under test. endpoint: where it connects. observers: the stubs, by name.

    listener: all verdicts since the start. scene: the scene file as the program reads it.
    """

    def __init__(self, file: Path, labels: Sequence[str], observers: Sequence[str], opened: ExitStack) -> None:
        written = read_scene(file, {})
        self._mesh = Mesh(written.mesh)
        opened.callback(self._mesh.close)
        self.endpoint = self._mesh.config.endpoint
        # The programs under test read where the others meet.
        file.write_text(file.read_text(encoding="utf-8").replace(LOOPBACK, self.endpoint), encoding="utf-8")
        self.file, self.scene = file, written.model_copy(update={"mesh": self._mesh.config})
        vocabulary = Vocabulary(tuple(labels))
        self.observers = {
            name: StubObserver(name, self.scene.keys, vocabulary, self.link("observer")) for name in observers
        }
        self.listener = opened.enter_context(listening(self.scene.keys, self.link()))
        self._mesh.run(serve, [self.scene], self.scene.fusion.id, self._mesh.meeting)
        self._mesh.run(self._play)
        self.listener.wait_for_judgement(lambda judgement: judgement.agreement.n == len(self.observers), SCENE_READY_S)

    def link(self, role: MeshRole = "hub") -> Link:
        """One more process of the scene, as far as the others can tell: for a program under test that takes a link."""
        return self._mesh.peer(role)

    def _play(self, stop: threading.Event) -> None:
        """Let all observers publish, as often as cameras do, until `stop` is set."""
        while not stop.wait(1 / STUB_RATE_HZ):
            for observer in self.observers.values():
                observer.publish_due()


class SceneStarter:
    """The fixture `laban_scene`: each call starts a scene, which ends with the test."""

    def __init__(self, folder: Path, opened: ExitStack) -> None:
        self._folder, self._opened = folder, opened

    def __call__(
        self,
        labels: Sequence[str],
        observers: Sequence[str] = OBSERVERS,
        *,
        name: str = "room",
        fusion: Mapping[str, object] | None = None,
        more: str = "",
    ) -> RunningScene:
        """Start a scene of these movements and stub observers; returns when all of them count.

        fusion: keys of [fusion] that differ from their defaults. more: other sections of the scene file, as TOML.
        Raises BadInput for what no scene file may hold.
        """
        lines = [f"scene = {json.dumps(name)}", f"vocabulary = {json.dumps(list(labels))}", "[mesh]"]
        lines += ['mode = "process"', f'endpoint = "{LOOPBACK}"', "[fusion]", 'memory = ""']
        lines += [f"{key} = {json.dumps(value)}" for key, value in (fusion or {}).items()]
        for observer in observers:
            lines += [f"[observers.{observer}]", 'source = "stub"']
        file = self._folder / f"{name}.toml"
        file.write_text("\n".join([*lines, more, ""]), encoding="utf-8")
        return RunningScene(file, labels, observers, self._opened)
