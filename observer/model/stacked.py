"""`stacked`, the default model: a phase filter, regressions on convolutional features and the nearest take, stacked.

The members make different mistakes. While the begin of a movement is known, from the person's stillness before it, all
of them judge; a movement that follows another one directly, or any other motion, is judged by the trailing windows
alone. `stacker.py` weighs what they say (docs/design/model.md).
"""

import json
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import ClassVar, Self

import numpy as np

from observer.model.base import Arrays, Example, Header, LearnsStreams, Onset, Stream, array_in, with_defaults
from observer.model.body_trace import EXTENT_S, BodyTrace, hop_of, tracks_of, width_of
from observer.model.chains import fill_gaps
from observer.model.cross_validation import CrossValidation, LearnedFromOthers
from observer.model.held_out import held_out_results, rows_of_fold, streams_left_out
from observer.model.leaning import LEANS_ON, leans_on
from observer.model.logistic import FEW_ITERATIONS, ITERATIONS, LogisticRegression
from observer.model.movement_times import oscillations_of, with_times
from observer.model.nearest_take import NearestTakes
from observer.model.parameters import POSITIVE, Parameter, ParameterRange, facings_in
from observer.model.periodicity import Oscillation
from observer.model.phase import Phase, posture_reader
from observer.model.segment_classifier import SegmentClassifier
from observer.model.stacked_watch import StackedWatch
from observer.model.stacker import Stacker, task_of
from observer.model.stacker_prior import PRIOR
from observer.model.trailing_features import TrailingFeatures
from observer.model.training_memory import TrainingMemory, trace_in
from observer.model.training_rows import learned_facings, thin_facings
from observer.model.training_table import TrainingTable
from observer.tracks import Floats, Floats32

LONGEST_SHARE = 1.4
"""A segment longer than this multiple of the longest example is no single movement."""


class Stacked(LearnsStreams):
    """The members and the stacker of one view.

    lengths (M,): median frames of a movement's examples; extents (M,): how far the farthest part usually goes within
    `body_trace.EXTENT_S`, body sizes; usual_posture (2 P,): where the parts usually are, relative to the body.
    """

    kind: ClassVar[str] = "stacked"
    # kernels: features of the segment classifier. inverse_penalty: of all regressions, for segments and for trailing
    # windows. Chosen by leaving out training people (docs/results/notebook.md). seed: of the kernels and of the blends
    # that are drawn at random, to find out how much of a difference is chance.
    PARAMETERS: ClassVar[Mapping[str, Parameter]] = {
        **Phase.PARAMETERS,
        "kernels": Parameter(2500.0, ParameterRange(84, 20_000, whole=True)),
        "inverse_penalty": Parameter(0.01, POSITIVE),
        "trailing_penalty": Parameter(0.005, POSITIVE),
        "seed": Parameter(0.0, ParameterRange(0.0, whole=True)),
    }

    def __init__(
        self,
        header: Header,
        phase: Phase,
        table: "TrainingTable | _Learned",
        answers: LogisticRegression,
        segments: SegmentClassifier,
        takes: NearestTakes | None,
        memory: TrainingMemory,
        stacker: Stacker,
    ) -> None:
        self.header, self.phase, self.memory, self.stacker = header, phase, memory, stacker
        self._table: TrainingTable | None = None
        """All windows that it was learned from, until it is stored."""
        self.trailing: TrailingFeatures = table.trailing
        self.trailing_answers, self.segments, self.takes = answers, segments, takes
        self.lengths, self.extents, self.usual_posture = table.lengths, table.extents, table.usual_posture
        self.longest, self.longest_segment = table.longest, LONGEST_SHARE * table.longest
        self.history = max(round(EXTENT_S * header.rate_hz), round(self.longest_segment)) + 2
        """Rows of the trace that a watch keeps."""

    @classmethod
    def learn_with_streams(cls, header: Header, examples: Sequence[Example], streams: Sequence[Stream]) -> Self:
        """Learn all members. The stacker is that of the prior: nothing has been tried yet."""
        header = replace(with_defaults(header, cls.PARAMETERS), background=header.background or ())
        facings = facings_in(header.parameters)
        split = [_split(header, e) for e in examples]
        phase = Phase.learn(_phase_header(header), [p for p, _ in split if p.movement >= 0])
        shown = thin_facings([replace(d, tracks=()) for _, d in split], facings)
        others = thin_facings([replace(_trace_of(header, s), tracks=()) for s in streams], facings)
        memory, table = TrainingMemory(tuple(shown), tuple(others)), TrainingTable(header, shown, others)
        model = cls._assembled(header, phase, table, (), memory)
        leaning = leans_on(model.segments, table.usual_posture, header, memory.examples)
        provenance = {**header.provenance, LEANS_ON: json.dumps(leaning)}
        model.header, model._table = with_times(replace(header, provenance=provenance), memory), table
        return model

    @classmethod
    def _assembled(
        cls,
        header: Header,
        phase: Phase,
        table: TrainingTable,
        left_out: Sequence[int],
        memory: TrainingMemory,
        part: tuple[int, int] | None = None,
    ) -> Self:
        """The model without the examples, and the part of streams, left out of the table; the memory has them all."""
        answers, segments = table.learn(left_out, FEW_ITERATIONS if left_out else ITERATIONS, part)
        gone = set(left_out)
        examples = [e for n, e in enumerate(memory.examples) if n not in gone]
        takes = NearestTakes.of(examples, header.vocabulary.size, hop=hop_of(header.rate_hz))
        stacker = PRIOR.stacker(_task_of(header, examples, memory.streams))
        return cls(header, phase, table, answers, segments, takes, memory, stacker)

    def cross_validated(self, cross_validation: CrossValidation) -> LearnedFromOthers:
        """The stacker of the examples and streams of the people left out, each watched by a model of all others."""
        examples = cross_validation.examples
        # The models of the folds need not count repetitions.
        header = replace(self.header, vocabulary=replace(self.header.vocabulary, movements={}))
        facings = facings_in(header.parameters)
        split = [_split(header, e) for e in examples]
        chosen = learned_facings(examples, facings)
        place = {n: k for k, n in enumerate(chosen)}
        streams = thin_facings([_trace_of(header, s) for s in cross_validation.streams], facings)
        table = self._table or TrainingTable(header, [split[n][1] for n in chosen], streams)
        rows = []
        for number, fold in enumerate(cross_validation.folds):
            gone, part = set(fold), (number, len(cross_validation.folds))
            of_phase = [p for n, (p, _) in enumerate(split) if n not in gone and p.movement >= 0]
            phase = Phase.learn(_phase_header(header), of_phase)
            model = self._assembled(header, phase, table, [place[n] for n in fold if n in place], self.memory, part)
            watched = [n for n in fold if n in cross_validation.watched]
            apart = list(streams_left_out(streams, examples, gone, part))
            rows.append(rows_of_fold(model, examples, watched, apart))
        stacker, results, strange = held_out_results(
            PRIOR, _task_of(header, examples, streams), rows, cross_validation.shares
        )
        return LearnedFromOthers(results, _stacker_arrays(stacker), strange)

    @classmethod
    def read(cls, header: Header, example: Example | Stream) -> Floats:
        """(F, D) the phase filter's features, then the trace; of a stream the trace alone."""
        trace = BodyTrace(header.body_parts, header.rate_hz)
        if isinstance(example, Stream):
            return np.array([trace.update(tracks) for tracks in example.tracks], np.float64)
        reader, rows, postures = posture_reader(_phase_header(header)), [], []
        for tracks in example.tracks:
            rows.append(trace.update(tracks))
            postures.append(reader.read(tracks, trace.frame.origin, trace.frame.size))
        return np.concatenate([fill_gaps(np.array(postures)), np.array(rows)], axis=1)

    @classmethod
    def from_arrays(cls, header: Header, arrays: Arrays) -> Self:
        """The inverse of `arrays`; ValueError if they do not fit."""
        movements, parts = header.vocabulary.size, len(header.body_parts)
        learned = _Learned.from_arrays(header, arrays)
        answers = LogisticRegression.from_arrays("trailing_movement", arrays, (learned.trailing.size, movements + 1))
        memory = TrainingMemory.from_arrays(arrays, movements, len(header.background or ()), width_of(parts))
        scales = _positive(arrays, "take_scales", movements if arrays["take_scales"].size else 0)
        hop = hop_of(header.rate_hz)
        takes = NearestTakes.of(memory.examples, movements, scales, hop) if len(scales) else None
        segments = SegmentClassifier.from_arrays(arrays, movements, parts)
        phase = Phase.from_arrays(_phase_header(header), arrays)
        return cls(header, phase, learned, answers, segments, takes, memory, _stacker_in(arrays))

    def arrays(self) -> Arrays:
        """Everything that was learned."""
        return {
            **self.phase.arrays(),
            **self.trailing.as_arrays(),
            **self.trailing_answers.as_arrays("trailing_movement"),
            **self.segments.arrays(),
            "longest": np.array([self.longest]),
            "lengths": self.lengths,
            "extents": self.extents,
            "usual_posture": self.usual_posture,
            "take_scales": np.zeros(0) if self.takes is None else self.takes.scales,
            **_stacker_arrays(self.stacker),
            **self.memory.as_arrays(),
        }

    def remembered(self, indices: Mapping[int, int]) -> tuple[list[Example], list[Stream]]:
        """What it was learned from of the movements in `indices`, old to new, with tracks and features."""
        memory, width = self.memory.renumbered(indices), width_of(len(self.header.body_parts))
        examples = [replace(e, tracks=tracks_of(trace_in(e)), features=None) for e in memory.examples]
        read = [self.read(self.header, e)[:, :-width] for e in examples]
        traces = [np.concatenate([p, trace_in(e)], axis=1) for p, e in zip(read, memory.examples, strict=True)]
        streams = [replace(s, tracks=tracks_of(trace_in(s))) for s in memory.streams]
        return [replace(e, features=t) for e, t in zip(examples, traces, strict=True)], streams

    @cached_property
    def oscillations(self) -> Mapping[int, Oscillation]:
        """How the periodic movements go to and fro, by index in the vocabulary."""
        return oscillations_of(self.header, self.memory)

    def watch(self, onset: Onset) -> StackedWatch:
        """Start watching; a known onset is the begin of the first segment."""
        return StackedWatch(self, onset)


@dataclass(frozen=True, slots=True, eq=False)
class _Learned:
    """What a model file has of a `TrainingTable`."""

    trailing: TrailingFeatures
    longest: int
    lengths: Floats
    extents: Floats
    usual_posture: Floats32

    @classmethod
    def from_arrays(cls, header: Header, arrays: Arrays) -> "_Learned":
        movements, parts = header.vocabulary.size, len(header.body_parts)
        return cls(
            TrailingFeatures.from_arrays(arrays, header.rate_hz, parts),
            int(array_in(arrays, "longest", (1,), np.int64)[0]),
            _positive(arrays, "lengths", movements),
            _positive(arrays, "extents", movements),
            array_in(arrays, "usual_posture", (2 * parts,), np.float32),
        )


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


def _stacker_arrays(stacker: Stacker) -> dict[str, Floats]:
    return {"stacker_weights": stacker.weights, "stacker_other": stacker.other}


def _stacker_in(arrays: Arrays) -> Stacker:
    """ValueError for arrays that do not fit."""
    weights = array_in(arrays, "stacker_weights", PRIOR.weights.spreads.shape, np.float64)
    return Stacker(weights, array_in(arrays, "stacker_other", PRIOR.other.spreads.shape, np.float64))


def _phase_header(header: Header) -> Header:
    parameters = {name: header.parameters[name] for name in Phase.PARAMETERS}
    return replace(header, kind=Phase.kind, parameters=parameters, background=None)


def _split(header: Header, example: Example) -> tuple[Example, Example]:
    features = Stacked.read(header, example) if example.features is None else example.features
    width = width_of(len(header.body_parts))
    return replace(example, features=features[:, :-width]), replace(example, features=features[:, -width:])


def _trace_of(header: Header, stream: Stream) -> Stream:
    return stream if stream.features is not None else replace(stream, features=Stacked.read(header, stream))
