"""The features of all windows that the regressions of a stacked model learn from, computed once.

The model is learned from all rows. In cross-validation each fold's model is learned from the rows of other people.
Which convolutions there are and their biases depend on no label: they are those of all examples in every fold.
"""

from collections.abc import Collection, Sequence

import numpy as np
from numpy.typing import NDArray

from observer.features import EXTENT_S, extent
from observer.model.base import Example, Header, Stream
from observer.model.logistic import ITERATIONS, LogisticRegression
from observer.model.rocket import FLOAT32_ROUNDING
from observer.model.segment_classifier import SegmentClassifier, SegmentTable
from observer.model.trailing_features import TrailingFeatures, Windows
from observer.model.training_rows import frames_apart, rows_of_examples, rows_of_streams
from observer.tracks import Floats, Floats32

Chosen = NDArray[np.bool_]
ENOUGH_EXAMPLES = 200
"""With fewer examples of movements each counts more: a penalty chosen for many leaves all answers equally likely."""


class TrainingTable:
    """Rows of trailing windows and of segments, for one model and its cross-validation.

    The features of examples and streams are their traces.
    """

    def __init__(self, header: Header, examples: Sequence[Example], streams: Sequence[Stream]) -> None:
        self._header, self._examples, self._streams = header, examples, streams
        traces, traces_of_streams = (
            [each.features.astype(np.float32) for each in source] for source in (examples, streams)
        )
        own = [len(t) for t, e in zip(traces, examples, strict=True) if e.movement >= 0]
        self.extents = _usual_extents(examples, traces, header)
        self._few = max(1.0, ENOUGH_EXAMPLES / len(own))
        windows = Windows.of(header.rate_hz, float(np.median(own)) / header.rate_hz)
        seed, movements = int(header.parameters["seed"]), header.vocabulary.size
        self.trailing = TrailingFeatures.learn(windows, header.rate_hz, [*traces, *traces_of_streams], seed)
        self._rows = [*rows_of_examples(examples, traces, movements, header.rate_hz, seed)]
        self._of_streams = [*rows_of_streams(streams, traces_of_streams, movements, header.rate_hz)]
        rows = [*self._rows, *self._of_streams]
        self._features = np.concatenate([self.trailing.of(r.trace, r.at) for r in rows])
        self._targets = np.concatenate([r.targets for r in rows])
        self._segments = SegmentTable.of(examples, traces, int(header.parameters["kernels"]), seed)

    def learn(
        self, left_out: Collection[int] = (), iterations: int = ITERATIONS, part: tuple[int, int] | None = None
    ) -> tuple[LogisticRegression, SegmentClassifier]:
        """Both classifiers, without the examples left out.

        part: of the streams, see `frames_apart`.
        """
        parameters, gone = self._header.parameters, set(left_out)
        of_examples = [np.full(len(r.at), not gone & set(r.examples)) for r in self._rows]
        chosen = np.concatenate([*of_examples, *self._stream_rows_apart(gone, part)])
        trailing = LogisticRegression.learn(
            self._features[chosen],
            self._targets[chosen],
            parameters["trailing_penalty"] * self._few,
            iterations,
            (self.trailing.convolutions,),
        )
        others = ~np.isin(self._segments.example_of, list(gone))
        movements = self._header.vocabulary.size
        return trailing, self._segments.learn(others, movements, parameters["inverse_penalty"] * self._few, iterations)

    def _stream_rows_apart(self, gone: set[int], part: tuple[int, int] | None) -> list[Chosen]:
        """As `frames_apart`: no stream of a person who is left out wholly, and no span of an example left out."""
        apart = frames_apart(self._streams, self._examples, gone, part)
        spans = {(e.subject, e.trial, e.movement) for e in (self._examples[n] for n in gone)}
        result = []
        for stream, rows, (begin, end) in zip(self._streams, self._of_streams, apart, strict=True):
            chosen = (rows.at < begin) | (rows.at >= end)
            for span in stream.spans:
                if (stream.subject, span.trial, span.movement) in spans:
                    chosen &= (rows.at < span.begin) | (rows.at >= span.end)
            result.append(chosen)
        return result


def _usual_extents(examples: Sequence[Example], traces: Sequence[Floats32], header: Header) -> Floats:
    """(M,) median over a movement's examples of how far the farthest part goes within EXTENT_S, body sizes."""
    frames = max(round(EXTENT_S * header.rate_hz), 2)
    # The box of a whole window holds those of the shorter ones that begin with it.
    largest = [
        (e.movement, max(extent(t[n : n + frames], header.rate_hz) for n in range(max(len(t) - frames, 0) + 1)))
        for e, t in zip(examples, traces, strict=True)
    ]
    of_each = ([size for movement, size in largest if movement == m] for m in range(header.vocabulary.size))
    return np.array([max(float(np.median(sizes)), FLOAT32_ROUNDING) for sizes in of_each])
