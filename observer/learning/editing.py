"""Movements added to a model, and taken out of it, without learning the others again (docs/guide/own-movements.md).

What the model has of the other movements stays as it is, bit for bit. Pure.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Protocol, runtime_checkable

import numpy as np

from common.errors import BadInput
from common.vocabulary import Vocabulary
from observer.geometry.views import View
from observer.learning.cross_validation import by_person, by_recording, judged
from observer.learning.learn import examples_of, facings_in
from observer.model.base import Example, Header, MovementModel, WithBackground, evenly_spread
from observer.model.posterior_calibration import PosteriorCalibration, Tried
from observer.motion.archive import MotionArchive
from observer.motion.transforms import common_rate, labels_of, movements_in

SAME_VIEW = 1e-6
"""Between the numbers of two matrices: a view is computed anew each time, and may differ in its last bits."""
SAME_RATE = 0.01
"""Between two rates, as an observer's source is held to the model's."""
MOST_TRIED = 30
"""Examples of the new movements that are judged: enough for a mean and a spread."""


@runtime_checkable
class Editable(Protocol):
    """What a movement model also has when what it knows of one movement is that movement's own."""

    def grown(self, header: Header, examples: Sequence[Example]) -> MovementModel:
        """The same for a vocabulary with more movements at its end, of which alone the examples are."""

    def shrunk(self, header: Header, kept: Sequence[int]) -> MovementModel:
        """The same for a vocabulary of only these movements, in their order."""


@dataclass(frozen=True, slots=True)
class Grown:
    """The model with its new movements, and how those were judged by models that had not learned the same examples.

    people: how many showed the new movements. promoted: those of them that were something else until now.
    """

    model: MovementModel
    labels: tuple[str, ...]
    examples: int
    people: int
    tried: tuple[Tried, ...]
    promoted: tuple[str, ...] = ()


def with_movements(
    model: MovementModel,
    archive: MotionArchive,
    view: View,
    *,
    labels: Sequence[str] = (),
    kind: str = "",
    parameters: Mapping[str, float] | None = None,
    source: str = "",
) -> Grown:
    """The model and, at its end, the movements of the archive that it does not have, or these `labels` of it.

    Temperature and doubt stay; how well a new movement is foreseen is found by leaving its examples out. source: where
    the movements come from, for people. Of a movement that was of the background those examples are left out.
    Raises BadInput for another view, rate or kind, for other parameters than
    the model's, for a movement that the model has, and when there is none that it has not.
    """
    _require_alike(model.header, archive, view, kind, parameters or {})
    new = _new_labels(model.header.vocabulary, labels, archive)
    promoted = tuple(label for label in new if label in (model.header.background or ()))
    model = _without_background(model, promoted)
    old = model.header
    vocabulary = Vocabulary((*old.vocabulary.labels, *new), old.vocabulary.name)
    chosen = [recording for recording in movements_in(archive) if recording.label in new]
    facings = facings_in({name: value for name, value in old.parameters.items() if name == "facings"})
    examples = examples_of(chosen, view, vocabulary, archive.body_parts, old.body_parts, facings)
    said = f"{','.join(new)}: {len(chosen)} examples" + (f" of {source}" if source else "")
    added = "; ".join([*filter(None, [old.provenance.get("added")]), said])
    header = replace(old, vocabulary=vocabulary, provenance={**old.provenance, "added": added})
    tried, persons = _tries(model, header, examples)
    certainty = replace(old.certainty, foreseen=_foreseen(old.certainty, tried, vocabulary, persons))
    grown = _editable(model).grown(replace(header, certainty=certainty), examples)
    return Grown(grown, new, len(chosen), len({r.subject for r in chosen}), tried, promoted)


def without_movements(model: MovementModel, labels: Sequence[str]) -> MovementModel:
    """The model without these movements. Raises BadInput for one that it has not, and when fewer than two stay."""
    old = model.header
    gone = {old.vocabulary.index(label) for label in labels}
    kept = [m for m in range(old.vocabulary.size) if m not in gone]
    if len(kept) < 2:
        stay = ", ".join(old.vocabulary.labels[m] for m in kept) or "none"
        raise BadInput(
            f"movements {','.join(labels)}: {stay} would stay, and two at least are needed; learn a new model"
        )
    vocabulary = Vocabulary(tuple(old.vocabulary.labels[m] for m in kept), old.vocabulary.name)
    foreseen = tuple(old.certainty.foreseen[m] for m in kept) if old.certainty.foreseen else ()
    removed = ",".join([*filter(None, [old.provenance.get("removed")]), *labels])
    header = replace(
        old,
        vocabulary=vocabulary,
        certainty=replace(old.certainty, foreseen=foreseen),
        provenance={**old.provenance, "removed": removed},
    )
    return _editable(model).shrunk(header, kept)


def _without_background(model: MovementModel, labels: Sequence[str]) -> MovementModel:
    for label in labels:
        if isinstance(model, WithBackground):
            model = model.without_background((model.header.background or ()).index(label))
    return model


def _editable(model: MovementModel) -> Editable:
    if not isinstance(model, Editable):
        raise BadInput(f"model {model.header.kind}: cannot be edited; learn it again with all its movements")
    return model


def _require_alike(old: Header, archive: MotionArchive, view: View, kind: str, parameters: Mapping[str, float]) -> None:
    if not np.allclose(old.matrix, view.matrix, rtol=0, atol=SAME_VIEW * float(np.abs(old.matrix).max())):
        raise BadInput(f"--view {view.name}: the model is for {old.view}; give that view, or learn another model")
    if kind and kind != old.kind:
        raise BadInput(f"--model {kind}: the model is of the kind {old.kind}; leave out --model")
    for name, value in parameters.items():
        if name not in old.parameters:
            raise BadInput(f"--parameter {name!r}: not of the model {old.kind}; it has {', '.join(old.parameters)}")
        if value != old.parameters[name]:
            raise BadInput(f"--parameter {name}={value:g}: the model has {old.parameters[name]:g}; leave it out")
    rate_hz = common_rate(archive)
    if abs(rate_hz - old.rate_hz) > SAME_RATE * old.rate_hz:
        raise BadInput(f"recordings at {rate_hz:g} Hz: the model is for {old.rate_hz:g} Hz; add --rate {old.rate_hz:g}")
    missing = [part for part in old.body_parts if part not in archive.body_parts]
    if missing:
        has = ", ".join(archive.body_parts)
        raise BadInput(f"body part {missing[0]!r}: the model needs it, and the recordings have {has} alone")


def _new_labels(vocabulary: Vocabulary, labels: Sequence[str], archive: MotionArchive) -> tuple[str, ...]:
    shown = labels_of(archive)
    for label in labels:
        if label in vocabulary.labels:
            raise BadInput(f"movement {label!r}: the model has it; take it out with labanmesh forget to learn it anew")
        if label not in shown:
            raise BadInput(f"movement {label!r}: no recording shows it; the archive has {', '.join(shown)}")
    new = tuple(labels) or tuple(label for label in shown if label not in vocabulary.labels)
    if not new:
        raise BadInput(f"movements {','.join(shown)}: the model has them all; there is nothing to add")
    return new


def _tries(model: MovementModel, header: Header, examples: Sequence[Example]) -> tuple[tuple[Tried, ...], bool]:
    """New examples judged by the model grown by the others, and whether it was whole persons who were left out."""
    front = [e for e in examples if e.facing == 0]
    persons = by_person(front)
    share = MOST_TRIED / len(front)
    tried: list[Tried] = []
    for out in persons or by_recording(front):
        left = {(front[n].movement, front[n].subject, front[n].trial) for n in out}
        others = [e for e in examples if (e.movement, e.subject, e.trial) not in left]
        if {e.movement for e in others} == {e.movement for e in front}:
            grown = _editable(model).grown(header, others)
            tried += [judged(grown, front[n]) for n in out if evenly_spread(n) < share]
    return tuple(tried), bool(persons)


def _foreseen(
    certainty: PosteriorCalibration, tried: Sequence[Tried], vocabulary: Vocabulary, persons: bool
) -> tuple[tuple[float, float], ...]:
    """Also of the new movements: nothing where nothing is known of the old ones.

    A movement tried on its own person alone is foreseen too well, and one tried once or never not at all: what is usual
    among the model's movements then stands in.
    """
    old = certainty.foreseen
    if not old:
        return ()
    usual = np.array(old).mean(axis=0)
    stats = list(old)
    for movement in range(len(old), vocabulary.size):
        own = [float(t.foreseen[movement]) for t in tried if t.truth == movement and t.foreseen is not None]
        mean = float(np.mean(own)) if len(own) > 1 else float(usual[0])
        spread = float(np.std(own)) if len(own) > 1 else 0.0
        stats.append((mean if persons else min(mean, float(usual[0])), max(spread, float(usual[1]))))
    return tuple(stats)
