"""The examples and streams that a stacked model keeps, so that it can be learned again with other movements.

They are stored as traces (`features.py`), float32: 36 bytes a frame for hands and head. Pure.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

from observer.model.base import Arrays, Example, Stream, StreamSpan, array_in
from observer.tracks import Floats32

OF_EXAMPLES, OF_STREAMS = "example", "stream"
"""Prefixes of the arrays' names."""


@dataclass(frozen=True, slots=True, eq=False)
class TrainingMemory:
    """Examples and streams whose `features` are traces (F, C); their tracks are not kept."""

    examples: tuple[Example, ...]
    streams: tuple[Stream, ...]

    def renumbered(self, new_index: Mapping[int, int]) -> Self:
        """Only the examples of these movements, with new indices, and streams without the spans of others."""
        examples = [replace(e, movement=new_index[e.movement]) for e in self.examples if e.movement in new_index]
        pieces = [piece for s in self.streams for piece in s.without(lambda span: span.movement not in new_index)]
        streams = [
            replace(p, spans=tuple(replace(span, movement=new_index[span.movement]) for span in p.spans))
            for p in pieces
        ]
        return type(self)(tuple(examples), tuple(streams))

    def lengths_of(self, movement: int) -> list[int]:
        """Frames of each take of the movement."""
        return [len(e.features) for e in self.examples if e.movement == movement]

    @property
    def usual_posture(self) -> Floats32:
        """(2 P,) where the parts usually are, relative to the body."""
        places = np.concatenate([e.features[:, :-3] for e in self.examples])
        usual: Floats32 = places.astype(np.float32).mean(axis=0)
        return usual

    def as_arrays(self) -> dict[str, NDArray[np.generic]]:
        """For a model file."""
        spans = [
            (n, span.begin, span.end, span.movement) for n, stream in enumerate(self.streams) for span in stream.spans
        ]
        trials = [span.trial for stream in self.streams for span in stream.spans]
        return {
            **_as_arrays(OF_EXAMPLES, self.examples),
            "example_movements": np.array([e.movement for e in self.examples], np.int16),
            **_as_arrays(OF_STREAMS, self.streams),
            "spans": np.array(spans, np.int32).reshape(-1, 4),
            "span_trials": np.array(trials, np.str_),
        }

    @classmethod
    def from_arrays(cls, arrays: Arrays, movements: int, background: int, columns: int) -> Self:
        """The inverse of `as_arrays`; ValueError if they do not fit these numbers of movements and columns."""
        of_examples = zip(arrays["example_movements"], _from_arrays(OF_EXAMPLES, arrays, columns), strict=True)
        examples = [Example((), int(movement), **own) for movement, own in of_examples]
        streams = [Stream((), **own) for own in _from_arrays(OF_STREAMS, arrays, columns)]
        spans: dict[int, list[StreamSpan]] = {}
        for (n, begin, end, movement), trial in zip(arrays["spans"].tolist(), arrays["span_trials"], strict=True):
            if not 0 <= begin < end <= len(streams[n].features):
                raise ValueError(f"span {begin} to {end} is not within its stream")
            spans.setdefault(n, []).append(StreamSpan(begin, end, movement, str(trial)))
        shown = [e.movement for e in examples] + [span.movement for own in spans.values() for span in own]
        if not all(-background <= movement < movements for movement in shown):
            raise ValueError("an example's movement is outside the vocabulary and the background")
        return cls(tuple(examples), tuple(replace(s, spans=tuple(spans.get(n, ()))) for n, s in enumerate(streams)))


def _as_arrays(name: str, sources: Sequence[Example | Stream]) -> dict[str, NDArray[np.generic]]:
    traces = [each.features for each in sources]
    return {
        f"{name}_traces": np.concatenate(traces).astype(np.float32) if traces else np.zeros((0, 0), np.float32),
        f"{name}_lengths": np.array([len(trace) for trace in traces], np.int32),
        f"{name}_facings": np.array([each.facing for each in sources], np.int16),
        f"{name}_subjects": np.array([each.subject for each in sources], np.str_),
        f"{name}_trials": np.array([each.trial for each in sources], np.str_),
    }


def _from_arrays(name: str, arrays: Arrays, columns: int) -> Iterator[dict[str, Any]]:
    """Facing, subject, trial and trace of each."""
    lengths = array_in(arrays, f"{name}_lengths", (None,), np.int64)
    traces = array_in(arrays, f"{name}_traces", (None, columns if len(lengths) else None), np.float32)
    if lengths.sum() != len(traces) or (lengths < 1).any():
        raise ValueError(f"{name}_traces do not fit {name}_lengths")
    parts = np.split(traces, np.cumsum(lengths)[:-1]) if len(lengths) else []
    others = (arrays[f"{name}_{what}"].tolist() for what in ("facings", "subjects", "trials"))
    for facing, subject, trial, trace in zip(*others, parts, strict=True):
        yield {"facing": facing, "subject": subject, "trial": trial, "features": trace.astype(np.float64)}
