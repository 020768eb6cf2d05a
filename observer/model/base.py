"""The protocol of movement models: learned from examples, stored as arrays, and used to watch a person."""

import math
from collections import defaultdict
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import count
from typing import TYPE_CHECKING, Any, ClassVar, Protocol, Self, TypeVar, runtime_checkable

import numpy as np
from numpy.typing import NDArray

from common.errors import BadInput
from common.posterior import Repeated
from common.text import nearest
from common.vocabulary import Vocabulary
from observer.geometry.placement import PersonPlacement
from observer.model.parameters import Parameter, check_parameters
from observer.tracks import Floats, Floats32, Tracks

if TYPE_CHECKING:
    from observer.score.references import ReferenceTakes

Arrays = Mapping[str, NDArray[np.generic]]


def array_in(arrays: Arrays, name: str, shape: tuple[int | None, ...], dtype: type[np.generic]) -> NDArray[Any]:
    """The array of that name in a model file; ValueError for another shape, None: any length, and for NaN, infinity."""
    array = np.asarray(arrays[name], dtype)
    fits = array.ndim == len(shape) and all(n in (None, own) for n, own in zip(shape, array.shape, strict=True))
    if not fits or not np.isfinite(array).all():
        raise ValueError(f"{name} of shape {array.shape}: finite numbers of shape {shape} are expected")
    return array


@dataclass(frozen=True, slots=True)
class Header:
    """The vocabulary, view and rate that a model is for, and the origin of what it learned.

    view: name of the view; matrix: (3, 4) its projection. parameters: the model's own numbers; after learning all of
    them, so that new defaults later change nothing. provenance: the origin of the examples, for people. background:
    movements outside the vocabulary, from which the model learned "something else", besides blends (means of two
    movements) and other motion; None: it does not know "something else".
    placement: where the person stands in a camera file's room, facing 0 for several facings; None: as in recordings.
    references: the takes that show how a movement should be done, by label.
    """

    kind: str
    vocabulary: Vocabulary
    view: str
    matrix: Floats
    rate_hz: float
    body_parts: tuple[str, ...]
    parameters: Mapping[str, float] = field(default_factory=dict)
    provenance: Mapping[str, str] = field(default_factory=dict)
    background: tuple[str, ...] | None = None
    placement: PersonPlacement | None = None
    references: Mapping[str, "ReferenceTakes"] = field(default_factory=dict)


def with_defaults(header: Header, known: Mapping[str, Parameter]) -> Header:
    """The same header with every parameter of the model.

    Raises BadInput for a parameter that the model does not have, and for a value outside its range.
    """
    for name in header.parameters:
        if name not in known:
            raise BadInput(f"parameter {name!r}: not of the model {header.kind}; {nearest(name, known)}")
    parameters = {**{name: parameter.default for name, parameter in known.items()}, **header.parameters}
    check_parameters(parameters, known)
    return replace(header, parameters=parameters)


def _nothing() -> Floats:
    return np.zeros((0, 0))


@dataclass(frozen=True, slots=True)
class Example:
    """One movement, cut out of a recording, as the model's view sees it; movement: its index in the vocabulary.

    A negative index is one of the background: -1 the first in the header. facing: which of the model's K facings the
    person had. subject, trial: who performed it, and which time. features: (F, D) the tracks as the model reads them;
    postures: as the phase filter of a model reads them whose features are traces. Both are empty until it reads them.
    """

    tracks: Sequence[Tracks]
    movement: int
    facing: int = 0
    subject: str = ""
    trial: str = ""
    features: Floats = field(default_factory=_nothing)
    postures: Floats = field(default_factory=_nothing)


@dataclass(frozen=True, slots=True)
class StreamSpan:
    """Frames begin..end-1 of a stream show one movement; movement, trial: as of the example that was cut out there."""

    begin: int
    end: int
    movement: int
    trial: str = ""


@dataclass(frozen=True, slots=True)
class Stream:
    """A continuous recording as the model's view sees it: outside the spans the person does something else.

    Within each span, in order and apart, there is one movement of the vocabulary or of the background; no other that
    has a name occurs. facing, subject, trial and features: as of `Example`.
    """

    tracks: Sequence[Tracks]
    spans: tuple[StreamSpan, ...] = ()
    facing: int = 0
    subject: str = ""
    trial: str = ""
    features: Floats = field(default_factory=_nothing)

    @property
    def frames(self) -> int:
        """Number of frames."""
        return len(self.features) or len(self.tracks)

    @property
    def other_frames(self) -> int:
        """Number of frames outside the spans."""
        return self.frames - sum(span.end - span.begin for span in self.spans)

    def without(self, is_gone: Callable[[StreamSpan], bool]) -> Iterator["Stream"]:
        """What is left of the stream when the spans for which `is_gone` holds are cut out: pieces with frames."""
        begin = 0
        for span in self.spans:
            if is_gone(span):
                yield from self.piece(begin, span.begin)
                begin = span.end
        yield from self.piece(begin, self.frames)

    def piece(self, begin: int, end: int) -> Iterator["Stream"]:
        """Frames begin..end-1, with the spans that are wholly within; nothing without frames."""
        if begin < end:
            within = (span for span in self.spans if begin <= span.begin and span.end <= end)
            spans = tuple(replace(span, begin=span.begin - begin, end=span.end - begin) for span in within)
            yield replace(self, tracks=self.tracks[begin:end], spans=spans, features=self.features[begin:end])


@dataclass(frozen=True, slots=True)
class Onset:
    """What is known about the beginning of the movement.

    known: the movement begins with the first frame. length: its number of frames, for the paper's frame clock I alone.
    """

    known: bool = False
    length: int | None = None


class Watch(Protocol):
    """A model that watches one person: it takes in frames and holds the posterior after the last one."""

    @property
    def p(self) -> Floats:
        """(M,) posterior over movements, given that it is one of them; probability at rest is spread as the prior."""

    @property
    def joint(self) -> Floats | None:
        """(M, K) joint posterior over movements and facings, whose sum is p; None for a model without facings."""
        return None

    @property
    def unlearned(self) -> Floats | None:
        """(K,) P(something else, facing), K = 1 without facings; None for a model that does not know something else."""
        return None

    @property
    def repetitions(self) -> float | None:
        """Periods of the likeliest movement since it began; None unless its takes are periodic."""
        return None

    @property
    def repeated(self) -> Repeated | None:
        """More about them; None if nothing is counted."""
        return None

    @property
    def rest(self) -> float:
        """Probability that the person is at rest now, before or after a movement."""

    @property
    def performed(self) -> int:
        """Frames of the movement that has ended, while the person rests after it; 0: none whose begin is known."""
        return 0

    def performance(self) -> tuple[Floats32, Floats] | None:
        """(F, 2 P + 3) the trace of these frames, and (P,) the share of them in which each part was seen."""
        return None

    def update(self, tracks: Tracks) -> None:
        """Take in one frame at the model's rate."""

    def pass_over(self, tracks: Tracks) -> None:
        """Take in one frame whose posterior nobody reads, because another one follows at once."""
        self.update(tracks)

    def end(self) -> None:
        """There are no more frames: the movement in progress has ended with the last one."""
        return


class MovementModel(Protocol):
    """Learns movements from examples, and watches a person for them.

    A model that also learns what is none of its movements has the methods of `LearnsStreams` too.

    To add a model: one file with such a class and one line in registry.py; tests/contracts/test_models.py checks it.
    """

    kind: ClassVar[str]
    PARAMETERS: ClassVar[Mapping[str, Parameter]]
    """The model's parameters, by name."""

    @property
    def header(self) -> Header:
        """The model's header, complete with all parameters."""

    @classmethod
    def learn(cls, header: Header, examples: Sequence[Example]) -> Self:
        """Learn from examples of every movement of the vocabulary."""

    @classmethod
    def from_arrays(cls, header: Header, arrays: Arrays) -> Self:
        """The inverse of `arrays`; may raise ValueError or KeyError for arrays that do not fit."""

    def arrays(self) -> Arrays:
        """The arrays that a file must store, by name."""

    def watch(self, onset: Onset) -> Watch:
        """Start watching a person, knowing only the prior."""


@runtime_checkable
class LearnsStreams(Protocol):
    """The additional methods of a kind that knows something else, from a background of other movements and streams."""

    @classmethod
    def learn(cls, header: Header, examples: Sequence[Example]) -> Self:
        """Learn from cut-out movements alone."""
        return cls.learn_with_streams(header, examples, ())

    @classmethod
    def learn_with_streams(cls, header: Header, examples: Sequence[Example], streams: Sequence[Stream]) -> Self:
        """As `learn`; the examples include the movements in the spans. There may be no streams."""

    def cross_validated(self, folds: Sequence[Sequence[int]], watched: Collection[int]) -> Self:
        """The model that has learned from what models of all others make of the examples of each fold.

        Once, after learning. folds: indices of the examples that are left out together. watched: of those that are
        evaluated. The provenance of the header tells the results (`cross_validation.with_results`).
        """


def knows_blends_only(header: Header) -> bool:
    """Whether a model with a background has seen no recording of something else."""
    return not header.background and float(header.provenance.get("other_motion_s", "0")) == 0


Shown = TypeVar("Shown", Example, Stream)


def recording_numbers(items: Sequence[Shown]) -> list[int]:
    """For each example or stream the number of its recording; recordings have the same order at every facing."""
    numbers = defaultdict[int, Iterator[int]](count)
    return [next(numbers[item.facing]) for item in items]


def evenly_spread(number: int) -> float:
    """The fractional part of `number` times the golden ratio, in place of random numbers, as it is the same each time:
    successive numbers fill [0, 1) evenly, however many."""
    return (number * (math.sqrt(5) - 1) / 2) % 1.0
