"""How `stacked` watches one person: members that judge each instant, and the stacker that weighs them
(docs/design/model.md)."""

import math
from collections import deque
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from common.posterior import Repeated
from observer.features import REFERENCE_HZ, BodyTrace, extent, hop_of, width_of
from observer.model.base import Onset, Watch
from observer.model.movement_segment import MovementBefore, MovementSegment, RepetitionCounter
from observer.model.nearest_take import NearestTakeWatch
from observer.model.phase import PhaseWatch, posture_reader
from observer.model.stacker import Instants, instant_of, shown_by
from observer.tracks import Floats, Floats32, Tracks

if TYPE_CHECKING:
    from observer.model.stacked import Stacked


class StackedWatch(Watch):
    """Watches one person. The phase filter starts anew at each begin of a segment, with the frames since then."""

    def __init__(self, model: "Stacked", onset: Onset) -> None:
        header, movements = model.header, model.header.vocabulary.size
        self._model = model
        self._trace = BodyTrace(header.body_parts, header.rate_hz, model.usual_posture)
        self._segment = MovementSegment(header.rate_hz, onset.known, model.longest_segment)
        self._before, self._followed = MovementBefore(), -1
        self._repetitions = RepetitionCounter(model.oscillations, header.rate_hz) if model.oscillations else None
        self._phase: PhaseWatch | None = None
        self._nearest: NearestTakeWatch | None = None
        self._reader = posture_reader(model.phase.header)
        # Features and stillness of the last frames.
        self._recent: deque[tuple[Floats, float]] = deque(maxlen=self._segment.lag + 1)
        # Those that the segment and the extent need.
        self._rows: Floats32 = np.zeros((0, width_of(len(header.body_parts))), np.float32)
        # Which parts were seen in these, for scores.
        self._sights: deque[NDArray[np.bool_]] | None = deque(maxlen=model.history) if header.references else None
        self._ended = False
        self._trailing = model.trailing.watch()
        self._hop, self._left = hop_of(header.rate_hz), 0
        # Before the first classification there is only the prior, in which something else is one answer of M + 1.
        self._log_trailing: Floats = np.log(np.full(movements + 1, 1 / (movements + 1)))
        # Of the segment's rows, which remain the same while the person is still after it.
        self._segment_rows, self._elapsed, self._judged_over = self._rows, 1.0, False
        self._log_segment: Floats | None = None
        self._answers: Floats = np.append(np.zeros(movements), 1.0)
        self._judged: Floats = np.full(movements, 1 / movements)
        self._something_else = 1 / (movements + 1)
        # Of the judgements since the segment began.
        self._course: Floats = np.zeros(movements)
        # ln P(movement | one of them) by the trailing windows when the person stopped; None while they move.
        self._log_moved: Floats | None = None
        self._kept = (1 - header.parameters["forget"]) ** (REFERENCE_HZ / header.rate_hz)
        """The share that is left after a frame that does not show it, of the posterior and of a facing."""
        self._doubt = 1.0
        """The weight of the prior in the posterior, which grows while nobody is seen; 1 before the first sight."""
        self.instant: Instants | None = None
        """What the members say since the last classification; None before the first."""
        facings = model.phase.facings
        self._facing: Floats = np.full(facings, 1.0 / facings)

    def update(self, tracks: Tracks) -> None:
        """Take in one frame."""
        self.pass_over(tracks)
        if self._left <= 0 and tracks.visible.any():
            self._left = self._hop
            self.classify()

    def end(self) -> None:
        """The recording has ended, and with it the movement."""
        self._ended = True
        if self._repetitions is not None:
            self._repetitions.end()
        self.classify()

    def pass_over(self, tracks: Tracks) -> None:
        """Take in one frame, without classifying what has been seen."""
        row, frame = self._trace.update(tracks), self._trace.frame
        seen = bool(tracks.visible.any())
        resting = self.rest >= 0.5
        if self._repetitions is not None:
            self._repetitions.update(row, resting)
        if seen:
            self._doubt = 0.0
            self._rows = np.concatenate([self._rows[1 - self._model.history :], row[None]])
            if self._sights is not None:
                self._sights.append(tracks.visible)
            self._trailing.update(row)
            self._segment.update(resting, frame.still, self._answers, self._something_else, len(self._rows))
            self._left -= 1
        else:
            self._doubt = 1 - (1 - self._doubt) * self._kept
        self._recent.append((self._reader.read(tracks, frame.origin, frame.size), frame.still))
        if seen:
            self._follow()
            self._hold(frame.still)

    def _follow(self) -> None:
        """One more frame for the members that watch since the begin."""
        begun, number = self._segment.begun, self._segment.number
        if begun is None:
            self._phase = self._nearest = None
        elif self._phase is None or number > self._followed:
            if number > 0:
                self._before.begin(self._judged)
            self._followed, self._judged_over = number, False
            self._course = np.zeros_like(self._course)
            self._phase = self._model.phase.watch(Onset(known=True))
            for features, still in list(self._recent)[-begun:]:
                self._phase.step(features, still)
            if self._model.takes is not None:
                self._nearest = NearestTakeWatch(self._model.takes, self._rows[len(self._rows) - begun :])
        elif not self._segment.over:
            self._phase.step(*self._recent[-1])
            if self._nearest is not None:
                self._nearest.step(self._rows[-1])
        if len(self._facing) > 1:
            # While the phase filter does not run, people turn.
            joint = None if self._phase is None else self._phase.joint
            facing = np.full_like(self._facing, 1.0 / len(self._facing)) if joint is None else joint.sum(axis=0)
            self._facing += (facing - self._facing) * (1 - self._kept if joint is None else 1.0)

    def classify(self) -> None:
        """Judge the newest frame."""
        if not len(self._rows):
            return
        model = self._model
        self._log_trailing = shown = self._trailing_answers()
        self._answers = np.exp(shown)
        if self._log_moved is not None:
            shown = np.append(self._log_moved + np.logaddexp.reduce(shown[:-1]), shown[-1])
        segment = self._segment
        rows = segment.rows_of(self._rows)
        if not len(rows):
            self._log_segment, self._elapsed = None, 1.0
        elif not (segment.over and self._judged_over) and not np.array_equal(rows, self._segment_rows):
            self._log_segment = model.segments.log_posteriors([rows])[:, 0].astype(float)
            running = np.exp(self._log_segment[0] - self._log_segment[0].max())
            self._elapsed = len(rows) / float(running @ model.lengths / running.sum())
        self._segment_rows, self._judged_over = rows, segment.over
        since = len(self._rows) if segment.begun is None else max(segment.begun + segment.ended, 1)
        self.instant = instant_of(
            None if self._phase is None else self._phase.p,
            shown,
            self._log_segment,
            None if self._nearest is None else self._nearest.relative_distances,
            extent(self._rows[-since:], model.header.rate_hz) / model.extents,
            segment.over or self._ended,
            self._elapsed,
        )
        judged, something_else = model.stacker.judge(self.instant)
        self._something_else = float(something_else)
        self._course = self._course + shown_by(judged, something_else)
        if self._ended:
            judged, _ = model.stacker.judge_ended(self.instant, self._course)
        self._judged = self._before.mixed(judged, self._something_else, self.rest) if len(rows) else judged

    def _hold(self, still: float) -> None:
        """Who is still shows no other movement than when they stopped."""
        stopped = self._segment.over if self._segment.begun is not None else still > 0.5
        if not stopped:
            self._log_moved = None
        elif self._log_moved is None:
            movements = self._trailing_answers()[:-1]
            self._log_moved = movements - np.logaddexp.reduce(movements)

    def _trailing_answers(self) -> Floats:
        """(M + 1,) ln P by the windows that end now, something else last."""
        return self._model.trailing_answers.log_probabilities(self._trailing.features()).astype(float)

    @property
    def p(self) -> Floats:
        """(M,) posterior given that it is one of the movements."""
        return (1 - self._doubt) * self._judged + self._doubt / len(self._judged)

    @property
    def joint(self) -> Floats | None:
        """(M, K) posterior over movements and facings; None for a model of one facing."""
        if len(self._facing) == 1:
            return None
        joint = None if self._phase is None else self._phase.joint
        if joint is None or self._phase is None:
            return self.p[:, None] * self._facing
        total = joint.sum(axis=1, keepdims=True)
        share = np.where(total > 0, joint / np.where(total > 0, total, 1.0), 1 / len(self._facing))
        return self.p[:, None] * share

    @property
    def unlearned(self) -> Floats | None:
        """(K,) P(something else, facing)."""
        p = (1 - self._doubt) * self._something_else + self._doubt / (len(self._judged) + 1)
        return p * self._facing

    @property
    def repetitions(self) -> float | None:
        """Periods of the likeliest movement since it began; None unless its takes are periodic."""
        return None if self._repetitions is None else self._repetitions.count(int(self._judged.argmax()))

    @property
    def repeated(self) -> Repeated | None:
        """How many of them are partial, and how far the movement swings in this view."""
        return None if self._repetitions is None else self._repetitions.repeated(int(self._judged.argmax()))

    @property
    def rest(self) -> float:
        """P(the person is still and does something else)."""
        return min(self._trace.frame.still * math.exp(self._log_trailing[-1]), 1.0)

    @property
    def performed(self) -> int:
        """Frames of the last movement, while the person rests after it; 0: there is none, or its begin is not known."""
        # Who only holds a posture may go on.
        is_over = (self._segment.over and self.rest >= 0.5) or self._ended
        return max((self._segment.begun or 0) - self._segment.lag, 0) if is_over else 0

    def performance(self) -> tuple[Floats32, Floats]:
        """The trace of these frames, and how much was seen of each part."""
        places = self._segment.rows_of(np.arange(len(self._rows)))
        # Rest after it, as before it, is noticed late.
        places = places[: -self._segment.lag] if self._segment.over else places
        seen = np.array(self._sights or ())[places]
        return self._rows[places], seen.mean(axis=0)
