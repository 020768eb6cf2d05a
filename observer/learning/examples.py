"""Recordings as the examples and streams that a model learns from, as one view sees them. Pure."""

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

from common.errors import BadInput
from common.vocabulary import Vocabulary
from observer.geometry.views import View, turned
from observer.model.base import Example, Stream, StreamSpan, evenly_spread
from observer.motion.archive import MotionArchive, Recording, require_labels, resample, streams_in
from observer.motion.projected import view_tracks
from observer.tracks import Tracks


@dataclass(frozen=True, slots=True)
class ExampleView:
    """How recordings become examples: from one view, at K facings, with these body parts in the model's order."""

    view: View
    vocabulary: Vocabulary
    body_parts: tuple[str, ...]
    facings: int = 1

    def number_of(self, label: str, background: tuple[str, ...] = ()) -> int:
        """The index of a movement in the vocabulary, or the negative one of a movement of the background."""
        return -1 - background.index(label) if label in background else self.vocabulary.index(label)

    def examples(
        self, recordings: Sequence[Recording], recorded: Sequence[str], background: tuple[str, ...] = ()
    ) -> list[Example]:
        """Each recording, with the parts `recorded`, as the view sees it from every facing.

        background: movements outside the vocabulary that recordings may show.
        """
        return [
            Example(tracks, self.number_of(recording.label, background), k, recording.subject, recording.trial)
            for recording, k, tracks in self._at_each_facing(recordings, recorded)
        ]

    def streams(
        self, recordings: Sequence[Recording], recorded: Sequence[str], background: tuple[str, ...] = ()
    ) -> list[Stream]:
        """As `examples`, for continuous recordings as `streams_in` yields them."""
        return [
            Stream(tracks, self._spans_of(recording, background), k, recording.subject, recording.trial)
            for recording, k, tracks in self._at_each_facing(recordings, recorded)
        ]

    def _spans_of(self, recording: Recording, background: tuple[str, ...]) -> tuple[StreamSpan, ...]:
        return tuple(
            StreamSpan(span.start, span.end, self.number_of(span.label, background), span.trial)
            for span in recording.spans
        )

    def _at_each_facing(
        self, recordings: Sequence[Recording], recorded: Sequence[str]
    ) -> Iterator[tuple[Recording, int, list[Tracks]]]:
        for k in range(self.facings):
            for n, recording in enumerate(recordings):
                turned_by_k = _turned(recording, k, self.facings, n)
                yield recording, k, view_tracks(self.view, turned_by_k, tuple(recorded), self.body_parts)


def _turned(recording: Recording, k: int, facings: int, number: int) -> Recording:
    """The recording turned to the left by k of `facings` directions, and by an offset of at most half a direction.

    Each recording has another offset, so that all together they fill the angles between two directions.
    """
    if facings == 1:
        return recording
    offset = evenly_spread(number) - 0.5
    return replace(recording, positions=turned(recording.positions, math.tau * (k + offset) / facings))


def gather_background(
    archives: Sequence[MotionArchive], labels: Sequence[str], body_parts: tuple[str, ...], rate_hz: float
) -> MotionArchive:
    """All recordings of the archives with these parts and at this rate; of movements only these labels (default: all).

    Raises BadInput for a body part that an archive lacks, and for a label that no recording shows.
    """
    recordings = [_with_parts(r, archive, body_parts) for archive in archives for r in archive.recordings]
    gathered = MotionArchive(body_parts, tuple(resample(r, rate_hz) if r.rate_hz != rate_hz else r for r in recordings))
    require_labels(labels, gathered, "--background-labels")
    single = [r for r in gathered.recordings if r.label and not r.spans and (not labels or r.label in labels)]
    return MotionArchive(body_parts, (*single, *streams_in(gathered, labels, unlabelled=True)))


def _with_parts(recording: Recording, archive: MotionArchive, body_parts: tuple[str, ...]) -> Recording:
    missing = [part for part in body_parts if part not in archive.body_parts]
    if missing:
        parts = ", ".join(archive.body_parts)
        raise BadInput(
            f"background: no {missing[0]!r} in its recordings, which the model needs; they have only {parts}"
        )
    rows = [archive.body_parts.index(part) for part in body_parts]
    return replace(recording, positions=recording.positions[:, rows])
