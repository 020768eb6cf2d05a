"""Metrics that every process exports to Prometheus, in its text format. Names: docs/reference/metrics.md.

1. A name is labanmesh_, the quantity, and its unit (seconds, bits, ratio); the name of a counter ends in _total.
2. Labels are the scene, the process, the scene's own observers, and words of a fixed set: names that strangers invent
   are counted together, under OTHERS.
3. Values that exist anyway (the last judgement, the status) are read on request, not written at every step.
"""

from collections.abc import Callable, Iterable, Mapping
from typing import TypeVar, get_args

from prometheus_client import (
    CollectorRegistry,
    Counter,
    GCCollector,
    Histogram,
    Metric,
    PlatformCollector,
    ProcessCollector,
    disable_created_metrics,
)
from prometheus_client.exposition import choose_encoder
from prometheus_client.metrics_core import CounterMetricFamily, GaugeMetricFamily
from prometheus_client.registry import Collector

from common import SECOND_NS
from common.messages import ProcessRole, ProcessState, StatusMessage

STEP_BUCKETS = (0.0005, 0.001, 0.0025, 0.005, 0.01, 0.025, 0.05, 0.1, 0.25, 0.5, 1.0)
"""Seconds: a step of fusion takes a millisecond, of an observer with a pose model a tenth of a second."""
AGE_BUCKETS = (0.005, 0.01, 0.025, 0.05, 0.1, 0.2, 0.5, 1.0, 2.0, 5.0)
"""Seconds; the defaults of fusion.fresh_s and fusion.drop_s are among them."""
OTHERS = "(others)"
"""Stands for all processes that are not in the scene; ids have no brackets."""

# The time of a counter's creation would be one more series each, which nothing uses.
disable_created_metrics()  # type: ignore[no-untyped-call]
Rows = Iterable[tuple[tuple[str, ...], float | None]]
Family = TypeVar("Family", bound=GaugeMetricFamily | CounterMetricFamily)


class Metrics(Collector):
    """One process's registry: its identity, memory, CPU and state, and what a subclass adds by `collect_own`.

    names: the labels of every series, e.g. scene and observer. status: returns the present status.
    """

    def __init__(
        self, role: ProcessRole, names: Mapping[str, str], status: Callable[[], StatusMessage] | None = None
    ) -> None:
        self._role, self._names, self._status = role, dict(names), status
        self.registry = CollectorRegistry()
        ProcessCollector(registry=self.registry)
        PlatformCollector(registry=self.registry)
        GCCollector(registry=self.registry)
        self.registry.register(self)

    def exposition(self, accept: str) -> tuple[bytes, str]:
        """All metrics as text in the format that the Accept header prefers, and the content type."""
        encode, kind = choose_encoder(accept)
        return encode(self.registry), kind

    def counter(self, name: str, meaning: str) -> Counter:
        """A counter; `_total` is appended to its name."""
        return Counter(f"labanmesh_{name}", meaning, [*self._names], registry=self.registry).labels(**self._names)

    def histogram(self, name: str, meaning: str, buckets: Iterable[float]) -> Histogram:
        """A histogram with these upper bounds of the buckets."""
        bounds = tuple(buckets)
        whole = Histogram(f"labanmesh_{name}", meaning, [*self._names], buckets=bounds, registry=self.registry)
        return whole.labels(**self._names)

    def gauge(self, name: str, meaning: str, rows: Rows, *labels: str) -> GaugeMetricFamily:
        """A gauge with one row per value of `labels`; rows of None are left out."""
        return self._family(GaugeMetricFamily, name, meaning, rows, labels)

    def total(self, name: str, meaning: str, rows: Rows, *labels: str) -> CounterMetricFamily:
        """A counter whose values are counted elsewhere."""
        return self._family(CounterMetricFamily, name, meaning, rows, labels)

    def _family(self, kind: type[Family], name: str, meaning: str, rows: Rows, labels: tuple[str, ...]) -> Family:
        family = kind(f"labanmesh_{name}", meaning, labels=[*self._names, *labels])
        for values, number in rows:
            if number is not None:
                family.add_metric([*self._names.values(), *values], number)
        return family

    def collect(self) -> Iterable[Metric]:
        """The values that are read on request; called by the registry."""
        status = self._status() if self._status is not None else None
        if status is not None:
            states = [((state,), float(status.state == state)) for state in get_args(ProcessState)]
            yield self.gauge("state", "1 for the state that the process is in, 0 for the others.", states, "state")
            version = ((self._role, status.version), 1.0)
            yield self.gauge("info", "Always 1; which role and version this is.", [version], "role", "version")
        yield from self.collect_own(status)

    def collect_own(self, status: StatusMessage | None) -> Iterable[Metric]:
        """The metrics that a subclass adds; status: the present one."""
        return ()


def seconds(time_ns: int | None) -> float | None:
    """A time in ns as Prometheus expects it, in seconds."""
    return None if time_ns is None else time_ns / SECOND_NS
