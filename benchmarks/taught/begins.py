"""Signs with which the takes of a movement begin: how often people give one without meaning it, and how often in vain.

Recorded people in 3-D are seen from two sides, each view an observer of its own; any of them may notice a sign. What
they do is their own life: nobody means to begin, so each sign is a false one. A wait for `still` begins at each second
of a recording, claps are counted over all of it. What may be missed: people who stand still, as one instant of a film
or a recording with the noise of a camera, and recorded claps, after which the person goes back to where they began.
"""

from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from benchmarks.clips.material import gesture_clips, webcam_clips
from benchmarks.clips.still import SHARES, frozen_film, frozen_recording
from common import SECOND_NS
from common.errors import BadInput
from common.teaching_messages import TeachReply
from hub.teaching.beginning import Still
from hub.teaching.interface import LOOK_S
from observer.geometry.views import parse_view
from observer.motion.archive import MotionArchive, Recording
from observer.motion.archive_file import read_archive
from observer.motion.importers.florence3d import FLORENCE_HZ as FILM_HZ
from observer.motion.importers.florence3d import import_folder as import_florence3d
from observer.motion.importers.msr_action3d import import_folder as import_msr
from observer.motion.projected import view_tracks
from observer.recording.own_tracks import RECORDING_HZ, watched_parts
from observer.teaching.clap import ClapWatch
from observer.teaching.take_watch import StillnessStream
from observer.tracks import BODY_PARTS, Floats, Tracks
from studies.sensors import with_parts

SIDES, FRONT = ("yaw:-20", "yaw:50"), ("yaw:0", "yaw:30")
"""Where the cameras stand: for stillness, and for claps, which need both hands."""
CHOSEN_WITH = {
    "storytelling": ("a",), "karate": ("1", "2", "3", "4"), "nw_ucla": ("1", "2", "3"),
    "msr_action3d": ("1", "3", "5", "7", "9"), "florence3d": ("1", "3", "5", "7", "9"),
}  # fmt: skip
"""The limits of claps were chosen with these people; claps of the others are judged. Those of `still` are older."""
LIFE = ("storytelling", "karate", "nw_ucla")
CLAPS = {"msr_action3d": "hand_clap", "florence3d": "clap"}
WAITS_S = (5.0, 10.0)
SOON_S = 4.0
"""Somebody who stands still this long in vain thinks that it does not work."""
MET_M = 0.3
"""The wrists meet in a clap; some recordings are cut before."""
EVERY = 7
"""Of the recordings every so many'th stands still."""
Progress = Callable[[int, int], None]


@dataclass(frozen=True, slots=True)
class BeginWatch:
    """What one observer notices of a stream, `rate_hz` times a second: P(still), and claps that end."""

    rate_hz: float
    still: Floats
    claps: NDArray[np.bool_]

    @property
    def seconds(self) -> float:
        """Length."""
        return len(self.still) / self.rate_hz


def watched(centres: Floats, rate_hz: float, body_parts: Sequence[str]) -> BeginWatch:
    """Look at (F, P, 2) tracks as an observer does in a lesson."""
    parts = watched_parts(body_parts)
    rows = [list(body_parts).index(part) for part in parts]
    stream, claps = StillnessStream(parts, RECORDING_HZ), ClapWatch(body_parts)
    still, clapped = [], []
    for n, places in enumerate(centres):
        at_ns = round((1 + n / rate_hz) * SECOND_NS)
        clapped.append(claps.update(at_ns, Tracks(places)))
        stream.update(at_ns, Tracks(places[rows]))
        still.append(stream.probability)
    return BeginWatch(rate_hz, np.array(still), np.array(clapped))


def seconds_until_still(observers: Sequence[BeginWatch], begin_s: float) -> float:
    """After so many seconds of waiting the sign is given; infinity: not until the stream ends."""
    sign = Still()
    for look in range(int((observers[0].seconds - begin_s) / LOOK_S)):
        now_s = begin_s + look * LOOK_S
        replies = {
            str(n): TeachReply.model_construct(visible=True, still=float(each.still[int(now_s * each.rate_hz)]))
            for n, each in enumerate(observers)
        }
        if sign.is_given(replies, now_s):
            return now_s - begin_s
    return float("inf")


def archive_of(data: Path, kind: str) -> MotionArchive:
    """The recordings of one folder, of nw_ucla by its first sensor."""
    if kind == "msr_action3d":
        return with_parts(import_msr(data / kind).archive, BODY_PARTS)
    if kind == "florence3d":
        return with_parts(import_florence3d(data / kind).archive, BODY_PARTS)
    return read_archive(data / kind / ("sensor1.npz" if kind == "nw_ucla" else f"{kind}.npz"))


def judged(data: Path, kind: str) -> tuple[MotionArchive, list[Recording]]:
    """The archive, and its recordings of people with whom no limit was chosen."""
    archive = archive_of(data, kind)
    return archive, [r for r in archive.recordings if r.subject not in CHOSEN_WITH[kind]]


def seen(archive: MotionArchive, recording: Recording, views: Sequence[str]) -> list[BeginWatch]:
    """A recording as observers notice it."""
    result = []
    for view in views:
        tracks = view_tracks(parse_view(view), recording, archive.body_parts, archive.body_parts)
        result.append(watched(np.array([each.centres for each in tracks]), recording.rate_hz, archive.body_parts))
    return result


def rows(data: Path, tracks: Path) -> Iterator[str]:
    """Lines on stillness and on claps. tracks: a folder of what mediapipe found in films, see `frozen_film`."""
    for kind in LIFE:
        archive = archive_of(data, kind)
        yield from _false_still(kind, [seen(archive, recording, SIDES) for recording in archive.recordings])
    yield from _missed_still(data, tracks)
    for kind in (*LIFE, *CLAPS):
        archive, recordings = judged(data, kind)
        others = [seen(archive, r, FRONT) for r in recordings if r.label != CLAPS.get(kind)]
        minutes = sum(each[0].seconds for each in others) / 60
        counts = [sum(int(each[n].claps.sum()) for each in others) for n in range(len(FRONT))]
        figures = ", ".join(f"{count / minutes:.2f}" for count in counts)
        yield f"clap   {kind:13s} {figures} false a minute from {', '.join(FRONT)} ({minutes:.1f} minutes)"
    for kind, label in CLAPS.items():
        archive, recordings = judged(data, kind)
        claps = [r for r in recordings if r.label == label and _meets(archive, r)]
        noticed = [[each.claps.any() for each in seen(archive, and_back(r), FRONT)] for r in claps]
        figures = ", ".join(str(int(count)) for count in np.sum(noticed, axis=0))
        yield f"clap   {kind:13s} noticed {figures} of {len(claps)} from {', '.join(FRONT)}"


def _false_still(kind: str, streams: Sequence[Sequence[BeginWatch]]) -> Iterator[str]:
    for count in range(1, len(SIDES) + 1):
        begun: Counter[float] = Counter()
        waits: Counter[float] = Counter()
        for observers in streams:
            for begin_s in np.arange(0.0, observers[0].seconds - min(WAITS_S) + 1e-9):
                after_s = seconds_until_still(observers[:count], float(begin_s))
                for wait_s in WAITS_S:
                    if begin_s + wait_s <= observers[0].seconds + 1e-9:
                        waits[wait_s] += 1
                        begun[wait_s] += after_s <= wait_s
        shares = ", ".join(f"{begun[s]} of {waits[s]} waits within {s:g} s" for s in WAITS_S)
        yield f"still  {kind:13s} {count} camera{'s' * (count > 1)}: begun without meaning it {shares}"


def _missed_still(data: Path, tracks: Path) -> Iterator[str]:
    try:
        films = [
            [watched(frozen_film(clip, share, FILM_HZ, tracks), FILM_HZ, BODY_PARTS)]
            for clip in (*gesture_clips(data), *webcam_clips(data))
            for share in SHARES
        ]
        yield f"still  films         {_missed(films)}"
    except BadInput as error:
        yield f"still  films         not measured: {error}"
    for kind in CLAPS:
        frozen = [
            [watched(frozen_recording(r, share, view, n), r.rate_hz, BODY_PARTS) for view in SIDES]
            for n, r in enumerate(archive_of(data, kind).recordings[::EVERY])
            for share in (0.0, 1.0)
        ]
        for count in range(1, len(SIDES) + 1):
            yield f"still  {kind:13s} {_missed([each[:count] for each in frozen])}"


def _missed(streams: Sequence[Sequence[BeginWatch]]) -> str:
    waits = [seconds_until_still(observers, begin_s) for observers in streams for begin_s in (0.0, 2.0, 4.0)]
    missed, count = sum(wait > SOON_S for wait in waits), len(streams[0])
    return f"{count} camera{'s' * (count > 1)}: no sign within {SOON_S:g} s of standing still {missed} of {len(waits)}"


def and_back(recording: Recording) -> Recording:
    """A second of rest, the recording, half a second back to where it began, and another second of rest."""
    positions, rest = recording.positions, round(recording.rate_hz)
    way = np.linspace(0, 1, rest // 2 + 1)[1:, None, None]
    back, still = positions[-1] * (1 - way) + positions[0] * way, np.repeat(positions[:1], rest, axis=0)
    return replace(recording, positions=np.concatenate([still, positions, back, still]).astype(np.float32))


def _meets(archive: MotionArchive, recording: Recording) -> bool:
    left, right = (recording.positions[:, archive.body_parts.index(part)] for part in ("left_hand", "right_hand"))
    return bool(np.nanmin(np.linalg.norm(left - right, axis=1)) < MET_M)
