"""Which service owns a scene: one of them, always, whatever dies, hangs, comes back or is cut off."""

from collections import Counter

import pytest
from hypothesis import given
from hypothesis import strategies as st

from fusion.ownership import EPOCHS_AHEAD, LEFT_S, START_S, Ownership, Role, rendezvous_rank

TAKEOVER_S = 0.5
STEP_S = 0.1


class Room:
    """Services that step in turn and hear each other, unless they are dead, frozen or cut off; time is simulated."""

    def __init__(self, names, named=(), takeover_s=TAKEOVER_S):
        self.now_s, self.named, self.published, self.owners = 100.0, named, [], []
        self.takeover_s = takeover_s
        self.services, self.dead, self.frozen, self.far = {}, set(), set(), set()
        for name in names:
            self.begin(name)

    def begin(self, name):
        self.services[name] = Ownership(name, "dojo", self.named, self.takeover_s)
        alive = {n for n in self.services if n not in self.dead and self.connected(n, name)}
        self.services[name].set_alive(alive, self.now_s)
        self.dead.discard(name)

    def connected(self, one, other):
        return (one in self.far) == (other in self.far)

    def step(self, steps=1):
        for _ in range(steps):
            self.now_s += STEP_S
            speakers = [self._step(name) for name in list(self.services) if name not in self.dead | self.frozen]
            self.owners.append([name for name in speakers if name])

    def _step(self, name):
        own = self.services[name]
        alive = {n for n in self.services if n not in self.dead and self.connected(n, name)}
        for other, epoch, at_s in self.published:
            if other != name and at_s > self.now_s - STEP_S - 1e-9 and self.connected(name, other):
                own.record_message(other, epoch, self.now_s)
        own.set_alive(alive, self.now_s)
        role = own.update(self.now_s)
        if role is Role.REQUESTING:
            owner = own.owner
            asked = owner not in self.dead | self.frozen and self.connected(name, owner)
            if asked and self.services[owner].hand_over_to(name, self.now_s):
                own.complete_handover()
        if own.role is Role.OWNER:
            self.published.append((name, own.epoch, self.now_s))
            return name
        return None

    @property
    def owner(self):
        (name,) = self.owners[-1]
        return name


NAMED = ("a", "b", "c")


@pytest.fixture
def standby():
    """A service b that stands by for a, which has published."""
    standby = Ownership("b", "dojo", ("a", "b"), TAKEOVER_S)
    standby.set_alive({"a", "b"}, 0.0)
    standby.update(0.0)
    assert standby.record_message("a", 1, 0.1)
    return standby


def test_the_first_in_the_file_leads_and_the_next_takes_over_at_its_next_step_when_it_dies():
    room = Room(NAMED, NAMED)
    room.step(10)
    assert room.owner == "a"
    room.dead.add("a")
    room.step(2)
    assert room.owner == "b"
    room.begin("a")
    room.step(20)
    assert room.owner == "b", "a service that comes back stands by"
    assert [s.role for s in room.services.values()] == [Role.STANDBY, Role.OWNER, Role.STANDBY]


def test_a_silent_owner_is_replaced_after_takeover_s_and_stands_by_when_it_wakes():
    room = Room(NAMED, NAMED)
    room.step(10)
    room.frozen.add("a")
    room.step(5)
    assert room.owners[-1] == []
    room.step(2)
    assert room.owner == "b"
    room.frozen.clear()
    room.step(20)
    assert room.owner == "b" and all(len(owners) == 1 for owners in room.owners[-20:])


def test_a_second_silent_service_delays_the_third_by_takeover_s():
    room = Room(NAMED, NAMED)
    room.step(10)
    room.frozen |= {"a", "b"}
    room.step(8)
    assert room.owners[-1] == [], "b has the first turn"
    room.step(5)
    assert room.owner == "c"


def test_after_a_partition_the_higher_epoch_stays():
    room = Room(NAMED[:2], NAMED[:2])
    room.step(10)
    room.far.add("b")
    room.step(10)
    assert room.owners[-1] == ["a", "b"]
    room.far.clear()
    room.step(3)
    assert room.owner == "b" and room.services["a"].role is Role.STANDBY


def test_a_lone_service_owns_its_scene_at_once_and_for_ever():
    alone = Ownership("a", "dojo", ("a",), TAKEOVER_S)
    assert alone.update(0.0) is Role.OWNER
    assert alone.update(1000.0) is Role.OWNER
    alone.set_alive({"a", "stranger"}, 1000.0)
    assert not alone.record_message("stranger", 99, 1000.0) and alone.update(1000.1) is Role.OWNER


def test_shared_scenes_move_to_the_first_in_rank_by_handover_without_a_gap():
    first, second = rendezvous_rank("dojo", ("x", "y"))
    room = Room([second])
    room.step(2)
    assert room.owner == second
    room.begin(first)
    for _ in range(15):
        room.step()
        # In the step of the handover both publish, one after the other.
        assert room.owners[-1] in ([second], [second, first], [first])
    assert room.owners.count([second, first]) == 1
    assert room.owner == first and room.services[second].role is Role.STANDBY
    assert room.services[first].epoch == 2


@pytest.mark.parametrize("order", [1, -1], ids=["first in rank first", "second in rank first"])
def test_services_that_start_together_do_not_wait_for_an_owner_that_cannot_be(order):
    """Seen in a storm: both services of twenty scenes were killed again while they waited."""
    names = rendezvous_rank("dojo", ("x", "y"))[::order]
    room = Room(names, takeover_s=2.0)
    room.step(13)
    assert len(room.owners[-1]) == 1


def test_a_service_waits_for_an_owner_that_was_suspended_before_it_started():
    """Its token says that it may be the owner, and nothing says that it is not."""
    first, second = rendezvous_rank("dojo", ("x", "y"))
    room = Room([second], takeover_s=2.0)
    room.step(5)
    room.frozen.add(second)
    room.begin(first)
    room.step(15)
    room.frozen.clear()
    room.step(10)
    assert all(owners in ([], [first], [second], [second, first]) for owners in room.owners[-10:])
    assert room.owner == first and room.services[first].epoch == 2


def test_a_service_that_appears_when_the_connection_is_back_may_own_the_scene():
    """Both lost the router; the owner's token comes back after this service has begun to listen again."""
    second = Ownership("y", "dojo", (), 2.0)
    second.set_alive((), 0.0)
    second.set_alive({"x"}, 0.1)
    second.update(0.1)
    assert second.record_message("x", 3, 0.2) and second.update(0.2) is not Role.OWNER
    second.set_alive((), 0.3)
    for n in range(3, 10):
        second.update(n * STEP_S, connected=lambda: False)
    second.set_alive({"x"}, 1.2)
    assert Role.OWNER not in {second.update(n * STEP_S) for n in range(12, 28)}


def test_a_scene_that_was_given_away_comes_back_when_the_new_owner_never_publishes():
    first, second = rendezvous_rank("dojo", ("x", "y"))
    room = Room([second])
    room.step(2)
    room.begin(first)
    room.frozen.add(first)
    room.step()
    assert room.services[second].hand_over_to(first, room.now_s)
    room.step(7)
    assert room.owner == second


def test_only_a_living_service_of_higher_rank_is_given_a_scene():
    first, second = rendezvous_rank("dojo", ("x", "y"))
    room = Room([first, second])
    room.step(20)
    assert not room.services[first].hand_over_to(second, room.now_s)
    assert not room.services[first].hand_over_to("stranger", room.now_s)
    named = Room(NAMED, NAMED)
    named.step(10)
    assert not named.services["a"].hand_over_to("b", named.now_s)


def test_a_named_service_listens_before_it_publishes_though_it_knows_of_no_other():
    first = Ownership("a", "dojo", ("a", "b"), TAKEOVER_S)
    assert [first.update(n * STEP_S) for n in range(6)] == [Role.STANDBY] * 5 + [Role.OWNER]


def test_a_named_owner_hands_over_to_nobody_and_a_forged_epoch_is_no_owners():
    owner = Ownership("b", "dojo", ("a", "b"), TAKEOVER_S)
    for n in range(20):
        owner.update(n * STEP_S)
    owner.set_alive({"a", "b"}, 2.0)
    assert owner.role is Role.OWNER and not owner.hand_over_to("a", 2.0)
    assert not owner.record_message("a", 2 * EPOCHS_AHEAD, 2.0) and owner.epoch == 1
    assert owner.record_message("a", 2, 2.0) and owner.role is Role.STANDBY


def test_of_shared_services_the_third_is_idle_and_one_that_was_silent_counts_again():
    names = rendezvous_rank("dojo", "xyz")
    room = Room(names)
    room.step(20)
    assert [room.services[name].role for name in names] == [Role.OWNER, Role.STANDBY, Role.IDLE]
    for lost in (room.frozen, room.dead):
        lost.add(names[0])
        room.step(15)
        assert room.owner == names[1]
        lost.clear()
        room.step(20)
        assert [room.services[name].role for name in names] == [Role.OWNER, Role.STANDBY, Role.IDLE]


def test_a_service_that_lost_its_connection_does_not_take_over(standby):
    """The router died: all tokens disappear, and the owner is no more dead than this service is."""
    standby.set_alive({"b"}, 0.2)
    for n in range(2, 30):
        assert standby.update(n * STEP_S, connected=lambda: False) is Role.STANDBY
    for n in range(30, 34):
        assert standby.update(n * STEP_S) is Role.STANDBY
    standby.set_alive({"a", "b"}, 3.4)
    assert standby.record_message("a", 1, 3.4) and standby.update(3.4) is Role.STANDBY and standby.epoch == 1


@pytest.mark.parametrize("named", [(), NAMED[:2]], ids=["shared", "named"])
def test_tokens_that_disappear_a_moment_before_the_connection_do_not_mean_that_the_owner_died(named):
    """Seen in a storm: the router was gone, one of twenty scenes had a second owner."""
    second = Ownership("b", "dojo", named, TAKEOVER_S)
    second.set_alive({"a", "b"}, 0.0)
    second.update(0.0)
    assert second.record_message("a", 1, 0.0) and second.update(0.0) is not Role.OWNER
    second.set_alive({}, 0.1)
    roles = [second.update(0.1)]
    roles += [second.update(0.1 + n * 0.01, connected=lambda: False) for n in range(1, 100)]
    second.set_alive({"a", "b"}, 1.1)
    assert Role.OWNER not in {*roles, second.update(1.1)}


def test_a_service_that_shares_scenes_listens_first_when_its_connection_is_back():
    """The router died and is back; the owner's token comes a moment later than the connection."""
    shared = Ownership("b", "dojo", (), TAKEOVER_S)
    shared.set_alive({"a", "b"}, 0.0)
    assert shared.update(0.0) is Role.STANDBY and shared.record_message("a", 3, 0.0)
    shared.set_alive({}, 0.1)
    for n in range(1, 30):
        assert shared.update(n * STEP_S, connected=lambda: False) is not Role.OWNER
    assert [shared.update(n * STEP_S) is Role.OWNER for n in (30, 33, 35)] == [False, False, True]
    alone = Ownership("b", "dojo", (), TAKEOVER_S)
    alone.update(0.0, connected=lambda: False)
    assert [alone.update(at_s) is Role.OWNER for at_s in (STEP_S, START_S)] == [False, True], "it met no other"


def test_a_service_that_hears_no_observer_does_not_take_over_from_a_silent_owner(standby):
    """The router is frozen: all tokens stay, and everybody is silent."""
    for n in range(2, 30):
        assert standby.update(n * STEP_S, connected=lambda: False) is Role.STANDBY
    assert standby.record_message("a", 1, 2.9) and standby.update(2.9) is Role.STANDBY and standby.epoch == 1
    for n in range(30, 36):
        standby.update(n * STEP_S)
    assert standby.role is Role.OWNER


@pytest.mark.parametrize("backlog", [True, False], ids=["a message waits", "none waits"])
@pytest.mark.parametrize(("owner", "other"), [("a", "b"), ("b", "a")], ids=["first in rank", "second in rank"])
def test_of_two_services_that_slept_together_the_owner_comes_back(owner, other, backlog):
    """Its last messages from before may arrive at the other one when both go on."""
    room = Room(NAMED[:2], NAMED[:2])
    room.step(10)
    if owner == "b":
        room.dead.add("a")
        room.step(10)
        room.begin("a")
        room.step(10)
    epoch = room.services[owner].epoch
    room.frozen |= {"a", "b"}
    room.step(12)
    room.frozen.clear()
    room.services[other].update(room.now_s)
    assert not backlog or room.services[other].record_message(owner, epoch, room.now_s)
    room.step(20)
    assert all(owners in ([], [owner]) for owners in room.owners[-20:]) and room.owner == owner


def test_an_owner_that_slept_does_not_follow_the_one_that_stands_down_for_it():
    """After a split network the owner's machine hangs for a moment, and the other's last messages arrive."""
    owner = Ownership("b", "dojo", NAMED[:2], TAKEOVER_S)
    for n in range(20):
        owner.update(n * STEP_S)
    assert (owner.role, owner.epoch) == (Role.OWNER, 1)
    owner.epoch = 2
    owner.set_alive({"a", "b"}, 2.6)
    assert owner.update(2.6) is Role.STANDBY
    assert not owner.record_message("a", 1, 2.6)
    for n in range(27, 38):
        owner.update(n * STEP_S)
    assert (owner.role, owner.epoch) == (Role.OWNER, 3)


def test_messages_that_are_not_decoded_are_heartbeats(standby):
    for n in range(2, 50):
        standby.record_heartbeat(n * STEP_S)
        assert standby.update(n * STEP_S) is Role.STANDBY


def test_the_last_message_of_a_dead_owner_does_not_bring_it_back(standby):
    standby.set_alive({"b"}, 0.2)
    assert not standby.record_message("a", 1, 0.2)
    assert standby.update(0.2 + LEFT_S) is Role.OWNER and standby.epoch == 2


def test_the_rank_is_the_same_for_all_and_a_service_moves_only_its_own_share():
    scenes, services = [f"s{n}" for n in range(400)], ["a", "b", "c", "d"]
    before = {s: rendezvous_rank(s, services)[0] for s in scenes}
    assert before == {s: rendezvous_rank(s, reversed(services))[0] for s in scenes}
    assert all(60 < count < 140 for count in Counter(before.values()).values())
    without = {s: rendezvous_rank(s, services[:3])[0] for s in scenes}
    assert all(without[s] == before[s] for s in scenes if before[s] != "d")


KINDS = ["kill", "begin", "freeze", "thaw", "cut", "join"]
EVENTS = st.lists(st.tuples(st.sampled_from(KINDS), st.sampled_from("abcd"), st.integers(1, 12)), max_size=15)


@pytest.mark.parametrize("named", [(), ("a", "b", "c", "d")], ids=["shared", "named"])
@given(events=EVENTS)
def test_whatever_happens_one_service_owns_the_scene_when_all_can_hear_each_other_again(named, events):
    room = Room("abcd", named)
    for event, name, steps in events:
        if event in ("kill", "freeze", "cut"):
            {"kill": room.dead, "freeze": room.frozen, "cut": room.far}[event].add(name)
        elif event == "begin" and name in room.dead:
            room.begin(name)
        elif event in ("thaw", "join"):
            {"thaw": room.frozen, "join": room.far}[event].discard(name)
        room.step(steps)
    room.frozen.clear()
    room.far.clear()
    for name in sorted(room.dead):
        room.begin(name)
    room.step(60)
    assert [len(owners) for owners in room.owners[-10:]] == [1] * 10
    assert len({tuple(owners) for owners in room.owners[-10:]}) == 1
    if not named:
        assert room.owner == rendezvous_rank("dojo", "abcd")[0]
