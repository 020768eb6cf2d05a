"""Tracks as a model wants them: its body parts, the pixels of its view, and its even rate. Pure.

`PreparedTracker` adapts a tracker to a model and to the camera file of its view, and lets it rest. `Resampler` brings
tracks at any times, live or from a file, to an even rate.
"""

from collections import deque
from collections.abc import Callable, Sequence
from dataclasses import replace
from statistics import median

import numpy as np
from numpy.typing import NDArray

from common import SECOND_NS
from common.errors import BadInput
from observer.geometry.views import View, picture_scale, scale_note
from observer.motion.archive import Span
from observer.tracks import Floats, Frame, PersonTracks, Size, Tracker, Tracks, size_of

NEVER_SEEN = np.full((1, 2), np.nan)
RESTING_RUNS = 4
"""While nothing changes, tracks are the mean of so many runs: the parts stay, only the tracker trembles."""


class PreparedTracker:
    """Adapts a tracker to a model: selects the wanted body parts, in their order, and brings the centres to its view.

    view: of a calibrated camera, with the size of its pictures, to which centres are scaled, and its lens, whose
    distortion is removed, because the projective matrix is valid for undistorted pixels of that size; None: neither.
    fewer_parts: a part that the tracker does not find is never seen. notify: gets one line when pictures of another
    size are scaled, once for each size. Raises BadInput if it does not find a wanted part, or none of them.

    hold: the tracker is not run, and the last tracks are valid for this frame too. resting: nothing changes, so the
    tracks are the mean of the last RESTING_RUNS runs. cost_s: CPU seconds of the last run, by the clock `cpu_s`.
    """

    def __init__(
        self,
        tracker: Tracker,
        wanted: Sequence[str],
        view: View | None = None,
        fewer_parts: bool = False,
        notify: Callable[[str], None] = lambda _: None,
        cpu_s: Callable[[], float] = lambda: 0.0,
    ) -> None:
        self.every_part = tuple(tracker.body_parts)
        """All body parts that the tracker finds, in its order."""
        self.tracker = tracker
        self.body_parts: tuple[str, ...] = ()
        self.lacking: tuple[str, ...] = ()
        """Wanted parts that the tracker does not find."""
        self._rows: list[int] = []
        self.want(wanted, fewer_parts)
        self._view, self._notify, self._cpu_s = view, notify, cpu_s
        self.hold, self.resting, self.cost_s = False, False, 0.0
        self._runs: deque[Floats] = deque(maxlen=RESTING_RUNS)
        self._size_px: Size | None = None
        self._scale = 1.0
        self.picture_tracks: Tracks | None = None
        self.all_tracks: Tracks | None = None
        """The tracker's own rows, of all its body parts, in px of the picture."""

    @property
    def every_track(self) -> Tracks | None:
        """The undistorted tracks of `every_part` in the newest frame; None before the first."""
        tracks = self.all_tracks
        if tracks is None or self._is_plain:
            return tracks
        return Tracks(self._calibrated(tracks.centres), people=tracks.people)

    def want(self, wanted: Sequence[str], fewer_parts: bool = False) -> None:
        """Select these body parts from now on; raises BadInput as the class does, and then changes nothing."""
        known = self.every_part
        lacking = tuple(part for part in wanted if part not in known)
        if lacking and not (fewer_parts and len(lacking) < len(wanted)):
            raise BadInput(lacking_parts(lacking, known))
        self.body_parts, self.lacking = tuple(wanted), lacking
        # One row more, which is never seen, stands for the parts that the tracker does not find.
        self._rows = [known.index(part) if part in known else len(known) for part in wanted]

    def of_parts(self, wanted: Sequence[str]) -> "PreparedTracker":
        """The same tracker for other body parts; raises BadInput if it does not find one of them."""
        return PreparedTracker(self.tracker, wanted, self._view, notify=self._notify)

    @property
    def complaint(self) -> str:
        """Why the tracker finds little in the pictures, and what to do about it; "" if all is well."""
        return str(getattr(self.tracker, "complaint", ""))

    def update(self, frame: Frame) -> Tracks:
        """Undistorted tracks (P, 2); those in px of the picture, to draw on it, are left in `picture_tracks`.

        Raises BadInput for pictures of another shape than the camera file's.
        """
        if self.all_tracks is None or not self.hold:
            begun_s = self._cpu_s()
            tracks = self.tracker.update(frame)
            self.cost_s = self._cpu_s() - begun_s
            self.all_tracks = self._settled(tracks)
        tracks = self.all_tracks
        guesses = None if tracks.guesses is None else self._wanted(tracks.guesses)
        self.picture_tracks = Tracks(self._wanted(tracks.centres), guesses, tracks.people)
        if self._view is None or self._is_plain:
            return self.picture_tracks
        if frame.content.dtype == np.uint8:
            self._fit(self._view, size_of(frame.content))
        calibrated = None if guesses is None else self._calibrated(guesses)
        return Tracks(self._calibrated(self.picture_tracks.centres), calibrated, tracks.people)

    def _settled(self, tracks: Tracks) -> Tracks:
        if not self.resting:
            self._runs.clear()
            return tracks
        self._runs.append(tracks.centres)
        runs = np.array(self._runs)
        visible = np.isfinite(runs)
        means = np.where(visible, runs, 0.0).sum(axis=0) / np.maximum(visible.sum(axis=0), 1)
        return replace(tracks, centres=np.where(np.isfinite(tracks.centres), means, np.nan))

    @property
    def most(self) -> int:
        """How many people the tracker follows."""
        return int(getattr(self.tracker, "most", 1))

    @property
    def tracks_of_all(self) -> Tracks | None:
        """`picture_tracks`, or those of all people, one below the other."""
        persons = () if self.all_tracks is None else self.all_tracks.persons
        return Tracks(np.concatenate([person.centres for person in persons])) if persons else self.picture_tracks

    def persons(self) -> list[PersonTracks]:
        """The people of the newest frame, each as `update` returns the tracks of one."""
        each = () if self.all_tracks is None else self.all_tracks.persons
        return [self._of_person(person) for person in each]

    def _of_person(self, person: PersonTracks) -> PersonTracks:
        every = person.centres if self._is_plain else self._calibrated(person.centres)
        return replace(person, centres=self._wanted(every), every=every)

    @property
    def _is_plain(self) -> bool:
        """Whether pixels of the picture are those of the view."""
        return self._view is None or (self._view.lens is None and self._view.size_px is None)

    def _fit(self, view: View, size_px: Size) -> None:
        """Take the scale of pictures of this size, and say so if they are of another one than the camera file's."""
        if size_px != self._size_px:
            self._scale, self._size_px = picture_scale(view, size_px), size_px
            if note := scale_note(view, size_px):
                self._notify(note)

    def _calibrated(self, centres: Floats) -> Floats:
        """(P, 2) px of the picture -> undistorted px of the camera file."""
        lens = self._view.lens if self._view else None
        return centres * self._scale if lens is None else lens.undistorted(centres * self._scale)

    def _wanted(self, rows: Floats) -> Floats:
        return (np.concatenate([rows, NEVER_SEEN]) if self.lacking else rows)[self._rows]


def lacking_parts(lacking: Sequence[str], tracked: Sequence[str]) -> str:
    """One line: a model reads parts that the tracker does not find, and what to do."""
    return (
        f"body part {lacking[0]!r}: the model reads it, the tracker finds {', '.join(tracked)}; use a tracker with a "
        f'pose model (tracker = "mediapipe"), or learn the model with --body-parts {",".join(tracked)}'
    )


LONGEST_BRIDGE_S = 0.25
"""Over gaps up to this length a body part is taken to move in a straight line, whatever the camera's rate."""
BRIDGED_INTERVALS, WIDEST_BRIDGE_S = 1.5, 0.75
"""A slow camera's bridge follows its own interval, up to 2 Hz; a gap longer than that is no single picture late."""
INTERVALS, LEAST_INTERVALS = 8, 4
"""The interval is the median of the last eight gaps in which somebody was seen; fewer than four show none."""


def is_bridged(gap_s: float, interval_s: float) -> bool:
    """Whether motion is interpolated over a gap. interval_s: the camera's usual interval, this gap included."""
    return gap_s <= LONGEST_BRIDGE_S or gap_s <= min(BRIDGED_INTERVALS * interval_s, WIDEST_BRIDGE_S)


def at_even_rate(at_ns: NDArray[np.int64], centres: Floats, rate_hz: float) -> NDArray[np.float32]:
    """Tracks (F, P, 2) at increasing times (F,) -> (K, P, 2) at this rate from the first frame on, as `Resampler` does.

    Nothing is left out of gaps, however long: nothing is seen in them.
    """
    resampler = Resampler(rate_hz, (int(at_ns[-1]) - int(at_ns[0])) / SECOND_NS + 1)
    frames = zip(at_ns.tolist(), centres, strict=True)
    instants = [tracks.centres for at, frame in frames for tracks in resampler.update(at, Tracks(frame))]
    return np.array(instants, np.float32)


def spans_at_even_rate(spans: Sequence[Span], at_ns: NDArray[np.int64], rate_hz: float) -> tuple[Span, ...]:
    """Spans in frames with these times (F,) -> the same in frames of `at_even_rate`; none that has no frame there."""
    ends = np.append(at_ns, at_ns[-1] + SECOND_NS / rate_hz) - at_ns[0]
    frames = np.ceil(ends * rate_hz / SECOND_NS - 1e-6).astype(np.int64)
    moved = (replace(span, start=int(frames[span.start]), end=int(frames[span.end])) for span in spans)
    return tuple(span for span in moved if span.start < span.end)


STEADY = 0.5
"""A parabola needs a gap before the last one that is at least this share of it: through two sights that are close
together and a third far away it would overshoot."""
LONGEST_GAP_S = 3.0
"""In a longer gap the filter has forgotten all that it can forget."""


Sight = tuple[int, Floats]
"""When a frame was captured, ns, and the centres (P, 2) in it."""


class Resampler:
    """Resamples tracks from any frame times to a model's fixed rate, by linear interpolation.

    Between two frames of which the observer left out some, a part moves on the parabola through its last three sights
    (constant acceleration): straight lines between few pictures cut the turning points of a movement.

    The model therefore sees the same motion from a faster camera, a slower one, or one that drops frames. There is no
    delay: each instant is returned with the first frame at or after it. Over a gap that is too long for the camera's
    rate (`observer.prepared_tracks.is_bridged`) nothing is seen; if the observer left out frames in it, the camera was
    not away, and it may be as long as that of the slowest camera.
    """

    def __init__(self, rate_hz: float, longest_gap_s: float = LONGEST_GAP_S) -> None:
        """rate_hz: the model's rate, > 0. longest_gap_s: a longer gap counts as this long."""
        self._period_ns = SECOND_NS / rate_hz
        self._most = round(longest_gap_s * SECOND_NS / self._period_ns)
        self._begin_ns = 0
        self._count = 0
        self._previous: Sight | None = None
        self._before: Sight | None = None
        """The frame before `_previous`."""
        self._gaps_s: deque[float] = deque(maxlen=INTERVALS)
        self.interval_s = 0.0
        """The usual time between two frames; 0 while it is not known."""

    def update(self, at_ns: int, tracks: Tracks, skipped: bool = False) -> list[Tracks]:
        """The instants after the previous frame, up to this frame at `at_ns`: any number of tracks (P, 2).

        skipped: frames were left out before it, so that the camera was not away.
        A part that is seen in only one of the two frames around an instant counts as seen where that frame is the
        nearer one. If the clock is set back, sampling restarts.
        """
        newest = (at_ns, tracks.centres)
        previous, self._previous = self._previous, newest
        if previous is None or at_ns < previous[0]:
            self._before = None
            self._begin_ns, self._count = at_ns, 1
            return [tracks]
        if at_ns == previous[0]:
            return []
        before, self._before = self._before, previous
        count = int((at_ns - self._begin_ns) / self._period_ns) + 1
        count += self._instant_ns(count) <= at_ns  # rounding must not hold an instant back
        first = max(self._count, count - self._most)
        self._count = max(count, self._count)
        gap_s = (at_ns - previous[0]) / SECOND_NS
        if tracks.visible.any() and Tracks(previous[1]).visible.any():
            self._gaps_s.append(gap_s)
            self.interval_s = median(self._gaps_s) if len(self._gaps_s) >= LEAST_INTERVALS else 0.0
        bridged = is_bridged(gap_s, self.interval_s) or (skipped and gap_s <= WIDEST_BRIDGE_S)
        if skipped and bridged and before is not None and _is_steady(before[0], previous[0], at_ns):
            return [Tracks(_curved(before, previous, newest, self._instant_ns(i))) for i in range(first, count)]
        return [Tracks(_interpolate(previous, newest, self._instant_ns(i), bridged)) for i in range(first, count)]

    def restart(self) -> None:
        """Begin anew: the next frame shows another motion, and nothing lies between it and the previous one."""
        self._previous = self._before = None

    def _instant_ns(self, i: int) -> int:
        return self._begin_ns + round(i * self._period_ns)


def _is_steady(before_ns: int, previous_ns: int, newest_ns: int) -> bool:
    gap_ns = previous_ns - before_ns
    return STEADY * (newest_ns - previous_ns) <= gap_ns <= WIDEST_BRIDGE_S * SECOND_NS


def _curved(before: Sight, previous: Sight, newest: Sight, instant_ns: int) -> Floats:
    """The parabola through three sights (Lagrange), between the last two; where one is missing, `_interpolate`."""
    t0, t1, t2 = (sight[0] - instant_ns for sight in (before, previous, newest))
    parabola = (
        before[1] * (t1 * t2 / ((t0 - t1) * (t0 - t2)))
        + previous[1] * (t0 * t2 / ((t1 - t0) * (t1 - t2)))
        + newest[1] * (t0 * t1 / ((t2 - t0) * (t2 - t1)))
    )
    return np.where(np.isfinite(parabola), parabola, _interpolate(previous, newest, instant_ns, True))


def _interpolate(previous: Sight, newest: Sight, instant_ns: int, bridged: bool) -> Floats:
    share = (instant_ns - previous[0]) / (newest[0] - previous[0])
    if not bridged:
        return newest[1] if share >= 1 else np.full_like(newest[1], np.nan)
    nearer = newest[1] if share > 0.5 else previous[1]
    mixed = (1 - share) * previous[1] + share * newest[1]
    return np.where(np.isfinite(mixed), mixed, nearer)
