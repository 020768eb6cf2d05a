"""`stacked`, the default model: the phase filter and the discriminative classifiers, multiplied with learned exponents.

Wolpert, "Stacked generalization", Neural Networks 5, 1992; here a log-linear pool (Genest and Zidek 1986). The
two kinds of model make different mistakes. While the begin of a movement is known, from the person's stillness before
it, both judge it; a movement that follows another one directly, or any other motion, is judged by the trailing windows
of the discriminative model alone (docs/design/model.md).
"""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import ClassVar, Self

import numpy as np

from observer.model.base import (
    MOST_FACINGS,
    NOT_NEGATIVE,
    Arrays,
    Example,
    Header,
    Onset,
    ParameterRange,
    Stream,
    Watch,
    with_defaults,
)
from observer.model.discriminative import Discriminative, DiscriminativeWatch
from observer.model.phase import Phase
from observer.model.trailing_features import width_of
from observer.tracks import Floats, Tracks

SMALLEST = 1e-4
"""Floor of a member's probability: neither can veto a movement alone."""
OF_PHASE, OF_DISCRIMINATIVE = "phase", "discriminative"


class Stacked:
    """Phase and Discriminative of one view."""

    kind: ClassVar[str] = "stacked"
    # generative, discriminative: exponents of the members' posteriors.
    DEFAULTS: ClassVar[Mapping[str, float]] = {
        **Phase.DEFAULTS,
        **Discriminative.DEFAULTS,
        "generative": 0.6,
        "discriminative": 1.0,
    }
    RANGES: ClassVar[Mapping[str, ParameterRange]] = {
        **Phase.RANGES,
        **Discriminative.RANGES,
        "facings": ParameterRange(1, MOST_FACINGS, whole=True),
        "generative": NOT_NEGATIVE,
        "discriminative": NOT_NEGATIVE,
    }

    def __init__(self, header: Header, phase: Phase, discriminative: Discriminative) -> None:
        self.header, self.phase, self.discriminative = header, phase, discriminative

    @classmethod
    def learn(cls, header: Header, examples: Sequence[Example]) -> Self:
        """Learn both members from cut-out movements alone."""
        return cls.learn_with_streams(header, examples, ())

    @classmethod
    def learn_with_streams(cls, header: Header, examples: Sequence[Example], streams: Sequence[Stream]) -> Self:
        """Learn both members; the phase filter learns from the movements of the vocabulary only."""
        header = replace(with_defaults(header, cls.DEFAULTS, cls.RANGES), background=header.background or ())
        members = [_split(header, e) for e in examples]
        phase = Phase.learn(_of_phase(header), [p for p, _ in members if p.movement >= 0])
        traces = [_trace_of(header, s) for s in streams]
        discriminative = Discriminative.learn_with_streams(_of_other(header), [d for _, d in members], traces)
        return cls(header, phase, discriminative)

    @classmethod
    def read(cls, header: Header, example: Example | Stream) -> Floats:
        """(F, D) the phase filter's features, then the trace."""
        trace = Discriminative.read(_of_other(header), example)
        if isinstance(example, Stream):
            return trace
        return np.concatenate([Phase.read(_of_phase(header), example), trace], axis=1)

    @classmethod
    def from_arrays(cls, header: Header, arrays: Arrays) -> Self:
        """The inverse of `arrays`."""
        phase = Phase.from_arrays(_of_phase(header), arrays)
        return cls(header, phase, Discriminative.from_arrays(_of_other(header), arrays))

    def arrays(self) -> Arrays:
        """Those of both members, whose names differ."""
        return {**self.phase.arrays(), **self.discriminative.arrays()}

    def grown(self, header: Header, examples: Sequence[Example]) -> Self:
        """The phase filter as it was, and grown; the discriminative classifiers learned again."""
        members = [_split(header, e) for e in examples]
        phase = self.phase.grown(_of_phase(header), [p for p, _ in members])
        return type(self)(header, phase, self.discriminative.grown(_of_other(header), [d for _, d in members]))

    def shrunk(self, header: Header, remaining: Sequence[int]) -> Self:
        """The phase filter without the other movements; the discriminative classifiers learned again."""
        phase = self.phase.shrunk(_of_phase(header), remaining)
        return type(self)(header, phase, self.discriminative.shrunk(_of_other(header), remaining))

    def without_background(self, gone: int) -> Self:
        """The same phase filter; the discriminative classifiers learned again."""
        discriminative = self.discriminative.without_background(gone)
        header = replace(self.header, background=discriminative.header.background)
        return type(self)(header, self.phase, discriminative)

    def watch(self, onset: Onset) -> "StackedWatch":
        """Start watching."""
        return StackedWatch(self, onset)


def _of_phase(header: Header) -> Header:
    parameters = {name: header.parameters[name] for name in Phase.DEFAULTS}
    return replace(header, kind=Phase.kind, parameters=parameters, background=None)


def _of_other(header: Header) -> Header:
    parameters = {name: header.parameters[name] for name in Discriminative.DEFAULTS}
    return replace(header, kind=Discriminative.kind, parameters=parameters)


def _split(header: Header, example: Example) -> tuple[Example, Example]:
    features = Stacked.read(header, example) if example.features is None else example.features
    width = width_of(len(header.body_parts))
    return replace(example, features=features[:, :-width]), replace(example, features=features[:, -width:])


def _trace_of(header: Header, stream: Stream) -> Stream:
    return stream if stream.features is not None else replace(stream, features=Stacked.read(header, stream))


class StackedWatch:
    """Watches one person. The phase filter starts anew at each begin of a segment, with the frames since then."""

    def __init__(self, model: Stacked, onset: Onset) -> None:
        self._model = model
        self._other: DiscriminativeWatch = model.discriminative.watch(onset)
        self._phase: Watch | None = model.phase.watch(onset) if onset.known else None
        self._recent: list[Tracks] = []

    def update(self, tracks: Tracks) -> None:
        """Take in one frame."""
        self._recent = [*self._recent[-self._other.lag :], tracks]
        before = self._other.begun
        self._other.update(tracks)
        begun = self._other.begun
        if not tracks.visible.any():
            return
        if begun is None:
            self._phase = None
        elif self._phase is None or (before is None or begun < before):
            self._phase = self._model.phase.watch(Onset(known=True))
            for frame in self._recent[-begun:]:
                self._phase.update(frame)
        elif not self._other.over:
            self._phase.update(tracks)

    def end(self) -> None:
        """The recording has ended, and with it the movement."""
        self._other.end()

    @property
    def _log_joint(self) -> Floats:
        """(M, K) not normalised; K = 1 without facings."""
        exponents = self._model.header.parameters
        movements = exponents["discriminative"] * np.log(np.maximum(self._other.p, SMALLEST))
        if self._phase is None:
            return np.repeat(movements[:, None], self._model.phase.facings, axis=1)
        joint = self._phase.joint
        phase = self._phase.p
        facing = np.ones((len(phase), 1)) if joint is None else joint / np.maximum(phase, 1e-300)[:, None]
        movements = movements + exponents["generative"] * np.log(np.maximum(phase, SMALLEST))
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
    def foreseen(self) -> Floats | None:
        """None: something else is one of the answers."""
        return None

    @property
    def unlearned(self) -> Floats | None:
        """(K,) P(something else, facing)."""
        facings = self._model.phase.facings
        return np.full(facings, float(self._other.unlearned[0]) / facings)

    @property
    def rest(self) -> float:
        """P(at rest now)."""
        return self._other.rest
