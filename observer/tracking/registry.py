"""All trackers by name: what each reads, and how it is made from a scene file's section."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from difflib import get_close_matches
from pathlib import Path
from typing import Literal

from common.config import ObserverConfig
from common.errors import BadInput
from observer.foreign.track_line import ForeignTracker
from observer.geometry.views import View, facing
from observer.motion.projected import ProjectedTracker
from observer.tracks import Tracker

Content = Literal["positions", "pictures", "tracks"]
"""What a frame holds: (P, 3) metres of recorded motion, (H, W, 3) uint8, or (P, 3) u, v, confidence."""


@dataclass(frozen=True, slots=True)
class TrackerSettings:
    """What a tracker may be told. recorded: names of the rows of positions or tracks; wanted: the parts a model reads.

    place: where a file named in the scene file is.
    """

    view: View
    recorded: Sequence[str]
    wanted: Sequence[str]
    section: ObserverConfig
    place: Callable[[str], Path]


@dataclass(frozen=True, slots=True)
class TrackerKind:
    """A way to find body parts. build: raises BadInput for a setting that it cannot work with."""

    name: str
    reads: Content
    build: Callable[[TrackerSettings], Tracker]


def _projected(setting: TrackerSettings) -> Tracker:
    return ProjectedTracker(setting.view, setting.recorded, setting.wanted)


def _camshift(setting: TrackerSettings) -> Tracker:
    # Imported only where it is used: OpenCV costs 0.2 s, and a machine that only projects does without.
    from observer.tracking.camshift import CamshiftTracker
    from observer.tracking.skin import SkinHistogram

    section = setting.section
    skin = SkinHistogram.load(setting.place(section.skin)) if section.skin else None
    return CamshiftTracker(skin, section.face, facing(setting.view))


def _mediapipe(setting: TrackerSettings) -> Tracker:
    from observer.tracking.mediapipe_pose import MediapipeTracker

    section = setting.section
    return MediapipeTracker(str(setting.place(section.pose_model)) if section.pose_model else None, section.hand)


def _foreign(setting: TrackerSettings) -> Tracker:
    return ForeignTracker(setting.recorded)


TRACKERS: Mapping[str, TrackerKind] = {
    kind.name: kind
    for kind in (
        TrackerKind("projected", "positions", _projected),
        TrackerKind("camshift", "pictures", _camshift),
        TrackerKind("mediapipe", "pictures", _mediapipe),
        TrackerKind("foreign", "tracks", _foreign),
    )
}
AUTO = "auto"


def tracker_named(name: str, key: str, content: Content) -> TrackerKind:
    """The tracker of that name, or with "auto" the first that reads `content`; `key` is where the name stands.

    Raises BadInput for an unknown name, and for a tracker that cannot read what the source holds.
    """
    if name == AUTO:
        return next(kind for kind in TRACKERS.values() if kind.reads == content)
    if name not in TRACKERS:
        near = get_close_matches(name, TRACKERS, 1)
        hint = f"; did you mean {near[0]!r}?" if near else ""
        raise BadInput(f"{key} = {name!r}: unknown tracker{hint}; known: {AUTO}, {', '.join(TRACKERS)}")
    kind = TRACKERS[name]
    # Positions can be filmed by the virtual camera; nothing else can be turned into something else.
    if kind.reads != content and (content, kind.reads) != ("positions", "pictures"):
        able = ", ".join(k.name for k in TRACKERS.values() if k.reads == content)
        raise BadInput(f"{key} = {name!r}: it reads {kind.reads}, the source gives {content}; able: {able}")
    return kind
