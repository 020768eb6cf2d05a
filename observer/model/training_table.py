"""The features of all windows that a discriminative model learns from, computed once.

The model is learned from all rows. In cross-validation each fold's model is learned from the rows of other people, and
judges those of the people left out. Which convolutions there are and their biases depend on no label: they are those
of all examples in every fold.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from observer.model.base import Example, Header, Stream
from observer.model.body_trace import extent
from observer.model.logistic import FEW_ITERATIONS, ITERATIONS, LogisticRegression
from observer.model.segment_classifier import SegmentClassifier, SegmentTable
from observer.model.something_else import ElseRows, log_odds_of
from observer.model.trailing_features import TrailingFeatures, Windows
from observer.model.training_rows import FRACTIONS, rows_of_examples, rows_of_streams
from observer.tracks import Floats, Floats32

Chosen = NDArray[np.bool_]


ENOUGH_EXAMPLES = 200
"""With fewer examples of movements each counts more: a penalty chosen for many leaves all answers equally likely."""
SMALL_SHARE, RARELY = 0.4, 0.05
"""What stays below SMALL_SHARE of the extent that all but this share of its examples reach is not the movement."""


@dataclass(frozen=True, slots=True, eq=False)
class HeldOutMembers:
    """What a model makes of an example of others: (10, M) logarithms in progress and (M,) at the end, not normalised.

    The ten are after FRACTIONS of the movement.
    """

    running: NDArray[np.floating]
    ended: NDArray[np.floating]

    def after(self, shares: Sequence[float]) -> Floats:
        """(T, M) after these shares of the movement, rounded to tenths; 1.0 is the end."""
        tenths = [self.running[max(round(share * 10), 1) - 1] if share < 1 else self.ended for share in shares]
        return np.array(tenths, np.float64)


class TrainingTable:
    """Rows of trailing windows and of segments, for one model and its cross-validation."""

    def __init__(
        self,
        header: Header,
        examples: Sequence[Example],
        traces: Sequence[Floats32],
        streams: Sequence[Stream],
        traces_of_streams: Sequence[Floats32],
    ) -> None:
        self._header, self._examples, self._streams = header, examples, streams
        own = [len(t) for t, e in zip(traces, examples, strict=True) if e.movement >= 0]
        self.longest, self.least_extents = max(own), _least_extents(examples, traces, header)
        self._few = max(1.0, ENOUGH_EXAMPLES / len(own))
        windows = Windows.of(header.rate_hz, float(np.median(own)) / header.rate_hz)
        seed, movements = int(header.parameters["seed"]), header.vocabulary.size
        self.trailing = TrailingFeatures.learn(windows, header.rate_hz, [*traces, *traces_of_streams], seed)
        self._rows = [*rows_of_examples(examples, traces, movements, header.rate_hz, seed)]
        self._of_streams = [*rows_of_streams(streams, traces_of_streams, movements, header.rate_hz)]
        rows = [*self._rows, *self._of_streams]
        self._features = np.concatenate([self.trailing.of(r.trace, r.at) for r in rows])
        self._targets, self._weights = (np.concatenate([getattr(r, a) for r in rows]) for a in ("targets", "weights"))
        self._segments = SegmentTable.of(examples, traces, int(header.parameters["kernels"]), seed)

    def learn(
        self, left_out: Sequence[int] = (), iterations: int = ITERATIONS
    ) -> tuple[LogisticRegression, SegmentClassifier]:
        """Both classifiers, without the examples left out."""
        parameters, gone = self._header.parameters, set(left_out)
        of_examples = [np.full(len(r.at), not gone & set(r.examples)) for r in self._rows]
        chosen = np.concatenate([*of_examples, *self._stream_rows_apart(gone)])
        trailing = LogisticRegression.learn(
            self._features[chosen],
            self._targets[chosen],
            self._weights[chosen],
            parameters["trailing_penalty"] * self._few,
            iterations,
        )
        others = ~np.isin(self._segments.example_of, list(gone))
        movements = self._header.vocabulary.size
        return trailing, self._segments.learn(others, movements, parameters["inverse_penalty"] * self._few, iterations)

    def _stream_rows_apart(self, gone: set[int]) -> list[Chosen]:
        """As `streams_apart`: no stream of a person who is left out wholly, and no span of an example left out."""
        people = self._people_only_in(gone)
        spans = {(e.subject, e.trial, e.movement) for e in (self._examples[n] for n in gone)}
        result = []
        for stream, rows in zip(self._streams, self._of_streams, strict=True):
            chosen = np.full(len(rows.at), stream.subject not in people)
            for span in stream.spans:
                if (stream.subject, span.trial, span.movement) in spans:
                    chosen &= (rows.at < span.begin) | (rows.at >= span.end)
            result.append(chosen)
        return result

    def held_out(self, left_out: Sequence[int]) -> tuple[dict[int, HeldOutMembers], ElseRows]:
        """For each of these examples what a model of all others makes of it; none for movements of the background.

        And how likely it takes something else to be, in the rows of these examples and of their people's streams.
        """
        trailing, segments = self.learn(left_out, FEW_ITERATIONS)
        ends = np.cumsum([0, *(len(r.at) for r in self._rows)])
        first = {r.examples[0]: begin for r, begin in zip(self._rows, ends, strict=False) if len(r.examples) == 1}
        result = {}
        for n in left_out:
            if self._examples[n].movement >= 0:
                # The first row is the movement's first frame.
                rows = self._features[first[n] + 1 : first[n] + 1 + len(FRACTIONS)]
                windows = self._segments.features[self._segments.example_of == n]
                of_trailing = trailing.log_probabilities(rows)[:, :-1]
                of_trailing -= np.logaddexp.reduce(of_trailing, axis=1, keepdims=True)
                running = (of_trailing + segments.log_posterior_of(windows, ended=False)) / 2
                result[n] = HeldOutMembers(running, segments.log_posterior_of(windows[-1], ended=True))
        return result, self._else_rows(trailing, set(left_out))

    def _else_rows(self, trailing: LogisticRegression, gone: set[int]) -> ElseRows:
        """Without blends: they are like movements on purpose."""
        people = self._people_only_in(gone)
        shown = [len(r.examples) == 1 and r.examples[0] in gone for r in self._rows]
        shown += [stream.subject in people for stream in self._streams]
        chosen = np.repeat(shown, [len(r.at) for r in (*self._rows, *self._of_streams)])
        log_answers = trailing.log_probabilities(self._features[chosen]).astype(np.float64)
        targets, weights = (values[chosen].astype(np.float64) for values in (self._targets[:, -1], self._weights))
        return ElseRows(log_odds_of(log_answers), targets, weights)

    def _people_only_in(self, gone: set[int]) -> set[str]:
        people = {self._examples[n].subject for n in gone}
        return people - {e.subject for n, e in enumerate(self._examples) if n not in gone}


def _least_extents(examples: Sequence[Example], traces: Sequence[Floats32], header: Header) -> Floats:
    """(M,) body sizes within EXTENT_S: what goes less far is not the movement."""
    largest = [
        (e.movement, max(extent(trace[: n + 1], header.rate_hz) for n in range(len(trace))))
        for e, trace in zip(examples, traces, strict=True)
    ]
    of_each = ([size for movement, size in largest if movement == m] for m in range(header.vocabulary.size))
    return np.array([SMALL_SHARE * np.quantile(sizes, RARELY) for sizes in of_each])
