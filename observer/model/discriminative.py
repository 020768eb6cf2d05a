"""`discriminative`: tells movements and something else apart by logistic regression on convolutional features.

Two classifiers share the work. One looks at trailing windows (`trailing_features.py`) and needs neither rest nor a
begin: P(movement or something else | the last seconds). The other looks at the stretched window from the begin of a
movement, if that is known, until now (`rocket.py`); it has one part for movements in progress, one for movements that
have ended, and one that tells which of the two applies (docs/design/model.md).
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import ClassVar, Self

import numpy as np

from common.probability import softmax
from observer.model.base import Arrays, Example, Header, LearnsStreams, Onset, Stream, Watch, with_defaults
from observer.model.body_trace import BodyTrace, extent, read_trace, width_of
from observer.model.common_gestures import GESTURES, streams_for
from observer.model.cross_validation import CrossValidation, LearnedFromOthers
from observer.model.logistic import LogisticRegression
from observer.model.movement_segment import MovementSegment
from observer.model.parameters import FACINGS, POSITIVE, Parameter, ParameterRange, facings_in
from observer.model.posterior_calibration import HeldOutResult
from observer.model.renumbering import indices_of_remaining, without_background_movement
from observer.model.segment_classifier import SegmentClassifier
from observer.model.something_else import SCALING, learn_scaling, scaled
from observer.model.trailing_features import TrailingFeatures
from observer.model.training_memory import TrainingMemory
from observer.model.training_rows import learned_facings, thin_facings
from observer.model.training_table import HeldOutMembers, TrainingTable
from observer.tracks import Floats, Floats32, Tracks

LONGEST_SHARE = 1.4
"""A segment longer than this multiple of the longest example is no single movement."""
STEPS_PER_S = 15.0
"""Most classifications per second."""
STEEP = 6
"""P(too little has moved for movement m) is 1 / (1 + (extent / least_extents[m])^STEEP)."""
FORGET_PER_S = 0.15
"""The share of a posterior that returns to the prior in a second without sight."""


class Discriminative(LearnsStreams):
    """The two classifiers of one view."""

    kind: ClassVar[str] = "discriminative"
    FEWER_PARTS: ClassVar[bool] = False
    # kernels: features of the segment classifier. inverse_penalty: of all regressions, for segments and for trailing
    # windows. Chosen by leaving out training people (docs/design/model.md). seed: of the kernels and of the blends that
    # are drawn at random, to find out how much of a difference is chance.
    PARAMETERS: ClassVar[Mapping[str, Parameter]] = {
        "kernels": Parameter(2500.0, ParameterRange(84, 20_000, whole=True)),
        "inverse_penalty": Parameter(0.01, POSITIVE),
        "trailing_penalty": Parameter(0.005, POSITIVE),
        "seed": Parameter(0.0, ParameterRange(0.0, whole=True), earlier=0.0),
        "facings": FACINGS,
        **SCALING,
        **GESTURES,
    }

    def __init__(
        self,
        header: Header,
        trailing: TrailingFeatures,
        movement: LogisticRegression,
        segments: SegmentClassifier,
        longest: int,
        least_extents: Floats,
        memory: TrainingMemory,
    ) -> None:
        self.header, self.least_extents, self.memory = header, least_extents, memory
        self.trailing, self.movement, self.segments, self.longest = trailing, movement, segments, longest

    @classmethod
    def learn_with_streams(cls, header: Header, examples: Sequence[Example], streams: Sequence[Stream]) -> Self:
        """Learn from cut-out movements and from continuous recordings."""
        header = with_defaults(header, cls.PARAMETERS)
        facings = facings_in(header.parameters)
        return cls._learn(header, thin_facings(examples, facings), thin_facings(streams, facings))

    @classmethod
    def _learn(cls, header: Header, examples: Sequence[Example], streams: Sequence[Stream]) -> Self:
        """The header has all parameters."""
        traces, of_streams = [cls._trace(header, e) for e in examples], [cls._trace(header, s) for s in streams]
        table = cls._table(header, examples, traces, streams, of_streams)
        movement, segments = table.learn()
        header = replace(header, background=header.background or ())
        memory = TrainingMemory.of(examples, traces, streams, of_streams)
        return cls(header, table.trailing, movement, segments, table.longest, table.least_extents, memory)

    @classmethod
    def _table(
        cls,
        header: Header,
        examples: Sequence[Example],
        traces: Sequence[Floats32],
        streams: Sequence[Stream],
        of_streams: Sequence[Floats32],
    ) -> TrainingTable:
        """The table of all windows, those of common gestures too; the model's memory has only what was shown."""
        common = streams_for(header, examples, traces)
        of_common = [cls._trace(header, stream) for stream in common]
        return TrainingTable(header, examples, traces, [*streams, *common], [*of_streams, *of_common])

    @classmethod
    def cross_validated(cls, header: Header, cross_validation: CrossValidation) -> LearnedFromOthers:
        """The scaling of something else, and the results of all examples of movements."""
        examples = cross_validation.examples
        members, scaling = cls.held_out(header, cross_validation)
        results = [
            HeldOutResult(examples[n].movement, softmax(m.after(cross_validation.shares)), None)
            for n, m in members.items()
        ]
        return LearnedFromOthers(scaling, results)

    @classmethod
    def held_out(
        cls, header: Header, cross_validation: CrossValidation
    ) -> tuple[dict[int, HeldOutMembers], dict[str, float]]:
        """The members' posteriors of each example of a movement by a model of the other folds, and the scaling learned.

        The examples, by index, are those from which a model learns and those that are watched. The scaling is that of
        something else, by name of the parameter.
        """
        header = with_defaults(header, cls.PARAMETERS)
        facings = facings_in(header.parameters)
        chosen = sorted({*learned_facings(cross_validation.examples, facings), *cross_validation.watched})
        examples = [cross_validation.examples[n] for n in chosen]
        streams = thin_facings(cross_validation.streams, facings)
        traces, of_streams = [cls._trace(header, e) for e in examples], [cls._trace(header, s) for s in streams]
        table = cls._table(header, examples, traces, streams, of_streams)
        place_of = {n: place for place, n in enumerate(chosen)}
        folds = [[place_of[n] for n in fold if n in place_of] for fold in cross_validation.folds]
        judged = [table.held_out(fold) for fold in folds]
        scaling = learn_scaling([rows for _, rows in judged], header.parameters, cross_validation.explicit)
        return {chosen[place]: members for fold, _ in judged for place, members in fold.items()}, scaling

    @classmethod
    def read(cls, header: Header, example: Example | Stream) -> Floats:
        """(F, 2 P + 3) the trace."""
        return read_trace(header.body_parts, header.rate_hz, example.tracks).astype(np.float64)

    @classmethod
    def _trace(cls, header: Header, example: Example | Stream) -> Floats32:
        features = cls.read(header, example) if example.features is None else example.features
        return features.astype(np.float32)

    @classmethod
    def from_arrays(cls, header: Header, arrays: Arrays) -> Self:
        """The inverse of `arrays`; ValueError if they do not fit."""
        movements, parts = header.vocabulary.size, len(header.body_parts)
        trailing = TrailingFeatures.from_arrays(arrays, header.rate_hz, parts)
        segments = SegmentClassifier.from_arrays(arrays, movements, parts)
        movement = LogisticRegression.from_arrays("trailing_movement", arrays, (trailing.size, movements + 1))
        memory = TrainingMemory.from_arrays(arrays, movements, len(header.background or ()), width_of(parts))
        longest, least = int(arrays["longest"].astype(np.int64)[0]), np.asarray(arrays["least_extents"], np.float64)
        if least.shape != (movements,) or not (np.isfinite(least) & (least >= 0)).all():
            raise ValueError(f"least_extents are {least}; {movements} sizes are expected")
        return cls(header, trailing, movement, segments, longest, least, memory)

    def arrays(self) -> Arrays:
        """Everything that was learned."""
        return {
            **self.trailing.as_arrays(),
            **self.movement.as_arrays("trailing_movement"),
            **self.segments.arrays(),
            "longest": np.array([self.longest]),
            "least_extents": self.least_extents,
            **self.memory.as_arrays(),
        }

    def grown(self, header: Header, examples: Sequence[Example]) -> Self:
        """Learned again with examples of more movements, which are at the end of the header's vocabulary."""
        examples = thin_facings(examples, facings_in(header.parameters))
        new = [replace(e, features=self._trace(header, e).astype(np.float64)) for e in examples]
        return self._learned_from(header, self.memory.with_examples(new))

    def shrunk(self, header: Header, remaining: Sequence[int]) -> Self:
        """Learned again for a vocabulary of only these movements, in their order."""
        return self._learned_from(header, self.memory.renumbered(indices_of_remaining(self.header, remaining)))

    def without_background(self, gone: int) -> Self:
        """Learned again without one movement of the background, given by its place in the header's."""
        header, new_index = without_background_movement(self.header, gone)
        return self._learned_from(header, self.memory.renumbered(new_index))

    def _learned_from(self, header: Header, memory: TrainingMemory) -> Self:
        return self._learn(header, memory.examples, memory.streams)

    def watch(self, onset: Onset) -> "DiscriminativeWatch":
        """Start watching; a known onset is the begin of the first segment."""
        return DiscriminativeWatch(self, onset.known)


class DiscriminativeWatch(Watch):
    """Watches one person."""

    def __init__(self, model: Discriminative, onset_known: bool) -> None:
        self._model = model
        header = model.header
        self.trace = BodyTrace(header.body_parts, header.rate_hz)
        self.segment = MovementSegment(header.rate_hz, onset_known, LONGEST_SHARE * model.longest)
        self._history = max(model.trailing.windows.history, round(LONGEST_SHARE * model.longest)) + 2
        self._rows: Floats32 = np.zeros((0, width_of(len(header.body_parts))), np.float32)
        self._hop = max(round(header.rate_hz / STEPS_PER_S), 1)
        self._left = 0
        self._ended = False
        self.doubt = 1.0
        """The weight of the prior in the posterior, which grows while nobody is seen; 1 before the first sight."""
        movements = header.vocabulary.size
        self._log_trailing: Floats = np.log(np.full(movements + 1, 1 / (movements + 1)))
        # Before the first classification there is only the prior, in which something else is unlikely.
        self._answers: Floats = np.append(np.zeros(movements), 1.0)
        self._something_else = 1 / (movements + 1)
        self._log_segment: Floats | None = None
        self._too_small = 0.0
        """P(too little has moved within EXTENT_S for the movement | it is one)."""

    @property
    def rows(self) -> Floats32:
        """(F, 2 P + 3) the newest rows of the trace."""
        return self._rows

    @property
    def judges_ended(self) -> bool:
        """Whether the posterior is that of the classifier for ended movements."""
        return self._ended and self._log_segment is not None

    @property
    def log_movements(self) -> Floats:
        """(M,) log P(movement), not normalised, given that it is one of them."""
        trailing: Floats = self._log_trailing[:-1] - np.logaddexp.reduce(self._log_trailing[:-1])
        if self._log_segment is None:
            return trailing
        return self._log_segment if self._ended else (trailing + self._log_segment) / 2

    @property
    def p(self) -> Floats:
        """(M,) posterior given that it is one of the movements."""
        logs = self.log_movements
        p: Floats = np.exp(logs - np.logaddexp.reduce(logs))
        p *= (1 - self.doubt) / p.sum()
        p += self.doubt / len(p)
        return p

    @property
    def unlearned(self) -> Floats:
        """(1,) P(something else)."""
        learned = (1 - self._something_else) * (1 - self._too_small)
        p = (1 - self.doubt) * (1 - learned) + self.doubt / len(self._log_trailing)
        return np.array([min(max(p, 0.0), 1.0)])

    @property
    def rest(self) -> float:
        """P(the person is still and does something else)."""
        return min(self.trace.frame.still * math.exp(self._log_trailing[-1]), 1.0)

    def update(self, tracks: Tracks) -> None:
        """Take in one frame."""
        if self._take(tracks) and self._left <= 0:
            self._left = self._hop
            self._classify(ended=self.segment.over)

    def pass_over(self, tracks: Tracks) -> None:
        """Take in one frame, without classifying what has been seen."""
        self._take(tracks)

    def _take(self, tracks: Tracks) -> bool:
        """Take in one frame; whether anything is seen in it."""
        row = self.trace.update(tracks)
        if not tracks.visible.any():
            self.doubt = 1 - (1 - self.doubt) * (1 - FORGET_PER_S / self._model.header.rate_hz)
            return False
        self.doubt = 0.0
        self._rows = np.concatenate([self._rows[1 - self._history :], row[None]])
        self.segment.update(self.rest >= 0.5, self._answers, len(self._rows))
        self._left -= 1
        return True

    def end(self) -> None:
        """The recording has ended, and with it the movement."""
        if len(self._rows):
            self._classify(ended=True)

    def _classify(self, ended: bool) -> None:
        model, self._ended = self._model, ended
        self._log_trailing = model.movement.log_probabilities(model.trailing.newest(self._rows)).astype(np.float64)
        self._answers = np.exp(self._log_trailing)
        self._something_else = scaled(self._log_trailing, model.header.parameters)
        self._log_segment = None
        if self.segment.begun:
            rows = self.segment.rows_of(self._rows)
            self._log_segment = model.segments.log_posterior(rows, ended).astype(np.float64)
        far = extent(self._rows, model.header.rate_hz)
        self._too_small = float(self.p @ (1 / (1 + (far / np.maximum(model.least_extents, 1e-6)) ** STEEP)))
