"""Adds movements to a model and removes them, without the recordings of the others (docs/guide/own-movements.md).

The model is learned again from the examples that it keeps, and is what learning all of them at once gives. Pure.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from common.errors import BadInput
from common.text import nearest, plural
from common.vocabulary import Vocabulary
from observer.geometry.placement import PersonPlacement, unlike
from observer.geometry.views import View
from observer.learning.examples import ExampleView
from observer.learning.learn import with_calibration
from observer.model.base import Example, Header, MovementModel
from observer.model.leaning import held_out_of
from observer.model.parameters import facings_in
from observer.model.stacked import Stacked
from observer.model.training_rows import LEARNED_FACINGS
from observer.motion.archive import MotionArchive, common_rate, labels_of, movements_in, require_labels
from observer.motion.projected import placed, require_view

SAME_VIEW = 1e-6
"""Relative tolerance of two matrices: a view is computed each time and may differ in its last bits."""
SAME_RATE = 0.01
"""Relative tolerance of two rates, as for an observer's source."""


@dataclass(frozen=True, slots=True)
class EditedModel:
    """A model with new movements.

    people: how many show the new movements. tried: how many of their examples were judged by models that had not
    learned from them; right: how many of these were recognised. promoted: new movements that were background before.
    """

    model: MovementModel
    labels: tuple[str, ...]
    examples: int
    people: int
    tried: int
    right: int
    promoted: tuple[str, ...] = ()


def add_movements(
    model: MovementModel,
    archive: MotionArchive,
    view: View,
    *,
    labels: Sequence[str] = (),
    kind: str = "",
    parameters: Mapping[str, float] | None = None,
    source: str = "",
    placement: PersonPlacement | None = None,
) -> EditedModel:
    """The model with the archive's movements that it does not have, or these `labels`, at the end of its vocabulary.

    source: the origin of the recordings, for people. If a new movement was background, it leaves the background.
    placement: where the people are put; by default where the model has its own.

    Raises BadInput for another view, placement, rate or kind, for other parameters than the model's, for a movement
    that the model already has, if there is none to add, and for a model that does not keep all its examples.
    """
    _require_match(model.header, archive, view, kind, parameters or {})
    archive = _placed_as(model.header, archive, placement)
    new = _new_labels(model.header.vocabulary, labels, archive)
    old, facings = model.header, facings_in(model.header.parameters)
    background = old.background or ()
    promoted, left = ([b for b in background if (b in new) is gone] for gone in (True, False))
    vocabulary = Vocabulary((*old.vocabulary.labels, *new), old.vocabulary.name)
    recordings = [recording for recording in movements_in(archive) if recording.label in new]
    examples = ExampleView(view, vocabulary, old.body_parts, facings).examples(recordings, archive.body_parts)
    addition = f"{','.join(new)}: {plural(len(recordings), 'example')}" + (f" of {source}" if source else "")
    added = "; ".join([*filter(None, [old.provenance.get("added")]), addition])
    header = replace(old, vocabulary=vocabulary, provenance={**old.provenance, "added": added})
    header = replace(header, background=None if old.background is None else tuple(left))
    indices = {m: m for m in range(old.vocabulary.size)}
    indices |= {-1 - background.index(label): -1 - n for n, label in enumerate(left)}
    edited = _learned_again(model, header, indices, examples)
    rows, people = held_out_of(edited.header), len({r.subject for r in recordings})
    tried = sum(sum(rows.get(label, {}).values()) for label in new)
    right = sum(rows.get(label, {}).get(label, 0) for label in new)
    return EditedModel(edited, new, len(recordings), people, tried, right, tuple(promoted))


def remove_movements(model: MovementModel, labels: Sequence[str]) -> MovementModel:
    """The model without these movements.

    Raises BadInput for an unknown movement, if fewer than two would remain, and for a model that does not keep all its
    examples.
    """
    if not labels:
        return model
    old = model.header
    gone = {old.vocabulary.index(label) for label in labels}
    remaining = [m for m in range(old.vocabulary.size) if m not in gone]
    if len(remaining) < 2:
        stay = ", ".join(old.vocabulary.labels[m] for m in remaining) or "none"
        raise BadInput(
            f"movements {','.join(labels)}: {stay} would stay, and at least two are needed; learn a new model"
        )
    vocabulary = Vocabulary(tuple(old.vocabulary.labels[m] for m in remaining), old.vocabulary.name)
    removed = ",".join([*filter(None, [old.provenance.get("removed")]), *labels])
    references = {label: own for label, own in old.references.items() if label in vocabulary.labels}
    header = replace(old, vocabulary=vocabulary, provenance={**old.provenance, "removed": removed})
    header = replace(header, references=references)
    indices = {-1 - b: -1 - b for b in range(len(old.background or ()))}
    return _learned_again(model, header, indices | {m: n for n, m in enumerate(remaining)})


def _learned_again(
    model: MovementModel, header: Header, indices: Mapping[int, int], added: Sequence[Example] = ()
) -> MovementModel:
    """The model of its own examples of the movements in `indices`, old to new, and of those that are added."""
    if not isinstance(model, Stacked) or facings_in(header.parameters) > LEARNED_FACINGS:
        raise BadInput(f"model {header.kind}: does not keep all its takes; learn it again with all its movements")
    examples, streams = model.remembered(indices)
    examples += added
    return with_calibration(type(model).learn_with_streams(header, examples, streams), examples)


def _require_match(old: Header, archive: MotionArchive, view: View, kind: str, parameters: Mapping[str, float]) -> None:
    if not np.allclose(old.matrix, view.matrix, rtol=0, atol=SAME_VIEW * float(np.abs(old.matrix).max())):
        raise BadInput(f"--view {view.name}: the model is for {old.view}; give that view, or learn another model")
    cameras = {name for name in (old.view.partition(":")[2], view.name.partition(":")[2]) if name}
    if view.is_this_camera and len(cameras) > 1:
        raise BadInput(
            f"recordings of {view.name}: the model is for {old.view}; a model is for the tracks of one camera"
        )
    require_view(view, archive.recordings)
    if kind and kind != old.kind:
        raise BadInput(f"--model {kind}: the model is of the kind {old.kind}; leave out --model")
    for name, value in parameters.items():
        if name not in old.parameters:
            raise BadInput(f"--parameter {name!r}: not of the model {old.kind}; {nearest(name, old.parameters)}")
        if value != old.parameters[name]:
            raise BadInput(f"--parameter {name}={value:g}: the model has {old.parameters[name]:g}; leave it out")
    rate_hz = common_rate(archive)
    if abs(rate_hz - old.rate_hz) > SAME_RATE * old.rate_hz:
        raise BadInput(f"recordings at {rate_hz:g} Hz: the model is for {old.rate_hz:g} Hz; add --rate {old.rate_hz:g}")
    missing = [part for part in old.body_parts if part not in archive.body_parts]
    if missing:
        has = ", ".join(archive.body_parts)
        raise BadInput(f"body part {missing[0]!r}: the model needs it, and the recordings have only {has}")


def _placed_as(old: Header, archive: MotionArchive, placement: PersonPlacement | None) -> MotionArchive:
    """The recordings with the people where the model has its own; raises BadInput for another placement."""
    known = old.placement
    if placement and (known is None or unlike(placement, known, facings_in(old.parameters) > 1)):
        place = "where its recordings say" if known is None else f"for a person at {known}"
        raise BadInput(f"--place: a person at {placement}, but the model was learned {place}; omit these options")
    return archive if known is None else placed(archive, known)


def _new_labels(vocabulary: Vocabulary, labels: Sequence[str], archive: MotionArchive) -> tuple[str, ...]:
    shown = labels_of(archive)
    for label in labels:
        if label in vocabulary.labels:
            raise BadInput(f"movement {label!r}: the model has it; remove it with labanmesh forget to learn it again")
    require_labels(labels, archive, "--labels")
    new = tuple(labels) or tuple(label for label in shown if label not in vocabulary.labels)
    if not new:
        raise BadInput(f"movements {','.join(shown)}: the model has them all; there is nothing to add")
    return new
