"""An observer whose pictures are used as the scene file asks: live pictures, clips of verdicts, the watch for falls."""

import logging
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack, contextmanager
from typing import TYPE_CHECKING

from common import SECOND_NS
from common.config import Scene
from common.errors import LabanmeshError
from observer.preview.clip_folder import ClipFolder
from observer.preview.clips import VerdictClips
from observer.preview.film import FilmPreview
from observer.preview.live_picture import LivePicture
from observer.preview.posture_outlet import PostureOutlet
from observer.preview.sight import MotionExtent, ShownPosterior, Sighting
from observer.runtime.pipeline import Posterior
from observer.runtime.service import ObserverAround, ObserverLike
from observer.tracks import Frame, Tracks

if TYPE_CHECKING:
    from common.link import Link
    from observer.runtime.prepared_tracker import PreparedTracker

log = logging.getLogger("labanmesh.observer")

LONGEST_NS = SECOND_NS // 2
"""After this long a picture is shown although the observer has skipped it: an observer rests in an empty room."""


PictureOutlet = LivePicture | VerdictClips | PostureOutlet | FilmPreview
"""Receives the pictures of an observer at its own rate. is_due: called after each frame, and fast."""


@contextmanager
def shown_pictures(
    scene: Scene,
    observer_id: str,
    observer: ObserverLike,
    tracker: "PreparedTracker",
    link: "Link",
    preview: FilmPreview | None = None,
) -> Iterator[ObserverLike]:
    """The observer, with the outlets that its section switches on; the observer itself if there are none."""
    section, keys = scene.observer(observer_id), scene.keys
    outlets: list[PictureOutlet] = [] if preview is None else [preview]
    closing = ExitStack()
    if section.picture_hz:
        publisher = link.publisher(keys.picture(observer_id), priority="low")
        outlets.append(LivePicture(publisher, section.picture_hz))
        log.info("%s: live picture of %g Hz while somebody watches", observer_id, section.picture_hz)
    clips = section.clips
    if clips.folder:
        folder = ClipFolder(scene.place(clips.folder), clips.keep_days, clips.keep_mb)
        arrived = link.inbox(keys.verdict, keys.fusion_status())
        written = VerdictClips(arrived, folder, observer_id, clips.seconds, lambda: observer.vocabulary)
        outlets.append(written)
        closing.callback(written.close)
        log.info("%s: a clip of each verdict in %s", observer_id, folder.path)
    if scene.watch.fallen is not None:
        posture = PostureOutlet(
            link.publisher(keys.posture(observer_id)), scene.watch.fallen.leave_out.get(observer_id, ())
        )
        outlets.append(posture)
    with closing:
        yield PicturedObserver(observer, tracker, outlets) if outlets else observer


class PicturedObserver(ObserverAround):
    """Performs each step of another observer, and gives its pictures to outlets.

    tracker: the one that the observer steps. An outlet that fails is dropped with one line in the log.
    """

    def __init__(
        self,
        observer: ObserverLike,
        tracker: "PreparedTracker",
        outlets: Sequence[PictureOutlet],
        clock: Callable[[], int] = time.time_ns,
    ) -> None:
        super().__init__(observer)
        self._tracker, self._outlets, self._clock = tracker, list(outlets), clock
        self._extent = MotionExtent()
        self._before: Tracks | None = None
        self._shown_ns = 0

    def step(self, frame: Frame) -> Posterior | None:
        """Let the observer process one frame, then show it to the outlets that want one."""
        posterior = self._observer.step(frame)
        now_ns, tracks = self._clock(), self._tracker.all_tracks
        if tracks is None:
            return posterior
        if frame.content.ndim != 3:
            for centres in (tracks.centres, *(person.centres for person in tracks.persons)):
                self._extent.widen(centres)
        due = [outlet for outlet in self._outlets if outlet.is_due(now_ns)]
        # The tracks at a picture that the observer skipped are those of an earlier one.
        skipped, self._before = posterior is None and tracks is self._before, tracks
        if due and not (skipped and now_ns - self._shown_ns < LONGEST_NS):
            self._shown_ns = now_ns
            sighting = self._sighting(frame, tracks, posterior)
            for outlet in due:
                self._show(outlet, sighting, now_ns)
        return posterior

    def _sighting(self, frame: Frame, tracks: Tracks, posterior: Posterior | None) -> Sighting:
        vocabulary, tracker, known = self.vocabulary, self._tracker.tracker, None
        if posterior is not None and vocabulary is not None:
            known = ShownPosterior(vocabulary.labels, posterior.p, posterior.rest)
        return Sighting(
            frame.content if frame.content.ndim == 3 else None,
            tracks,
            tracker.body_parts,
            frame.captured_ns,
            self._extent.corners,
            known,
            self.complaint,
            getattr(tracker, "skin", None),
        )

    def _show(self, outlet: PictureOutlet, sighting: Sighting, now_ns: int) -> None:
        try:
            outlet.show(sighting, now_ns)
        except LabanmeshError as error:
            self._outlets.remove(outlet)
            log.warning("no more pictures: %s", error)
