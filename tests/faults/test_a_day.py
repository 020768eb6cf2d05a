"""A day of traffic: each verdict once, memory flat, no file descriptor more. LABANMESH_DAY_HOURS (24 for `make
soak-day`) and LABANMESH_DAY_RATE_HZ say how long and how dense it is."""

import os
from statistics import median

import pytest
from fault_day import NAMES, ROUND_S, run_day

HOURS = float(os.environ.get("LABANMESH_DAY_HOURS", "0.025"))
RATE_HZ = float(os.environ.get("LABANMESH_DAY_RATE_HZ", "5"))
GROWTH_KB = 12_000
"""Between the first tenth of the time and its end: what the allocator keeps; a leak of one posterior each is 50 MB."""


@pytest.mark.skipif(
    "LABANMESH_FAULTS" not in os.environ and "LABANMESH_DAY_HOURS" not in os.environ,
    reason="20 s of a busy machine for 90 s of traffic: in make faults, and for a whole day in make soak-day",
)
@pytest.mark.timeout(3 * 3600)
def test_a_day_of_traffic_leaves_nothing_behind():
    day = run_day(HOURS, RATE_HZ, HOURS / 48)
    print(day)
    expected = int(HOURS * 3600 / ROUND_S)
    assert expected > 3 and abs(len(day.verdicts) - expected) <= 1
    for number, published in enumerate(list(day.verdicts.values())[:expected]):
        label = NAMES.labels[number % NAMES.size]
        assert published == [(label, False), (label, True)] or number == expected - 1, (number, published)
    settled = [one for one in day.samples if one.hour >= HOURS / 10]
    assert max(one.rss_kb for one in settled) - settled[0].rss_kb < GROWTH_KB
    # Halves are compared: a query that is being answered is a thread for a moment, a look at sockets a descriptor.
    half = len(settled) // 2
    for count in ("descriptors", "threads"):
        before, after = (median(getattr(one, count) for one in part) for part in (settled[:half], settled[half:]))
        assert after <= before + 2, count
