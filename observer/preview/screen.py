"""Shows an observer's frames while it works: a thread paints them and never slows the observer."""

import logging
import queue
import threading
import time
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING, Any, Self

from numpy.typing import NDArray

from common import SECOND_NS
from common.errors import BadInput, LabanmeshError
from observer.preview.film import CODECS, STILLS, Film, Outlet, Stills, Window, why_no_window
from observer.preview.painting import paint
from observer.preview.sight import Picture, PreviewFrame, PreviewHistory, ShownPosterior
from observer.runtime.pipeline import Posterior
from observer.runtime.service import ObserverAround, ObserverLike
from observer.tracks import Frame, Tracker, Tracks

if TYPE_CHECKING:
    from observer.runtime.prepared_tracker import PreparedTracker

log = logging.getLogger("labanmesh.observer")

FALLBACK = Path("labanmesh-preview.mp4")
"""Written instead of a window where no window can be opened."""
QUEUE_SIZE = 8
"""Pictures that may wait for painting when all are kept; then the observer waits."""
THREAD_CHECK_S = 0.2
"""Interval at which a waiting observer checks that the painting thread still works."""
KNOWN_OUTPUTS = "window, FILE.mp4, FILE.avi, FILE.png (the newest), FILE-%06d.png, a folder"
INSET_PX = 320
"""The back-projection is computed for about this many pixels per row, since it is shown small."""

Clock = Callable[[], int]
Item = tuple[int, Picture | None, PreviewFrame]


def open_preview(target: str, rate_hz: float, *, keep_all: bool = False) -> "PreviewThread":
    """Open `target`: `window`, FILE.mp4, FILE.avi, FILE.png, a name with %d, or a folder of pictures.

    rate_hz: of a film. keep_all: paint every picture even if the observer must wait, for recordings played as fast as
    possible; otherwise a newer picture replaces a waiting one.

    Where no window can be opened, logs the reason and writes FALLBACK. Raises BadInput for an unknown target and for a
    file that cannot be written.
    """
    if target == "window":
        reason = why_no_window()
        if not reason:
            return PreviewThread(Window("labanmesh"), keep_all=False)
        log.warning("cannot open a window: %s; the preview is written to %s", reason, FALLBACK)
        return PreviewThread(Film(FALLBACK, rate_hz, keep_all, unnamed=True), keep_all)
    return PreviewThread(_outlet(target, rate_hz, keep_all), keep_all)


def _outlet(target: str, rate_hz: float, keep_all: bool) -> Outlet:
    path = Path(target)
    suffix = path.suffix.lower()
    if suffix in CODECS:
        return Film(path, rate_hz, keep_all)
    if suffix in STILLS or (target.strip() and (path.is_dir() or not suffix)):
        return Stills(path)
    raise BadInput(f"--preview {target!r}: unknown kind; known: {KNOWN_OUTPUTS}")


class PreviewThread:
    """A context manager that paints frames in a thread. Errors are logged once and never stop the observer."""

    def __init__(self, outlet: Outlet, keep_all: bool, clock: Clock = time.monotonic_ns) -> None:
        self._outlet, self._keep_all, self._clock = outlet, keep_all, clock
        self._queue: queue.Queue[Item | None] = queue.Queue(QUEUE_SIZE if keep_all else 1)
        self._thread = threading.Thread(target=self._work, name="preview", daemon=True)
        self._thread.start()

    def show(self, picture: Picture | None, frame: PreviewFrame) -> None:
        """Queue a frame; neither argument may be changed afterwards. Waits only when all pictures are kept."""
        if self._keep_all:
            self._put((self._clock(), picture, frame))
            return
        with suppress(queue.Empty):
            self._queue.get_nowait()
        # There is room, since only this thread puts anything.
        self._queue.put_nowait((self._clock(), picture, frame))

    def close(self) -> None:
        """Paint all waiting frames and complete the file. A second call does nothing."""
        self._put(None)
        self._thread.join()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def _put(self, item: Item | None) -> None:
        while self._thread.is_alive():
            try:
                self._queue.put(item, timeout=THREAD_CHECK_S)
            except queue.Full:
                continue
            return

    def _work(self) -> None:
        """The thread: paint until None comes or nothing more can be shown."""
        try:
            try:
                while (item := self._queue.get()) is not None:
                    shown_ns, picture, frame = item
                    self._outlet.draw(paint(picture, frame), shown_ns)
            finally:
                self._outlet.close()
        except (LabanmeshError, OSError) as error:
            log.warning("preview: %s", error)


class PreviewingObserver(ObserverAround):
    """Performs each step of another observer and shows it.

    tracker: the one that the observer steps. The first frame decides whether there are pictures or motion alone.
    """

    def __init__(
        self,
        observer: ObserverLike,
        tracker: "PreparedTracker",
        preview: PreviewThread,
        history: PreviewHistory,
        clock: Callable[[], int] = time.time_ns,
    ) -> None:
        super().__init__(observer)
        self._tracker, self._preview = tracker, preview
        self._history, self._clock = history, clock
        self._shown: Tracks | None = None

    def step(self, frame: Frame) -> Posterior | None:
        """Let the observer process one frame, then show it unless it was skipped or a newer one replaces it."""
        posterior = self._observer.step(frame)
        tracks = self._tracker.all_tracks
        if tracks is not None and (posterior is not None or tracks is not self._shown):
            self._shown = tracks
            picture = picture_in(frame.content)
            vocabulary = self.vocabulary
            known = None
            if posterior is not None and vocabulary is not None:
                known = ShownPosterior(vocabulary.labels, posterior.p, posterior.rest)
            shown = self._history.add(
                tracks,
                posterior=known,
                back_projection=None if picture is None else back_projection(self._tracker.tracker, picture),
                age_s=(self._clock() - frame.captured_ns) / SECOND_NS,
                complaint=self.complaint,
            )
            self._preview.show(picture, shown)
        return posterior


def picture_in(content: NDArray[Any]) -> Picture | None:
    """A frame's content if it is a picture; None for positions and tracks."""
    return content if content.ndim == 3 else None


def back_projection(tracker: Tracker, picture: Picture) -> Picture | None:
    """The back-projection of the tracker's skin colour, reduced; None for a tracker without one."""
    skin = getattr(tracker, "skin", None)
    if skin is None:
        return None
    step = max(1, picture.shape[1] // INSET_PX)
    small: Picture = skin.back_project(picture[::step, ::step].copy())
    return small
