"""An observer that is taught while it runs: it answers teachers, remembers its newest tracks, and changes its model."""

import logging
import os
import threading
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING

from common.config import MODELS_VARIABLE, Scene
from common.errors import BadInput, LabanmeshError
from common.message_types import BodyRegionShares
from common.subsession import SubSession
from common.teaching_messages import TEACHING_TEXT_LIMIT, TaughtPlace, TeachReply, TeachRequest
from common.vocabulary import Vocabulary
from common.wire import BadMessage, decode, encode
from observer.learning.taught_takes import doubtful_takes
from observer.motion.archive import TracksCamera
from observer.preview.clip_folder import ClipFolder
from observer.recording.own_tracks import RECORDING_HZ, TracksRecorder
from observer.runtime.people_observer import AnyObserver, FloorPlacer, picture_width
from observer.runtime.pipeline import Posterior
from observer.teaching.model_learner import Build, ModelLearner
from observer.teaching.takes_file import TakesFile
from observer.teaching.taught_person import TaughtPerson
from observer.teaching.teaching import TEACHER_S, Teaching
from observer.tracks import Frame

if TYPE_CHECKING:
    from observer.model.base import MovementModel
    from observer.runtime.scene_inputs import ObserverInputs

log = logging.getLogger("labanmesh.observer")
NO_MODEL = "no model yet: labanmesh teach {} LABEL LABEL ... teaches this camera"
LESSON_S, IDLE_S = 60.0, 2.0
"""Seconds of tracks that are remembered in a lesson, at least, and outside of one."""


class TeachableObserver:
    """An `ObserverLike` whose tracks are remembered, and whose model can be taught and replaced while it runs.

    observer: has the model to begin with; None: there is no model yet, and no posterior. file: the scene file, for
    people. placer: tells where people stand.
    """

    def __init__(
        self,
        inputs: "ObserverInputs",
        observer: AnyObserver | None,
        recorder: TracksRecorder,
        teaching: Teaching,
        learner: ModelLearner,
        file: str,
        placer: FloorPlacer,
    ) -> None:
        self._no_model = NO_MODEL.format(file)
        self._tracker, self._observer = inputs.tracker, observer
        self._recorder, self._teaching, self._learner = recorder, teaching, learner
        self._remembered_s = recorder.memory_s
        self._taught, self._asked_s = TaughtPerson(placer), float("-inf")
        self._lock = threading.Lock()

    @property
    def vocabulary(self) -> Vocabulary | None:
        """The movements of the model in force; None without one."""
        return None if self._observer is None else self._observer.vocabulary

    @property
    def leans_on(self) -> BodyRegionShares | None:
        """The regions of the body that the model in force leans on; None if unknown."""
        return None if self._observer is None else self._observer.leans_on

    @property
    def complaint(self) -> str:
        """The tracker's complaint, or that there is no model."""
        return self._tracker.complaint or ("" if self._observer is not None else self._no_model)

    def step(self, frame: Frame) -> Posterior | None:
        """The posterior after one more frame; None without a model."""
        if self._learner.removed:
            self._observer, self._learner.removed = None, False
            log.warning("%s", self._no_model)
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
        with self._lock:
            now_s = time.monotonic()
            is_asked = now_s - self._asked_s < TEACHER_S
            width_px = picture_width(frame)
            tracks = self._taught.tracks(self._tracker, width_px, now_s) if is_asked else self._tracker.every_track
            if tracks is None:
                return posterior
            least_s = LESSON_S if self._teaching.is_taught(now_s) else IDLE_S
            self._recorder.memory_s = max(self._remembered_s, least_s)
            self._recorder.update(frame, tracks)
            complaint = self._tracker.complaint or self._taught.complaint
            is_of_any = len(self._tracker.persons()) > 1 and not (is_asked and self._taught.is_begun)
            self._teaching.step(frame.at_ns, tracks, complaint, now_s, is_of_any)
        return posterior

    def end(self) -> Posterior | None:
        """The posterior now that the source has ended; None if it shows nothing new."""
        return None if self._observer is None else self._observer.end()

    def respond(self, payload: bytes) -> bytes | None:
        """The answer to a request, in a thread of the mesh; None for bytes that are none."""
        try:
            request = decode(TeachRequest, payload)
        except BadMessage as error:
            return encode(TeachReply(state="idle", fault=f"not understood: {error}"[:TEACHING_TEXT_LIMIT]))
        vocabulary = self.vocabulary
        with self._lock:
            self._asked_s = time.monotonic()
            self._taught.expect(request, self._asked_s)
            reply = self._teaching.handle(request, self._asked_s, vocabulary.labels if vocabulary else ())
            if (place := self._taught.place) is not None:
                at = TaughtPlace(at=list(place.at), covariance=list(place.covariance))
                reply = reply.model_copy(update={"place": at})
            takes = self._teaching.recorded() if request.command == "check" and not reply.fault else None
        if takes is not None:
            # Without the lock: frames go on meanwhile.
            reply = reply.model_copy(update={"doubts": doubtful_takes(takes, request.labels)})
        if reply.fault:
            log.warning("teaching: %s", reply.fault)
        try:
            return encode(reply)
        except LabanmeshError as error:
            # Thousands of takes: what was done is done.
            return encode(TeachReply(state=reply.state, fault=str(error)[:TEACHING_TEXT_LIMIT]))


def why_not(scene: Scene, observer_id: str) -> str:
    """Why the observer cannot be taught, in a line; "" if it can."""
    if scene.vocabulary is not None:
        labels = ", ".join(scene.vocabulary)
        return f"the scene file names its vocabulary ({labels}); remove that line, the models bring theirs"
    model = scene.observer(observer_id).model
    others = [name for name, each in scene.observers.items() if each.model == model and name != observer_id]
    if others:
        return f"{model} is the model of {' and '.join(others)} too; give each observer a model of its own"
    folder = scene.taught_model(observer_id).parent
    if not (folder.is_dir() and os.access(folder, os.W_OK | os.X_OK)):
        way_out = f"make the observer's user its owner, or set {MODELS_VARIABLE} to a folder of that user"
        return f"this observer cannot write to {folder}, where its takes and its model belong; {way_out}"
    return ""


def model_in_force(scene: Scene, observer_id: str) -> "MovementModel | None":
    """The observer's model; None while it waits to be taught: it has none yet, or one of another version beside takes.

    Raises BadInput for a model that cannot be read and that nobody can teach anew from takes that lie beside it.
    """
    # Imported on use: whoever only asks why not needs neither models nor cameras.
    from observer.model.model_file import read_model
    from observer.runtime.scene_inputs import is_untaught

    if is_untaught(scene, observer_id):
        return None
    path = scene.model_file(observer_id)
    try:
        return read_model(path)
    except BadInput as error:
        if why_not(scene, observer_id) or not path.with_name(f"{observer_id}.tracks.npz").exists():
            raise
        log.warning("%s; or teach it: its takes lie beside it", error)
        return None


def _clips_of(scene: Scene, observer_id: str) -> Callable[[str], int]:
    """Deletes the observer's clips of a label, or all for ""; returns how many."""
    clips = scene.observer(observer_id).clips
    if not clips.folder:
        return lambda label: 0
    folder = ClipFolder(scene.place(clips.folder), clips.keep_days, clips.keep_mb)
    return lambda label: folder.delete_of(observer_id, label)


@contextmanager
def teachable(
    scene: Scene, observer_id: str, inputs: "ObserverInputs", observer: AnyObserver | None, build: Build
) -> Iterator[TeachableObserver]:
    """The observer that can be taught; its takes lie beside its model file, as ID.tracks.npz."""
    from observer.runtime.scene_inputs import person_in

    model = scene.taught_model(observer_id)
    rate_hz = inputs.source.rate_hz if inputs.at_own_rate else RECORDING_HZ
    parts = inputs.tracker.every_part
    recorder = TracksRecorder(parts, rate_hz, scene.teaching.remember_minutes * 60)
    takes = takes_of(scene, observer_id, parts)
    learner = ModelLearner(takes.path, model, build, scene_model_of(scene, observer_id))
    teaching = Teaching(recorder, takes, learner, why_not(scene, observer_id), _clips_of(scene, observer_id))
    try:
        placer = FloorPlacer(inputs.view, person_in(scene, observer_id, inputs.view), alone=len(scene.roster) == 1)
        yield TeachableObserver(inputs, observer, recorder, teaching, learner, scene.file, placer)
    finally:
        learner.close()


def takes_of(scene: Scene, observer_id: str, body_parts: Sequence[str]) -> TakesFile:
    """The takes of an observer, with these parts."""
    models, file = (scene.taught_model(observer_id), scene_model_of(scene, observer_id)), f"{observer_id}.tracks.npz"
    path, earlier = (model.with_name(file) for model in models)
    return TakesFile(path, body_parts, TracksCamera(observer_id), earlier)


def scene_model_of(scene: Scene, observer_id: str) -> Path:
    """The model that the scene file names; by the same path as the taught one if both are one file."""
    named, taught = scene.named_model(observer_id), scene.taught_model(observer_id)
    return taught if named.resolve() == taught.resolve() else named


def answer_teachers(session: SubSession, scene: Scene, observer_id: str, observer: TeachableObserver) -> None:
    """Answer requests under the observer's own key until the session ends."""
    session.answer_requests(scene.keys.teach(observer_id), observer.respond)
