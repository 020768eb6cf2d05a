"""Adds movements to a model and removes them, without the recordings of the others (docs/guide/own-movements.md).

The examples of the other movements that a model keeps stay the same, bit for bit, and so does everything that is
learned from one movement alone. Pure.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Protocol, runtime_checkable

import numpy as np

from common.errors import BadInput
from common.text import nearest, plural
from common.vocabulary import Vocabulary
from observer.geometry.placement import PersonPlacement, unlike
from observer.geometry.views import View
from observer.learning.examples import ExampleView
from observer.learning.folds import folds_by_person, folds_by_recording
from observer.learning.learn import evaluate_example, right_count, with_calibration
from observer.model.base import (
    Example,
    Header,
    LearnsStreams,
    MovementModel,
    WithBackground,
    with_features,
)
from observer.model.body_trace import tracks_of
from observer.model.cross_validation import held_out_of
from observer.model.even_spread import evenly_spread
from observer.model.parameters import facings_in
from observer.model.posterior_calibration import HeldOutResult, PosteriorCalibration
from observer.model.training_memory import Remembers, trace_in
from observer.model.training_rows import LEARNED_FACINGS
from observer.motion.archive import MotionArchive, common_rate, labels_of, movements_in, require_labels
from observer.motion.placing import placed
from observer.motion.projected import require_view

SAME_VIEW = 1e-6
"""Relative tolerance of two matrices: a view is computed each time and may differ in its last bits."""
SAME_RATE = 0.01
"""Relative tolerance of two rates, as for an observer's source."""
MOST_EVALUATED = 30
"""Examples of the new movements that are evaluated: enough for a mean and a spread."""
MOST_TIMES_LEARNED = 3
"""A model that learns all movements again is evaluated so often, with the examples of several people left out."""


@runtime_checkable
class Editable(Protocol):
    """The additional methods of a model that keeps the data of each movement."""

    def grown(self, header: Header, examples: Sequence[Example]) -> MovementModel:
        """The same model for a vocabulary with more movements at its end; the examples show only these."""

    def shrunk(self, header: Header, remaining: Sequence[int]) -> MovementModel:
        """The same model for a vocabulary of only these movements, in their order."""


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

    A model that `Remembers` is calibrated anew, as if it were learned from all its examples at once. Of others
    temperature and doubt stay; the predictive likelihood of a new movement is estimated by leaving out its examples.
    source: the origin of the recordings, for people. If a new movement was background, it leaves the background.
    placement: where the people are put; by default where the model has its own.

    Raises BadInput for another view, placement, rate or kind, for other parameters than the model's, for a movement
    that the model already has, and if there is none to add.
    """
    _require_match(model.header, archive, view, kind, parameters or {})
    archive = _placed_as(model.header, archive, placement)
    new = _new_labels(model.header.vocabulary, labels, archive)
    promoted = tuple(label for label in new if label in (model.header.background or ()))
    model = _without_background(model, promoted)
    old = model.header
    vocabulary = Vocabulary((*old.vocabulary.labels, *new), old.vocabulary.name)
    recordings = [recording for recording in movements_in(archive) if recording.label in new]
    facings = facings_in(old.parameters)
    examples = ExampleView(view, vocabulary, old.body_parts, facings).examples(recordings, archive.body_parts)
    examples = with_features(type(model), old, examples)
    addition = f"{','.join(new)}: {plural(len(recordings), 'example')}" + (f" of {source}" if source else "")
    added = "; ".join([*filter(None, [old.provenance.get("added")]), addition])
    header = replace(old, vocabulary=vocabulary, provenance={**old.provenance, "added": added})
    people = len({r.subject for r in recordings})
    if _remembers_all(model):
        edited = calibrated_anew(_editable(model).grown(header, examples))
        rows = held_out_of(edited.header)
        tried = sum(sum(rows.get(label, {}).values()) for label in new)
        right = sum(rows.get(label, {}).get(label, 0) for label in new)
        return EditedModel(edited, new, len(recordings), people, tried, right, promoted)
    results, by_person = _evaluate(model, header, examples)
    statistics = _likelihood_statistics_of_all(old.calibration, results, vocabulary, by_person)
    header = replace(header, calibration=replace(old.calibration, likelihood_statistics=statistics))
    edited = _editable(model).grown(header, examples)
    return EditedModel(edited, new, len(recordings), people, len(results), right_count(results), promoted)


def remove_movements(model: MovementModel, labels: Sequence[str]) -> MovementModel:
    """The model without these movements, calibrated anew if it `Remembers`.

    Raises BadInput for an unknown movement, and if fewer than two would remain.
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
    statistics = (
        tuple(old.calibration.likelihood_statistics[m] for m in remaining)
        if old.calibration.likelihood_statistics
        else ()
    )
    removed = ",".join([*filter(None, [old.provenance.get("removed")]), *labels])
    header = replace(
        old,
        vocabulary=vocabulary,
        calibration=replace(old.calibration, likelihood_statistics=statistics),
        provenance={**old.provenance, "removed": removed},
    )
    smaller = _editable(model).shrunk(header, remaining)
    return calibrated_anew(smaller) if _remembers_all(smaller) else smaller


def _remembers_all(model: MovementModel) -> bool:
    """Whether the model has all its examples. Of more than LEARNED_FACINGS facings it remembers only some."""
    return isinstance(model, Remembers) and facings_in(model.header.parameters) <= LEARNED_FACINGS


def calibrated_anew(model: MovementModel) -> MovementModel:
    """A model that `Remembers` with the calibration that its examples give.

    Those of the model before it was edited may not hold: with other people, more takes or more movements other weights
    are right (`observer.model.stacker`).
    """
    if not isinstance(model, Remembers):
        return model
    kind, header = type(model), model.header
    examples = [replace(e, tracks=tracks_of(trace_in(e)), features=None) for e in model.memory.examples]
    streams = [replace(s, tracks=tracks_of(trace_in(s)), features=None) for s in model.memory.streams]
    examples, streams = with_features(kind, header, examples), with_features(kind, header, streams)
    return with_calibration(kind, model, examples, streams)


def _without_background(model: MovementModel, labels: Sequence[str]) -> MovementModel:
    for label in labels:
        if isinstance(model, WithBackground):
            model = model.without_background((model.header.background or ()).index(label))
    return model


def _editable(model: MovementModel) -> Editable:
    if not isinstance(model, Editable):
        raise BadInput(f"model {model.header.kind}: cannot be edited; learn it again with all its movements")
    return model


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


def _evaluate(
    model: MovementModel, header: Header, examples: Sequence[Example]
) -> tuple[tuple[HeldOutResult, ...], bool]:
    """New examples evaluated by the model grown by the others; and whether whole people were left out."""
    front = [e for e in examples if e.facing == 0]
    people = folds_by_person(front)
    share = MOST_EVALUATED / len(front)
    results: list[HeldOutResult] = []
    folds = people or folds_by_recording(front)
    if isinstance(model, LearnsStreams) and len(folds) > MOST_TIMES_LEARNED:
        folds = [[n for fold in folds[k::MOST_TIMES_LEARNED] for n in fold] for k in range(MOST_TIMES_LEARNED)]
    for fold in folds:
        left_out = {(front[n].movement, front[n].subject, front[n].trial) for n in fold}
        others = [e for e in examples if (e.movement, e.subject, e.trial) not in left_out]
        if {e.movement for e in others} == {e.movement for e in front}:
            grown = _editable(model).grown(header, others)
            results += [evaluate_example(grown, front[n]) for n in fold if evenly_spread(n) < share]
    return tuple(results), bool(people)


def _likelihood_statistics_of_all(
    calibration: PosteriorCalibration, results: Sequence[HeldOutResult], vocabulary: Vocabulary, by_person: bool
) -> tuple[tuple[float, float], ...]:
    """Mean and spread of the predictive likelihood, also of the new movements; empty if unknown for the old ones.

    Evaluated on its own person only, a movement is predicted too well; evaluated once or never, its spread is unknown.
    The averages of the old movements then limit or replace its own.
    """
    old = calibration.likelihood_statistics
    if not old:
        return ()
    usual = np.array(old).mean(axis=0)
    statistics = list(old)
    for movement in range(len(old), vocabulary.size):
        own = [
            float(r.log_likelihood[movement]) for r in results if r.truth == movement and r.log_likelihood is not None
        ]
        mean = float(np.mean(own)) if len(own) > 1 else float(usual[0])
        spread = float(np.std(own)) if len(own) > 1 else 0.0
        statistics.append((mean if by_person else min(mean, float(usual[0])), max(spread, float(usual[1]))))
    return tuple(statistics)
