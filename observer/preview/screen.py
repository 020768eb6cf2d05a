"""Shows an observer's frames while it works: drawing runs in its own thread and never slows the observer."""

import logging
import queue
import threading
import time
from collections.abc import Callable, Sequence
from contextlib import suppress
from pathlib import Path
from typing import Any, Protocol, Self

from numpy.typing import NDArray

from common.errors import BadInput, LabanmeshError
from common.vocabulary import Vocabulary
from observer.preview.film import CODECS, STILLS, Film, Outlet, Stills, Window, why_no_window
from observer.preview.painting import paint
from observer.preview.sight import Picture, PreviewFrame, PreviewHistory, ShownPosterior
from observer.runtime.pipeline import Posterior
from observer.runtime.service import ObserverLike
from observer.tracks import Frame, Tracker, Tracks

log = logging.getLogger("labanmesh.observer")

INSTEAD = Path("labanmesh-preview.mp4")
"""What is written where a window was wanted and there can be none."""
WAITING = 8
"""So many pictures may wait to be painted where all are kept; then the observer waits too."""
LOOK_S = 0.2
"""So often who waits for the painter looks whether it still works."""
KNOWN = "window, FILE.mp4, FILE.avi, FILE.png (the newest), FILE-%06d.png, a folder"

Clock = Callable[[], int]
Show = tuple[int, Picture | None, PreviewFrame]


def open_preview(
    target: str, rate_hz: float, *, keep_all: bool = False, title: str = "labanmesh", folder: Path | None = None
) -> "PreviewThread":
    """Where `target` says: `window`, FILE.mp4, FILE.avi, FILE.png, a name with %d, or a folder of pictures.

    rate_hz: of a film. keep_all: every picture is painted, even if the observer must wait for that, which suits
    recordings played as fast as possible; else older ones give way to the newest. Relative names are below `folder`.

    Where there can be no window, says so and writes INSTEAD. Raises BadInput for an unknown target and for what
    cannot be written.
    """
    place = (folder or Path()) / target
    if target == "window":
        reason = why_no_window()
        if not reason:
            return PreviewThread(Window(title), keep_all=False)
        place = (folder or Path()) / INSTEAD
        log.warning("no window: %s; the preview goes to %s", reason, place)
    return PreviewThread(_outlet(target, place, rate_hz, keep_all), keep_all)


def _outlet(target: str, place: Path, rate_hz: float, keep_all: bool) -> Outlet:
    ending = place.suffix.lower()
    if ending in CODECS:
        return Film(place, rate_hz, keep_all)
    if ending in STILLS or (target.strip() and (place.is_dir() or not ending)):
        return Stills(place)
    raise BadInput(f"--preview {target!r}: unknown kind; known: {KNOWN}")


class PreviewThread:
    """A context manager; what it could not show is logged once, and never stops the observer."""

    def __init__(self, outlet: Outlet, keep_all: bool, clock: Clock = time.monotonic_ns) -> None:
        self._outlet, self._keep_all, self._clock = outlet, keep_all, clock
        self._waiting: queue.Queue[Show | None] = queue.Queue(WAITING if keep_all else 1)
        self._thread = threading.Thread(target=self._work, name="preview", daemon=True)
        self._thread.start()

    def show(self, picture: Picture | None, sight: PreviewFrame) -> None:
        """Paint this soon; both must not be changed any more. Waits only where all pictures are kept."""
        if self._keep_all:
            self._put((self._clock(), picture, sight))
            return
        with suppress(queue.Empty):
            self._waiting.get_nowait()
        # There is room: nobody else puts anything.
        self._waiting.put_nowait((self._clock(), picture, sight))

    def close(self) -> None:
        """What waits is painted, and what was painted is whole. A second time does nothing."""
        self._put(None)
        self._thread.join()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def _put(self, item: Show | None) -> None:
        while self._thread.is_alive():
            try:
                self._waiting.put(item, timeout=LOOK_S)
            except queue.Full:
                continue
            return

    def _work(self) -> None:
        """The thread: until None comes, or nothing more can be shown, which is said once."""
        try:
            try:
                while (item := self._waiting.get()) is not None:
                    shown_ns, picture, sight = item
                    self._outlet.draw(paint(picture, sight), shown_ns)
            finally:
                self._outlet.close()
        except (LabanmeshError, OSError) as error:
            log.warning("preview: %s", error)


INSET_PX = 320
"""The back-projection is computed from every so-many-th pixel, about so many a row: it is shown small."""


class Finder(Protocol):
    """What is asked of `observer.runtime.scene_inputs.PreparedTracker`."""

    @property
    def body_parts(self) -> Sequence[str]:
        """Names of the rows of `picture_tracks`."""

    @property
    def picture_tracks(self) -> Tracks | None:
        """The newest tracks, in px of the picture."""

    @property
    def tracker(self) -> Tracker:
        """The tracker itself; its `skin`, if it has one, is shown."""


class PreviewingObserver:
    """An `observer.runtime.service.ObserverLike` that shows each step of another one.

    finder: the tracker that the observer steps. The first frame decides whether there are pictures or motion alone.
    """

    def __init__(
        self,
        observer: ObserverLike,
        finder: Finder,
        preview: PreviewThread,
        recent: PreviewHistory,
        clock: Callable[[], int] = time.time_ns,
    ) -> None:
        self._observer, self._finder, self._preview = observer, finder, preview
        self._recent, self._clock = recent, clock
        self.vocabulary: Vocabulary = observer.vocabulary

    @property
    def complaint(self) -> str:
        """As the observer says."""
        return self._observer.complaint

    def step(self, frame: Frame) -> Posterior | None:
        """One frame, as the observer does it; then it is shown, or given up for a newer one."""
        opinion = self._observer.step(frame)
        tracks = self._finder.picture_tracks
        if tracks is not None:
            picture = picture_in(frame.content)
            sight = self._recent.see(
                tracks,
                belief=None if opinion is None else ShownPosterior(self.vocabulary.labels, opinion.p, opinion.rest),
                back_projection=None if picture is None else back_projection(self._finder.tracker, picture),
                age_s=(self._clock() - frame.captured_ns) / 1e9,
                complaint=self.complaint,
            )
            self._preview.show(picture, sight)
        return opinion


def picture_in(content: NDArray[Any]) -> Picture | None:
    """A frame's content if it is a picture; None for positions and tracks."""
    return content if content.ndim == 3 else None


def back_projection(tracker: Tracker, picture: Picture) -> Picture | None:
    """Where the tracker's skin colour is in the picture, made small; None where it knows none."""
    skin = getattr(tracker, "skin", None)
    if skin is None:
        return None
    step = max(1, picture.shape[1] // INSET_PX)
    small: Picture = skin.back_project(picture[::step, ::step].copy())
    return small
