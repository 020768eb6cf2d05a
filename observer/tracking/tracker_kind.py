"""What the registry knows of a tracker, and what a tracker is told."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

from common.config import ObserverConfig
from common.tracker_choice import Content
from observer.geometry.views import View
from observer.tracks import Tracker


@dataclass(frozen=True, slots=True)
class TrackerSettings:
    """Arguments of a tracker. recorded: names of the rows of positions or tracks. wanted: parts that the model reads.

    place: from the name of a file in the scene file to its path. smooth: tracks may be smoothed as they come, by which
    they lag; recordings are smoothed afterwards. most: how many people are followed.
    """

    view: View
    recorded: Sequence[str]
    wanted: Sequence[str]
    section: ObserverConfig
    place: Callable[[str], Path]
    smooth: bool = True
    most: int = 1


@dataclass(frozen=True, slots=True)
class TrackerKind:
    """An entry of the registry. build: raises BadInput for settings that the tracker cannot use.

    finds: the parts that it can find; () if these are the source's.
    """

    name: str
    reads: Content
    build: Callable[[TrackerSettings], Tracker]
    finds: tuple[str, ...] = ()
