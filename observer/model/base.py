"""What every movement model is: learned from examples, stored as arrays, and asked to watch a performer."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import ClassVar, Protocol, Self, runtime_checkable

import numpy as np
from numpy.typing import NDArray

from common.errors import BadInput
from common.vocabulary import Vocabulary
from observer.model.posterior_calibration import PosteriorCalibration
from observer.tracks import Floats, Tracks

Arrays = Mapping[str, NDArray[np.generic]]


@dataclass(frozen=True, slots=True)
class Header:
    """What a model is for: refused for another vocabulary or rate, and it says where it came from.

    view: name of the view it was learned for; matrix: (3, 4) that view's projective matrix. parameters: the model's own
    numbers, all of them once it was learned, so that other defaults of a later version change nothing. provenance:
    what it was learned from, for people. certainty: how far what it believes can be believed. background: movements
    that are none of the vocabulary, by whose examples, and by blends, it knows "something else"; None: it does not.
    """

    kind: str
    vocabulary: Vocabulary
    view: str
    matrix: Floats
    rate_hz: float
    body_parts: tuple[str, ...]
    parameters: Mapping[str, float] = field(default_factory=dict)
    provenance: Mapping[str, str] = field(default_factory=dict)
    certainty: PosteriorCalibration = field(default_factory=PosteriorCalibration)
    background: tuple[str, ...] | None = None


def with_defaults(header: Header, defaults: Mapping[str, float]) -> Header:
    """The same header with every parameter of the model; raises BadInput for one that the model does not have."""
    for name in header.parameters:
        if name not in defaults:
            raise BadInput(f"parameter {name!r}: not of the model {header.kind}; it has {', '.join(defaults)}")
    return replace(header, parameters={**defaults, **header.parameters})


@dataclass(frozen=True, slots=True)
class Example:
    """One movement, cut out, as seen from the model's view. movement: its index in the vocabulary.

    Of a movement that is none of the vocabulary it is negative: -1 the first of the header's background, -2 the second.
    facing: which of the model's K facings the person had. subject, trial: who performed it, and which time. features:
    (F, D) what a model makes of the tracks, once it was `as_read`.
    """

    tracks: Sequence[Tracks]
    movement: int
    facing: int = 0
    subject: str = ""
    trial: str = ""
    features: Floats | None = None


@dataclass(frozen=True, slots=True)
class Onset:
    """What is known of where the movement begins.

    known: it begins with the first frame. length: its number of frames, which only `frame-table` may use, as the
    paper's frame clock I does.
    """

    known: bool = False
    length: int | None = None


class Watch(Protocol):
    """One performer being watched: frames in, belief out."""

    @property
    def p(self) -> Floats:
        """(M,) posterior over movements, given that it is one; what is spent at rest is spread as the prior."""

    @property
    def joint(self) -> Floats | None:
        """(M, K) posterior over movements and facings, of which p is the sum; None of who knows no facings."""

    @property
    def foreseen(self) -> Floats | None:
        """(M,) how well each movement foresaw what was seen since the last rest: mean log probability a frame, in nats.

        None while nothing is known of that, and of a model that cannot tell.
        """

    @property
    def unlearned(self) -> Floats | None:
        """(K,) P(none of the movements, facing), K = 1 of who knows no facings; None of who was shown nothing else."""

    @property
    def rest(self) -> float:
        """Probability that the person is at rest now, before or after a movement."""

    def update(self, tracks: Tracks) -> None:
        """One frame at the model's rate."""


class MovementModel(Protocol):
    """log P(observation | movement, phase) and how to believe by it.

    A model that can also be shown movements that are none of its vocabulary has `WithBackground` too.

    To add one: a file with such a class, a line in registry.py; tests/contracts/test_models.py holds it to this.
    """

    kind: ClassVar[str]
    DEFAULTS: ClassVar[Mapping[str, float]]
    """The model's parameters where nobody gave others."""

    @property
    def header(self) -> Header:
        """What the model is for."""

    @classmethod
    def learn(cls, header: Header, examples: Sequence[Example]) -> Self:
        """Learn from examples of every movement of the vocabulary."""

    @classmethod
    def from_arrays(cls, header: Header, arrays: Arrays) -> Self:
        """The inverse of `arrays`."""

    def arrays(self) -> Arrays:
        """What has to be kept, by name."""

    def watch(self, onset: Onset) -> Watch:
        """Begin to watch somebody, knowing nothing but the prior."""


@runtime_checkable
class WithBackground(Protocol):
    """What a movement model also has that learns from examples of a negative movement, the background."""

    def without_background(self, gone: int) -> MovementModel:
        """The same without this movement of the background, by its place in the header's."""


@runtime_checkable
class Reads(Protocol):
    """What a kind of model also has that reads each example by itself, and so need not read it for every learning."""

    def read(self, header: Header, example: Example) -> Floats:
        """(F, D) features, for `Example.features`."""


def as_read(kind: type[MovementModel], header: Header, examples: Sequence[Example]) -> list[Example]:
    """The examples with what the model makes of them, to learn from them again and again; others as they are."""
    if not isinstance(kind, Reads):
        return list(examples)
    whole = with_defaults(header, kind.DEFAULTS)
    return [replace(e, features=kind.read(whole, e)) for e in examples]


def evenly_spread(number: int) -> float:
    """0 to 1: successive numbers fill the interval evenly, however many there are (multiples of the golden ratio)."""
    return (number * (math.sqrt(5) - 1) / 2) % 1.0
