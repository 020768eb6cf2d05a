"""A line that is repeated without end is counted, and not written each time."""

import io
import logging

import pytest

from common.log_limit import INFOS, KINDS_LIMIT, PERIOD_S, WARNINGS, LimitedHandler


class Clock:
    now_s = 100.0

    def __call__(self):
        return self.now_s


@pytest.fixture
def clock():
    return Clock()


@pytest.fixture
def log(clock):
    stream = io.StringIO()
    logger = logging.Logger("labanmesh.test", logging.DEBUG)
    logger.addHandler(LimitedHandler(stream, ticks=clock))
    logger.lines = lambda: stream.getvalue().splitlines()
    return logger


def test_a_line_without_end_is_counted(log, clock):
    for n in range(533):
        log.warning("no descriptors left for 10.0.0.%d: 100 %%", n % 7)
    assert len(log.lines()) == WARNINGS and log.lines()[0] == "no descriptors left for 10.0.0.0: 100 %"
    log.info("another line")
    clock.now_s += PERIOD_S
    log.warning("no descriptors left for 10.0.0.%d: 100 %%", 9)
    assert log.lines()[WARNINGS:] == [
        "another line",
        "no descriptors left for 10.0.0.0: 100 % ... repeated 523 times in 10 s",
        "no descriptors left for 10.0.0.9: 100 %",
    ]


def test_what_was_counted_is_told_at_the_end(log):
    for _ in range(WARNINGS + 1):
        log.error("broken")
    log.handlers[0].close()
    assert log.lines()[WARNINGS:] == ["broken ... repeated 1 time in 10 s"]


def test_verdicts_and_debug_lines_are_all_written(log):
    for n in range(INFOS + 5):
        log.info("verdict %d", n, extra={"verdict": str(n)})
        log.debug("detail")
    assert len(log.lines()) == 2 * (INFOS + 5)


def test_lines_that_are_all_different_are_counted_together(log, clock):
    for n in range(KINDS_LIMIT * 3):
        log.warning(f"junk {n}")
    assert len(log.lines()) == KINDS_LIMIT + WARNINGS
    clock.now_s += PERIOD_S
    log.warning("next")
    assert any("repeated 990 times" in line for line in log.lines())
