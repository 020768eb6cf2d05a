"""Models for films: learned from the recordings in 3-D of everybody but the person in the film."""

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache
from pathlib import Path

from benchmarks.clips.material import FOUR, clip_view
from common.text import split_list
from common.vocabulary import Vocabulary
from observer.learning.examples import gather_background
from observer.learning.learn import learn_view
from observer.model.base import MovementModel
from observer.motion.archive import MotionArchive, common_rate, labels_of
from observer.motion.archive_file import read_archive
from observer.motion.label_sets import labels_in

ALL, THE_FOUR = "all", "four"


@dataclass(frozen=True, slots=True, eq=False)
class Learning:
    """How models are learned. background: recordings of something else, None for none."""

    archive: MotionArchive
    labels: tuple[str, ...]
    kind: str
    parameters: Mapping[str, float]
    background: MotionArchive | None = None

    @cache  # noqa: B019 - a process has one
    def model(self, without: str, view: str) -> MovementModel:
        """The model of everybody but the person `without`."""
        others = tuple(r for r in self.archive.recordings if r.subject != without)
        return learn_view(
            MotionArchive(self.archive.body_parts, others),
            clip_view(view),
            Vocabulary(self.labels),
            kind=self.kind,
            parameters=self.parameters,
            background=self.background,
        )


def chosen_labels(archive: MotionArchive, text: str) -> tuple[str, ...]:
    """`all` of the archive, the `four` that the clips show, or names separated by commas."""
    return {ALL: labels_of(archive), THE_FOUR: FOUR}.get(text) or labels_in(text)


def chosen_background(archive: MotionArchive, text: str) -> MotionArchive | None:
    """The archives named, separated by commas; "": None."""
    if not text:
        return None
    archives = [read_archive(Path(name)) for name in split_list("--background", text)]
    return gather_background(archives, (), archive.body_parts, common_rate(archive))
