"""Learns a view's model from 3-D recordings that are projected into the view (section II.B), or from its own tracks.

A model of one camera's tracks is for this camera where it stands. Cross-validation by person weighs the members of a
model.
"""

from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace

from common.errors import BadInput
from common.vocabulary import Vocabulary
from observer.geometry.placement import PersonPlacement
from observer.geometry.views import View
from observer.learning.examples import ExampleView
from observer.model.base import (
    Example,
    Header,
    LearnsStreams,
    MovementModel,
    Onset,
    Stream,
    evenly_spread,
    recording_numbers,
)
from observer.model.leaning import Judged, with_results
from observer.model.parameters import facings_in
from observer.model.registry import DEFAULT_MODEL, model_named
from observer.motion.archive import (
    MotionArchive,
    Recording,
    common_rate,
    labels_of,
    movements_in,
    require_labels,
    streams_in,
)
from observer.motion.projected import placed, require_view


def learn_view(
    archive: MotionArchive,
    view: View,
    vocabulary: Vocabulary,
    *,
    kind: str = DEFAULT_MODEL,
    body_parts: tuple[str, ...] | None = None,
    parameters: Mapping[str, float] | None = None,
    provenance: Mapping[str, str] | None = None,
    calibrate: bool = True,
    background: MotionArchive | None = None,
    streams: Sequence[Recording] = (),
    placement: PersonPlacement | None = None,
) -> MovementModel:
    """One view's model of the vocabulary's movements, from all recordings of the archive.

    With a parameter `facings` of K the performer is turned to K directions, evenly around. calibrate: cross-validate
    by person, so that a model learns how sure it may be. background: recordings of other movements, from which
    the model also learns "something else". A kind that learns from streams also
    gets the continuous and the unlabelled recordings of the archive and of the background, and `streams`, which have
    the archive's body parts: what people do outside the spans is "something else".
    placement: where the people are put in the room of a camera file; with several facings its own does not count.

    Raises BadInput for recordings at different rates, an unknown model, an invalid parameter, a movement that no
    recording shows, and recordings that the view cannot show (3-D for the view `camera`, tracks for others).
    """
    parts, facings = body_parts or archive.body_parts, facings_in(parameters or {})
    rate_hz, model = common_rate(archive), model_named(kind)
    sources = [archive, MotionArchive(archive.body_parts, tuple(streams)), *([background] if background else [])]
    require_view(view, [recording for source in sources for recording in source.recordings], facings)
    require_labels(vocabulary.labels, archive, "--labels")
    labels = () if background is None else _background_labels(model, background, vocabulary)
    if placement is not None:
        placement = placement if facings == 1 else replace(placement, facing_deg=0.0)
        sources = [placed(source, placement) for source in sources]
    seen = ExampleView(view, vocabulary, parts, facings)
    recordings = [recording for recording in movements_in(sources[0]) if recording.label in vocabulary.labels]
    examples = seen.examples(recordings, archive.body_parts)
    for other in sources[2:]:  # The background.
        examples += seen.examples([r for r in movements_in(other) if r.label], other.body_parts, labels)
    origin = {"examples": str(len(recordings)), **(provenance or {})}
    header = Header(kind, vocabulary, view.name, view.matrix, rate_hz, parts, parameters or {}, origin)
    header = replace(header, placement=placement, background=None if background is None else labels)
    if not issubclass(model, LearnsStreams):
        learned = model.learn(header, examples)
    else:
        watched = _streams(seen, sources, labels)
        if watched:
            header = replace(header, background=labels, provenance={**origin, **_other_motion(watched, rate_hz)})
        learned = model.learn_with_streams(header, examples, watched)
    return with_calibration(learned, examples) if calibrate else learned


def _streams(seen: ExampleView, sources: Sequence[MotionArchive], labels: tuple[str, ...]) -> list[Stream]:
    """Everything from which "something else" can be learned; labels: the movements of the background."""
    labelled = (*seen.vocabulary.labels, *labels)
    return [
        stream
        for source in sources
        for stream in seen.streams([*streams_in(source, labelled, unlabelled=True)], source.body_parts, labels)
    ]


def _other_motion(streams: Sequence[Stream], rate_hz: float) -> dict[str, str]:
    """For the provenance: how many seconds of something else there are, and by how many people."""
    front = [stream for stream in streams if stream.facing == 0 and stream.other_frames]
    seconds = sum(stream.other_frames for stream in front) / rate_hz
    return {"other_motion_s": f"{seconds:.0f}", "other_motion_people": str(len({s.subject for s in front}))}


def _background_labels(
    model: type[MovementModel], background: MotionArchive, vocabulary: Vocabulary
) -> tuple[str, ...]:
    """The labels of the background; raises BadInput for a model that cannot use it, and for labels to be learned."""
    if not issubclass(model, LearnsStreams):
        raise BadInput(f"model {model.kind}: learns no background; leave it out, or take --model {DEFAULT_MODEL}")
    labels = labels_of(background)
    for label in labels:
        if label in vocabulary.labels:
            raise BadInput(
                f"background: {label!r} is among the movements that are learned; name others with --background-labels"
            )
    return labels


MOST_EVALUATED = 240
"""Examples that are evaluated; more hardly change what is found."""
MOST_WATCHED = 60
"""The same for a kind that evaluates a whole fold at once."""


def with_calibration(model: MovementModel, examples: Sequence[Example]) -> MovementModel:
    """The same model, just learned from these examples, evaluated by leaving out one person at a time.

    A kind that evaluates a whole fold at once leaves out several people at a time if there are many, and learns from
    the results how sure it may be. If only one person shows a movement, one recording of each movement is left out at a
    time instead. `tried` and `right` in the provenance count the evaluated examples.
    """
    kind, header = type(model), model.header
    front = [e for e in examples if e.facing == 0]
    folds = folds_by_person(front) or folds_by_recording(front)
    if isinstance(model, LearnsStreams):
        share = MOST_WATCHED / len(examples)
        watched = {n for n in range(len(examples)) if evenly_spread(n) < share}
        return model.cross_validated(at_all_facings(examples, fewer_folds(front, folds)), watched)
    # The facing hardly changes the results, and a dozen facings take a dozen times as long.
    parameters = {name: 1.0 if name == "facings" else value for name, value in header.parameters.items()}
    of_one_facing = replace(header, parameters=parameters)
    results = [result for fold in folds for result in _evaluate_fold(kind, of_one_facing, front, fold)]
    return kind.from_arrays(with_results(header, results), model.arrays())


def _evaluate_fold(
    kind: type[MovementModel], header: Header, examples: Sequence[Example], fold: Sequence[int]
) -> Iterator[Judged]:
    """Results by a model of all other examples; with many examples only a share of the fold is evaluated."""
    left_out, share = set(fold), MOST_EVALUATED / len(examples)
    model = kind.learn(header, [e for n, e in enumerate(examples) if n not in left_out])
    for n in fold:
        # Evenly spread whatever the order: every second example could always be of the same movements.
        if evenly_spread(n) < share:
            watch = model.watch(Onset(known=True, length=len(examples[n].tracks)))
            for tracks in examples[n].tracks:
                watch.update(tracks)
            yield examples[n].movement, int(watch.p.argmax())


FEWEST_FOLDS = 3
"""Of a kind of model that evaluates a whole fold at once, if there are so many people, or takes of each movement."""
LEARNED_AGAIN = 240
"""Examples that the models of all folds learn from together, about. Few take little time, and a model of two thirds of
five takes is worse than the one that is used."""


def folds_by_recording(examples: Sequence[Example]) -> list[list[int]]:
    """Indices of the examples left out together: the first of each movement that has several, the second, ..."""
    counts: Counter[int] = Counter()
    folds: dict[int, list[int]] = {}
    several = {m for m, count in Counter(e.movement for e in examples).items() if count > 1}
    for n, example in enumerate(examples):
        if example.movement in several:
            folds.setdefault(counts[example.movement], []).append(n)
            counts[example.movement] += 1
    return list(folds.values())


def folds_by_person(examples: Sequence[Example]) -> list[list[int]] | None:
    """Indices of the examples left out together: one person's; None if a movement would then have no example."""
    of_vocabulary = [e for e in examples if e.movement >= 0]
    movements = {e.movement for e in of_vocabulary}
    subjects = sorted({e.subject for e in examples})
    if any({e.movement for e in of_vocabulary if e.subject != s} != movements for s in subjects):
        return None
    return [[n for n, e in enumerate(examples) if e.subject == s] for s in subjects]


def at_all_facings(examples: Sequence[Example], folds: Sequence[Sequence[int]]) -> list[list[int]]:
    """Folds of recordings, as numbers -> of examples, as indices."""
    numbers = recording_numbers(examples)
    return [[n for n, number in enumerate(numbers) if number in recordings] for recordings in map(set, folds)]


def fewer_folds(examples: Sequence[Example], folds: list[list[int]]) -> list[list[int]]:
    """Folds merged into at least FEWEST_FOLDS: with more examples fewer, so that learning all of them takes no longer.

    Unchanged if a movement would have no example outside a merged fold.
    """
    most = max(FEWEST_FOLDS, LEARNED_AGAIN // len(examples))
    merged = [[n for fold in folds[k::most] for n in fold] for k in range(min(most, len(folds)))]
    movements = {e.movement for e in examples if e.movement >= 0}
    for fold in map(set, merged):
        if {e.movement for n, e in enumerate(examples) if n not in fold and e.movement >= 0} != movements:
            return folds
    return merged


def of_one_person(archive: MotionArchive) -> MotionArchive:
    """The same recordings with one subject, so that recordings are left out and not people."""
    return replace(archive, recordings=tuple(replace(r, subject="somebody") for r in archive.recordings))
