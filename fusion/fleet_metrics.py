"""What a fusion process of many scenes counts for Prometheus; of each scene its status and judgements tell more."""

from collections.abc import Iterable
from typing import TYPE_CHECKING

from common.messages import StatusMessage
from common.metrics import STEP_BUCKETS, Metrics

if TYPE_CHECKING:
    from prometheus_client import Metric

    from fusion.fleet_telling import Round


class FleetMetrics(Metrics):
    """Of one process; the number of its series does not grow with its scenes."""

    def __init__(self, fusion: str) -> None:
        super().__init__("fusion", {"fusion": fusion}, None)
        self._judged = 0
        self._rounds = self.histogram(
            "fusion_round_seconds", "One round: hearing all, judging who is due.", STEP_BUCKETS
        )
        self._arrived = self.counter("posteriors_received", "Posteriors that arrived, used or not.")
        self._ended = self.counter("movements_ended", "Movements that have ended, in all scenes judged here.")

    def round(self, taken: "Round") -> None:
        """One round of the loop."""
        self._judged = taken.judged
        self._rounds.observe(taken.took_s)
        self._arrived.inc(taken.arrived)
        self._ended.inc(len(taken.ended))

    def collect_own(self, status: StatusMessage | None) -> "Iterable[Metric]":
        """Which share is judged here, as of now."""
        yield self.gauge("scenes_judged", "Scenes that this process judges now.", [((), float(self._judged))])
