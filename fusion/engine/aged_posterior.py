"""One observer's newest posterior, and how it fades with its age (fusion.md, "The roster"). Pure."""

import math
from collections import Counter, deque
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from common import SECOND_NS
from common.clock_skew import ClockReading, ClockSkew
from common.messages import PosteriorMessage, VoteState
from common.posterior import ObservedScore, Repeated, Unscored
from common.probability import Floats, Surprise, decode_facing, encode_facing, normalise, temper, uniform
from fusion.engine.trust import HONEST

POOLED_STATES = ("counted", "stale")
"""Vote states in which an observer's posterior is pooled; in the others it contributes the prior."""
GAPS = 8
"""An observer's usual interval is the median of the last gaps; fewer than half of them show none (as
observer/motion/even_rate has it of pictures)."""
INTERVALS, SLOWEST_S = 2, 0.75
"""A posterior is fresh for so many usual intervals of its observer (rule 3), but at most for the time over which
observers themselves take motion to go on (observer/prepared_tracks.py)."""
SESSIONS_LIMIT = 64
"""Past sessions that are remembered per observer."""
TIMING_REASONS = ("repeated", "out_of_order", "past_session", "same_id")
"""Reasons for which a correct message is not used."""
IGNORED_SKEW_NS = 5_000_000
"""5 ms: a smaller skew is not corrected. It is less than a frame, and measurements over a network are no more exact."""


@dataclass(slots=True)
class ObserverClock:
    """When the newest frame of a posterior was captured, by our own clock (rule 7).

    correction_ns: what is subtracted from the observer's stamps. session, seq, sent_ns: of the last message that was
    used. doubtful: the clock stood still or was set back since it was read; messages count as sent on arrival.
    """

    skew: ClockSkew = field(default_factory=ClockSkew)
    skew_s: float | None = None
    correction_ns: int = 0
    session: str = ""
    seq: int = -1
    sent_ns: int = 0
    doubtful: bool = False

    def record_reading(self, reading: ClockReading) -> None:
        """Take a reading, which ends a doubt. A skew no larger than the error of measurement is not corrected."""
        self.skew.note(reading)
        best, self.skew_s, self.doubtful = self.skew.best, self.skew.skew_s, False
        is_certain = best is not None and abs(best.skew_ns) > max(best.doubt_ns, IGNORED_SKEW_NS)
        self.correction_ns = best.skew_ns if best is not None and is_certain else 0

    def captured_ns(self, message: PosteriorMessage, now_ns: int) -> int:
        """The capture time of a message that arrived at `now_ns`, at most `now_ns` and at most the time of sending."""
        captured_ns, sent_ns = message.captured_ns, message.sent_ns
        if captured_ns > sent_ns:
            captured_ns = sent_ns
        latest_ns = now_ns - (sent_ns - captured_ns)
        if self.doubtful or (sent_ns <= self.sent_ns and self._precedes(message)):
            return latest_ns
        captured_ns -= self.correction_ns
        return captured_ns if captured_ns < latest_ns else latest_ns

    def record_message(self, message: PosteriorMessage) -> None:
        """Remember the stamps of a message that was used, to compare the next one's with."""
        if message.sent_ns <= self.sent_ns and self._precedes(message):
            self.doubtful = True
        self.session, self.seq, self.sent_ns = message.session, message.seq, message.sent_ns

    def _precedes(self, message: PosteriorMessage) -> bool:
        """Whether `message` follows the last used one in the same session; else they do not show how the clock runs."""
        return message.session == self.session and message.seq > self.seq


@dataclass(slots=True)
class AgedPosterior:
    """One observer's posterior as it is pooled: p (M,), and `rest`, the probability that the person is at rest.

    Nothing changes it after it is made. It is not frozen, because a frozen one takes six times as long to make, and
    each step makes N. An optional field that the observer does not publish is None, and `facets` is empty.
    age_s: since the capture, corrected by skew_s; None before the first message. skew_s: how far the observer's clock
    is ahead. sees: whether it counts, and sees somebody or does not publish what it sees; where false, rest is 1.
    unlearned: P(none of the movements). surprise (M, K): encoded P(facing | movement). reliability: the trust in its
    labels and its course (trust.py). freshness: k of the fading (rule 3), from 1 (unchanged) to 0 (the prior).
    answers: what `answers_of` returns, if known. score: as published, or why there is none, by our clock.
    """

    observer: str
    p: Floats
    rest: float
    age_s: float | None
    state: VoteState
    skew_s: float | None = None
    unlearned: float | None = None
    surprise: Surprise | None = None
    facets: Mapping[str, Sequence[float]] = field(default_factory=dict)
    reliability: float = 1.0
    freshness: float = 1.0
    repetitions: float | None = None
    answers: Floats | None = None
    repeated: Repeated | None = None
    score: ObservedScore | Unscored | None = None
    sees: bool = True

    def captured_ns(self, now_ns: int) -> int:
        """When its newest frame was captured; not after `now_ns`."""
        return now_ns - round(max(self.age_s or 0.0, 0.0) * SECOND_NS)

    @property
    def information(self) -> float:
        """Information about the movement, before fading: 0 if p is uniform or unlearned is 1; 1 if p is certain."""
        p, unlearned = self.p, self.unlearned
        if 0.0 < self.freshness < 1.0:
            p, unlearned = _tempered(p, unlearned, 1.0 / self.freshness)
        certainty = math.log(max(len(p) * max(p.tolist()), 1.0)) / math.log(len(p)) if len(p) > 1 else 0.0
        return certainty * (1.0 - (unlearned or 0.0))


@dataclass(slots=True)
class RosterEntry:
    """One observer's newest message, and what follows from it; computed once per message instead of once per step.

    p, answers, rest, surprise, facets, score: as in AgedPosterior while fresh. steady: P(honest) on the time channel;
    honest, stays: of its labels, by verdicts and by what it says after decisions (trust.py). visible_ns:
    capture of the newest frame of this session that showed a body part. usual_s: for so long a posterior is fresh by
    the observer's usual interval, 0 while that is unknown. fault: the vote state after an unusable message. gone: the
    process disappeared after its last usable one. published: the hash of the vocabulary of its newest message, usable
    or not, and when that arrived; None if the process disappeared since. All times by our clock, Unix epoch.
    """

    past_sessions: deque[str] = field(default_factory=lambda: deque(maxlen=SESSIONS_LIMIT))
    message: PosteriorMessage | None = None
    p: Floats = field(default_factory=lambda: np.empty(0))
    answers: Floats = field(default_factory=lambda: np.empty(0))
    rest: float = 1.0
    surprise: Surprise | None = None
    facets: Mapping[str, Sequence[float]] = field(default_factory=dict)
    score: ObservedScore | Unscored | None = None
    steady: float = HONEST
    stays: float = HONEST
    session_ns: int = 0
    captured_ns: int = 0
    received_ns: int = 0
    visible_ns: int = 0
    gaps_ns: deque[int] = field(default_factory=lambda: deque(maxlen=GAPS))
    usual_s: float = 0.0
    gone: bool = False
    published: tuple[str, int] | None = None
    fault: VoteState | None = None
    rejected: Counter[str] = field(default_factory=Counter)
    honest: float = HONEST
    clock: ObserverClock = field(default_factory=ObserverClock)

    def begin_session(self, message: PosteriorMessage, now_ns: int) -> None:
        """Begin the session of `message`, which is not the newest yet; it has seen nobody so far."""
        if self.message is not None:
            self.past_sessions.append(self.message.session)
        if message.session in self.past_sessions:
            self.past_sessions.remove(message.session)
        self.session_ns, self.visible_ns, self.steady = now_ns, 0, HONEST
        self.gaps_ns.clear()
        self.usual_s = 0.0

    def note_gap(self, gap_ns: int) -> None:
        """Count the time from one capture to the next towards the observer's usual interval."""
        self.gaps_ns.append(gap_ns)
        gaps = len(self.gaps_ns)
        if 2 * gaps >= GAPS:
            self.usual_s = min(INTERVALS * sorted(self.gaps_ns)[gaps // 2] / SECOND_NS, SLOWEST_S)

    def count_rejected(self, reason: str) -> None:
        """Count a message that was not used."""
        self.rejected[reason] += 1
        if reason not in TIMING_REASONS:
            self.fault = "foreign" if reason == "foreign_vocabulary" else "invalid"


def answers_of(p: Floats, unlearned: float | None) -> Floats:
    """(M + 1,) a posterior (M,) with "something else" last, at the prior if the observer does not publish it."""
    size = len(p)
    u = 1.0 / (size + 1) if unlearned is None else unlearned
    answers = np.empty(size + 1)
    np.multiply(p, 1.0 - u, answers[:size])
    answers[size] = u
    return answers


def _tempered(p: Floats, unlearned: float | None, exponent: float) -> tuple[Floats, float | None]:
    """`p` and `unlearned` after all answers have been tempered; the prior of a scene is uniform."""
    if unlearned is not None:
        answers = answers_of(p, unlearned)
        unlearned = temper(answers, uniform(len(answers)), exponent).item(-1)
    return temper(p, uniform(len(p)), exponent), unlearned


def faded(posterior: AgedPosterior) -> AgedPosterior:
    """The posterior faded by its `freshness`."""
    freshness, surprise = posterior.freshness, posterior.surprise
    p, unlearned = _tempered(posterior.p, posterior.unlearned, freshness)
    if surprise is not None:
        # Encoded again, so that the vote carries it as it was pooled.
        surprise = encode_facing(normalise(decode_facing(surprise) ** freshness))
    facets = {name: temper(np.array(p), uniform(len(p)), freshness).tolist() for name, p in posterior.facets.items()}
    return replace(
        posterior, p=p, answers=None, state="stale", unlearned=unlearned, surprise=surprise, facets=facets,
    )  # fmt: skip
