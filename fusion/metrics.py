"""Metrics of a fusion service for Prometheus: steps, votes, weights, verdicts, rejections, ownership."""

from collections import Counter as Tally
from collections.abc import Callable, Iterable, Sequence
from time import time_ns
from typing import TYPE_CHECKING, get_args

from common import SECOND_NS
from common.messages import JudgementMessage, StatusMessage, VerdictMessage, Vote, VoteState
from common.metrics import AGE_BUCKETS, OTHERS, STEP_BUCKETS, Metrics
from common.vocabulary import ABSTAIN
from fusion.engine.roster import POOLED_STATES

if TYPE_CHECKING:
    from prometheus_client import Metric

    from fusion.instrumentation import ServerStep
    from fusion.membership import SceneMember


OF_VOTES: Sequence[tuple[str, str, Callable[[Vote], float | None]]] = (
    ("heard", "1 while the observer's posterior counts, even if stale.", lambda v: float(v.state in POOLED_STATES)),
    ("entropy_bits", "Of the observer's posterior as pooled.", lambda v: v.entropy),
    ("weight_ratio", "Its share in the pooled posterior.", lambda v: v.weight),
    ("age_seconds", "Since its newest frame was captured.", lambda v: v.age_s),
    ("reliability_ratio", "How far its labels were trusted lately.", lambda v: _trust(v.label_reliability)),
    ("rest_reliability_ratio", "How far its probability of rest was trusted lately.",
     lambda v: _trust(v.rest_reliability)),
    ("clock_skew_seconds", "How far its clock is ahead of ours.", lambda v: v.skew_s),
)  # fmt: skip
"""A gauge of each observer: its name, its meaning, and its value in a vote."""


def _trust(published: float | None) -> float:
    """Where none is published the trust is whole."""
    return 1.0 if published is None else published


class FusionMetrics(Metrics):
    """The metrics of one fusion service `own`.

    only: its scene if it has one; then there are metrics of each observer and of verdicts by label. With many scenes
    the number of series does not grow.
    """

    def __init__(self, own: str, only: "SceneMember | None") -> None:
        status = None if only is None else lambda: only.status.status(time_ns())
        super().__init__(
            "fusion", {"fusion": own} if only is None else {"scene": only.scene.scene, "fusion": own}, status
        )
        self._only = only
        self._owned, self._dropped = 0, 0
        self._verdicts: Tally[str] = Tally()
        self._decided: dict[str, str] = {}
        name = "fusion_round_seconds" if only is None else "fusion_step_seconds"
        self._steps = self.histogram(name, "One step of the loop: receive, pool, decide.", STEP_BUCKETS)
        self._received = self.counter("posteriors_received", "Posteriors that arrived, used or not.")
        self._read = self.counter("posteriors_read", "Posteriors that were read: of a flood only the newest are.")
        self._ended = self.counter("movements_ended", "Movements that have ended, in all scenes of this service.")
        self._revised = self.counter("verdicts_revised", "Decided labels that another label replaced.")
        self._delay = self.histogram(
            "verdict_delay_seconds", "From a movement's begin to its first decision.", AGE_BUCKETS
        )

    def record(self, step: "ServerStep") -> None:
        """Count one step of the loop; each movement counts once, by its last word."""
        self._owned, self._dropped = step.owned, step.dropped
        self._received.inc(step.received)
        self._read.inc(step.read)
        self._steps.observe(step.took_s)
        for verdict in step.published:
            self._record(verdict)

    def _record(self, verdict: VerdictMessage) -> None:
        judged = f"{verdict.scene}/{verdict.person or ''}"
        if self._decided.get(judged) != verdict.id:
            self._delay.observe((verdict.decided_ns - verdict.began_ns) / SECOND_NS)
            self._decided[judged] = verdict.id
        self._revised.inc(verdict.stage == "revised")
        if verdict.stage == "ended":
            self._verdicts[verdict.label] += 1
            self._ended.inc()

    def collect_own(self, status: StatusMessage | None) -> "Iterable[Metric]":
        """The last judgement and the present state of the observers."""
        yield self.gauge("scenes_judged", "Scenes that this service owns now.", [((), float(self._owned))])
        dropped = [((), float(self._dropped))]
        yield self.total("posteriors_dropped", "Posteriors that arrived faster than they could be fused.", dropped)
        if self._only is None:
            return
        yield self.gauge("leading", "1 while this service is the one that publishes.", [((), float(self._owned))])
        # Every label is there from the first scrape on, so that the first verdict is an increase.
        # Those of a vocabulary from before stay, as counters must.
        current = self._only.vocabulary.labels if self._only.vocabulary is not None else ()
        labels = dict.fromkeys((*current, ABSTAIN, *self._verdicts))
        verdicts = [((label,), float(self._verdicts[label])) for label in labels]
        yield self.total("verdicts", "Movements that have ended, by their verdict.", verdicts, "label")
        judgement = None if self._only.worker is None else self._only.worker.judgement
        if judgement is not None:
            yield from self._of(judgement)
            if status is not None and status.observers is not None:
                yield from self._rejected(status, judgement)

    def _of(self, judgement: JudgementMessage) -> "Iterable[Metric]":
        yield self.gauge("entropy_bits", "Of the pooled posterior: 0 is certain.", [((), judgement.certainty_bits)])
        agreeing = [((), float(judgement.agreement.k))]
        yield self.gauge("agreeing_observers", "Observers whose own label is the pooled label.", agreeing)
        states = Tally(vote.state for vote in judgement.votes.values())
        rows = [((state,), float(states[state])) for state in get_args(VoteState)]
        yield self.gauge("votes", "Observers in each state.", rows, "state")
        for name, meaning, value in OF_VOTES:
            values = [((observer,), value(vote)) for observer, vote in judgement.votes.items()]
            yield self.gauge(f"observer_{name}", meaning, values, "observer")

    def _rejected(self, status: StatusMessage, judgement: JudgementMessage) -> "Iterable[Metric]":
        """Senders that are not observers of the scene are counted together, because any process may invent names."""
        rejected: Tally[tuple[str, str]] = Tally()
        for name, statistics in (status.observers or {}).items():
            for reason, count in statistics.rejected.items():
                rejected[name if name in judgement.votes else OTHERS, reason] += count
        rows = [(names, float(count)) for names, count in rejected.items()]
        yield self.total("posteriors_rejected", "Posteriors that could not be used.", rows, "observer", "reason")
