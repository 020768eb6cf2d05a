"""What one posterior costs with a thousand SIMULATED observers beside what it costs with four: rows of `make bench`."""

import tempfile
from collections.abc import Iterator
from pathlib import Path

from benchmarks.crowd.play import JUDGES
from benchmarks.crowd.trial import Plan, run
from benchmarks.timing import Row, row

SECONDS = 10.0
FEW, MANY = 1, 250
"""Scenes, of four observers each."""


def rows(seconds: float = SECONDS) -> Iterator[Row]:
    """Processor time of the fusion process for each posterior, and how old judgements are at the 99th percentile."""
    few, many = (_run(scenes, seconds) for scenes in (FEW, MANY))
    observers = f"{many[2]} observers, floor: {few[2]}"
    yield row(f"one posterior, {observers}", many[0], few[0], "us", 1)
    yield row(f"age of a judgement, p99, {observers}", many[1], few[1], "ms", 1)


def _run(scenes: int, seconds: float) -> tuple[float, float, int]:
    with tempfile.TemporaryDirectory() as folder:
        outcome = run(Plan(scenes, 30.0, seconds), Path(folder), lambda line: None)
    return outcome.cpu_per_posterior_us, outcome.age_p99_ms, scenes * JUDGES
