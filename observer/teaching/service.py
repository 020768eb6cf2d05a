"""An observer that is taught while it runs: requests on the mesh, learning in a process of its own, the new model."""

import json
import logging
import os
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import TYPE_CHECKING

from common.config import MODELS, Scene
from common.errors import LabanmeshError
from common.subsession import SubSession
from common.teaching_messages import TEXT_LIMIT, LearnedReport, TeachReply, TeachRequest
from common.vocabulary import Vocabulary
from common.wire import BadMessage, decode, encode
from observer.model.model_file import read_model
from observer.motion.archive import TracksCamera
from observer.recording.own_tracks import RATE_HZ, TracksRecorder
from observer.runtime.pipeline import Observer, Posterior
from observer.teaching.takes_file import TakesFile
from observer.teaching.teaching import Teaching
from observer.tracks import Frame

if TYPE_CHECKING:
    from observer.model.base import MovementModel
    from observer.runtime.scene_inputs import ObserverInputs

log = logging.getLogger("labanmesh.observer")
NICE = 10
"""Learning waits for whatever else the machine has to do: posteriors go on."""
END_S = 2.0
NO_MODEL = "no model yet: labanmesh teach SCENE LABEL LABEL ... teaches this camera"
Build = Callable[["MovementModel"], Observer]


class ModelLearner:
    """Learns a model from the takes file in a process of its own, and builds the observer that uses it.

    model: the model file, which `adopt` replaces; the last one is kept as NAME.before.model. build: makes an observer
    of a model. `ready` is that observer from the time on that `adopt` named.
    """

    def __init__(self, takes: Path, model: Path, build: Build) -> None:
        self._takes, self._model, self._build = takes, model, build
        self._next = model.with_name(f"{model.stem}.next{model.suffix}")
        self._observer: Observer | None = None
        self._process: subprocess.Popen[str] | None = None
        self._due_s: float | None = None
        self.busy, self.fault = False, ""
        self.learned: LearnedReport | None = None

    def learn(self, labels: Sequence[str]) -> None:
        """Begin to learn these movements."""
        self.busy, self.fault, self.learned = True, "", None
        threading.Thread(target=self._learn, args=(list(labels),), name="learn", daemon=True).start()

    def adopt(self, in_s: float) -> None:
        """Replace the model file now, and the observer after so many seconds; raises LabanmeshError."""
        try:
            if self._model.exists():
                self._model.replace(self._model.with_name(f"{self._model.stem}.before{self._model.suffix}"))
            self._next.replace(self._model)
        except OSError as error:
            raise LabanmeshError(f"{self._model}: cannot be replaced: {error.strerror or error}") from None
        self._due_s, self.learned = time.monotonic() + in_s, None

    def ready(self) -> Observer | None:
        """The observer of the adopted model, once, when it is due."""
        if self._due_s is None or time.monotonic() < self._due_s:
            return None
        observer, self._observer, self._due_s = self._observer, None, None
        return observer

    def close(self) -> None:
        """End a process that still learns."""
        process = self._process
        if process is not None and process.poll() is None:
            process.terminate()
            with suppress(subprocess.TimeoutExpired):
                process.wait(END_S)

    def _learn(self, labels: list[str]) -> None:
        try:
            self._run(labels)
            model = read_model(self._next)
            self._observer = self._build(model)
            self.learned = LearnedReport(labels=list(model.header.vocabulary.labels), results=_results(model))
        except (LabanmeshError, OSError) as error:
            self.fault = str(error)[:TEXT_LIMIT]
            log.warning("learning failed: %s", error)
        finally:
            self.busy = False

    def _run(self, labels: list[str]) -> None:
        command = [sys.executable, "-P", "-m", "labanmesh", "learn", str(self._takes), "--labels", ",".join(labels)]
        command += ["--body-parts", "auto", "-o", str(self._next)]
        self._process = process = subprocess.Popen(  # noqa: S603 - the command line is ours
            command, stdin=subprocess.DEVNULL, stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT, text=True, errors="replace",
        )  # fmt: skip
        with suppress(OSError):
            os.setpriority(os.PRIO_PROCESS, process.pid, NICE)
        text, _ = process.communicate()
        lines = [line for line in text.splitlines() if line.strip()]
        if process.returncode:
            raise LabanmeshError(lines[-1] if lines else f"learning ended with status {process.returncode}")
        for line in lines:
            log.info("%s", line)


def _results(model: "MovementModel") -> dict[str, dict[str, int]]:
    with suppress(ValueError, AttributeError, TypeError):
        table = json.loads(model.header.provenance.get("held_out", "{}"))
        return {str(truth): {str(label): int(n) for label, n in row.items()} for truth, row in table.items()}
    return {}


class TeachableObserver:
    """An `ObserverLike` whose tracks are remembered, and whose model can be taught and replaced while it runs.

    observer: with the model that it begins with; None: it has none and publishes nothing. respond: answers a request.
    """

    def __init__(
        self,
        inputs: "ObserverInputs",
        observer: Observer | None,
        recorder: TracksRecorder,
        teaching: Teaching,
        learner: ModelLearner,
    ) -> None:
        self._tracker, self._observer = inputs.tracker, observer
        self._recorder, self._teaching, self._learner = recorder, teaching, learner
        self._lock = threading.Lock()

    @property
    def vocabulary(self) -> Vocabulary | None:
        """The movements of the model in force."""
        return None if self._observer is None else self._observer.vocabulary

    @property
    def complaint(self) -> str:
        """The tracker's complaint, or that there is no model."""
        return self._tracker.complaint or ("" if self._observer is not None else NO_MODEL)

    def step(self, frame: Frame) -> Posterior | None:
        """The posterior after one more frame; None without a model."""
        if (observer := self._learner.ready()) is not None:
            self._observer = observer
            self._tracker.want(observer.body_parts, fewer_parts=True)
            log.info("new model: %s", ", ".join(observer.vocabulary.labels))
        if frame.repeated:
            return None if self._observer is None else self._observer.step(frame)
        posterior = None
        if self._observer is not None:
            posterior = self._observer.step(frame)
        else:
            self._tracker.update(frame)
        # All that the tracker finds is recorded, whatever the model reads now.
        tracks = self._tracker.every_track
        if tracks is None:
            return posterior
        with self._lock:
            self._recorder.update(frame, tracks)
            self._teaching.step(frame.at_ns, tracks, self._tracker.complaint, time.monotonic())
        return posterior

    def end(self) -> Posterior | None:
        """The posterior now that the source has ended."""
        return None if self._observer is None else self._observer.end()

    def respond(self, payload: bytes) -> bytes | None:
        """The answer to a request, in a thread of the mesh; None for bytes that are none."""
        try:
            request = decode(TeachRequest, payload)
        except BadMessage as error:
            return encode(TeachReply(state="idle", fault=f"not understood: {error}"[:TEXT_LIMIT]))
        vocabulary = self.vocabulary
        with self._lock:
            reply = self._teaching.handle(request, time.monotonic(), vocabulary.labels if vocabulary else ())
        if reply.fault:
            log.warning("teaching: %s", reply.fault)
        return encode(reply)


def why_not(scene: Scene, observer_id: str) -> str:
    """Why the observer cannot be taught, in a line; "" if it can."""
    if scene.vocabulary is not None:
        named = ", ".join(scene.vocabulary)
        return f"the scene file names its vocabulary ({named}); remove that line, the models bring theirs"
    model = scene.observer(observer_id).model
    others = [name for name, each in scene.observers.items() if each.model == model and name != observer_id]
    if others:
        return f"{model} is the model of {' and '.join(others)} too; give each observer a model of its own"
    folder = scene.taught_model(observer_id).parent
    if not (folder.is_dir() and os.access(folder, os.W_OK | os.X_OK)):
        way_out = f"make the observer's user its owner, or set {MODELS} to a folder of that user"
        return f"this observer cannot write to {folder}, where its takes and its model belong; {way_out}"
    return ""


@contextmanager
def teachable(
    scene: Scene, observer_id: str, inputs: "ObserverInputs", observer: Observer | None, build: Build
) -> Iterator[TeachableObserver]:
    """The observer that can be taught; its takes lie beside its model file, as ID.tracks.npz."""
    model = scene.taught_model(observer_id)
    rate_hz = inputs.source.rate_hz if inputs.at_own_rate else RATE_HZ
    parts = inputs.tracker.every_part
    recorder = TracksRecorder(parts, rate_hz)
    takes = TakesFile(model.with_name(f"{observer_id}.tracks.npz"), parts, TracksCamera(observer_id))
    learner = ModelLearner(takes.path, model, build)
    teaching = Teaching(recorder, takes, learner, why_not(scene, observer_id))
    try:
        yield TeachableObserver(inputs, observer, recorder, teaching, learner)
    finally:
        learner.close()


def answer_teachers(session: SubSession, scene: Scene, observer_id: str, observer: TeachableObserver) -> None:
    """Answer requests under the observer's own key until the session ends."""
    session.answer_requests(scene.keys.teach(observer_id), observer.respond)
