"""An observer whose pictures are used as the scene file asks: live pictures, clips of verdicts, the watch for falls."""

import logging
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack, contextmanager
from typing import TYPE_CHECKING

from common import SECOND_NS
from common.config import Scene
from common.errors import LabanmeshError
from common.picture_message import MOST_PICTURE_BYTES, PICTURE_BYTES_PER_S, PICTURE_SIDE_PX, PictureMessage
from common.subsession import Publisher
from common.wire import encode
from observer.preview.clip_folder import ClipFolder
from observer.preview.clips import VerdictClips
from observer.preview.posture_outlet import PostureOutlet
from observer.preview.small_picture import MotionExtent, Sighting, encode_jpeg, small_picture
from observer.runtime.pipeline import Posterior
from observer.runtime.service import ObserverAround, ObserverLike
from observer.tracks import Frame, Tracks

if TYPE_CHECKING:
    from common.link import Link
    from observer.prepared_tracks import PreparedTracker

log = logging.getLogger("labanmesh.observer")

LONGEST_NS = SECOND_NS // 2
"""After this long a picture is shown although the observer has skipped it: an observer rests in an empty room."""


class LivePicture:
    """Publishes at most `rate_hz` pictures a second, and at most PICTURE_BYTES_PER_S bytes."""

    def __init__(self, publisher: Publisher, rate_hz: float) -> None:
        self._publisher, self._every_ns = publisher, round(SECOND_NS / rate_hz)
        self._limit = min(MOST_PICTURE_BYTES, int(PICTURE_BYTES_PER_S / rate_hz))
        self._next_ns = 0

    def is_due(self, now_ns: int) -> bool:
        """Whether a picture is wanted at `now_ns`."""
        # A clock that was set back must not silence it.
        early = now_ns < self._next_ns <= now_ns + self._every_ns
        return not early and self._publisher.has_subscriber

    def show(self, sighting: Sighting, now_ns: int) -> None:
        """Publish one picture; raises LabanmeshError if the link is closed."""
        # Counted from when it was due, so that the rate is right whatever the camera's is.
        late_ns = now_ns - self._next_ns
        self._next_ns = (self._next_ns if 0 <= late_ns < self._every_ns else now_ns) + self._every_ns
        jpeg, (width, height) = encode_jpeg(small_picture(sighting, PICTURE_SIDE_PX), self._limit)
        message = PictureMessage(captured_ns=sighting.captured_ns, width=width, height=height, jpeg=jpeg)
        self._publisher.put(encode(message))


PictureOutlet = LivePicture | VerdictClips | PostureOutlet
"""Receives the pictures of an observer at its own rate. is_due: called after each frame, and fast."""


@contextmanager
def shown_pictures(
    scene: Scene, observer_id: str, observer: ObserverLike, tracker: "PreparedTracker", link: "Link"
) -> Iterator[ObserverLike]:
    """The observer, with the outlets that its section switches on; the observer itself if there are none."""
    section, keys = scene.observer(observer_id), scene.keys
    outlets: list[PictureOutlet] = []
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
        """The observer's posterior after the frame, if it has one. Then the outlets that are due get the frame."""
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
            picture, parts = frame.content if frame.content.ndim == 3 else None, self._tracker.tracker.body_parts
            sighting = Sighting(picture, tracks, parts, frame.captured_ns, self._extent.corners)
            for outlet in due:
                self._show(outlet, sighting, now_ns)
        return posterior

    def _show(self, outlet: PictureOutlet, sighting: Sighting, now_ns: int) -> None:
        try:
            outlet.show(sighting, now_ns)
        except LabanmeshError as error:
            self._outlets.remove(outlet)
            log.warning("no more pictures: %s", error)
