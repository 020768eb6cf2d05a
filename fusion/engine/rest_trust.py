"""The trust in each observer's rest probability. Pure: time is passed in.

The design: fusion.md, "Who may say that the person rests".

An observer that says rest is at least 1/2 is on the side of rest, else on the side of motion. It may be wrong, stuck or
hostile. It loses trust if

1. it changes sides more often than people do (CHANGES_LIMIT in WINDOWS_S), and more than OFTENER times as often as the
   lower median of the others, all of which change sides often if the person moves in fits and starts;
2. it has not changed sides while the others did; one that changes too often is no other. Any change of the others
   takes trust at once, since a wrong side does harm. Its reliability loses only by changes that it missed: those that
   lasted for so long that two of its own frames (STAYED_S) might have shown them;
3. it is on another side than most of two or more others for much of the time. Of several others the lower median
   counts, so that one of them cannot lower the trust in another;
4. it and the only other contradict each other for much of the time, and its own posterior supports it less. A
   cumulative posterior learns while the person moves: each gain g of information adds g (1 - rest) to `right` and
   g rest to `wrong`, and evidence is e = right - wrong, 0 without a gain. Trust is the Bayes factor
   exp(EVIDENCE c (e - max e)) of its side against the other's, with c, 0 to 1, for how much they contradict.

If frames come late or seldom, sides are compared as of the capture of the oldest newest frame, so that lateness alone
is no contradiction. Between two frames on different sides an observer may have been on either: there its older frame is
compared with the others, and none of theirs with it.

If two contradict each other and none of this shows which is wrong, rest is `contested`. The mean trust in an observer
over the time in which it saw the person is its reliability about rest; votes publish it as `rest_reliability`.
"""

import math
from bisect import bisect_right
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from itertools import permutations

from common import SECOND_NS
from fusion.engine.roster import POOLED_STATES, AgedPosterior

SIGHTED = 0.2
"""The least freshness of an observer with which others are compared."""
WINDOWS_S, CHANGES_LIMIT = (3.0, 12.0), (6, 16)
"""Observers of recorded people change sides up to eight times in three seconds, seldom more than six; 16 in twelve."""
OFTENER, CHANGES_KEPT = 1.5, 32
STUCK_S, MISSED = 6.0, 4
"""An observer that changed sides before is stuck after so long, and so many changes of the others."""
MET_S = 1.0
"""One that never changed sides is stuck after so long; those that change too often are known by then."""
STAYED_S = 0.3
"""A change of another is missed if two frames so far apart show nothing of it: no turn, tail or blink of the other."""
DISSENT_S = 8.0
USUAL_DISSENT, DISSENT_RANGE = 0.25, 0.25
"""Observers of recorded people differ from one another in 6 to 12 % of the time, at most 20 % of eight seconds."""
LATE_S = 0.3
"""A frame older than this is late; at 4 Hz, none in time is."""
AGREED_S = 3.0
"""Imagined agreement of two that have just met."""
MOVEMENTS_KEPT, EVIDENCE, MOST_EVIDENCE = 4.0, 10.0, 0.5
"""Gains fade with so many movements, and count so much; an observer has no use for inventing more than half of one."""
CONTESTED, UNDECIDED = 0.2, 0.5
"""Rest is contested if two contradict each other so much (c), and are trusted alike to this factor."""
LEAST_TRUST = 0.05
RELIABILITY_S, RELIABLE = 8.0, 0.9
"""Trust is averaged over so long; observers of recorded people stay above .82, and those that lie fall below .1."""
REFRESH_S = 0.25
"""While no observer changes sides, trust is computed anew at this interval."""


@dataclass(slots=True)
class _Voter:
    """One observer's side, when it changed it (newest last), its information, and what was gained on each side.

    Times are those of capture, by our clock. captured_ns: of its newest frame. before_ns: of the last frame before each
    change, as far as frames were looked at. missed: changes of each other one since it changed sides itself.
    dissent: how much it lately differed from most of the others; contradiction: from the only other.
    """

    rests: bool
    information: float
    met_ns: int
    captured_ns: int = 0
    changed_ns: list[int] = field(default_factory=list)
    before_ns: list[int] = field(default_factory=list)
    missed: dict[str, "_MissedChanges"] = field(default_factory=dict)
    right: float = 0.0
    wrong: float = 0.0
    dissent: float = 0.0
    contradiction: float = 0.0
    compared_s: float = AGREED_S
    reliability: float = 1.0

    def note(self, posterior: AgedPosterior, now_ns: int) -> None:
        """Take its newest posterior."""
        rests = posterior.rest >= 0.5
        last_ns, self.captured_ns = self.captured_ns, now_ns - round(max(posterior.age_s or 0.0, 0.0) * SECOND_NS)
        if rests != self.rests:
            self.rests = rests
            self.missed.clear()
            self.changed_ns = [*self.changed_ns[1 - CHANGES_KEPT :], self.captured_ns]
            self.before_ns = [*self.before_ns[1 - CHANGES_KEPT :], last_ns]
        information = posterior.information
        gain, self.information = information - self.information, information
        if gain > 0.0:
            decay = math.exp(-gain / MOVEMENTS_KEPT)
            self.right = self.right * decay + gain * (1.0 - posterior.rest)
            self.wrong = self.wrong * decay + gain * posterior.rest

    def compare(self, others: Sequence["_Voter"], at_ns: int, seconds: float) -> None:
        """Note the side that it was on at `at_ns`, beside the others, for so long (3, 4)."""
        after = bisect_right(self.changed_ns, at_ns)
        if after < len(self.changed_ns):
            # Between two frames on different sides the first one speaks, as of its capture.
            at_ns = min(at_ns, self.before_ns[after])
        rests = self._side_before(after)
        sides = [side for other in others if (side := other.rested_at(at_ns)) is not None]
        if len(others) == 1 and sides:
            share = 1.0 - math.exp(-seconds / self.compared_s)
            self.compared_s = min(self.compared_s + seconds, DISSENT_S)
            self.contradiction += ((rests != sides[0]) - self.contradiction) * share
        elif len(sides) > 1 and 2 * (resting := sum(sides)) != len(sides):
            differs = rests != (2 * resting > len(sides))
            self.dissent += (differs - self.dissent) * (1.0 - math.exp(-seconds / DISSENT_S))

    def rested_at(self, at_ns: int) -> bool | None:
        """The side that it was on; None between two frames on different sides, when it may have been on either."""
        after = bisect_right(self.changed_ns, at_ns)
        if after < len(self.changed_ns) and self.before_ns[after] < at_ns:
            return None
        return self._side_before(after)

    def stay_at(self, at_ns: int) -> tuple[bool, int, int]:
        """The side that its frames show around `at_ns`, and when the first and the last of them were captured.

        The first is `at_ns` where it is not known.
        """
        after = bisect_right(self.changed_ns, at_ns)
        last_ns = self.before_ns[after] if after < len(self.changed_ns) else self.captured_ns
        return self._side_before(after), self.changed_ns[after - 1] if after else at_ns, last_ns

    def _side_before(self, change: int) -> bool:
        """The side that it was on before its change of that index."""
        return self.rests != ((len(self.changed_ns) - change) % 2 == 1)

    @property
    def evidence(self) -> float:
        """How much its own posterior supports its side (4): nats before EVIDENCE."""
        return min(self.right - self.wrong, MOST_EVIDENCE)

    def changes_since(self, since_ns: int) -> int:
        """How often it has changed sides."""
        return len(self.changed_ns) - bisect_right(self.changed_ns, since_ns)

    def calmness(self, now_ns: int, others: Sequence["_Voter"] = ()) -> float:
        """1, or less if it changes sides too often, also beside the others (1)."""
        fewest, longest_ns = CHANGES_LIMIT[0], round(WINDOWS_S[-1] * SECOND_NS)
        if len(self.changed_ns) <= fewest or self.changed_ns[-1 - fewest] <= now_ns - longest_ns:
            # The usual case: even the longest window holds no more than the shortest may.
            return 1.0
        calmness = 1.0
        for window_s, limit in zip(WINDOWS_S, CHANGES_LIMIT, strict=True):
            since_ns = now_ns - round(window_s * SECOND_NS)
            changes, theirs = self.changes_since(since_ns), sorted(other.changes_since(since_ns) for other in others)
            most = max(limit, OFTENER * theirs[(len(theirs) - 1) // 2]) if theirs else limit
            calmness *= 1.0 if changes <= most else (most / changes) ** 3
        return calmness

    def watch(self, name: str, other: "_Voter") -> None:
        """Note whether its newest frame shows that it missed a change of another (2)."""
        missed = self.missed.get(name)
        if missed is None:
            missed = self.missed[name] = _MissedChanges(other.stay_at(self.captured_ns)[0])
        missed.look(other, self.captured_ns)

    def liveliness(self, others: Mapping[str, "_Voter"], now_ns: int) -> tuple[float, float]:
        """Half for each change of the others that it has not made, and that it has missed, if it is no timing (2)."""
        last_ns, until_ns = self.changed_ns[-1] if self.changed_ns else None, self.captured_ns
        patience_s, allowed = (MET_S, 0) if last_ns is None else (STUCK_S, MISSED)
        if now_ns - (last_ns or self.met_ns) <= patience_s * SECOND_NS:
            return 1.0, 1.0
        since_ns, half = last_ns or self.met_ns, (len(others) - 1) // 2
        calm = {name: other for name, other in others.items() if other.calmness(now_ns) == 1.0}
        rest = [0] * (len(others) - len(calm))
        made = [other.changes_since(since_ns) - other.changes_since(until_ns) for other in calm.values()]
        shown = [self.missed[name].count if name in self.missed else 0 for name in calm]
        not_made, missed = (max(sorted(counts + rest)[half] - allowed, 0) for counts in (made, shown))
        return float(0.5**not_made), float(0.5**missed)


@dataclass(slots=True)
class _MissedChanges:
    """How often another has changed sides since an observer did, and the observer's own frames might have shown it.

    rests: the side of the other that the observer's frames have shown last. first_ns: its first frame since the other
    left that side.
    """

    rests: bool
    count: int = 0
    first_ns: int = 0

    def look(self, other: _Voter, at_ns: int) -> None:
        """A frame of the observer, captured at `at_ns`, shows no change."""
        rests, began_ns, last_ns = other.stay_at(at_ns)
        if rests == self.rests or min(last_ns, at_ns) - began_ns < STAYED_S * SECOND_NS:
            return
        if self.first_ns == 0:
            self.first_ns = at_ns
        elif at_ns - self.first_ns >= STAYED_S * SECOND_NS:
            self.rests, self.count, self.first_ns = rests, self.count + 1, 0


class RestTrust:
    """The trust in each observer's rest probability; `update` takes one step."""

    def __init__(self) -> None:
        self.contested = False
        """Whether two observers contradict each other, and nothing shows which of them is wrong."""
        self.reliability: Mapping[str, float] = {}
        """Mean trust in the observers lately, of those below RELIABLE."""
        self._voters: dict[str, _Voter] = {}
        self._sides: list[bool | None] = []
        self._names: list[str] = []
        self._trust: list[float] = []
        self._now_ns = 0

    def update(self, posteriors: Sequence[AgedPosterior], now_ns: int) -> list[float]:
        """The trust in each posterior of this step, LEAST_TRUST to 1."""
        sides = [posterior.rest >= 0.5 if _is_sighted(posterior) else None for posterior in posteriors]
        elapsed_ns = now_ns - self._now_ns
        if sides == self._sides and 0 <= elapsed_ns < REFRESH_S * SECOND_NS:
            return self._trust
        if elapsed_ns < 0:
            self._voters.clear()
        self._now_ns = now_ns
        # Until now the sides were those of the last update.
        seconds = min(max(elapsed_ns / SECOND_NS, 0.0), 1.0)
        self._compare(now_ns - elapsed_ns, seconds)
        sighted = [posterior for posterior, side in zip(posteriors, sides, strict=True) if side is not None]
        for posterior in sighted:
            name = posterior.observer
            if name not in self._voters:
                self._voters[name] = _Voter(posterior.rest >= 0.5, posterior.information, now_ns)
            self._voters[name].note(posterior, now_ns)
        self._sides, self._names = sides, [posterior.observer for posterior in sighted]
        self._watch()
        both = {posterior.observer: self._trust_in(posterior.observer, now_ns) for posterior in posteriors}
        self._trust = [trust for trust, _ in both.values()]
        self.contested, self.reliability = self._is_contested(both), self._reliability(both, seconds)
        return self._trust

    def _watch(self) -> None:
        """Note which changes of the others each observer has missed."""
        for name, other in permutations(self._names, 2):
            self._voters[name].watch(other, self._voters[other])

    def _compare(self, last_ns: int, seconds: float) -> None:
        """Compare the sides since the last update: of `last_ns`, or of the oldest frame if that came late."""
        at_ns = min((self._voters[name].captured_ns for name in self._names if name in self._voters), default=0)
        at_ns = last_ns if last_ns - at_ns < LATE_S * SECOND_NS else at_ns
        for voter, others in self._pairings():
            voter.compare(others, at_ns, seconds)

    def _pairings(self) -> Iterator[tuple[_Voter, list[_Voter]]]:
        """Each observer that sees the person, with the others that do, if there are any."""
        sighted = [self._voters[name] for name in self._names if name in self._voters]
        for voter in sighted if len(sighted) > 1 else ():
            yield voter, [other for other in sighted if other is not voter]

    def _trust_in(self, observer: str, now_ns: int) -> tuple[float, float]:
        """The trust in its side, and that of which its reliability is the mean."""
        voter = self._voters.get(observer)
        others = {name: self._voters[name] for name in self._names if name != observer}
        if voter is None or not others:
            return 1.0, 1.0
        not_made, missed = voter.liveliness(others, now_ns)
        trust = voter.calmness(now_ns, list(others.values())) * (1.0 - _excess(voter.dissent))
        if len(others) == 1:
            behind = max(next(iter(others.values())).evidence - voter.evidence, 0.0)
            trust *= math.exp(-EVIDENCE * behind * _excess(voter.contradiction))
        return max(trust * not_made, LEAST_TRUST), max(trust * missed, LEAST_TRUST)

    def _is_contested(self, trust: Mapping[str, tuple[float, float]]) -> bool:
        if len(self._names) != 2:
            return False
        contradiction = min(self._voters[name].contradiction for name in self._names)
        low, high = sorted(trust[name][0] for name in self._names)
        return _excess(contradiction) >= CONTESTED and low >= UNDECIDED * high

    def _reliability(self, trust: Mapping[str, tuple[float, float]], seconds: float) -> dict[str, float]:
        share = 1.0 - math.exp(-seconds / RELIABILITY_S)
        for name in self._names:
            voter = self._voters[name]
            voter.reliability += (trust[name][1] - voter.reliability) * share
        return {name: round(v.reliability, 3) for name, v in self._voters.items() if v.reliability < RELIABLE}


def _excess(dissent: float) -> float:
    """How much more two differ than honest observers do, 0 to 1."""
    return min(max(dissent - USUAL_DISSENT, 0.0) / DISSENT_RANGE, 1.0)


def _is_sighted(posterior: AgedPosterior) -> bool:
    return posterior.state in POOLED_STATES and posterior.freshness >= SIGHTED
