"""Learns a view's model: 3-D recordings, projected into one view, become its movement model (section II.B).

Cross-validation by person calibrates the model's posteriors.
"""

import math
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

from common.errors import BadInput
from common.vocabulary import Vocabulary
from observer.geometry.views import View, turned
from observer.model.base import (
    Example,
    Header,
    MovementModel,
    Onset,
    WithBackground,
    evenly_spread,
    facings_in,
    with_features,
)
from observer.model.posterior_calibration import HeldOutResult, answer_posterior, at_least_cautious, fit_calibration
from observer.model.registry import DEFAULT_MODEL, model_named
from observer.motion.archive import (
    MotionArchive,
    Recording,
    common_rate,
    labels_of,
    movements_in,
    require_labels,
    resample,
)
from observer.motion.projected import view_tracks

BLENDS = "blends"
"""Stands for a background without recordings: only blends of the learned movements are "something else"."""


@dataclass(frozen=True, slots=True)
class ExampleView:
    """How recordings become examples: from one view, at K facings, with these body parts in the model's order."""

    view: View
    vocabulary: Vocabulary
    body_parts: tuple[str, ...]
    facings: int = 1

    def examples(
        self, recordings: Sequence[Recording], recorded: Sequence[str], background: tuple[str, ...] | None = None
    ) -> list[Example]:
        """Each recording, with the parts `recorded`, as the view sees it from every facing.

        background: given if the recordings show these movements, which are outside the vocabulary.
        """
        number = self.vocabulary.index if background is None else lambda label: -1 - background.index(label)
        return [
            Example(
                view_tracks(self.view, _turned(recording, k, self.facings, n), tuple(recorded), self.body_parts),
                number(recording.label),
                k,
                recording.subject,
                recording.trial,
            )
            for k in range(self.facings)
            for n, recording in enumerate(recordings)
        ]


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
) -> MovementModel:
    """One view's model of the vocabulary's movements, from all recordings of the archive.

    With a parameter `facings` of K the performer is turned to K directions, evenly around. calibrate: cross-validate
    by person, so that the model's posteriors can be calibrated. background: recordings of other movements, from which
    the model also learns "something else"; without recordings, from blends only.

    Raises BadInput for recordings at different rates, an unknown model, an invalid parameter, and a movement that no
    recording shows.
    """
    parts = body_parts or archive.body_parts
    rate_hz, model = common_rate(archive), model_named(kind)
    seen_from = ExampleView(view, vocabulary, parts, facings_in(parameters or {}))
    recordings = [recording for recording in movements_in(archive) if recording.label in vocabulary.labels]
    require_labels(vocabulary.labels, archive, "--labels")
    examples = seen_from.examples(recordings, archive.body_parts)
    origin = {"examples": str(len(recordings)), **(provenance or {})}
    header = Header(kind, vocabulary, view.name, view.matrix, rate_hz, parts, parameters or {}, origin)
    if background is not None:
        labels = _background_labels(model, background, vocabulary)
        header = replace(header, background=labels)
        examples += seen_from.examples(background.recordings, background.body_parts, labels)
    examples = with_features(model, header, examples)
    learned = model.learn(header, examples)
    return with_calibration(model, learned, examples) if calibrate else learned


def gather_background(
    archives: Sequence[MotionArchive], labels: Sequence[str], body_parts: tuple[str, ...], rate_hz: float
) -> MotionArchive:
    """All labelled recordings of the archives, or those with these labels, with these parts and at this rate.

    Raises BadInput for a body part that an archive lacks, and for a label that no recording shows.
    """
    recordings = [_with_parts(r, archive, body_parts) for archive in archives for r in movements_in(archive) if r.label]
    gathered = MotionArchive(body_parts, tuple(resample(r, rate_hz) if r.rate_hz != rate_hz else r for r in recordings))
    require_labels(labels, gathered, "--background-labels")
    return MotionArchive(body_parts, tuple(r for r in gathered.recordings if not labels or r.label in labels))


def _with_parts(recording: Recording, archive: MotionArchive, body_parts: tuple[str, ...]) -> Recording:
    missing = [part for part in body_parts if part not in archive.body_parts]
    if missing:
        parts = ", ".join(archive.body_parts)
        raise BadInput(
            f"background: no {missing[0]!r} in its recordings, which the model needs; they have only {parts}"
        )
    rows = [archive.body_parts.index(part) for part in body_parts]
    return replace(recording, positions=recording.positions[:, rows])


def _background_labels(
    model: type[MovementModel], background: MotionArchive, vocabulary: Vocabulary
) -> tuple[str, ...]:
    """The labels of the background; raises BadInput for a model that cannot use it, and for labels to be learned."""
    if not issubclass(model, WithBackground):
        raise BadInput(f"model {model.kind}: learns no background; leave it out, or take --model {DEFAULT_MODEL}")
    labels = labels_of(background)
    for label in labels:
        if label in vocabulary.labels:
            raise BadInput(
                f"background: {label!r} is among the movements that are learned; name others with --background-labels"
            )
    return labels


def _turned(recording: Recording, k: int, facings: int, number: int) -> Recording:
    """The recording turned to the left by k of `facings` directions, and by an offset of at most half a direction.

    Each recording has another offset, so that all together they fill the angles between two directions.
    """
    if facings == 1:
        return recording
    offset = evenly_spread(number) - 0.5
    return replace(recording, positions=turned(recording.positions, math.tau * (k + offset) / facings))


MOST_EVALUATED = 240
"""Examples that are evaluated; more hardly change the few numbers that are fitted."""


def with_calibration(kind: type[MovementModel], model: MovementModel, examples: Sequence[Example]) -> MovementModel:
    """The same model with its calibration, estimated by leaving out one person at a time.

    If only one person shows a movement, one recording of each movement is left out at a time instead. That tells
    nothing about other people, and the result is at least as cautious as CAUTIOUS. `tried` and `right` in the
    provenance count the evaluated examples.
    """
    results = _cross_validate(kind, model.header, examples)
    calibration = fit_calibration(results, model.header.vocabulary.size)
    if folds_by_person(examples) is None:
        calibration = at_least_cautious(calibration)
    counts = {"tried": str(len(results)), "right": str(right_count(results))}
    header = replace(model.header, calibration=calibration, provenance={**model.header.provenance, **counts})
    return kind.from_arrays(header, model.arrays())


def right_count(results: Sequence[HeldOutResult]) -> int:
    """How many of the examples were recognised."""
    return sum(int(r.posteriors[-1].argmax()) == r.truth for r in results)


def evaluate_example(model: MovementModel, example: Example) -> HeldOutResult:
    """The model's posterior at the end of an example that it has not learned, where verdicts are made."""
    watch = model.watch(Onset(known=True, length=len(example.tracks)))
    for tracks in example.tracks:
        watch.update(tracks)
    movements = model.header.vocabulary.size
    truth = example.movement if example.movement >= 0 else movements
    return HeldOutResult(truth, answer_posterior(watch).sum(axis=1)[None], watch.foreseen)


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


def _cross_validate(kind: type[MovementModel], header: Header, examples: Sequence[Example]) -> list[HeldOutResult]:
    # The facing hardly changes the calibration, and a dozen facings take a dozen times as long.
    front = [e for e in examples if e.facing == 0]
    if "facings" in header.parameters:
        header = replace(header, parameters={**header.parameters, "facings": 1.0})
    folds = folds_by_person(front) or folds_by_recording(front)
    return [result for fold in folds for result in _evaluate_fold(kind, header, front, fold)]


def _evaluate_fold(
    kind: type[MovementModel], header: Header, examples: Sequence[Example], fold: Sequence[int]
) -> Iterator[HeldOutResult]:
    """Results by a model of all other examples; with many examples only a share of the fold is evaluated."""
    left_out, share = set(fold), MOST_EVALUATED / len(examples)
    model = kind.learn(header, [e for n, e in enumerate(examples) if n not in left_out])
    for n in fold:
        # Evenly spread whatever the order: every second example could always be of the same movements.
        if evenly_spread(n) < share:
            unaware = _without_movement(model, examples[n].movement)
            if unaware is not None:
                yield evaluate_example(unaware, examples[n])


def _without_movement(model: MovementModel, movement: int) -> MovementModel | None:
    """The model that may evaluate an example: for a background movement, one that has learned from others only."""
    if movement >= 0:
        return model
    if isinstance(model, WithBackground) and len(model.header.background or ()) > 1:
        return model.without_background(-1 - movement)
    return None
