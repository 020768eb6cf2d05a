"""An observer that is looked at while it works: the same steps, and each of them shown."""

import time
from collections.abc import Callable, Sequence
from typing import Any, Protocol

from numpy.typing import NDArray

from common.vocabulary import Vocabulary
from observer.opinion import OpinionLike
from observer.preview.screen import Preview
from observer.preview.sight import Belief, Picture, Recent
from observer.service import ObserverLike
from observer.tracks import Frame, Tracker, Tracks

INSET_PX = 320
"""The back-projection is computed from every so-many-th pixel, about so many a row: it is shown small."""


class Finder(Protocol):
    """What is asked of `observer.prepared.PreparedTracker`."""

    @property
    def body_parts(self) -> Sequence[str]:
        """Names of the rows of `found`."""

    @property
    def found(self) -> Tracks | None:
        """The newest tracks, in px of the picture."""

    @property
    def tracker(self) -> Tracker:
        """The tracker itself; its `skin`, if it has one, is shown."""


class Previewed:
    """An `observer.service.ObserverLike` that shows each step of another one.

    finder: the tracker that the observer steps. The first frame decides whether there are pictures or motion alone.
    """

    def __init__(
        self,
        observer: ObserverLike,
        finder: Finder,
        preview: Preview,
        recent: Recent,
        clock: Callable[[], int] = time.time_ns,
    ) -> None:
        self._observer, self._finder, self._preview = observer, finder, preview
        self._recent, self._clock = recent, clock
        self.vocabulary: Vocabulary = observer.vocabulary

    @property
    def complaint(self) -> str:
        """As the observer says."""
        return self._observer.complaint

    def step(self, frame: Frame) -> OpinionLike | None:
        """One frame, as the observer does it; then it is shown, or given up for a newer one."""
        opinion = self._observer.step(frame)
        tracks = self._finder.found
        if tracks is not None:
            picture = picture_in(frame.content)
            sight = self._recent.see(
                tracks,
                belief=None if opinion is None else Belief(self.vocabulary.labels, opinion.p, opinion.rest),
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
