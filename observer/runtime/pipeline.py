"""One observer's computation, from a frame to a posterior and the bytes that carry it. No network and no clock."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np

from common import SECOND_NS
from common.floor_place import FloorPlace
from common.messages import Facing, PosteriorMessage, VocabularyHash
from common.posterior import ObservedScore, Repeated, Unscored
from common.probability import encode_facing
from common.vocabulary import Vocabulary
from common.wire import encode
from observer.effort.reader import FacetReader
from observer.model.base import MovementModel, Onset
from observer.model.leaning import region_shares
from observer.prepared_tracks import Resampler
from observer.score.performance import PerformanceScorer
from observer.tracks import LOST_S, Floats, Frame, Tracker, Tracks

if TYPE_CHECKING:
    from common.link import Publisher
    from observer.runtime.send_on_change import SendOnChange

HURRIED_S = 1.0
"""An observer that left out a frame is in a hurry for so long: the next frames will take as long as those before."""
TINY = 1e-300
"""Divisor for movements that have no probability."""


@dataclass(frozen=True, slots=True)
class Posterior:
    """An observer's state after a frame.

    p: (M,) posterior over the vocabulary, cumulative since the movement began. rest: probability that the person is at
    rest. frames: number of frames so far, at the model's rate. visible: per body part, whether it is seen in the newest
    frame. facets: distributions over the values of facets (common.facets), where available. facing: (M, K)
    P(facing | movement), None for a model with one facing. unlearned: P(none of the vocabulary), None if the model
    cannot tell. repetitions, repeated: of the likeliest movement, None unless it is periodic. judged: whether the
    newest frame is judged too; an observer in a hurry only follows some of them. score: of the last movement
    that is over, or why it has none; None unless the model has references. person, place, others: of an observer that
    follows several people, whose it is, where that person is, and the posteriors of the others.
    """

    p: Floats
    rest: float
    frames: int
    visible: Mapping[str, bool]
    facets: Mapping[str, Floats] = field(default_factory=dict)
    facing: Floats | None = None
    unlearned: float | None = None
    repetitions: float | None = None
    repeated: Repeated | None = None
    judged: bool = True
    score: ObservedScore | Unscored | None = None
    person: str | None = None
    place: FloorPlace | None = None
    others: "tuple[Posterior, ...]" = ()


class Hurry:
    """Decides for each frame whether the movement is judged with it; judged_s: interval for an observer in a hurry.

    An observer in a hurry spends its time on following the body parts: a hand that is lost between two frames costs
    more than a judgement that is some tenths of a second old. A frame that is not judged is not published either.
    """

    def __init__(self, judged_s: float) -> None:
        self._judged_ns = round(judged_s * SECOND_NS)
        self._last_judged_ns: int | None = None
        self._last_skipped_ns: int | None = None

    def judges(self, frame: Frame) -> bool:
        """Whether to judge with this frame; the last one of a recording always is."""
        if frame.skipped:
            self._last_skipped_ns = frame.at_ns
        hurried = _within(self._last_skipped_ns, frame.at_ns, HURRIED_S * SECOND_NS)
        if hurried and not frame.last and _within(self._last_judged_ns, frame.at_ns, self._judged_ns):
            return False
        self._last_judged_ns = frame.at_ns
        return True


def _within(before_ns: int | None, now_ns: int, most_ns: float) -> bool:
    """Whether less than this time has passed; false after a clock was set back."""
    return before_ns is not None and 0 <= now_ns - before_ns < most_ns


class Observer:
    """Steps 3 to 6 of docs/design/README.md: tracks the body parts, reads features and updates the filter.

    resampler: brings frames to the model's rate; None if they arrive at it. facets: reads Effort and Shape at that
    rate. judged_s: how often an observer judges the movement that is too slow for all frames (`Hurry`).
    """

    def __init__(
        self,
        tracker: Tracker,
        model: MovementModel,
        onset: Onset | None = None,
        resampler: Resampler | None = None,
        facets: FacetReader | None = None,
        judged_s: float = 0.0,
    ) -> None:
        self._tracker, self._resampler, self._facets = tracker, resampler, facets
        self._model, self._onset = model, onset or Onset()
        self.watch = model.watch(self._onset)
        self._ended = False
        self.vocabulary: Vocabulary = model.header.vocabulary
        self.body_parts, self.leans_on = model.header.body_parts, region_shares(model.header)
        self._frames, self._hurry = 0, Hurry(judged_s)
        self._scorer = PerformanceScorer(model.header) if model.header.references else None
        self._captured_ns = 0
        self._seen_ns: int | None = None
        self.tracks: Tracks | None = None

    @property
    def complaint(self) -> str:
        """Why the tracker finds little in the pictures, and what to do about it; "" if all is well."""
        return str(getattr(self._tracker, "complaint", ""))

    def step(self, frame: Frame) -> Posterior:
        """The posterior after one more frame; it does not change while no instant of the model is due.

        The frame's tracks are left in `tracks`. A frame after the last one of a recording is watched anew, and so is
        one that shows somebody after nobody was seen for LOST_S.
        """
        if frame.repeated and self.tracks is not None:
            return self._posterior(self.tracks)
        tracks = self._tracker.update(frame)
        if self._comes_back(frame, tracks) or self._ended:
            self._begin_again()
        self.tracks, judged = tracks, self._hurry.judges(frame)
        self._captured_ns = frame.captured_ns
        instants = [self.tracks]
        if self._resampler is not None:
            instants = self._resampler.update(frame.at_ns, self.tracks, frame.skipped > 0)
        for n, tracks in enumerate(instants, 1):
            # An observer that is too slow must not spend on the instants between its frames what it has not.
            passed = not judged or (frame.skipped > 0 and n < len(instants))
            (self.watch.pass_over if passed else self.watch.update)(tracks)
            if self._facets is not None:
                self._facets.update(tracks, self.watch.rest, not passed)
        self._frames += len(instants)
        if frame.last:
            self._end()
        return self._posterior(self.tracks, judged)

    def end(self) -> Posterior | None:
        """The posterior now that source and movement have ended; None without a frame, or if the last was known."""
        if self.tracks is None or self._ended:
            return None
        self._end()
        return self._posterior(self.tracks)

    def _comes_back(self, frame: Frame, tracks: Tracks) -> bool:
        """Whether somebody is seen who was lost.

        Not if the observer only left out the frames in between, nor in a recording whose first frame begins a movement.
        """
        if self._onset.known or not tracks.visible.any():
            return False
        last_ns, self._seen_ns = self._seen_ns, frame.at_ns
        is_late = frame.skipped > 0 and self.tracks is not None and bool(self.tracks.visible.any())
        return last_ns is not None and not is_late and frame.at_ns - last_ns > LOST_S * SECOND_NS

    def _end(self) -> None:
        self.watch.end()
        self._ended = True

    def _begin_again(self) -> None:
        self.watch, self._ended = self._model.watch(self._onset), False
        if self._resampler is not None:
            self._resampler.restart()

    def _posterior(self, tracks: Tracks, judged: bool = True) -> Posterior:
        visible = dict(zip(self._tracker.body_parts, tracks.visible.tolist(), strict=True))
        facets = {} if self._facets is None else self._facets.facets
        watch, frames = self.watch, self._frames
        joint, p = watch.joint, watch.p
        facing = None if joint is None else joint / np.maximum(p, TINY)[:, None]
        # The sum over the facings may be above 1 by rounding.
        unlearned = None if watch.unlearned is None else min(float(watch.unlearned.sum()), 1.0)
        counts = watch.repetitions, watch.repeated
        score = self._scorer.update(watch, p, self._captured_ns) if self._scorer and judged else None
        return Posterior(p, watch.rest, frames, visible, facets, facing, unlearned, *counts, judged, score)


class PosteriorEncoder:
    """Makes an observer's numbered messages; each start of the observer has a new session.

    directed: whether its direction is known, so that others can use its facings. What the key contains is left out.
    """

    def __init__(self, vocabulary: Vocabulary | None, session: str, directed: bool = True) -> None:
        self._session, self._directed = session, directed
        self.vocabulary = vocabulary
        """That of the next posterior; None while the observer has no model and thus no posteriors."""
        self.seq = 0
        """Number of messages so far."""

    def encode(self, posterior: Posterior, captured_ns: int, now_ns: int) -> PosteriorMessage:
        """The posterior of the frame captured at `captured_ns` as a message, which clamps round-off."""
        facing = posterior.facing if self._directed else None
        score = posterior.score
        message = PosteriorMessage(
            v=2,
            seq=self.seq,
            session=self._session,
            captured_ns=captured_ns,
            sent_ns=now_ns,
            vocabulary=VocabularyHash(hash="" if self.vocabulary is None else self.vocabulary.digest),
            p=posterior.p.tolist(),
            rest=posterior.rest,
            unlearned=posterior.unlearned,
            frames=posterior.frames,
            visible={} if all(posterior.visible.values()) else dict(posterior.visible),
            facing=None if facing is None else Facing(surprise=encode_facing(facing).tolist()),
            facets={name: p.tolist() for name, p in posterior.facets.items()} or None,
            repetitions=posterior.repetitions,
            repeated=posterior.repeated,
            score=score if isinstance(score, ObservedScore) else None,
            unscored=score if isinstance(score, Unscored) else None,
            person=posterior.person,
            place=posterior.place,
        )
        self.seq += 1
        return message


class PosteriorPublisher(PosteriorEncoder):
    """Publishes posteriors on the mesh; on_change: None to send each one. session: as in `PosteriorEncoder`."""

    def __init__(
        self,
        vocabulary: Vocabulary | None,
        publisher: "Publisher",
        directed: bool = True,
        on_change: "SendOnChange | None" = None,
        session: str = "",
    ) -> None:
        super().__init__(vocabulary, session, directed)
        self._publisher, self._on_change = publisher, on_change

    def follow(self, vocabulary: Vocabulary | None) -> None:
        """The next posterior is in this vocabulary; if it is another one, it is sent in any case."""
        if vocabulary is not self.vocabulary:
            self.vocabulary = vocabulary
            if self._on_change is not None:
                self._on_change.forget()

    def publish(self, posterior: Posterior, captured_ns: int, now_ns: int) -> bool:
        """Send the posterior of the frame captured at `captured_ns`, unless it hardly changed; whether it was sent."""
        # Of several people any may have changed.
        is_alone = posterior.person is None
        if self._on_change is not None and is_alone and not self._on_change.should_send(posterior, captured_ns):
            return False
        for each in (posterior, *posterior.others):
            self._publisher.put(encode(self.encode(each, captured_ns, now_ns)))
        return True
