"""The roster: the newest posterior of each observer of a scene, faded to its age (fusion.md, "The roster"). Pure.

A posterior that is dated further than `drop_s` from now, as after a clock was set back, or from a capture that is
played again, blocks no other, nor replaces a newer one.
"""

import math
from collections import Counter
from collections.abc import Mapping

import numpy as np

from common import SECOND_NS
from common.clock_skew import ClockReading
from common.config_sections import FusionConfig
from common.messages import OngoingMovement, PosteriorMessage, VoteState
from common.probability import Floats, array_of, entropy_bits, normalise, uniform
from common.vocabulary import Vocabulary
from fusion.engine.aged_posterior import POOLED_STATES as POOLED_STATES
from fusion.engine.aged_posterior import AgedPosterior as AgedPosterior
from fusion.engine.aged_posterior import RosterEntry, answers_of, faded
from fusion.engine.trust import (
    HONEST,
    LEAST_TRUST,
    LEAST_VOTES,
    Reliability,
    after_decision,
    after_message,
    among_contradicted,
    overlap_of,
    published_trust,
)

SAME_ID_S = 1.0
"""A process that captures a frame so long after another one with its id began still runs (rule 2)."""


class Roster:
    """The observers of one scene with their newest posteriors."""

    def __init__(self, observers: list[str], vocabulary: Vocabulary, config: FusionConfig) -> None:
        self._set_vocabulary(vocabulary)
        self._config = config
        self._drop_ns, self._fresh_s = config.drop_s * SECOND_NS, config.fresh_s
        self._states = {observer: RosterEntry() for observer in observers}
        self._present: frozenset[str] = frozenset()
        self._compared_ns = 0

    @property
    def rejected(self) -> dict[str, Counter[str]]:
        """Per observer, how many of its messages were not used, by reason."""
        return {observer: state.rejected for observer, state in self._states.items()}

    def change_vocabulary(self, vocabulary: Vocabulary) -> None:
        """Take posteriors in `vocabulary` from now on; those in the old one count no more."""
        self._set_vocabulary(vocabulary)
        for observer, state in self._states.items():
            self._states[observer] = RosterEntry(
                gone=state.gone, published=state.published, rejected=state.rejected, clock=state.clock
            )

    def _set_vocabulary(self, vocabulary: Vocabulary) -> None:
        self.vocabulary, self.prior = vocabulary, uniform(vocabulary.size)
        self._digest, self._size = vocabulary.digest, vocabulary.size
        self._neutral = answers_of(self.prior, None)

    def record_clock(self, observer: str, reading: ClockReading) -> None:
        """Take a reading of an observer's clock."""
        if observer in self._states:
            self._states[observer].clock.record_reading(reading)

    def skew_s(self, observer: str) -> float | None:
        """Seconds by which an observer's clock is ahead of ours; None before the first reading."""
        return self._states[observer].clock.skew_s if observer in self._states else None

    def set_reliability(self, reliability: Reliability) -> None:
        """Take what verdicts have taught."""
        for observer, state in self._states.items():
            state.honest = reliability.honest(observer)

    def receive(self, observer: str, message: PosteriorMessage, now_ns: int) -> str | None:
        """Take one posterior that arrived at `now_ns`; returns why it was not used, or None."""
        state = self._states.get(observer)
        if state is None:
            return "unknown_observer"
        state.published, captured_ns = (message.vocabulary.hash, now_ns), state.clock.captured_ns(message, now_ns)
        if (reason := self._rejection(state, message, captured_ns, now_ns)) is not None:
            state.count_rejected(reason)
            return reason
        state.clock.record_message(message)
        last, p = state.message, self._over_our_prior(message)
        answers = answers_of(p, message.unlearned)
        if last is None or message.session != last.session:
            state.begin_session(message, now_ns)
        else:
            state.note_gap(captured_ns - state.captured_ns)
            seconds = (captured_ns - state.captured_ns) / SECOND_NS
            state.steady = after_message(state.steady, overlap_of(state.answers, answers), seconds)
        # An observer that does not publish what is visible, as an audio classifier, is not blind.
        if not message.visible or True in message.visible.values():
            state.visible_ns = captured_ns
        state.message, state.p, state.answers = message, p, answers
        state.captured_ns, state.received_ns = captured_ns, now_ns
        # Of an observer that does not publish rest, its entropy over the largest.
        state.rest = float(entropy_bits(p)) / math.log2(len(p)) if message.rest is None else message.rest
        state.surprise = None if message.facing is None else np.array(message.facing.surprise)
        state.facets = message.facets or {}
        scored = message.score or message.unscored
        state.score = scored and scored.shifted(captured_ns - message.captured_ns)
        state.gone, state.fault = False, None
        return None

    def compare(self, movement: OngoingMovement | None, now_ns: int) -> None:
        """Compare what each says after a decision with its label, if at least three do (trust.py)."""
        since_ns, self._compared_ns = self._compared_ns, now_ns
        if movement is None or movement.label not in self.vocabulary.labels or movement.decided_ns is None:
            return
        decided_ns, label = movement.decided_ns, self.vocabulary.index(movement.label)
        seconds = min((now_ns - max(since_ns, decided_ns)) / SECOND_NS, 1.0)
        used = [(s, s.message) for s in self._states.values() if s.message is not None and s.captured_ns > decided_ns]
        if seconds <= 0.0 or len(used) < LEAST_VOTES:
            return
        for state, message in used:
            # One that does not publish "something else" leaves nothing to it.
            p = state.p if message.unlearned is None else state.answers
            state.stays = after_decision(state.stays, (self._size + 1) * p.item(label), seconds)

    def reject(self, observer: str, reason: str) -> None:
        """Count a message that could not be read."""
        if observer in self._states:
            self._states[observer].count_rejected(reason)

    def set_present(self, observers: frozenset[str]) -> None:
        """Record which observers are present on the mesh. One that was never announced still counts."""
        for observer in (self._present - observers) & self._states.keys():
            # The message stays, so that a copy of it does not bring its observer back.
            state = self._states[observer]
            state.gone, state.fault, state.published = True, None, None
        self._present = observers

    def majority(self, now_ns: int) -> str | None:
        """The hash of the vocabulary in which most observers publish; None if there is no majority."""
        published = [state.published for state in self._states.values() if state.published is not None]
        counts = Counter(digest for digest, at_ns in published if abs(now_ns - at_ns) <= self._drop_ns)
        if not counts:
            return None
        digest, votes = counts.most_common(1)[0]
        return digest if 2 * votes > counts.total() else None

    def posteriors(self, now_ns: int, resting: Mapping[str, float] | None = None) -> list[AgedPosterior]:
        """The posterior of every observer, in order, faded to its age; resting: trust in what some say about rest."""
        # P(honest) on the time channel of the upper median of those that are pooled: what most do is no fault.
        steady = sorted(
            state.steady
            for state in self._states.values()
            if state.message is not None and not state.gone and abs(now_ns - state.captured_ns) <= self._drop_ns
        )
        usual = steady[len(steady) // 2] if steady else HONEST
        result = [self._aged(observer, state, now_ns, usual) for observer, state in self._states.items()]
        if resting:
            for each in result:
                share = among_contradicted(resting.get(each.observer, 1.0))
                each.reliability = max(each.reliability * share, LEAST_TRUST)
        return result

    def _rejection(self, state: RosterEntry, message: PosteriorMessage, captured_ns: int, now_ns: int) -> str | None:
        """Why a message is not used (rules 1, 2 and 6); None: it is."""
        if message.vocabulary.hash != self._digest:
            return "foreign_vocabulary"
        if len(message.p) != self._size:
            return "wrong_length"
        last = state.message
        is_next = last is not None and message.session == last.session and message.seq > last.seq
        if is_next and state.captured_ns < captured_ns and now_ns - captured_ns <= self._drop_ns:
            # The usual case first.
            return None
        if abs(now_ns - state.received_ns) > self._drop_ns or state.captured_ns - now_ns > self._drop_ns:
            return None
        is_late = now_ns - state.captured_ns > self._drop_ns
        if is_late and captured_ns > state.captured_ns:
            return None
        if message.session in state.past_sessions:
            return "same_id" if captured_ns > state.session_ns + SAME_ID_S * SECOND_NS else "past_session"
        if last is not None and not is_late and now_ns - captured_ns > self._drop_ns:
            return "out_of_order"
        if last is not None and message.session == last.session:
            if message.seq == last.seq:
                return "repeated"
            if message.seq < last.seq or captured_ns <= state.captured_ns:
                return "out_of_order"
        return None

    def _aged(self, observer: str, state: RosterEntry, now_ns: int, usual: float) -> AgedPosterior:
        message, rest = state.message, 1.0
        trust = published_trust(state.honest * state.stays / HONEST, state.steady, usual)
        age_s = None if message is None else (now_ns - state.captured_ns) / SECOND_NS
        if age_s is not None and abs(age_s) <= self._config.drop_s:
            fresh_s = self._fresh_s if state.usual_s < self._fresh_s else state.usual_s
            unseen_s, freshness = (state.captured_ns - state.visible_ns) / SECOND_NS, 1.0
            if unseen_s > fresh_s:
                freshness = math.exp((fresh_s - unseen_s) / self._config.blind_s)
            # One that sees nobody sees nobody move, and does not see that anybody rests.
            sees = freshness >= 0.5
            rest = state.rest if sees else 1.0
            if message is not None and not state.gone:
                if age_s > fresh_s:
                    freshness *= math.exp((fresh_s - age_s) / self._config.fade_s)
                fresh = AgedPosterior(
                    observer, state.p, rest, age_s, "counted", state.clock.skew_s, message.unlearned, state.surprise,
                    state.facets, trust, freshness, message.repetitions, state.answers,
                    message.repeated, state.score, sees,
                )  # fmt: skip
                return fresh if freshness == 1.0 else faded(fresh)
        # It contributes the prior (rule 4).
        return AgedPosterior(
            observer, self.prior, rest, age_s, self._unused_state(state, now_ns), state.clock.skew_s,
            reliability=trust, freshness=0.0, answers=self._neutral, sees=False,
        )  # fmt: skip

    def _unused_state(self, state: RosterEntry, now_ns: int) -> VoteState:
        publishes = not state.gone and abs(now_ns - state.received_ns) <= self._drop_ns
        is_late = publishes and state.received_ns - state.captured_ns > self._drop_ns
        return state.fault or ("late" if is_late else "silent")

    def _over_our_prior(self, message: PosteriorMessage) -> Floats:
        """(M,) the posterior of `message` under the prior of the scene."""
        # Its sum was checked on arrival to be nearly 1.
        p = array_of(message.p) / sum(message.p)
        if message.prior is None:
            return p
        # Bayes: the likelihood of the frames is p over the observer's own prior; our prior replaces that.
        own_prior = np.maximum(np.array(message.prior), 1e-12)
        return normalise(p / own_prior * self.prior)
