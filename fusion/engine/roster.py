"""The roster: who judges, what each last said, and how old that is. Pure: time is passed in.

1. An observer's posterior is cumulative, so only its newest by capture time is kept; two are never multiplied.
   Capture times are by our own clock, as far as the observer's is known (clocks.py).
2. A restarted observer begins a new session and is heard at once; stragglers of its old session are not. They come
   within seconds: who alone goes on to speak for longer than `drop_s` is heard again, so that no single message,
   forged or mad, can silence a judge for good.
3. An opinion older than `fresh_s` fades towards the prior, p <- (p/prior)^exp(-(age-fresh_s)/fade_s) prior. Whether
   the person rests is believed as it was said until `drop_s`: silence is no sign of rest, and a line that was broken
   for a second must not cut a movement in two.
4. Past `drop_s`, or before anything was said, a judge is the prior: it takes part and says nothing. Who speaks of what
   is already that old is late; who does not speak is silent; whose last word could not be used is foreign or invalid.
5. A judge whose process is seen to go is silent at once, until it speaks again; what it said of rest stays, as in 3.
6. What cannot be used is counted by reason, and changes no opinion: a judge who counts goes on to count.
7. A judge who has seen no body part for longer than `fresh_s` fades too, by `blind_s`, however newly he says so: what
   he believes is of then. A Karate judge covers his eyes: mienai, "I could not see". His next sight brings it back.
8. When a clock was set back, what is dated past `drop_s` in the future counts no more, nor stands in anybody's way.
"""

import math
from collections import Counter, deque
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from common.config_sections import FusionConfig
from common.messages import PosteriorMessage, VoteState
from common.probability import Surprise, decode_facing, encode_facing, entropy_bits, normalise, temper, uniform
from common.vocabulary import Vocabulary

Floats = NDArray[np.float64]
SECOND_NS = 1_000_000_000
HEARD = ("counted", "stale")
"""States of a judge that is heard: the others say nothing."""
SESSIONS_KEPT = 64
"""So many sessions of one observer are remembered: stragglers come within seconds of a restart, not after so many."""


@dataclass(frozen=True, slots=True)
class AgedPosterior:
    """One judge as the rule hears it: p (M,) faded to its age, rest the chance that the person is at rest.

    skew_s: how far its clock is ahead of ours, as far as that was asked; age_s has it taken out. unlearned: how likely
    it is none of the movements; surprise (M, K): which way the person faces given the movement; facets by name: None or
    left out where it does not say it, all faded like p. reliability, correlations: what was learned of it (lessons.py).
    """

    observer: str
    p: Floats
    rest: float
    age_s: float | None
    state: VoteState
    skew_s: float | None = None
    unlearned: float | None = None
    surprise: Surprise | None = None
    facets: Mapping[str, Floats] = field(default_factory=dict)
    reliability: float = 1.0
    correlations: Mapping[str, float] = field(default_factory=dict)


@dataclass(frozen=True, slots=True)
class ObserverRecord:
    """What is known of a judge beside what it says: skew_s, reliability and correlations as in AgedPosterior."""

    skew_s: float | None = None
    reliability: float = 1.0
    correlations: Mapping[str, float] = field(default_factory=dict)


NO_RECORD = ObserverRecord()


@dataclass(slots=True)
class _Seat:
    past_sessions: deque[str] = field(default_factory=lambda: deque(maxlen=SESSIONS_KEPT))
    message: PosteriorMessage | None = None
    p: Floats = field(default_factory=lambda: np.empty(0))
    captured_ns: int = 0
    heard_ns: int = 0
    seen_ns: int = 0
    gone: bool = False
    trouble: VoteState | None = None
    rejected: Counter[str] = field(default_factory=Counter)


class Roster:
    """The judges of one scene and their newest opinions."""

    def __init__(self, observers: list[str], vocabulary: Vocabulary, config: FusionConfig) -> None:
        self.vocabulary = vocabulary
        self.prior = uniform(vocabulary.size)
        self._config = config
        self._seats = {observer: _Seat() for observer in observers}
        self._alive: frozenset[str] = frozenset()

    @property
    def rejected(self) -> dict[str, Counter[str]]:
        """Per observer, how many of its messages could not be used, by reason."""
        return {observer: seat.rejected for observer, seat in self._seats.items()}

    def receive(
        self, observer: str, message: PosteriorMessage, now_ns: int, captured_ns: int | None = None
    ) -> str | None:
        """Take one posterior; returns why it was not used, or None.

        captured_ns: when its newest frame was captured by our clock; left out: as the observer dates it.
        """
        seat = self._seats.get(observer)
        if seat is None:
            return "unknown_observer"
        captured_ns = message.captured_ns if captured_ns is None else captured_ns
        reason = self._refuse(seat, message, captured_ns, now_ns)
        if reason is None:
            begins = seat.message is None or message.session != seat.message.session
            if seat.message is not None and begins:
                seat.past_sessions.append(seat.message.session)
            if message.session in seat.past_sessions:
                seat.past_sessions.remove(message.session)
            if begins or _sees(message):
                seat.seen_ns = captured_ns
            seat.message, seat.captured_ns, seat.heard_ns = message, captured_ns, now_ns
            # Here once, not at each of the steps in which it is judged.
            seat.p = self._with_our_prior(message)
            seat.gone, seat.trouble = False, None
        else:
            self._count(seat, reason)
        return reason

    def reject(self, observer: str, reason: str) -> None:
        """Count a message that could not even be read."""
        if observer in self._seats:
            self._count(self._seats[observer], reason)

    def present(self, alive: frozenset[str]) -> None:
        """Who is alive on the mesh now. A judge that never announced itself is heard all the same."""
        for observer in (self._alive - alive) & self._seats.keys():
            # The message stays, so that a copy of it does not bring its judge back.
            self._seats[observer].gone, self._seats[observer].trouble = True, None
        self._alive = alive

    def opinions(
        self, now_ns: int, known: Callable[[str], ObserverRecord] = lambda _: NO_RECORD
    ) -> list[AgedPosterior]:
        """Every judge of the roster in order, faded to its age at `now_ns`, with what is known of it."""
        return [self._opinion(observer, seat, now_ns, known(observer)) for observer, seat in self._seats.items()]

    def _refuse(self, seat: _Seat, message: PosteriorMessage, captured_ns: int, now_ns: int) -> str | None:
        if message.vocabulary.hash != self.vocabulary.digest:
            return "foreign_vocabulary"
        if len(message.p) != self.vocabulary.size:
            return "wrong_length"
        if captured_ns > now_ns + self._config.drop_s * SECOND_NS:
            return "from_the_future"
        last, drop_s = seat.message, self._config.drop_s
        if abs(_age_s(seat.heard_ns, now_ns)) > drop_s or _age_s(seat.captured_ns, now_ns) < -drop_s:
            return None
        if message.session in seat.past_sessions:
            return "past_session"
        if last is not None and message.session == last.session:
            if message.seq == last.seq:
                return "repeated"
            if message.seq < last.seq or captured_ns <= seat.captured_ns:
                return "out_of_order"
        return None

    def _count(self, seat: _Seat, reason: str) -> None:
        seat.rejected[reason] += 1
        # A late copy says nothing against the judge; a message that is wrong in itself does.
        if reason not in ("repeated", "out_of_order", "past_session"):
            seat.trouble = "foreign" if reason == "foreign_vocabulary" else "invalid"

    def _opinion(self, observer: str, seat: _Seat, now_ns: int, known: ObserverRecord) -> AgedPosterior:
        message, config = seat.message, self._config
        skew_s, trust = known.skew_s, (known.reliability, known.correlations)
        if message is None:
            return AgedPosterior(
                observer, self.prior, 1.0, None, seat.trouble or "silent", skew_s, None, None, {}, *trust
            )
        age_s = _age_s(seat.captured_ns, now_ns)
        unseen_s = (seat.captured_ns - seat.seen_ns) / SECOND_NS
        faded = max(age_s - config.fresh_s, 0.0) / config.fade_s
        sees = math.exp(-max(unseen_s - config.fresh_s, 0.0) / config.blind_s)
        keeps = math.exp(-faded) * sees
        p = seat.p
        active = sees * (1.0 - (_ignorance(p) if message.rest is None else message.rest))
        state: VoteState
        if seat.gone or abs(age_s) > config.drop_s:
            speaks = not seat.gone and abs(now_ns - seat.heard_ns) <= config.drop_s * SECOND_NS
            late = speaks and _age_s(seat.captured_ns, seat.heard_ns) > config.drop_s
            rest = 1.0 - active if seat.gone and abs(age_s) <= config.drop_s else 1.0
            state = seat.trouble or ("late" if late else "silent")
            return AgedPosterior(observer, self.prior, rest, age_s, state, skew_s, None, None, {}, *trust)
        surprise = None if message.facing is None else _faded_surprise(np.array(message.facing.surprise), keeps)
        facets = {name: _faded_facet(said, keeps) for name, said in (message.facets or {}).items()}
        unlearned = message.unlearned
        if keeps < 1.0:
            unlearned = None if unlearned is None else self._faded_answer(p, unlearned, keeps)
            p = temper(p, self.prior, keeps)
        state = "counted" if keeps == 1.0 else "stale"
        return AgedPosterior(observer, p, 1.0 - active, age_s, state, skew_s, unlearned, surprise, facets, *trust)

    def _faded_answer(self, p: Floats, unlearned: float, keeps: float) -> float:
        """How likely "something else" is when the belief over all answers has faded."""
        size = self.vocabulary.size + 1
        return float(temper(np.append(p * (1.0 - unlearned), unlearned), uniform(size), keeps)[-1])

    def _with_our_prior(self, message: PosteriorMessage) -> Floats:
        # It sums to nearly 1: that was checked where it came in.
        said = np.array(message.p)
        p: Floats = said / np.add.reduce(said)
        if message.prior is None:
            return p
        # Bayes: what the frames said is p over the judge's own prior; the scene's prior takes its place.
        own = np.maximum(np.array(message.prior), 1e-12)
        return normalise(p / own * self.prior)


def _sees(message: PosteriorMessage) -> bool:
    """Whether some body part is seen; who does not say (an audio classifier) is not blind."""
    return not message.visible or any(message.visible.values())


def _age_s(captured_ns: int, now_ns: int) -> float:
    return (now_ns - captured_ns) / SECOND_NS


def _ignorance(p: Floats) -> float:
    """A judge that does not say whether the person rests: as near to rest as its belief is to knowing nothing."""
    return float(entropy_bits(p)) / math.log2(len(p))


def _faded_surprise(surprise: Surprise, keeps: float) -> Surprise:
    """P(facing | movement)^keeps as surprise again, so that a vote can say it as it was pooled."""
    return surprise if keeps == 1.0 else encode_facing(normalise(decode_facing(surprise) ** keeps))


def _faded_facet(said: list[float], keeps: float) -> Floats:
    p = normalise(np.array(said))
    return p if keeps == 1.0 or len(p) < 2 else temper(p, uniform(len(p)), keeps)
