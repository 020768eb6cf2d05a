"""`stacked`, the default model: a phase filter, regressions on convolutional features and the nearest take, stacked.

The members make different mistakes. While the begin of a movement is known, from the person's stillness before it, all
of them judge; a movement that follows another one directly, or any other motion, is judged by the trailing windows
alone. `stacker.py` weighs what they say (docs/design/model.md).
"""

import copy
import json
from collections import Counter
from collections.abc import Collection, Mapping, Sequence
from dataclasses import replace
from functools import cached_property
from typing import ClassVar, Self

import numpy as np

from observer.features import EXTENT_S, BodyTrace, hop_of, tracks_of, width_of
from observer.model.base import (
    Arrays,
    Example,
    Header,
    LearnsStreams,
    Onset,
    Shown,
    Stream,
    array_in,
    with_defaults,
)
from observer.model.held_out import held_out_results, rows_of_fold, streams_left_out
from observer.model.leaning import LEANS_ON, leans_on, with_results
from observer.model.logistic import FEW_ITERATIONS, ITERATIONS, LogisticRegression
from observer.model.nearest_take import NearestTakes
from observer.model.parameters import Parameter, Positive, facings_in
from observer.model.periodicity import Oscillation, oscillations_of, with_times
from observer.model.phase import Phase, fill_gaps, posture_reader
from observer.model.segment_classifier import SegmentClassifier
from observer.model.stacked_watch import StackedWatch
from observer.model.stacker import Stacker, task_of
from observer.model.stacker_prior import PRIOR
from observer.model.trailing_features import TrailingFeatures
from observer.model.training_memory import TrainingMemory
from observer.model.training_rows import learned_facings, thin_facings
from observer.model.training_table import TrainingTable
from observer.tracks import Floats

LONGEST_SHARE = 1.4
"""A segment longer than this multiple of the longest example is no single movement."""


class Stacked(LearnsStreams):
    """The members and the stacker of one view.

    lengths (M,): median frames of a movement's examples; extents (M,): how far the farthest part usually goes within
    `features.EXTENT_S`, body sizes; usual_posture (2 P,): where the parts usually are, relative to the body.
    """

    kind: ClassVar[str] = "stacked"
    # kernels: features of the segment classifier. inverse_penalty: of all regressions, for segments and for trailing
    # windows. Chosen by leaving out training people (docs/results/notebook.md). seed: of the kernels and of the blends
    # that are drawn at random, to find out how much of a difference is chance.
    PARAMETERS: ClassVar[Mapping[str, Parameter]] = {
        **Phase.PARAMETERS,
        "kernels": Parameter(2500.0, 84, 20_000, whole=True),
        "inverse_penalty": Positive(0.01),
        "trailing_penalty": Positive(0.005),
        "seed": Parameter(0.0, 0.0, whole=True),
    }

    def __init__(
        self,
        header: Header,
        phase: Phase,
        trailing: TrailingFeatures,
        answers: LogisticRegression,
        segments: SegmentClassifier,
        takes: NearestTakes | None,
        extents: Floats,
        memory: TrainingMemory,
        stacker: Stacker,
    ) -> None:
        self.header, self.phase, self.memory, self.stacker = header, phase, memory, stacker
        self.trailing, self.trailing_answers, self.segments, self.takes = trailing, answers, segments, takes
        own = [memory.lengths_of(movement) for movement in range(header.vocabulary.size)]
        self.longest_segment = LONGEST_SHARE * max(map(max, own))
        self.lengths: Floats = np.array([np.median(each) for each in own])
        self.extents, self.usual_posture = extents, memory.usual_posture
        self.history = max(round(EXTENT_S * header.rate_hz), round(self.longest_segment)) + 2
        """Rows of the trace that a watch keeps."""
        self._learned: tuple[TrainingTable, Sequence[Example], Sequence[Stream]] | None = None
        """All windows, examples and streams that it was learned from, until it is stored."""

    @classmethod
    def learn_with_streams(cls, header: Header, examples: Sequence[Example], streams: Sequence[Stream]) -> Self:
        """Learn all members. The stacker is that of the prior: nothing has been tried yet."""
        header = replace(with_defaults(header, cls.PARAMETERS), background=header.background or ())
        facings = facings_in(header.parameters)
        examples = [e if len(e.features) else cls.read(header, e) for e in examples]
        streams = thin_facings([s if len(s.features) else cls.read(header, s) for s in streams], facings)
        shown = [replace(e, tracks=(), postures=e.postures[:0]) for e in thin_facings(examples, facings)]
        memory = TrainingMemory(tuple(shown), tuple(replace(s, tracks=()) for s in streams))
        table = TrainingTable(header, shown, streams)
        model = cls._assembled(header, examples, table, memory)
        leaning = leans_on(model.segments, model.usual_posture, header, shown)
        provenance = {**header.provenance, LEANS_ON: json.dumps(leaning)}
        model.header = with_times(replace(header, provenance=provenance), memory)
        model._learned = table, examples, streams
        return model

    @classmethod
    def _assembled(
        cls,
        header: Header,
        examples: Sequence[Example],
        table: TrainingTable,
        memory: TrainingMemory,
        left_out: Collection[int] = (),
        part: tuple[int, int] | None = None,
    ) -> Self:
        """The model without some of the examples, and a part of the streams; the memory has them all."""
        of_phase = [e for n, e in enumerate(examples) if n not in left_out and e.movement >= 0]
        phase = Phase.learn(_phase_header(header), [replace(e, features=e.postures) for e in of_phase])
        chosen = learned_facings(examples, facings_in(header.parameters))
        gone = {k for k, n in enumerate(chosen) if n in left_out}
        answers, segments = table.learn(gone, FEW_ITERATIONS if gone else ITERATIONS, part)
        takes_of = [e for k, e in enumerate(memory.examples) if k not in gone]
        takes = NearestTakes.of(takes_of, header.vocabulary.size, hop=hop_of(header.rate_hz))
        stacker = PRIOR.stacker(_task_of(header, takes_of, memory.streams))
        return cls(header, phase, table.trailing, answers, segments, takes, table.extents, memory, stacker)

    def cross_validated(self, folds: Sequence[Sequence[int]], watched: Collection[int]) -> Self:
        """With the stacker of the examples and streams of the people left out, watched by models of all others."""
        if self._learned is None:
            raise ValueError("a model that was stored is not evaluated again")
        table, examples, streams = self._learned
        # The models of the folds need not count repetitions.
        header = replace(self.header, vocabulary=replace(self.header.vocabulary, movements={}))
        rows = []
        for number, fold in enumerate(map(set, folds)):
            part = number, len(folds)
            model = self._assembled(header, examples, table, self.memory, fold, part)
            apart = list(streams_left_out(streams, examples, fold, part))
            rows += rows_of_fold(model, examples, [n for n in sorted(fold) if n in watched], apart)
        evaluated = copy.copy(self)
        evaluated.stacker, results, strange = held_out_results(PRIOR, _task_of(header, examples, streams), rows)
        evaluated.header, evaluated._learned = with_results(self.header, results, strange), None
        return evaluated

    @classmethod
    def read(cls, header: Header, example: Shown) -> Shown:
        """The example with its trace (F, 2 P + 3), and with the phase filter's postures unless it is a stream."""
        trace, reader = BodyTrace(header.body_parts, header.rate_hz), posture_reader(_phase_header(header))
        rows, postures = [], []
        for tracks in example.tracks:
            rows.append(trace.update(tracks))
            if isinstance(example, Example):
                postures.append(reader.read(tracks, trace.frame.origin, trace.frame.size))
        read = replace(example, features=np.array(rows, np.float64))
        return replace(read, postures=fill_gaps(np.array(postures))) if isinstance(read, Example) else read

    @classmethod
    def from_arrays(cls, header: Header, arrays: Arrays) -> Self:
        """The inverse of `arrays`; ValueError if they do not fit."""
        movements, parts = header.vocabulary.size, len(header.body_parts)
        trailing = TrailingFeatures.from_arrays(arrays, header.rate_hz, parts)
        answers = LogisticRegression.from_arrays("trailing_movement", arrays, (trailing.size, movements + 1))
        memory = TrainingMemory.from_arrays(arrays, movements, len(header.background or ()), width_of(parts))
        scales = _positive(arrays, "take_scales", movements if arrays["take_scales"].size else 0)
        hop = hop_of(header.rate_hz)
        takes = NearestTakes.of(memory.examples, movements, scales, hop) if len(scales) else None
        segments = SegmentClassifier.from_arrays(arrays, movements, parts)
        phase, extents = Phase.from_arrays(_phase_header(header), arrays), _positive(arrays, "extents", movements)
        shapes = {"stacker_weights": PRIOR.weights.spreads.shape, "stacker_other": PRIOR.other.spreads.shape}
        stacker = Stacker(*(array_in(arrays, name, shape, np.float64) for name, shape in shapes.items()))
        return cls(header, phase, trailing, answers, segments, takes, extents, memory, stacker)

    def arrays(self) -> Arrays:
        """Everything that was learned."""
        return {
            **self.phase.arrays(),
            **self.trailing.as_arrays(),
            **self.trailing_answers.as_arrays("trailing_movement"),
            **self.segments.arrays(),
            "extents": self.extents,
            "take_scales": np.zeros(0) if self.takes is None else self.takes.scales,
            "stacker_weights": self.stacker.weights,
            "stacker_other": self.stacker.other,
            **self.memory.as_arrays(),
        }

    def remembered(self, indices: Mapping[int, int]) -> tuple[list[Example], list[Stream]]:
        """What it was learned from of the movements in `indices`, old to new, with tracks and features."""
        memory = self.memory.renumbered(indices)
        shown = [replace(e, tracks=tracks_of(e.features)) for e in memory.examples]
        examples = [replace(self.read(self.header, e), features=e.features) for e in shown]
        return examples, [replace(s, tracks=tracks_of(s.features)) for s in memory.streams]

    @cached_property
    def oscillations(self) -> Mapping[int, Oscillation]:
        """How the periodic movements go to and fro, by index in the vocabulary."""
        return oscillations_of(self.header, self.memory)

    def watch(self, onset: Onset) -> StackedWatch:
        """Start watching; a known onset is the begin of the first segment."""
        return StackedWatch(self, onset)


def _positive(arrays: Arrays, name: str, count: int) -> Floats:
    values: Floats = array_in(arrays, name, (count,), np.float64)
    if not (values > 0).all():
        raise ValueError(f"{name} are {values}: positive numbers are expected")
    return values


def _task_of(header: Header, examples: Sequence[Example], streams: Sequence[Stream]) -> Floats:
    """How much the members learned from, as the stacker's prior wants it."""
    takes = [e for e in examples if e.movement >= 0 and e.facing == examples[0].facing]
    movements = header.vocabulary.size
    other_s = sum(s.other_frames for s in streams if s.facing == streams[0].facing) / header.rate_hz
    # The effective number, 1 / P(two takes are of one person): one take by a second person hardly makes two people.
    shares = np.array([*Counter(e.subject for e in takes).values()]) / len(takes)
    return task_of(len(takes) / movements, 1 / float(shares @ shares), movements, other_s)


def _phase_header(header: Header) -> Header:
    parameters = {name: header.parameters[name] for name in Phase.PARAMETERS}
    return replace(header, kind=Phase.kind, parameters=parameters, background=None)
