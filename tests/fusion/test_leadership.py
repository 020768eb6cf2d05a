"""Who leads: one test a rule, and any number of services over a network that loses what it likes."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from fusion.leadership import Leadership

S = 1_000_000_000
TAKEOVER_S = 0.5
STEP = S // 10
BOTH = frozenset({"a", "b"})


class Hall:
    """Fusion services that step every tenth of a second; who is dead or stopped neither steps nor speaks."""

    def __init__(self, names="ab"):
        self.names, self.now = frozenset(names), 1000 * S
        self.made, self.alive, self.stopped = {}, set(), set()
        self.speakers = []
        for name in names:
            self.start(name)

    def start(self, name):
        self.made[name] = Leadership(name, self.names, TAKEOVER_S)
        self.alive.add(name)
        self.stopped.discard(name)

    def step(self, n=1):
        for _ in range(n):
            self.now += STEP
            stepping = sorted(self.alive - self.stopped)
            for name in stepping:
                self.made[name].present(frozenset(self.alive), self.now)
            self.speakers = [name for name in stepping if self.made[name].leads(self.now)]
            for speaker in self.speakers:
                for name in stepping:
                    if name != speaker:
                        self.made[name].heard(speaker, self.now)
        return self.speakers


def test_rule_1_after_a_moment_of_listening_exactly_the_first_by_name_speaks():
    hall = Hall("cab")
    assert [hall.step() for _ in range(5)] == [[]] * 5
    assert hall.step() == ["a"]
    assert all(hall.step() == ["a"] for _ in range(50))
    assert hall.made["b"].leader == "a"


def test_rule_2_who_comes_back_stands_by():
    hall = Hall()
    hall.step(10)
    hall.alive -= {"a"}
    hall.step(10)
    hall.start("a")
    assert all(hall.step() == ["b"] for _ in range(50))


def test_rule_3_when_the_leader_dies_the_next_speaks_in_the_next_step():
    hall = Hall()
    assert hall.step(10) == ["a"]
    hall.alive -= {"a"}
    assert hall.step() == ["b"]


def test_rule_3_when_the_leader_falls_silent_the_next_speaks_after_the_takeover_time():
    hall = Hall("abc")
    hall.step(10)
    hall.stopped |= {"a"}
    said = [hall.step() for _ in range(8)]
    assert said.index(["b"]) * STEP / S <= TAKEOVER_S + 0.1
    assert ["c"] not in said


def test_rule_3_when_the_next_is_stopped_too_the_one_after_it_speaks():
    hall = Hall("abc")
    hall.step(10)
    hall.stopped |= {"a", "b"}
    assert hall.step(13) == ["c"]


def test_rule_4_of_two_leaders_the_later_by_name_yields():
    one, other = Leadership("a", BOTH, TAKEOVER_S), Leadership("b", BOTH, TAKEOVER_S)
    for now in range(0, 2 * S, STEP):
        leading = one.leads(now), other.leads(now)
    assert leading == (True, True)  # each was alone in its part of the network
    assert not one.heard("b", now) and other.heard("a", now)
    assert (one.leads(now), other.leads(now)) == (True, False)


def test_rule_5_who_was_stopped_does_not_speak_when_it_goes_on():
    hall = Hall()
    hall.step(10)
    hall.stopped |= {"a"}
    assert hall.step(10) == ["b"]
    hall.stopped.clear()
    assert all(hall.step() == ["b"] for _ in range(30))


def test_rule_5_and_when_nobody_took_its_place_it_goes_on_after_listening():
    hall = Hall()
    hall.alive -= {"b"}
    hall.step(10)
    hall.stopped |= {"a"}
    hall.step(20)
    hall.stopped.clear()
    assert [hall.step() for _ in range(7)][-2:] == [["a"]] * 2


def test_rule_6_who_is_alone_leads_always():
    alone = Leadership("a", frozenset({"a"}), TAKEOVER_S)
    assert all(alone.leads(now) for now in (0, 1, 3600 * S, 5))


def test_a_stranger_is_nobody():
    one = Leadership("b", BOTH, TAKEOVER_S)
    assert not one.heard("zz", 0) and one.leader is None
    one.present(frozenset({"zz", "0"}), 0)
    for now in range(0, S, STEP):
        leads = one.leads(now)
    assert leads


HAPPENINGS = st.lists(
    st.tuples(st.sampled_from(["kill", "start", "stop", "go on"]), st.sampled_from("abc"), st.integers(0, 12)),
    max_size=12,
)


@given(HAPPENINGS)
def test_two_never_speak_for_longer_than_a_step_and_soon_somebody_does(happenings):
    """Two may begin in the very same step; by the next each has heard the other (rule 4)."""
    hall, before = Hall("abc"), []
    for what, who, steps in happenings:
        if what == "kill":
            hall.alive.discard(who)
        elif what == "start" and who not in hall.alive:
            hall.start(who)
        elif what == "stop":
            hall.stopped.add(who)
        elif what == "go on":
            hall.stopped.discard(who)
        for _ in range(steps):
            now = hall.step()
            assert len(now) <= 1 or len(before) <= 1
            before = now
    for _ in range(30):
        hall.step()
    running = hall.alive - hall.stopped
    assert len(hall.step()) == (1 if running else 0)


@pytest.mark.parametrize("jump_s", [-3600, 3600])
def test_a_clock_that_is_set_makes_it_listen_and_go_on(jump_s):
    one = Leadership("a", BOTH, TAKEOVER_S)
    start = 10_000 * S
    for now in range(start, start + 2 * S, STEP):
        one.leads(now)
    after = start + jump_s * S
    assert not one.leads(after)
    assert any(one.leads(after + k * STEP) for k in range(1, 8))
