"""Recordings as the examples and streams that a model learns from, and the takes that show how a movement should be
done (docs/design/score.md), as one view sees them. Pure."""

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from common.errors import BadInput
from common.text import nearest
from common.vocabulary import Vocabulary
from observer.features import hop_of, read_trace
from observer.geometry.placement import PersonPlacement
from observer.geometry.views import View, turned
from observer.model.base import Example, MovementModel, Stream, StreamSpan, evenly_spread
from observer.model.parameters import facings_in
from observer.motion.archive import MotionArchive, Recording, movements_in, require_labels, resample, streams_in
from observer.motion.projected import placed, view_tracks
from observer.score.references import ReferenceTake, ReferenceTakes
from observer.tracks import Tracks, other_side


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


ALL_TAKES, CHOSEN = "all", "references"
"""The word for every take, and where a model says which were chosen."""


def with_references(
    model: MovementModel,
    archive: MotionArchive,
    view: View,
    chosen: Sequence[str],
    placement: PersonPlacement | None = None,
) -> MovementModel:
    """The same model with the chosen takes of the archive as references.

    chosen: `all`, or trials, as `1`, movements, as `squat`, and trials of one movement, as `squat:1`. placement: where
    the people are put. Raises BadInput for what no recording is, for too few takes of a movement, and for a model of
    several facings or of a kind that does not know when a movement ends.
    """
    header = model.header
    if header.kind != "stacked" or facings_in(header.parameters) > 1:
        raise BadInput("--reference: scores need a model of the kind stacked with one facing; leave one of both out")
    archive = archive if placement is None else placed(archive, placement)
    own = [each for each in movements_in(archive) if each.label in header.vocabulary.labels]
    shown = [each for each in own if any(_is_meant(name, each) for name in chosen)]
    for name in chosen:
        if not any(_is_meant(name, each) for each in own):
            known = sorted({word for each in own for word in (each.trial, each.label) if word})
            raise BadInput(f"--reference {name}: no take of a movement; {nearest(name, known)}")
    references = {}
    for label in header.vocabulary.labels:
        if takes := [each for each in shown if each.label == label]:
            references[label] = _references(label, takes, archive.body_parts, view, model)
    provenance = {**header.provenance, CHOSEN: ",".join(chosen)}
    return type(model).from_arrays(replace(header, references=references, provenance=provenance), model.arrays())


def _is_meant(name: str, take: Recording) -> bool:
    return name in (ALL_TAKES, take.trial, take.label, f"{take.label}:{take.trial}")


def _references(
    label: str, takes: Sequence[Recording], recorded: tuple[str, ...], view: View, model: MovementModel
) -> ReferenceTakes:
    """The references of one movement, each also as done to the other side, where recordings are in 3-D."""
    header, hop = model.header, hop_of(model.header.rate_hz)
    shown = list[ReferenceTake]()
    for take in takes:
        sides = [take, *([mirrored(take, recorded)] if take.positions.shape[-1] == 3 else [])]
        for n, each in enumerate(sides):
            tracks = view_tracks(view, each, recorded, header.body_parts)
            trace = read_trace(header.body_parts, header.rate_hz, tracks)[::hop]
            shown.append(ReferenceTake(trace, take.subject, mirrored=n > 0))
    try:
        return ReferenceTakes(shown, header.body_parts, header.rate_hz / hop)
    except BadInput as error:
        raise BadInput(f"--reference: {label}: {error}") from None


def mirrored(recording: Recording, body_parts: Sequence[str]) -> Recording:
    """The same to the other side: left and right parts change places, and x its sign; 3-D recordings alone."""
    swapped = recording.positions[:, other_side(body_parts)]
    return replace(recording, positions=swapped * np.array([-1, 1, 1], np.float32))
