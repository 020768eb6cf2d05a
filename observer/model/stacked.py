"""`stacked`, the default model: the phase filter and the discriminative classifiers, multiplied with learned exponents.

Wolpert, "Stacked generalization", Neural Networks 5, 1992; here a log-linear pool (Genest and Zidek 1986). The
two kinds of model make different mistakes. While the begin of a movement is known, from the person's stillness before
it, both judge it; a movement that follows another one directly, or any other motion, is judged by the trailing windows
of the discriminative model alone (docs/design/model.md).
"""

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from typing import ClassVar, Self

import numpy as np

from common.probability import softmax
from observer.model.base import Arrays, Example, Header, LearnsStreams, Onset, Stream, with_defaults
from observer.model.body_trace import BodyTrace, width_of
from observer.model.chains import fill_gaps
from observer.model.common_gestures import learns_gestures
from observer.model.cross_validation import CrossValidation, LearnedFromOthers
from observer.model.discriminative import Discriminative
from observer.model.few_takes import CALIBRATION, COMMON_OFFSET, OFFSET, judges_by_takes, pooled_with_takes
from observer.model.few_takes import PARAMETERS as FEW_TAKES_PARAMETERS
from observer.model.nearest_take import NEAREST, arrays_of, held_out_distances, scales_in, takes_of
from observer.model.parameters import Parameter
from observer.model.phase import Phase, posture_reader
from observer.model.posterior_calibration import HeldOutResult
from observer.model.something_else import (
    AGREED_FROM,
    AGREEMENT,
    learn_agreement,
    learn_confusions,
)
from observer.model.stack_exponents import EXPONENTS, RUNNING_AT, learned_exponents, pooled_at
from observer.model.stacked_watch import StackedWatch
from observer.model.training_memory import TrainingMemory
from observer.tracks import Floats


class Stacked(LearnsStreams):
    """Phase and Discriminative of one view."""

    kind: ClassVar[str] = "stacked"
    FEWER_PARTS: ClassVar[bool] = False
    PARAMETERS: ClassVar[Mapping[str, Parameter]] = {
        **Phase.PARAMETERS,
        **Discriminative.PARAMETERS,
        **EXPONENTS,
        **AGREEMENT,
        **NEAREST,
        **FEW_TAKES_PARAMETERS,
    }

    def __init__(
        self,
        header: Header,
        phase: Phase,
        discriminative: Discriminative,
        confusions: Floats | None = None,
        take_scales: Floats | None = None,
    ) -> None:
        """take_scales: (M,) of `NearestTakes`, empty if the model does not compare with takes; None: measured here."""
        self.header, self.phase, self.discriminative = header, phase, discriminative
        self.confusions = np.eye(header.vocabulary.size) if confusions is None else confusions
        examples = discriminative.memory.examples
        self.takes = takes_of(header, examples, take_scales)
        self.judges_by_takes = self.takes is not None and judges_by_takes(header, examples)
        self.else_offset = COMMON_OFFSET if learns_gestures(discriminative.header, examples) else OFFSET

    @property
    def memory(self) -> TrainingMemory:
        """What it was learned from."""
        return self.discriminative.memory

    @classmethod
    def learn_with_streams(cls, header: Header, examples: Sequence[Example], streams: Sequence[Stream]) -> Self:
        """Learn both members; the phase filter learns from the movements of the vocabulary only."""
        header = replace(with_defaults(header, cls.PARAMETERS), background=header.background or ())
        members = [_split(header, e) for e in examples]
        phase = Phase.learn(_phase_header(header), [p for p, _ in members if p.movement >= 0])
        traces = [_trace_of(header, s) for s in streams]
        discriminative = Discriminative.learn_with_streams(
            _discriminative_header(header), [d for _, d in members], traces
        )
        return cls(header, phase, discriminative)

    @classmethod
    def cross_validated(cls, header: Header, cross_validation: CrossValidation) -> LearnedFromOthers:
        """The exponents, what tells something else, and the results of the examples watched by the phase filter."""
        header = with_defaults(header, cls.PARAMETERS)
        split = [_split(header, e) for e in cross_validation.examples]
        others = replace(
            cross_validation,
            examples=[other for _, other in split],
            streams=[_trace_of(header, s) for s in cross_validation.streams],
        )
        of_others, scaling = Discriminative.held_out(_discriminative_header(header), others)
        shares = (*RUNNING_AT, *cross_validation.shares)
        numbers, truth, members = [], [], []
        for n, of_phase in _held_out_phases(header, [p for p, _ in split], cross_validation, shares):
            members.append(np.stack([of_phase, softmax(of_others[n].after(shares))], axis=1))
            truth.append(split[n][0].movement)
            numbers.append(n)
        if not members:
            return LearnedFromOthers(scaling, [])
        explicit, arrays = cross_validation.explicit, {}
        exponents = learned_exponents(header, np.array(members), np.array(truth), explicit)
        if cross_validation.across_people:
            late = {share: n for n, share in enumerate(shares) if share >= AGREED_FROM}
            of_late = np.array(members)[:, [*late.values()]]
            arrays["confusions"] = confusions = learn_confusions(of_late)
            scaling |= learn_agreement(of_late, np.array(truth), confusions, header.parameters, explicit)
        own = [pooled_at(shares, p, exponents) for p in members]
        calibration = None
        if judges_by_takes(header, others.examples) and takes_of(header, others.examples, None) is not None:
            distances = held_out_distances(header, others.examples, others.folds, shares)
            own = [pooled_with_takes(p[:, 0], p[:, 1], distances[n]) for n, p in zip(numbers, members, strict=True)]
            calibration = CALIBRATION
        results = [HeldOutResult(m, p[len(RUNNING_AT) :], None) for m, p in zip(truth, own, strict=True)]
        return LearnedFromOthers({**scaling, **exponents}, results, arrays, calibration)

    @classmethod
    def read(cls, header: Header, example: Example | Stream) -> Floats:
        """(F, D) the phase filter's features, then the trace."""
        if isinstance(example, Stream):
            return Discriminative.read(_discriminative_header(header), example)
        reader, trace = posture_reader(_phase_header(header)), BodyTrace(header.body_parts, header.rate_hz)
        rows, postures = [], []
        for tracks in example.tracks:
            rows.append(trace.update(tracks))
            postures.append(reader.read(tracks, trace.frame.origin, trace.frame.size))
        return np.concatenate([fill_gaps(np.array(postures)), np.array(rows)], axis=1)

    @classmethod
    def from_arrays(cls, header: Header, arrays: Arrays) -> Self:
        """The inverse of `arrays`; ValueError if they do not fit. Earlier files have no confusions."""
        movements = header.vocabulary.size
        confusions = np.asarray(arrays.get("confusions", np.eye(movements)), np.float64)
        if confusions.shape != (movements, movements) or not ((confusions >= 0) & (confusions <= 1)).all():
            raise ValueError(f"confusions {confusions.shape}: {movements} by {movements} from 0 to 1 are expected")
        phase, scales = Phase.from_arrays(_phase_header(header), arrays), scales_in(arrays, movements)
        return cls(
            header, phase, Discriminative.from_arrays(_discriminative_header(header), arrays), confusions, scales
        )

    def arrays(self) -> Arrays:
        """Those of both members, whose names differ, how the movements are confused, and how far takes are apart."""
        own = {"confusions": self.confusions, **arrays_of(self.takes)}
        return {**self.phase.arrays(), **self.discriminative.arrays(), **own}

    def grown(self, header: Header, examples: Sequence[Example]) -> Self:
        """The phase filter as it was, and grown; the discriminative classifiers learned again."""
        members = [_split(header, e) for e in examples]
        phase = self.phase.grown(_phase_header(header), [p for p, _ in members])
        discriminative = self.discriminative.grown(_discriminative_header(header), [d for _, d in members])
        confusions, known = np.eye(header.vocabulary.size), len(self.confusions)
        confusions[:known, :known] = self.confusions
        return type(self)(header, phase, discriminative, confusions)

    def shrunk(self, header: Header, remaining: Sequence[int]) -> Self:
        """The phase filter without the other movements; the discriminative classifiers learned again."""
        phase = self.phase.shrunk(_phase_header(header), remaining)
        confusions = self.confusions[np.ix_(remaining, remaining)]
        return type(self)(
            header, phase, self.discriminative.shrunk(_discriminative_header(header), remaining), confusions
        )

    def without_background(self, gone: int) -> Self:
        """The same phase filter; the discriminative classifiers learned again."""
        discriminative = self.discriminative.without_background(gone)
        header = replace(self.header, background=discriminative.header.background)
        return type(self)(header, self.phase, discriminative, self.confusions)

    def watch(self, onset: Onset) -> StackedWatch:
        """Start watching."""
        return StackedWatch(self, onset)


def _phase_header(header: Header) -> Header:
    parameters = {name: header.parameters[name] for name in Phase.PARAMETERS}
    return replace(header, kind=Phase.kind, parameters=parameters, background=None)


def _discriminative_header(header: Header) -> Header:
    parameters = {name: header.parameters[name] for name in Discriminative.PARAMETERS}
    return replace(header, kind=Discriminative.kind, parameters=parameters)


def _split(header: Header, example: Example) -> tuple[Example, Example]:
    features = Stacked.read(header, example) if example.features is None else example.features
    width = width_of(len(header.body_parts))
    return replace(example, features=features[:, :-width]), replace(example, features=features[:, -width:])


def _trace_of(header: Header, stream: Stream) -> Stream:
    return stream if stream.features is not None else replace(stream, features=Stacked.read(header, stream))


def _held_out_phases(
    header: Header, examples: Sequence[Example], cross_validation: CrossValidation, shares: Sequence[float]
) -> Iterator[tuple[int, Floats]]:
    """Index and (T, M) posteriors after these shares of each example watched, by phase filters of others."""
    for fold in cross_validation.folds:
        left_out = set(fold)
        others = [e for n, e in enumerate(examples) if n not in left_out and e.movement >= 0]
        phase = Phase.learn(_phase_header(header), others)
        for n in fold:
            if n in cross_validation.watched and examples[n].movement >= 0:
                tracks, watch = examples[n].tracks, phase.watch(Onset(known=True))
                posteriors = []
                for frame in tracks:
                    watch.update(frame)
                    posteriors.append(watch.p)
                yield n, np.array([posteriors[max(math.ceil(s * len(tracks)), 1) - 1] for s in shares])
