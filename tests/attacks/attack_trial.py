"""A trial of one hostile judge before the pure engine: recorded posteriors of the honest, and what it did to verdicts.
Posteriors are bytes, and pass the same ingest as in a fusion service; time is simulated."""

from dataclasses import dataclass, field

import numpy as np
from attack_strategies import STRATEGIES, Moment

from common import SECOND_NS
from common.config_sections import FusionConfig, default_quorum
from common.inbox import Arrival
from common.messages import PosteriorMessage, VocabularyReference
from common.vocabulary import ABSTAIN
from common.wire import encode
from fusion.engine.engine import FusionEngine
from fusion.ingest import PosteriorIngest

BEGAN_NS = 1_800_000_000 * SECOND_NS
STEP_HZ = 10
HOSTILE = "hostile"
HONEST = ("door", "corner", "wheel")
LAG_S = 0.8
"""A verdict belongs to a movement that was over so long before its begin at most: fusion notices late."""
KINDS = ("blocked", "turned", "doubled", "invented", "unended")
FORGET_S = 4.0
"""After the end of the film; every verdict has ended by then."""


@dataclass(frozen=True)
class Case:
    """One row: how many judges, the hostile one among them, at which rate, and how many of the honest are blind.
    slow_hz: the rate of the first honest one, if it is another."""

    strategy: str
    judges: int
    rate_hz: float
    blind: int = 0
    slow_hz: float | None = None

    @property
    def label(self):
        blind = f", {self.blind} blind" if self.blind else ""
        return f"{self.judges} judges, {self.rate_hz:g} Hz{blind}"


@dataclass(frozen=True)
class Harm:
    """What differs from the same trial without the hostile judge, by movement."""

    movements: int
    right: int
    blocked: list = field(default_factory=list)
    turned: list = field(default_factory=list)
    doubled: list = field(default_factory=list)
    invented: list = field(default_factory=list)
    unended: list = field(default_factory=list)

    @property
    def none(self):
        """Whether verdicts are as if the hostile judge were absent."""
        return not any(getattr(self, kind) for kind in KINDS)

    def __str__(self):
        parts = [f"{len(getattr(self, kind))} {kind}" for kind in KINDS if getattr(self, kind)]
        return ", ".join(parts) or "-"


@dataclass(frozen=True)
class Outcome:
    """Verdicts by id: label and span in seconds of the film, whether ended; and what is known of the hostile judge.
    about_rest: the least reliability about rest of each judge at any moment, of those that ever lost some."""

    verdicts: dict
    reliability: float | None
    rejected: dict
    states: set
    judgement: object
    statistics: dict
    about_rest: dict


def run(person, case):
    """The outcome of a case; with strategy "" the fourth judge is absent."""
    trial = _Trial(person, case)
    return trial.play()


class _Trial:
    def __init__(self, person, case):
        self.person, self.case = person, case
        honest = HONEST[: case.judges - 1]
        # The last are blind: one always sees.
        blind = set(honest[len(honest) - case.blind :]) if case.blind else set()
        self.courses = {name: person.course(name, name in blind) for name in honest}
        seeing = len(honest) - len(blind)
        config = FusionConfig(quorum=min(default_quorum(case.judges), seeing))
        self.engine = FusionEngine("dojo", [*honest, HOSTILE], person.vocabulary, config)
        self.now_ns = BEGAN_NS
        self.ingest = PosteriorIngest(self.engine)
        self.reference = VocabularyReference(name=person.vocabulary.name, hash=person.vocabulary.digest)
        self.own = person.course("side")
        self.hostile = STRATEGIES.get(case.strategy)
        self.messages, self.states, self.last, self.about_rest = [], set(), None, {}
        self.rates = dict.fromkeys((*honest, HOSTILE), case.rate_hz)
        self.rates[honest[0]] = case.slow_hz or case.rate_hz

    def play(self):
        rate = max(self.case.rate_hz, STEP_HZ)
        length_s = len(self.person.stream.positions) / self.person.stream.rate_hz
        sent = dict.fromkeys((*self.courses, HOSTILE), 0)
        for tick in range(round((length_s + FORGET_S) * rate)):
            at_s = tick / rate
            self.now_ns = BEGAN_NS + round(at_s * SECOND_NS)
            for n, name in enumerate(sent):
                # Each at its own moment, as cameras are.
                due = int(at_s * self.rates[name] - n / len(sent)) + 1
                if at_s < length_s and due > sent[name]:
                    sent[name] = due
                    self._send(name, due, at_s)
            output = self.engine.step(self.now_ns)
            self.messages += output.verdicts
            self.states.add(output.judgement.votes[HOSTILE].state)
            for name, vote in output.judgement.votes.items():
                if vote.rest_reliability is not None:
                    self.about_rest[name] = min(self.about_rest.get(name, 1.0), vote.rest_reliability)
            self.last = output.judgement
        return self._outcome()

    def _send(self, name, seq, at_s):
        frame = min(int(at_s * self.person.stream.rate_hz), len(self.person.stream.positions) - 1)
        key = f"laban/dojo/observer/{name}/posterior"
        if name != HOSTILE:
            self._take(key, self._honest(name, seq, self.courses[name], frame))
        elif self.hostile is not None:
            for payload in self.hostile(self._moment(seq, frame)):
                self._take(key, payload)

    def _take(self, key, payload):
        posteriors = self.ingest.read([Arrival(key, payload, self.now_ns)], self.now_ns)
        self.ingest.pass_on(posteriors, self.engine, self.now_ns)

    def _honest(self, name, seq, course, frame):
        unlearned = float(course.unlearned[frame])
        return encode(
            PosteriorMessage(
                v=1, scene="dojo", observer=name, seq=seq, session=name, captured_ns=self.now_ns, sent_ns=self.now_ns,
                vocabulary=self.reference, p=course.p[frame].tolist(), rest=float(course.rest[frame]), frames=seq,
                unlearned=None if np.isnan(unlearned) else unlearned, visible={"hand": bool(course.visible[frame])},
            )
        )  # fmt: skip

    def _moment(self, seq, frame):
        span = next((s for s in self.person.spans if s.start <= frame < s.end), None)
        label = None if span is None else self.person.vocabulary.labels.index(span.label)
        since_s = 0.0 if span is None else (frame - span.start) / self.person.stream.rate_hz
        own = self.own
        digest = self.person.vocabulary.digest
        return Moment(self.now_ns, seq, own.p[frame], own.rest[frame], label, since_s, digest, 1 / self.case.rate_hz)

    def _outcome(self):
        verdicts = {}
        for message in self.messages:
            end_ns = message.ended_ns or message.decided_ns
            span = tuple((at_ns - BEGAN_NS) / SECOND_NS for at_ns in (message.began_ns, end_ns))
            verdicts[message.id] = (message.label, span, message.ended_ns is not None)
        vote, rejected = self.last.votes[HOSTILE], dict(self.engine.roster.rejected[HOSTILE])
        statistics = self.ingest.statistics(list(self.last.votes))
        return Outcome(verdicts, vote.reliability, rejected, self.states, self.last, statistics, self.about_rest)


def compare(person, without, under, honest=None):
    """The harm that `under` shows beside the same trial `without` the hostile judge. honest: the trial in which it is
    honest too. What is so there as well, is no harm: its honest word counts."""
    harm = _compare(person, without, under)
    if honest is None:
        return harm
    other = _compare(person, honest, under)
    both = {kind: [each for each in getattr(harm, kind) if each in getattr(other, kind)] for kind in KINDS}
    return Harm(harm.movements, harm.right, **both)


def _compare(person, without, under):
    rate = person.stream.rate_hz
    spans = [(s.start / rate, s.end / rate, s.label) for s in person.spans]
    before, after = by_movement(spans, without.verdicts), by_movement(spans, under.verdicts)
    harm = Harm(
        len(spans), sum(label_of(ids, under.verdicts) == s[2] for s, ids in zip(spans, after[:-1], strict=True))
    )
    for number, (span, ids, known) in enumerate(zip(spans, after[:-1], before[:-1], strict=True)):
        label, expected = label_of(ids, under.verdicts), label_of(known, without.verdicts)
        if expected == span[2] and label in (None, ABSTAIN):
            harm.blocked.append(number)
        if label not in (None, ABSTAIN, expected, span[2]) and not is_in(without, first_of(ids, under), under):
            harm.turned.append(number)
        if len(ids) > max(len(known), 1):
            harm.doubled.append(number)
    harm.invented.extend(range(max(len(after[-1]) - len(before[-1]), 0)))
    harm.unended.extend(name for name, (_, _, ended) in under.verdicts.items() if not ended)
    return harm


def by_movement(spans, verdicts):
    """The ids of each movement's verdicts, and last of those that belong to none."""
    ids = [[] for _ in spans] + [[]]
    for name, (label, (began_s, ended_s), _) in verdicts.items():
        shares = [min(ended_s, end + LAG_S) - max(began_s, start) for start, end, _ in spans]
        best = int(np.argmax(shares))
        if shares[best] > 0:
            ids[best].append(name)
        elif label != ABSTAIN:
            ids[-1].append(name)
    return ids


def label_of(ids, verdicts):
    """The label of a movement: of its verdicts the first that is no abstention."""
    labels = [verdicts[name][0] for name in ids]
    return next((label for label in labels if label != ABSTAIN), labels[0] if labels else None)


def first_of(ids, outcome):
    """The verdict from which a movement has its label."""
    return next(name for name in ids if outcome.verdicts[name][0] == label_of(ids, outcome.verdicts))


def is_in(other, name, outcome):
    """Whether a verdict is in another outcome too: its label, for at least half of the shorter time. One between two
    movements may lie a tenth of a second within the next, and belong to none in the other outcome."""
    label, (began_s, ended_s), _ = outcome.verdicts[name]
    for known, (start_s, end_s), _ in other.verdicts.values():
        shared_s = min(ended_s, end_s) - max(began_s, start_s)
        if known == label and 2 * shared_s >= min(ended_s - began_s, end_s - start_s) > 0:
            return True
    return False
