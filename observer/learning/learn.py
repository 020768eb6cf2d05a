"""Learning a perspective: recordings in 3-D, seen from one view, become that view's model (section II.B)."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace

from common.errors import BadInput
from common.vocabulary import Vocabulary
from observer.geometry.views import View, turned
from observer.learning.cross_validation import believable
from observer.model.base import Example, Header, MovementModel, WithBackground, as_read, evenly_spread
from observer.model.registry import DEFAULT_MODEL, model_named
from observer.motion.archive import MotionArchive, Recording
from observer.motion.projected import view_tracks
from observer.motion.transforms import common_rate, labels_of, movements_in

MOST_FACINGS = 72


def learn_view(
    archive: MotionArchive,
    view: View,
    vocabulary: Vocabulary,
    *,
    kind: str = DEFAULT_MODEL,
    body_parts: tuple[str, ...] | None = None,
    parameters: Mapping[str, float] | None = None,
    provenance: Mapping[str, str] | None = None,
    tried: bool = True,
    background: MotionArchive | None = None,
) -> MovementModel:
    """One view's model of the vocabulary's movements, from all recordings of the archive.

    With a parameter `facings` of K the performer is turned to K directions, evenly around. tried: the model is tried
    on who it has not learned from, one person at a time, so that it knows how far it can be believed. background:
    recordings of other movements, so that it also knows "something else"; with none in it, by blends alone.
    Raises BadInput for recordings at different rates, an unknown model, and a movement that nobody performs.
    """
    parts = body_parts or archive.body_parts
    rate_hz, facings = common_rate(archive), facings_in(parameters or {})
    chosen = [recording for recording in movements_in(archive) if recording.label in vocabulary.labels]
    examples = examples_of(chosen, view, vocabulary, archive.body_parts, parts, facings)
    shown = {e.movement for e in examples}
    never = [label for m, label in enumerate(vocabulary.labels) if m not in shown]
    if never:
        raise BadInput(f"movement {never[0]!r}: no recording shows it; leave it out with --labels, or record it")
    model = model_named(kind)
    said = {"examples": str(len(chosen)), **(provenance or {})}
    header = Header(kind, vocabulary, view.name, view.matrix, rate_hz, parts, parameters or {}, said)
    if background is not None:
        header = replace(header, background=_others(model, background, vocabulary))
        examples += examples_of(
            background.recordings, view, vocabulary, background.body_parts, parts, facings, header.background
        )
    examples = as_read(model, header, examples)
    learned = model.learn(header, examples)
    return believable(model, learned, examples) if tried else learned


def examples_of(
    recordings: Sequence[Recording],
    view: View,
    vocabulary: Vocabulary,
    recorded: tuple[str, ...],
    parts: tuple[str, ...],
    facings: int,
    background: tuple[str, ...] | None = None,
) -> list[Example]:
    """Each recording as the view sees it, from every facing; `recorded` body parts, of which `parts` are wanted.

    background: where given, the recordings are of these movements, which are none of the vocabulary.
    """
    number = vocabulary.index if background is None else lambda label: -1 - background.index(label)
    return [
        Example(
            view_tracks(view, _facing(recording, k, facings, n), recorded, parts),
            number(recording.label),
            k,
            recording.subject,
            recording.trial,
        )
        for k in range(facings)
        for n, recording in enumerate(recordings)
    ]


def _others(model: type[MovementModel], background: MotionArchive, vocabulary: Vocabulary) -> tuple[str, ...]:
    """What the recordings of the background show; raises BadInput for who cannot learn it, and what is learned."""
    if not issubclass(model, WithBackground):
        raise BadInput(f"model {model.kind}: learns no background; leave it out, or take --model {DEFAULT_MODEL}")
    labels = labels_of(background)
    for label in labels:
        if label in vocabulary.labels:
            raise BadInput(
                f"background: {label!r} is among the movements that are learned; name others with --background-labels"
            )
    return labels


def facings_in(parameters: Mapping[str, float]) -> int:
    """How many facings the parameters ask for; raises BadInput for what is no number from 1 to 72."""
    facings = parameters.get("facings", 1.0)
    if not 1 <= facings <= MOST_FACINGS or facings != int(facings):
        raise BadInput(f"facings = {facings:g}: a whole number from 1 to {MOST_FACINGS} is expected, e.g. 12")
    return int(facings)


def _facing(recording: Recording, k: int, facings: int, number: int) -> Recording:
    """Turned to his left by k of `facings` directions, and a little more or less.

    Each recording by another little, so that all together they fill the angles between two directions.
    """
    if facings == 1:
        return recording
    astray = evenly_spread(number) - 0.5
    return replace(recording, positions=turned(recording.positions, math.tau * (k + astray) / facings))
