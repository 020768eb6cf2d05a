"""`stacked`, the default model: the phase filter and the discriminative classifiers, multiplied with learned exponents.

Wolpert, "Stacked generalization", Neural Networks 5, 1992; here a log-linear pool (Genest and Zidek 1986). The
two kinds of model make different mistakes. While the begin of a movement is known, from the person's stillness before
it, both judge it; a movement that follows another one directly, or any other motion, is judged by the trailing windows
of the discriminative model alone (docs/design/model.md).
"""

import math
from collections import deque
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from typing import ClassVar, Self

import numpy as np

from common.probability import softmax
from observer.model.base import Arrays, Example, Header, LearnsStreams, Onset, Stream, Watch, with_defaults
from observer.model.body_trace import BodyTrace, width_of
from observer.model.chains import fill_gaps
from observer.model.cross_validation import CrossValidation, LearnedFromOthers
from observer.model.discriminative import Discriminative, DiscriminativeWatch
from observer.model.log_linear_pool import SMALLEST
from observer.model.nearest_take import NEAREST, WEIGHT, NearestTakeWatch, arrays_of, scales_in, takes_of
from observer.model.parameters import Parameter
from observer.model.phase import Phase, PhaseWatch, posture_reader
from observer.model.posterior_calibration import HeldOutResult
from observer.model.something_else import (
    AGREED_FROM,
    AGREEMENT,
    disagreement,
    learn_agreement,
    learn_confusions,
    raised,
)
from observer.model.stack_exponents import ENDED, EXPONENTS, RUNNING, RUNNING_AT, learned_exponents, pooled_at
from observer.tracks import Floats, Tracks

TURN_S = 5.0
"""In this time the facing that was last known is forgotten, if nothing shows it."""


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
        self.takes = takes_of(header, discriminative.memory.examples, take_scales)

    @classmethod
    def learn_with_streams(cls, header: Header, examples: Sequence[Example], streams: Sequence[Stream]) -> Self:
        """Learn both members; the phase filter learns from the movements of the vocabulary only."""
        header = replace(with_defaults(header, cls.PARAMETERS), background=header.background or ())
        members = [_split(header, e) for e in examples]
        phase = Phase.learn(_of_phase(header), [p for p, _ in members if p.movement >= 0])
        traces = [_trace_of(header, s) for s in streams]
        discriminative = Discriminative.learn_with_streams(_of_other(header), [d for _, d in members], traces)
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
        of_others, scaling = Discriminative.held_out(_of_other(header), others)
        shares = (*RUNNING_AT, *cross_validation.shares)
        truth, members = [], []
        for n, of_phase in _held_out_phases(header, [p for p, _ in split], cross_validation, shares):
            members.append(np.stack([of_phase, softmax(of_others[n].after(shares))], axis=1))
            truth.append(split[n][0].movement)
        if not members:
            return LearnedFromOthers(scaling, [])
        explicit, arrays = cross_validation.explicit, {}
        exponents = learned_exponents(header, np.array(members), np.array(truth), explicit)
        if cross_validation.across_people:
            late = {share: n for n, share in enumerate(shares) if share >= AGREED_FROM}
            of_late = np.array(members)[:, [*late.values()]]
            arrays["confusions"] = confusions = learn_confusions(of_late)
            scaling |= learn_agreement(of_late, np.array(truth), confusions, header.parameters, explicit)
        results = [
            HeldOutResult(movement, pooled_at(shares, p, exponents)[len(RUNNING_AT) :], None)
            for movement, p in zip(truth, members, strict=True)
        ]
        return LearnedFromOthers({**scaling, **exponents}, results, arrays)

    @classmethod
    def read(cls, header: Header, example: Example | Stream) -> Floats:
        """(F, D) the phase filter's features, then the trace."""
        if isinstance(example, Stream):
            return Discriminative.read(_of_other(header), example)
        reader, trace = posture_reader(_of_phase(header)), BodyTrace(header.body_parts, header.rate_hz)
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
        phase, scales = Phase.from_arrays(_of_phase(header), arrays), scales_in(arrays, movements)
        return cls(header, phase, Discriminative.from_arrays(_of_other(header), arrays), confusions, scales)

    def arrays(self) -> Arrays:
        """Those of both members, whose names differ, how the movements are confused, and how far takes are apart."""
        own = {"confusions": self.confusions, **arrays_of(self.takes)}
        return {**self.phase.arrays(), **self.discriminative.arrays(), **own}

    def grown(self, header: Header, examples: Sequence[Example]) -> Self:
        """The phase filter as it was, and grown; the discriminative classifiers learned again."""
        members = [_split(header, e) for e in examples]
        phase = self.phase.grown(_of_phase(header), [p for p, _ in members])
        discriminative = self.discriminative.grown(_of_other(header), [d for _, d in members])
        confusions, known = np.eye(header.vocabulary.size), len(self.confusions)
        confusions[:known, :known] = self.confusions
        return type(self)(header, phase, discriminative, confusions)

    def shrunk(self, header: Header, remaining: Sequence[int]) -> Self:
        """The phase filter without the other movements; the discriminative classifiers learned again."""
        phase = self.phase.shrunk(_of_phase(header), remaining)
        confusions = self.confusions[np.ix_(remaining, remaining)]
        return type(self)(header, phase, self.discriminative.shrunk(_of_other(header), remaining), confusions)

    def without_background(self, gone: int) -> Self:
        """The same phase filter; the discriminative classifiers learned again."""
        discriminative = self.discriminative.without_background(gone)
        header = replace(self.header, background=discriminative.header.background)
        return type(self)(header, self.phase, discriminative, self.confusions)

    def watch(self, onset: Onset) -> "StackedWatch":
        """Start watching."""
        return StackedWatch(self, onset)


def _of_phase(header: Header) -> Header:
    parameters = {name: header.parameters[name] for name in Phase.PARAMETERS}
    return replace(header, kind=Phase.kind, parameters=parameters, background=None)


def _of_other(header: Header) -> Header:
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
        phase = Phase.learn(_of_phase(header), others)
        for n in fold:
            if n in cross_validation.watched and examples[n].movement >= 0:
                tracks, watch = examples[n].tracks, phase.watch(Onset(known=True))
                posteriors = []
                for frame in tracks:
                    watch.update(frame)
                    posteriors.append(watch.p)
                yield n, np.array([posteriors[max(math.ceil(s * len(tracks)), 1) - 1] for s in shares])


class StackedWatch(Watch):
    """Watches one person. The phase filter starts anew at each begin of a segment, with the frames since then."""

    def __init__(self, model: Stacked, onset: Onset) -> None:
        self._model = model
        self._other: DiscriminativeWatch = model.discriminative.watch(onset)
        self._phase: PhaseWatch | None = None
        self._nearest: NearestTakeWatch | None = None
        self._reader = posture_reader(model.phase.header)
        # Features and stillness of the last frames.
        self._recent: deque[tuple[Floats, float]] = deque(maxlen=self._other.segment.lag + 1)
        facings = model.phase.facings
        self._facing: Floats = np.full(facings, 1.0 / facings)
        self._turned = 1 - math.exp(-1 / (TURN_S * model.header.rate_hz))

    def update(self, tracks: Tracks) -> None:
        """Take in one frame."""
        before = self._other.segment.begun
        self._other.update(tracks)
        begun, frame = self._other.segment.begun, self._other.trace.frame
        self._recent.append((self._reader.read(tracks, frame.origin, frame.size), frame.still))
        if not tracks.visible.any():
            return
        if begun is None:
            self._phase = self._nearest = None
        elif self._phase is None or (before is None or begun < before):
            self._phase = self._model.phase.watch(Onset(known=True))
            for features, still in list(self._recent)[-begun:]:
                self._phase.step(features, still)
            if self._model.takes is not None:
                self._nearest = NearestTakeWatch(self._model.takes, self._other.rows[len(self._other.rows) - begun :])
        elif not self._other.segment.over:
            self._phase.step(*self._recent[-1])
            if self._nearest is not None:
                self._nearest.step(self._other.rows[-1])
        self._follow_facing()

    def _follow_facing(self) -> None:
        """P(facing): that of the phase filter; while it does not run, people turn."""
        if len(self._facing) == 1:
            return
        joint = None if self._phase is None else self._phase.joint
        facing = np.full_like(self._facing, 1.0 / len(self._facing)) if joint is None else joint.sum(axis=0)
        self._facing += (facing - self._facing) * (self._turned if joint is None else 1.0)

    def end(self) -> None:
        """The recording has ended, and with it the movement."""
        self._other.end()

    @property
    def _log_joint(self) -> Floats:
        """(M, K) not normalised; K = 1 without facings."""
        movements = np.log(np.maximum(self._other.p, SMALLEST))
        if self._phase is None:
            # The exponents were learned for both members together; one that judges alone is believed as it is.
            return movements[:, None] + np.log(np.maximum(self._facing, 1e-300))
        names = ENDED if self._other.judges_ended else RUNNING
        generative, discriminative = (self._model.header.parameters[name] for name in names)
        movements *= discriminative
        joint, phase = self._phase.joint, self._phase.p
        movements += generative * np.log(np.maximum(phase, SMALLEST))
        if joint is None:
            return movements[:, None]
        facing = joint / np.maximum(phase, 1e-300)[:, None]
        return movements[:, None] + np.log(np.maximum(facing, 1e-300))

    @property
    def _posterior(self) -> Floats:
        logs = self._log_joint
        p = np.exp(logs - logs.max())
        doubt = self._other.doubt
        posterior: Floats = (1 - doubt) * p / p.sum() + doubt / p.size
        return posterior

    @property
    def p(self) -> Floats:
        """(M,) posterior given that it is one of the movements."""
        p: Floats = self._posterior.sum(axis=1)
        return p

    @property
    def joint(self) -> Floats | None:
        """(M, K) posterior over movements and facings; None for a model of one facing."""
        return self._posterior if self._model.phase.facings > 1 else None

    @property
    def unlearned(self) -> Floats | None:
        """(K,) P(something else, facing)."""
        p, nats = float(self._other.unlearned[0]), 0.0
        if self._phase is not None and not self._other.judges_ended:
            members = np.array([self._phase.p, self._other.p])
            nats = disagreement(members, self._model.confusions, self._model.header.parameters)
        if self._nearest is not None:
            nats += self._nearest.nats(int(self.p.argmax()), self._model.header.parameters[WEIGHT])
        return raised(p, nats * (1 - self._other.doubt)) * self._facing

    @property
    def rest(self) -> float:
        """P(at rest now)."""
        return self._other.rest
