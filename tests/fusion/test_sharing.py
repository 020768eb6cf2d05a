"""Many scenes among several services: who comes or goes moves only its share, and never do two judge one scene."""

from collections import Counter

from hypothesis import given
from hypothesis import strategies as st

from fusion.sharing import Duty, Share, ranked

SERVICES = ("north", "south", "east", "west", "spare")
names = st.text("abcdefghijklmnopqrstuvwxyz0123456789_-", min_size=1, max_size=8)
several = st.sets(names, min_size=1, max_size=6)


@given(names, several)
def test_everybody_finds_the_same_rank(scene, services):
    assert ranked(scene, sorted(services)) == ranked(scene, sorted(services, reverse=True))
    assert set(ranked(scene, services)) == services


@given(names, several, names)
def test_who_comes_or_goes_changes_nothing_among_the_others(scene, services, other):
    without = ranked(scene, services - {other})
    assert tuple(s for s in ranked(scene, services | {other}) if s != other) == without


def test_the_shares_are_about_equal():
    shares = Counter(ranked(f"home{n:04d}", SERVICES[:4])[0] for n in range(1000))
    assert set(shares) == set(SERVICES[:4])
    # Five standard deviations of a fair draw.
    assert all(abs(count - 250) < 5 * (1000 * 0.25 * 0.75) ** 0.5 for count in shares.values())


def test_a_service_alone_takes_the_scene_and_judges():
    share = Share("north", "dojo")
    assert share.present(()) is Duty.TAKING
    share.took_over()
    assert share.duty is Duty.JUDGING


def test_who_judges_goes_on_until_it_is_asked():
    first, second, *_ = ranked("dojo", SERVICES)
    share = Share(second, "dojo")
    share.present([second])
    share.took_over()
    assert share.present([first, second]) is Duty.JUDGING
    share.handed_over()
    assert share.present([first, second]) is Duty.SECOND


def test_who_was_stopped_for_long_asks_again():
    first, second, *_ = ranked("dojo", SERVICES)
    for own, after in ((first, Duty.TAKING), (second, Duty.SECOND)):
        share = Share(own, "dojo")
        share.present([own])
        share.took_over()
        share.present([first, second])
        share.doubtful()
        assert share.duty is after


class House:
    """Services of one scene that learn late of each other; to ask and to be answered is one moment."""

    def __init__(self):
        self.alive = {}

    def come(self, service):
        self.alive[service] = Share(service, "dojo")
        # It waits until it knows the others before it takes anything.
        self.notice(service)

    def go(self, service):
        self.alive.pop(service, None)

    def notice(self, service):
        if service in self.alive:
            self.alive[service].present(self.alive)

    def ask(self, service):
        share = self.alive.get(service)
        if share is None or share.duty is not Duty.TAKING:
            return
        for other in self.alive.values():
            if other.duty is Duty.JUDGING:
                other.handed_over()
        share.took_over()

    @property
    def judging(self):
        return [name for name, share in self.alive.items() if share.duty is Duty.JUDGING]

    def settle(self):
        for _ in range(4):
            for service in self.alive:
                self.notice(service)
                self.ask(service)


@given(st.lists(st.tuples(st.sampled_from(["come", "go", "notice", "ask"]), st.sampled_from(SERVICES)), max_size=60))
def test_never_do_two_judge_and_in_the_end_the_heaviest_does(story):
    house = House()
    for what, service in story:
        if not (what == "come" and service in house.alive):
            getattr(house, what)(service)
        assert len(house.judging) <= 1
    house.settle()
    assert house.judging == ([ranked("dojo", house.alive)[0]] if house.alive else [])
