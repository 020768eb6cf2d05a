"""Learning a perspective: recordings in 3-D, seen from one view, become that view's model (section II.B)."""

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace

import numpy as np

from common.errors import BadInput
from common.vocabulary import Vocabulary
from observer.geometry.views import View, turned
from observer.model.base import Example, Header, MovementModel, WithBackground, as_read
from observer.model.evenly import evenly
from observer.model.left_out import believable
from observer.model.registry import DEFAULT_MODEL, model_named
from observer.motion.archive import MotionArchive, Recording
from observer.motion.resample import resample
from observer.projected import ProjectedTracker
from observer.tracks import Frame, Tracks

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
    chosen = [recording for recording in cut_out(archive) if recording.label in vocabulary.labels]
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
            seen_from(view, _facing(recording, k, facings, n), recorded, parts),
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
    astray = evenly(number) - 0.5
    return replace(recording, positions=turned(recording.positions, math.tau * (k + astray) / facings))


def prepared(archive: MotionArchive, subjects: Sequence[str] = (), rate_hz: float | None = None) -> MotionArchive:
    """Only these people (all, when none is named), at this rate (their own, when none is given).

    Raises BadInput for a person who is not in the archive.
    """
    known = sorted({r.subject for r in archive.recordings})
    for subject in subjects:
        if subject not in known:
            raise BadInput(f"subject {subject!r}: not in the archive; it has {', '.join(known)}")
    chosen = [r for r in archive.recordings if not subjects or r.subject in subjects]
    if rate_hz is not None:
        chosen = [r if r.rate_hz == rate_hz else resample(r, rate_hz) for r in chosen]
    return MotionArchive(archive.body_parts, tuple(chosen))


def cut_out(archive: MotionArchive) -> Iterator[Recording]:
    """Recordings of one movement each: those that are, and the spans of continuous ones."""
    for recording in archive.recordings:
        if not recording.spans:
            yield recording
        for n, span in enumerate(recording.spans):
            piece = recording.positions[span.start : span.end]
            yield Recording(piece, recording.rate_hz, span.label, recording.subject, f"{recording.trial}.{n}")


def seen_from(view: View, recording: Recording, recorded: tuple[str, ...], wanted: tuple[str, ...]) -> list[Tracks]:
    """The recording's frames as the view sees them."""
    tracker = ProjectedTracker(view, recorded, wanted)
    return [tracker.update(frame) for frame in frames_of(recording)]


def frames_of(recording: Recording, start_ns: int = 0) -> Iterator[Frame]:
    """The recording's frames, captured at its own rate from `start_ns` on."""
    interval_ns = 1e9 / recording.rate_hz
    for n, positions in enumerate(recording.positions.astype(np.float64)):
        yield Frame(start_ns + round(n * interval_ns), positions)


def common_rate(archive: MotionArchive) -> float:
    """The one rate of all recordings, in Hz; raises BadInput when they differ."""
    rates = sorted({recording.rate_hz for recording in archive.recordings})
    if len(rates) > 1:
        raise BadInput(f"recordings at {rates[0]:g} and {rates[-1]:g} Hz: bring them to one rate with --rate")
    return rates[0]


def labels_of(archive: MotionArchive) -> tuple[str, ...]:
    """All movements that the archive names, in order of first appearance."""
    return tuple(dict.fromkeys(r.label for r in cut_out(archive) if r.label))
