"""The rows of `make bench` that have a goal: how fast the processes are, as medians of three runs.

Each part is measured alone; one that cannot be, on this machine, says why.
"""

from collections.abc import Iterator, Sequence

from benchmarks import flood, fusion, mesh, starting
from benchmarks.posteriors import engine_of, message, random_posteriors, scene_of
from benchmarks.timing import BenchmarkRow, medians, row
from common.messages import PosteriorMessage
from common.wire import encode

RUNS = 3
LATENCY_FRAMES = 180
STEP_BATCH_S = 0.005
OBSERVERS = 4
MOST_BYTES = 900
NOW_NS = 1_800_000_000_000_000_000
"""A present-day time: its size on the wire counts."""


def step_rows() -> Iterator[BenchmarkRow]:
    """One step of fusion: messages to judgement, the pool alone, bytes to bytes."""
    yield from medians([fusion.pace_rows(batch_s=STEP_BATCH_S) for _ in range(RUNS)])


def latency_rows() -> Iterator[BenchmarkRow]:
    """What our way costs over bare Zenoh's, from a posterior put to the judgement received: median and p99."""
    yield from medians([mesh.pace_rows(OBSERVERS, LATENCY_FRAMES) for _ in range(RUNS)])


def flood_rows() -> Iterator[BenchmarkRow]:
    """Posteriors a second into one process."""
    return flood.flood_rows()


def sharing_rows() -> Iterator[BenchmarkRow]:
    """Two processes against one."""
    yield flood.sharing_row()


def start_rows() -> Iterator[BenchmarkRow]:
    """Start of commands."""
    return starting.rows()


def size_rows() -> Iterator[BenchmarkRow]:
    """Bytes of a judgement of 4 observers and 20 movements; floor: the posterior alone in single precision."""
    name, posteriors = f"a judgement, {OBSERVERS} observers, 20 movements", random_posteriors(OBSERVERS)
    floor = 4 * posteriors.shape[1]
    bare = [message(1, NOW_NS, p, facets=0, unlearned=None) for p in posteriors]
    yield row(name, _judgement_bytes(bare), floor, "bytes", 1, MOST_BYTES)
    whole = [message(1, NOW_NS, p) for p in posteriors]
    yield row(f"{name}, Shape and something else", _judgement_bytes(whole), floor, "bytes", 1)


def _judgement_bytes(messages: Sequence[PosteriorMessage]) -> int:
    """The size of the first judgement."""
    engine = engine_of(scene_of(OBSERVERS))
    for n, own in enumerate(messages, 1):
        engine.receive(f"cam{n}", own, NOW_NS)
    return len(encode(engine.step(NOW_NS + 5_000_000).judgement))
