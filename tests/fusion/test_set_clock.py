"""The clock of the fusion machine is set within a movement: no verdict is lost, doubled or turned."""

from itertools import chain

import pytest
from engine_stage import LABELS, UNIFORM, EngineDriver, message, sure

from common import SECOND_NS
from common.clock_skew import ClockReading
from fusion.server import SteadyClock

TICK_NS = SECOND_NS // 15
JUMPS_S = [-3600.0, -0.5, -0.05, 3.0, 3600.0]
MOVING, REST = 20, 20
"""Ticks of each movement, and of the rest after it."""


class Machine:
    """A wall clock that is set once, at a tick, and ticks that go on."""

    def __init__(self, jump_s, at_tick):
        self.jump_ns, self.at_tick, self.tick = round(jump_s * SECOND_NS), at_tick, 0

    def ticks_ns(self):
        return 5_000 * SECOND_NS + self.tick * TICK_NS

    def wall_ns(self):
        return self.ticks_ns() + 10**18 + (self.jump_ns if self.tick >= self.at_tick else 0)


def verdicts(jump_s, at_tick, *, on_this_machine, movements=LABELS[:2]):
    """Labels and stages of the verdicts; the loop of the server, with observers at 15 Hz and their clocks read."""
    machine, scene = Machine(jump_s, at_tick), EngineDriver(["door", "wheel", "table"], quorum=2)
    clock, at_rest = SteadyClock(machine.wall_ns, machine.ticks_ns), True
    story = chain([(UNIFORM, 0.95)] * 15, *([(sure(m), 0.05)] * MOVING + [(UNIFORM, 0.95)] * REST for m in movements))
    for machine.tick, (p, rest) in enumerate(story):
        shown_ns = machine.wall_ns() if on_this_machine else machine.ticks_ns() + 10**18
        for observer in ("door", "wheel", "table"):
            if machine.tick % 15 == 0:
                scene.engine.roster.record_clock(observer, ClockReading(clock(), shown_ns, clock()))
            posterior = message(shown_ns, observer=observer, seq=machine.tick, session=observer, p=p, rest=rest)
            scene.engine.receive(observer, posterior, clock())
        output = scene.engine.step(clock())
        scene.verdicts += output.verdicts
        at_rest = output.judgement.movement is None
        if machine.tick % 15 == 14 and at_rest:
            clock.follow()
    ids = dict.fromkeys(verdict.id for verdict in scene.verdicts)
    return [(v.label, v.stage, list(ids).index(v.id)) for v in scene.verdicts]


EXPECTED = [(label, stage, n) for n, label in enumerate(LABELS[:2]) for stage in ("decided", "ended")]
WHEN = {"in a movement": 24, "before the next": 54}


@pytest.mark.parametrize("on_this_machine", [True, False], ids=["observers here", "observers elsewhere"])
@pytest.mark.parametrize("at_tick", WHEN.values(), ids=WHEN)
@pytest.mark.parametrize("jump_s", JUMPS_S)
def test_a_clock_that_is_set_loses_and_doubles_no_verdict(jump_s, at_tick, on_this_machine):
    assert verdicts(jump_s, at_tick, on_this_machine=on_this_machine) == EXPECTED
