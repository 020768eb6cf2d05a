"""The data of the segmenter: what is pooled at one time, a movement and its decision, how long movements last. Pure.

Here observers' counts of a periodic movement are pooled, too (fusion.md, "Segments", 8). Times: Unix epoch in ns.
"""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from enum import Enum
from math import floor, inf
from typing import NamedTuple

from common import SECOND_NS
from common.config_sections import FusionConfig
from common.message_types import LONGEST_STAY, PAUSE_S, MovementTimes
from common.messages import JudgementMessage, VerdictStage
from common.vocabulary import Vocabulary
from fusion.engine.roster import AgedPosterior
from fusion.engine.trust import MOVEMENT_S

NO_TIMES = MovementTimes()
ANY = "*"
"""In place of the label that was held before a movement: it may have been any."""
NOTICED_S = 0.3
"""Observers notice within so long that a movement has begun, has changed or is over: a label that is held for a shorter
time as one begins may be its own (rule 3), as may one that begins sooner after the begin (rule 7), and something else
that lasts for less may be rest (rule 6). Where one takes a turn of a movement for rest, it does so for .1 to .3 s."""
NOTICED_NS = NOTICED_S * SECOND_NS
OUTAGE_NS = 1.0 * SECOND_NS
"""A shorter outage hides no whole movement, nor the whole rest between two (rule 9)."""


class RepetitionCount(NamedTuple):
    """How often a movement has been done so far, and how many of these repetitions are partial."""

    done: int
    partial: int = 0


@dataclass(slots=True)
class PooledState:
    """The pooled posterior at one time: the likeliest label, and probabilities.

    p: of the label, among all answers. unlearned: of "something else", which is no label. rest: that the person rests.
    agreeing: how many observers hold the label themselves. contested: whether an observer votes for another label.
    observed: whether an observer sees somebody. newest_capture_ns: of the newest frame of such an observer; None:
    at_ns. complete: whether each observer of the roster has begun. repetitions: of the label so far; None without.
    """

    at_ns: int
    label: str
    p: float
    agreeing: int
    rest: float
    unlearned: float = 0.0
    observed: bool = True
    newest_capture_ns: int | None = None
    complete: bool = True
    repetitions: RepetitionCount | None = None
    contested: bool = False

    @property
    def rests(self) -> bool:
        """Whether rest is likelier than motion."""
        return self.rest >= 0.5

    @property
    def begins(self) -> bool:
        """Whether a movement is likelier than rest and "something else"."""
        return self.observed and not self.idle

    @property
    def idle(self) -> bool:
        """Whether rest or "something else" is likelier than a movement of the vocabulary."""
        return self.rest >= 0.5 or self.unlearned > 0.5

    @property
    def moves(self) -> bool:
        """Whether an observer sees that the person moves, whatever they do."""
        return self.observed and self.rest < 0.5

    @property
    def longer_s(self) -> float:
        """For how much longer than `hold_s` the label has to meet the demand: where it is contested, while more of the
        movement will show who is right (rule 2)."""
        return NOTICED_S if self.contested and self.rest < 0.5 else 0.0


@dataclass(frozen=True, slots=True)
class MovementDecision:
    """Label or ABSTAIN, begin of the movement, time of decision; the end when it is known.

    revises: the label that `label` replaced; None while the first one stands. revisions: how many there were.
    repetitions: of a periodic movement so far.
    """

    label: str
    began_ns: int
    decided_ns: int
    ended_ns: int | None = None
    stage: VerdictStage = "decided"
    revises: str | None = None
    revisions: int = 0
    repetitions: RepetitionCount | None = None


@dataclass(frozen=True, slots=True)
class MovementProgress:
    """A movement that has not ended: when it began, and the decision, if there is one.

    carried: the label that observers held before it began (rule 3); ANY where this may be any label.
    early: it began while the service still waited for observers (rule 10).
    unseen: nobody saw the person idle before it, neither since they came nor since the last movement ended (rule 1).
    after: the label of a movement that ended at most `NOTICED_S` before (rule 1).
    outage_ns: when it was last seen before an outage that may have hidden its end (rule 9).
    contested: the last label that only the vote of an observer for another label kept from being decided (rule 2).
    """

    began_ns: int
    decision: MovementDecision | None = None
    carried: str | None = None
    early: bool = False
    unseen: bool = False
    after: str = ""
    outage_ns: int | None = None
    contested: str | None = None


class HeldLabel(NamedTuple):
    """A label that meets the threshold: since when, until when, and since when it also has the quorum."""

    label: str
    since_ns: int
    last_ns: int
    agreed_ns: int | None


class Quiet(NamedTuple):
    """A time in which the movement is not seen: since when, and since when that is beyond doubt."""

    since_ns: int
    clear_ns: int | None


class SegmentState(Enum):
    """What is known of the person."""

    IDLE = "the person rests, or does something else"
    MOVING = "a movement goes on, undecided"
    PAUSED = "undecided, and the person has come to rest"
    LOST = "undecided, and an outage hid how it went on; the person rests"
    DECIDED = "a decided movement goes on"
    PASSED = "decided, and something else, or an outage, was since"
    UNSEEN = "decided, here or by another service, and not seen since"
    ENDING = "decided, and the person has come to rest"
    SETTLED = "decided or revised at rest"


class SegmentStep(NamedTuple):
    """One step. named: the label that meets rule 2 now; before: the label that met it at the step before.

    gap_ns: from the newest capture at the step before, `heard_ns`, to the newest one now.
    """

    state: PooledState
    named: str | None
    before: HeldLabel | None
    heard_ns: int
    gap_ns: int

    @property
    def is_out(self) -> bool:
        """Whether an outage is over."""
        return self.gap_ns > OUTAGE_NS

    @property
    def hides(self) -> bool:
        """Whether the outage may have hidden a whole movement."""
        return self.gap_ns > MOVEMENT_S * SECOND_NS


class Heard(NamedTuple):
    """The newest capture time of a posterior, and the time of the step that ended the last outage; None: none yet."""

    until_ns: int
    since_ns: int | None = None


class Durations(NamedTuple):
    """What is known of how long movements with one label last; ns. shortest: the shortest of its takes.

    least: half of the shortest take, or of a period, less NOTICED_S; no movement is over sooner. over: two thirds of
    the shortest take, less NOTICED_S, or `least` of a periodic one; hardly any is over sooner.
    periodic: whether the movement is repeated.
    rest, other: how long a repeated movement may rest, or look like something else, before it has ended.
    """

    shortest_ns: float = inf
    least_ns: float = 0.0
    over_ns: float = 0.0
    rest_ns: float = 0.0
    other_ns: float = 0.0
    periodic: bool = False


UNKNOWN = Durations()


def durations_of(config: FusionConfig, vocabulary: Vocabulary) -> dict[str, Durations]:
    """The durations of labels of which some are known, or that are periodic, by the scene file or else by their takes.

    A periodic movement goes on while an observer counts its repetitions: for the shortest rest between two takes, and
    for LONGEST_STAY periods without a turn.
    """
    periodic = vocabulary.periods if config.periodic is None else config.periodic
    durations = {}
    for label in {*vocabulary.movements, *periodic}:
        known = vocabulary.movements.get(label, NO_TIMES)
        once_s, rest_s, other_s = known.shortest_s, 0.0, 0.0
        if label in periodic:
            once_s = once_s if known.period_s is None else known.period_s
            rest_s = max(PAUSE_S if known.rest_s is None else known.rest_s, config.hold_s)
            turn_s = known.shortest_s or 0.0 if known.period_s is None else LONGEST_STAY * known.period_s
            other_s = max(rest_s, turn_s, 2 * config.hold_s)
        shortest_s = inf if known.shortest_s is None else known.shortest_s
        least_s = 0.0 if once_s is None else once_s / 2 - NOTICED_S
        over_s = least_s if known.shortest_s is None or label in periodic else 2 * known.shortest_s / 3 - NOTICED_S
        all_s = (shortest_s, least_s, over_s, rest_s, other_s)
        shortest_ns, least_ns, over_ns, rest_ns, other_ns = (s * SECOND_NS for s in all_s)
        durations[label] = Durations(shortest_ns, least_ns, over_ns, rest_ns, other_ns, label in periodic)
    return durations


def last_capture_ns(judgement: JudgementMessage) -> int:
    """The capture time of the newest posterior of the service that sent a judgement, by its votes; 0 without one."""
    if judgement.agreement.n:
        return judgement.at_ns
    ages_s = [vote.age_s for vote in judgement.votes.values() if vote.age_s is not None]
    return judgement.at_ns - round(max(min(ages_s), 0.0) * SECOND_NS) if ages_s else 0


def pooled_repetitions(posteriors: Iterable[AgedPosterior]) -> RepetitionCount | None:
    """The weighted median of the counts of these observers, rounded down; None: nobody counts.

    A view along the movement misses repetitions, so one weighs by its swing, from half to full; of three and more
    equally trusted no single one outweighs the others, whatever it counts.
    """
    counting = [(each, each.repetitions) for each in posteriors if each.repetitions is not None]
    if not counting:
        return None
    swings = [0.0 if each.repeated is None else each.repeated.swing for each, _ in counting]
    widest = max(swings) or 1.0
    weights = [
        each.reliability * each.freshness * (1.0 + swing / widest) / 2
        for (each, _), swing in zip(counting, swings, strict=True)
    ]
    count = floor(weighted_median([repetitions for _, repetitions in counting], weights))
    partials = [0.0 if each.repeated is None else each.repeated.partial for each, _ in counting]
    return RepetitionCount(count, min(floor(weighted_median(partials, weights)), count))


def weighted_median(values: Sequence[float], weights: Sequence[float]) -> float:
    """The value at which half of the weight is reached; the mean with the next one where it is reached exactly.

    Without any weight all count alike. values: at least one.
    """
    total = sum(weights)
    if total <= 0.0:
        weights, total = [1.0] * len(values), float(len(values))
    ordered, below = sorted(zip(values, weights, strict=True)), 0.0
    for place, (value, weight) in enumerate(ordered):
        below += weight
        # Sums of weights have round-off.
        if abs(2 * below - total) <= 1e-9 * total and place + 1 < len(ordered):
            return (value + ordered[place + 1][0]) / 2
        if 2 * below > total:
            return value
    return ordered[-1][0]


def repetition_fields(repetitions: RepetitionCount | None) -> dict[str, int | None]:
    """The repetitions as fields of a judgement or verdict; `partial_repetitions` is left out where it is 0."""
    done, partial = repetitions or (None, None)
    return {"repetitions": done, "partial_repetitions": partial or None}
