"""Which takes show how a movement should be done, and a model that scores by them (docs/design/score.md)."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from common.errors import BadInput
from common.text import nearest
from observer.features import hop_of, read_trace
from observer.geometry.placement import PersonPlacement
from observer.geometry.views import View
from observer.model.base import MovementModel
from observer.model.parameters import facings_in
from observer.motion.archive import MotionArchive, Recording, movements_in
from observer.motion.projected import placed, view_tracks
from observer.score.references import ReferenceTake, ReferenceTakes
from observer.tracks import other_side

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
