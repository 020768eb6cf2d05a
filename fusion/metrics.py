"""What a fusion service counts for Prometheus: steps, votes, weights, verdicts, refusals, and whether it leads."""

from collections import Counter as Tally
from collections.abc import Callable, Iterable, Sequence
from typing import TYPE_CHECKING, get_args

from common.messages import JudgementMessage, StatusMessage, VoteState
from common.metrics import AGE_BUCKETS, OTHERS, STEP_BUCKETS, Metrics
from common.vocabulary import ABSTAIN

if TYPE_CHECKING:
    from prometheus_client import Metric

    from fusion.telling import Step

HEARD = ("counted", "stale")


class FusionMetrics(Metrics):
    """Of one fusion service of a scene; labels: the movements that it can decide for."""

    def __init__(
        self, scene: str, fusion: str, labels: Sequence[str], status: Callable[[], StatusMessage] | None
    ) -> None:
        super().__init__("fusion", {"scene": scene, "fusion": fusion}, status)
        self._judgement: JudgementMessage | None = None
        self._leads, self._dropped = False, 0
        # From the first scrape on every label is there, so that the first verdict is seen as an increase.
        self._verdicts = Tally(dict.fromkeys((*labels, ABSTAIN), 0))
        self._steps = self.histogram("fusion_step_seconds", "One step: hearing, weighing, judging.", STEP_BUCKETS)
        self._arrived = self.counter("posteriors_received", "Posteriors that arrived, used or not.")
        self._read = self.counter("posteriors_read", "Posteriors that were read: of a flood only the newest are.")
        self._delay = self.histogram("verdict_delay_seconds", "From a movement's begin to its decision.", AGE_BUCKETS)

    def step(self, step: "Step") -> None:
        """One step of the loop; of its verdicts each movement counts once, by its last word."""
        self._judgement = step.ruling.judgement if step.ruling is not None else self._judgement
        self._leads, self._dropped = step.leads, step.dropped
        self._arrived.inc(step.arrived)
        self._read.inc(step.read)
        self._steps.observe(step.took_s)
        for verdict in step.said:
            if verdict.ended_ns is not None:
                self._verdicts[verdict.label] += 1
                self._delay.observe((verdict.decided_ns - verdict.began_ns) / 1e9)

    def collect_own(self, status: StatusMessage | None) -> "Iterable[Metric]":
        """The last judgement and what was noticed of the observers, as of now."""
        dropped = [((), float(self._dropped))]
        yield self.total("posteriors_dropped", "Posteriors that came faster than they could be judged.", dropped)
        yield self.gauge("leading", "1 while this service is the one that speaks.", [((), float(self._leads))])
        verdicts = [((label,), float(count)) for label, count in self._verdicts.items()]
        yield self.total("verdicts", "Movements that have ended, by their verdict.", verdicts, "label")
        if self._judgement is not None:
            yield from self._of(self._judgement)
        if status is not None and status.observers is not None and self._judgement is not None:
            yield from self._noticed(status, self._judgement)

    def _of(self, judgement: JudgementMessage) -> "Iterable[Metric]":
        yield self.gauge("entropy_bits", "Of the pooled belief: 0 is certain.", [((), judgement.certainty_bits)])
        agreeing = float(judgement.agreement.k)
        yield self.gauge("agreeing_observers", "How many hold the pooled label themselves.", [((), agreeing)])
        states = Tally(vote.state for vote in judgement.votes.values())
        rows = [((state,), float(states[state])) for state in get_args(VoteState)]
        yield self.gauge("votes", "How many observers were heard in each state.", rows, "state")
        votes = judgement.votes.items()
        heard = [((name,), float(vote.state in HEARD)) for name, vote in votes]
        yield self.gauge("observer_heard", "1 while the observer's opinion counts, also if stale.", heard, "observer")
        entropies = [((name,), vote.entropy) for name, vote in votes]
        yield self.gauge("observer_entropy_bits", "Of the observer's belief as pooled.", entropies, "observer")
        weights = [((name,), vote.weight) for name, vote in votes]
        yield self.gauge("observer_weight_ratio", "Its share in the pooled belief.", weights, "observer")
        ages = [((name,), vote.age_s) for name, vote in votes]
        yield self.gauge("observer_age_seconds", "Since its newest frame was captured.", ages, "observer")
        skews = [((name,), vote.skew_s) for name, vote in votes]
        yield self.gauge("observer_clock_skew_seconds", "How far its clock is ahead of ours.", skews, "observer")

    def _noticed(self, status: StatusMessage, judgement: JudgementMessage) -> "Iterable[Metric]":
        """Observers that are not of the scene are counted together: anybody may invent names."""
        refused: Tally[tuple[str, str]] = Tally()
        for name, account in (status.observers or {}).items():
            for reason, count in account.rejected.items():
                refused[name if name in judgement.votes else OTHERS, reason] += count
        rows = [(names, float(count)) for names, count in refused.items()]
        yield self.total("posteriors_rejected", "Posteriors that could not be used.", rows, "observer", "reason")
