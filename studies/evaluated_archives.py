"""Reads the archives that `labanmesh evaluate` names, and brings them to common body parts and one rate."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from common.errors import BadInput
from common.text import split_list
from observer.geometry.placement import PersonPlacement
from observer.geometry.views import View, split_views
from observer.learning.examples import gather_background
from observer.motion.archive import MotionArchive, Recording, common_rate, labels_of, resample, select
from observer.motion.archive_file import read_archive
from observer.motion.projected import placed, require_same_camera, view_of
from studies.sensors import performances, read_sensors, with_parts

ALL_PARTS = ("all",)
"""In place of the names of body parts: every part that the archives have."""


def chosen_parts(named: tuple[str, ...], recorded: tuple[str, ...]) -> tuple[str, ...]:
    """The body parts that an evaluation reads; named: the value of --body-parts, recorded: what all archives have."""
    return named if named and named != ALL_PARTS else recorded


@dataclass(frozen=True, slots=True)
class EvaluatedArchives:
    """What is evaluated: `whole` has every performance once; sensors: the archive of each view, none with one archive.

    All have the same body parts. background, other_motion: as in EvaluationSettings.
    """

    whole: MotionArchive
    views: tuple[View, ...]
    sensors: tuple[MotionArchive, ...]
    body_parts: tuple[str, ...]
    background: MotionArchive | None
    other_motion: tuple[Recording, ...]


@dataclass(frozen=True, slots=True)
class BackgroundArchives:
    """--background: archives to learn something else from, and the people of these, by default all."""

    paths: tuple[Path, ...] = ()
    subjects: tuple[str, ...] = ()

    @classmethod
    def parse(cls, background: str, subjects: str) -> "BackgroundArchives":
        """The values of --background and --background-subjects; raises BadInput for other values."""
        paths = tuple(Path(name) for name in split_list("--background", background))
        people = split_list("--background-subjects", subjects)
        if people and not paths:
            raise BadInput(f"--background-subjects {subjects}: of which archive? name it with --background")
        for path in paths:
            if path.suffix != ".npz":
                raise BadInput(f"--background {path}: an archive (.npz) is expected")
        return cls(paths, people)


def read_archives(
    archive: Path | None,
    views: str,
    sensors: Sequence[str],
    body_parts: tuple[str, ...],
    background: BackgroundArchives,
    other_motion: Sequence[Path],
    placement: PersonPlacement | None = None,
) -> EvaluatedArchives:
    """Read all archives, and keep the body parts of `chosen_parts`.

    placement: where all people are put in the room of the views, which are camera files. Raises BadInput for an archive
    beside sensors, neither of both, a body part that an archive lacks, and a placement for other views.
    """
    chosen, own = _evaluated(archive, views, sensors)
    others = {path: read_archive(path) for path in dict.fromkeys((*background.paths, *other_motion))}
    if placement is not None:
        _require_rooms(chosen, sensors)
        own = tuple(placed(archive_of_view, placement) for archive_of_view in own)
        others = {path: placed(other, placement) for path, other in others.items()}
    everywhere = tuple(p for p in own[0].body_parts if all(p in other.body_parts for other in others.values()))
    parts = chosen_parts(body_parts, everywhere)
    # Also the evaluation's noise is the same whatever other parts were recorded.
    own = tuple(with_parts(archive_of_view, parts) for archive_of_view in own)
    whole = performances(own) if sensors else own[0]
    if others and len(own) > 1 and own[0].camera is not None:
        raise BadInput(
            "--background, --other-motion: tracks belong to one camera; record them into each sensor's archive"
        )
    for path, other in others.items():
        require_same_camera(own[0], other, str(path))
    learned = {path: select(others[path], background.subjects) for path in background.paths}
    gathered = None
    if learned:
        gathered = gather_background(list(learned.values()), (), whole.body_parts, common_rate(whole))
    streams = [s for path in other_motion for s in _unseen(path, others[path], learned.get(path), whole)]
    return EvaluatedArchives(whole, chosen, own if sensors else (), parts, gathered, tuple(streams))


def _require_rooms(views: Sequence[View], sensors: Sequence[str]) -> None:
    """Raise BadInput unless all views are cameras in a room."""
    if sensors:
        raise BadInput("--place, --facing: sensors record in their own axes; give ARCHIVE --views in place of --sensor")
    for view in views:
        if not view.has_place:
            raise BadInput(f"--place, --facing: for camera files only, and {view.name} is none; name yaw:DEG instead")


def _evaluated(
    archive: Path | None, views: str, sensors: Sequence[str]
) -> tuple[tuple[View, ...], tuple[MotionArchive, ...]]:
    """The views, and the archive of each, or the one of all."""
    if sensors:
        if archive or views:
            raise BadInput("--sensor: takes the place of ARCHIVE and --views; omit these")
        return read_sensors(sensors, read_archive)
    if archive is None:
        raise BadInput("ARCHIVE: which one? name a motion archive (.npz), or sensors with --sensor NAME=FILE.npz")
    motion = read_archive(archive)
    if not (views or motion.camera):
        raise BadInput("--views: which ones? for example --views door,wheel")
    return tuple(view_of(motion, view) for view in (split_views(views) if views else ("",))), (motion,)


def _unseen(path: Path, archive: MotionArchive, learned: MotionArchive | None, whole: MotionArchive) -> list[Recording]:
    """The streams of people whom no model has learned from, with the parts and the rate of `whole`."""
    known = {r.subject for r in learned.recordings} if learned else set()
    unseen = tuple(r for r in archive.recordings if r.subject not in known)
    if not unseen:
        raise BadInput(
            f"--other-motion {path}: all its people are learned from; name some of them in --background-subjects"
        )
    chosen, rate_hz = with_parts(replace(archive, recordings=unseen), whole.body_parts), common_rate(whole)
    shown = [label for label in labels_of(chosen) if label in labels_of(whole)]
    if shown:
        raise BadInput(f"--other-motion {path}: {shown[0]!r} is a movement of the archive; give streams without it")
    streams = (replace(r, label="", spans=()) for r in chosen.recordings)
    return [r if r.rate_hz == rate_hz else resample(r, rate_hz) for r in streams]
