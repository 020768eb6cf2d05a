"""The roster: a test for each rule, the fading against its formula, and what hostile messages cannot do."""

import copy
import math

import engine_stage
import numpy as np
import pytest
from engine_stage import VOCABULARY
from hypothesis import given
from hypothesis import strategies as st

from common import SECOND_NS
from common.config_sections import FusionConfig
from common.messages import Facing
from common.vocabulary import Vocabulary
from fusion.engine.aged_posterior import SESSIONS_LIMIT
from fusion.engine.roster import Roster
from fusion.engine.trust import HONEST, Reliability, after_message, log_odds_of

OTHER_VOCABULARY = Vocabulary(("bow", "punch", "lunge"))
CONFIG = FusionConfig(fresh_s=0.2, fade_s=0.5, blind_s=0.15, drop_s=2.0)
NOW = 100_000 * SECOND_NS
P, OTHER_P = (0.7, 0.2, 0.1), (0.1, 0.1, 0.8)
PRIOR = pytest.approx([1 / 3] * 3)


def message(captured_ns=NOW, **fields):
    return engine_stage.message(captured_ns, **{"rest": 0.1, **fields})


class Cam1:
    """A roster of which the first observer is used; its clock is ours."""

    def __init__(self, *messages, now_ns=NOW, observers=("cam1", "cam2"), config=CONFIG):
        self.roster = Roster(list(observers), VOCABULARY, config)
        for posterior in messages:
            self.receive(posterior, now_ns)

    def receive(self, posterior, now_ns=NOW, observer="cam1"):
        return self.roster.receive(observer, posterior, now_ns)

    def at(self, now_ns=NOW):
        return self.roster.posteriors(now_ns)[0]

    def state(self, now_ns=NOW):
        return self.at(now_ns).state


def after(seconds):
    return NOW + round(seconds * SECOND_NS)


def tempered(p, exponent):
    mass = np.array(p) ** exponent
    return mass / mass.sum()


def test_rule_1_only_the_newest_by_capture_time_counts():
    cam = Cam1(message(NOW - 2, seq=1), message(NOW, seq=3, p=OTHER_P))
    assert cam.receive(message(NOW - 1, seq=2)) == "out_of_order"
    assert cam.receive(message(NOW, seq=3, p=OTHER_P)) == "repeated"
    assert cam.receive(message(NOW, seq=4)) == "out_of_order"  # nothing newer was seen
    assert cam.at().p == pytest.approx(OTHER_P) and cam.state() == "counted"


@pytest.mark.parametrize(("old", "new"), [("a", "b"), ("b", "")])
def test_rule_2_a_new_session_counts_at_once_even_if_its_clock_is_behind(old, new):
    cam = Cam1(message(seq=90, session=old))
    assert cam.receive(message(NOW - SECOND_NS, session=new, p=OTHER_P)) is None
    assert cam.at().p.argmax() == 2
    assert cam.receive(message(NOW + 1, seq=91, session=old)) == "past_session"
    assert cam.receive(message(NOW + 1, seq=1, session=new)) is None


def test_rule_2_two_processes_of_one_id_are_reported_and_the_one_that_started_last_counts():
    cam, reasons = Cam1(), []
    for n in range(40):
        now_ns = after(n / 10)
        reasons.append(cam.receive(message(now_ns, seq=n, session="one"), now_ns))
        if n >= 10:
            assert cam.receive(message(now_ns, seq=n, session="two", p=OTHER_P), now_ns) is None
    # In the first second after a restart these are the last messages of a process that has gone.
    assert reasons == [None] * 11 + ["past_session"] * 10 + ["same_id"] * 19
    assert cam.at(now_ns).p == pytest.approx(OTHER_P) and cam.state(now_ns) == "counted"
    # A capture that is played again is no process that runs.
    assert cam.receive(message(after(1.5), seq=99, session="one"), now_ns) == "past_session"


def test_rule_2_endless_restarts_cost_no_memory():
    cam = Cam1()
    for n in range(3 * SESSIONS_LIMIT):
        assert cam.receive(message(NOW + n, session=str(n)), NOW + n) is None
    oldest = n - SESSIONS_LIMIT
    assert cam.receive(message(NOW + SECOND_NS, session=str(oldest)), NOW + SECOND_NS) == "past_session"
    assert cam.receive(message(NOW + SECOND_NS, session=str(oldest - 1)), NOW + SECOND_NS) is None


@pytest.mark.parametrize("faulty", [message(seq=2**62), message(NOW + 1, session="forged", seq=0)])
def test_rule_2_one_faulty_or_forged_message_silences_nobody_for_good(faulty):
    cam = Cam1(message(NOW - 1, seq=1), faulty)
    reasons = [cam.receive(message(after(s / 10), seq=2 + s), after(s / 10)) for s in range(1, 30)]
    assert reasons[0] in ("out_of_order", "past_session") and reasons[-1] is None
    assert reasons.count(None) >= 8 and cam.state(after(2.9)) == "counted"


@given(
    st.lists(st.floats(0.001, 1), min_size=3, max_size=3).map(lambda m: [x / sum(m) for x in m]),
    st.floats(0.21, 2.0),
    st.floats(0, 1),
)
def test_rule_3_an_old_posterior_fades_by_the_formula_and_rest_does_not(p, age_s, rest):
    age_s = round(age_s, 6)
    posterior = Cam1(message(p=p, rest=rest)).at(after(age_s))
    assert posterior.state == "stale" and posterior.rest == pytest.approx(rest)
    assert posterior.p == pytest.approx(tempered(p, math.exp(-(age_s - 0.2) / 0.5)), rel=1e-6)


@pytest.mark.parametrize(
    ("interval_s", "count", "fresh_s"),
    [(1 / 15, 9, 0.2), (0.2, 9, 0.4), (0.3, 9, 0.6), (0.3, 4, 0.2), (0.6, 9, 0.75)],
)
def test_rule_3_a_slow_observer_stays_fresh_for_two_of_its_usual_intervals(interval_s, count, fresh_s):
    # The first message begins the session, so that there is one gap less than messages; four gaps show an interval.
    sent = [after((n + 1 - count) * interval_s) for n in range(count)]
    cam = Cam1()
    for seq, captured_ns in enumerate(sent):
        cam.receive(message(captured_ns, seq=seq), captured_ns)
    assert cam.state(after(fresh_s - 0.01)) == "counted"
    posterior = cam.at(after(fresh_s + 0.1))
    assert posterior.state == "stale"
    assert posterior.p == pytest.approx(tempered(P, math.exp(-0.1 / CONFIG.fade_s)))


def test_rule_3_one_long_gap_makes_nobody_slow_and_a_new_session_begins_anew():
    cam = Cam1()
    for seq, at_s in enumerate((-2.0, -1.9, -1.8, -1.0, -0.9, -0.8)):
        cam.receive(message(after(at_s), seq=seq), after(at_s))
    assert cam.state(after(-0.55)) == "stale"
    for seq in range(6):
        cam.receive(message(after(0.3 * seq), seq=6 + seq), after(0.3 * seq))
    assert cam.state(after(2.0)) == "counted"
    cam.receive(message(after(2.1), seq=0, session="new"), after(2.1))
    assert cam.state(after(2.4)) == "stale"


def test_rule_7_a_slow_observer_is_not_blind_because_of_one_picture():
    cam = Cam1()
    for seq in range(8):
        seen = {"left_hand": seq != 7}
        cam.receive(message(after(0.3 * seq), seq=seq, visible=seen), after(0.3 * seq))
    assert cam.state(after(2.1)) == "counted"


def test_rule_3_even_a_certainty_fades_without_a_nan():
    certain = message(p=(1, 0, 0))
    # An exclusion stays until it is dropped.
    assert Cam1(certain).at(after(1.9)).p.tolist() == [1, 0, 0]
    quick = Cam1(certain, config=FusionConfig(fresh_s=0.0, fade_s=1e-3, blind_s=0.15, drop_s=2.0))
    assert quick.at(after(1.9)).p == PRIOR


def test_rules_3_and_7_all_fields_fade_together():
    fields = {
        "unlearned": 0.7,
        "facing": Facing(surprise=[[0, 40], [16, 2], [8, 5]]),
        "facets": {"effort_time": [0.1, 0.9]},
    }
    cam = Cam1(message(**fields))
    fresh, faded, dropped = cam.at(), cam.at(after(0.7)), cam.at(after(2.5))
    assert fresh.unlearned == 0.7 and fresh.surprise.tolist() == fields["facing"].surprise
    assert fresh.facets["effort_time"] == pytest.approx([0.1, 0.9])
    exponent = math.exp(-1)
    assert faded.unlearned == pytest.approx(tempered(np.append(np.array(P) * 0.3, 0.7), exponent)[-1])
    assert faded.p == pytest.approx(tempered(P, exponent))
    expected = tempered(np.exp(-np.array([0, 40]) / 8), exponent)
    assert np.exp(-faded.surprise[0] / 8) == pytest.approx(expected, abs=0.06)
    assert 0.5 < faded.facets["effort_time"][1] < 0.9
    assert (dropped.unlearned, dropped.surprise, dict(dropped.facets)) == (None, None, {})


def test_rule_4_before_the_first_message_and_past_the_drop_it_is_the_prior_and_silent():
    for posterior, age_s in ((Cam1().at(), None), (Cam1(message()).at(after(2.01)), pytest.approx(2.01))):
        assert posterior.p == PRIOR
        assert (posterior.rest, posterior.age_s, posterior.state) == (1.0, age_s, "silent")


@pytest.mark.parametrize("sent_s", [0.0, 2.5], ids=["late on the way or by its clock", "slow observer"])
def test_rule_4_an_observer_that_publishes_old_data_is_late_and_silent_when_it_stops(sent_s):
    cam = Cam1(message(after(-3), sent_ns=after(-3 + sent_s)))
    assert cam.at().p == PRIOR
    assert [cam.state(after(s)) for s in (0, 1.9, 2.1)] == ["late", "late", "silent"]
    assert Cam1(message(after(-0.1))).state(after(1.95)) == "silent"  # in time, then stopped: never late


def test_rule_5_an_observer_that_disappears_is_silent_at_once_until_its_next_message():
    cam = Cam1(message())
    cam.roster.set_present(frozenset({"cam1", "cam2"}))
    assert cam.state() == "counted"
    cam.roster.set_present(frozenset({"cam2"}))
    assert cam.state() == "silent" and cam.at().p == PRIOR
    # The network may have failed: its rest stays for as long as it would have.
    assert cam.at().rest == pytest.approx(0.1) and cam.at(after(2.1)).rest == 1
    assert cam.receive(message()) == "repeated" and cam.state() == "silent"
    assert cam.receive(message(NOW + 1, seq=1), NOW + 1) is None and cam.state() == "counted"


@pytest.mark.parametrize(
    ("captured_ns", "present", "is_invalid", "state"),
    [(after(-3), "cam1", False, "silent"), (NOW, "cam1", True, "silent"), (NOW, "stranger", False, "counted")],
    ids=["was late", "was invalid", "never announced"],
)
def test_rule_5_only_the_observer_itself_becomes_silent(captured_ns, present, is_invalid, state):
    cam = Cam1(message(captured_ns))
    cam.roster.set_present(frozenset({present}))
    if is_invalid:
        cam.roster.reject("cam1", "malformed")
    cam.roster.set_present(frozenset())
    assert cam.state() == state


@pytest.mark.parametrize(
    ("bad", "reason", "state"),
    [
        (message(vocabulary=OTHER_VOCABULARY), "foreign_vocabulary", "foreign"),
        (message(p=(0.5, 0.5)), "wrong_length", "invalid"),
    ],
)
def test_rule_6_unusable_messages_are_counted_and_give_the_state(bad, reason, state):
    cam = Cam1()
    assert cam.receive(bad) == reason
    assert cam.roster.rejected == {"cam1": {reason: 1}, "cam2": {}}
    assert (cam.state(), cam.at().age_s) == (state, None)


def test_rule_6_an_unusable_message_shows_when_the_last_good_one_is_dropped():
    cam = Cam1(message())
    cam.receive(message(NOW + 1, seq=1, vocabulary=OTHER_VOCABULARY))
    cam.roster.reject("cam1", "malformed")
    assert [cam.state(after(s)) for s in (0, 1, 2.1)] == ["counted", "stale", "invalid"]
    cam.receive(message(NOW + 1, seq=1), NOW + 1)
    assert cam.state(after(2.1)) == "silent"


def test_rule_6_late_messages_and_copies_say_nothing_against_an_observer():
    cam = Cam1(message(session="old"), message(seq=1))
    for unused in (message(session="old", seq=2), message(seq=1), message(NOW - 1, seq=0)):
        assert cam.receive(unused) in ("past_session", "repeated", "out_of_order")
        assert cam.state(after(2.1)) == "silent"


def test_rule_7_an_observer_that_sees_nothing_fades_by_the_formula_and_is_restored_by_sight():
    sees, blind = ({"visible": {"head": head, "left_hand": False}} for head in (True, False))
    cam = Cam1(message(**sees))
    for seq in range(1, 11):
        cam.receive(message(after(seq / 10), seq=seq, **blind), after(seq / 10))
        posterior = cam.at(after(seq / 10))
        assert posterior.p == pytest.approx(tempered(P, math.exp(-max(seq / 10 - 0.2, 0) / 0.15)))
        assert posterior.state == ("counted" if seq <= 2 else "stale")
        # Half of the weight is left .304 s after it saw somebody last.
        assert (posterior.sees, posterior.rest) == ((True, 0.1) if seq <= 3 else (False, 1.0))
    cam.receive(message(after(1.1), seq=11, **sees), after(1.1))
    assert cam.at(after(1.1)).p == pytest.approx(P) and cam.state(after(1.1)) == "counted"
    unsaid = Cam1(message(seq=0), message(after(1), seq=1), now_ns=after(1))
    assert unsaid.at(after(1)).p == pytest.approx(P)  # an observer that does not publish `visible` is not blind
    none_yet = Cam1()
    none_yet.receive(message(after(0), seq=0, **blind), after(0))
    assert not none_yet.at(after(0)).sees and none_yet.at(after(0)).p == pytest.approx(tempered(P, 0.0))


def test_rules_3_and_7_an_observer_that_sees_nothing_and_falls_silent_fades_by_both():
    cam = Cam1(message())
    cam.receive(message(after(0.5), seq=1, visible={"head": False}), after(0.5))
    posterior, visibility = cam.at(after(0.9)), math.exp(-(0.5 - 0.2) / 0.15)
    assert posterior.p == pytest.approx(tempered(P, visibility * math.exp(-(0.4 - 0.2) / 0.5)))
    assert not posterior.sees
    only_late = Cam1(message()).at(after(1.9))
    assert only_late.sees and only_late.rest == 0.1 and not Cam1(message()).at(after(2.1)).sees


def test_rule_8_a_clock_set_back_blocks_nobody_and_leaves_no_posterior_for_ever():
    cam, before = Cam1(message(seq=5)), after(-3600)
    assert cam.state(before) == "silent"
    assert cam.receive(message(before, seq=6), before) is None and cam.state(before) == "counted"
    ahead = Cam1(message(after(1.9), seq=5), now_ns=after(1.9))
    before = after(-1.5)  # the posterior is now dated 3.4 s ahead
    assert ahead.receive(message(before, seq=6), before) is None
    ahead = Cam1(message(after(1.9)), now_ns=after(1.9))
    assert ahead.state() == "counted" and ahead.at().age_s == pytest.approx(-1.9)


def test_rule_8_a_capture_that_is_played_again_neither_replaces_a_newer_posterior_nor_keeps_one_away():
    cam = Cam1(message())
    assert cam.receive(message(after(-3600), seq=1, session="an hour ago")) == "out_of_order"
    assert cam.state() == "counted" and cam.at().age_s == 0
    late = Cam1(message(after(-3)))
    assert late.receive(message(after(-3))) == "repeated"
    assert late.receive(message(after(-2.5), seq=1)) is None


def test_rule_2_a_past_session_counts_again_once_nothing_else_was_received_for_drop_s():
    cam = Cam1(message(NOW - 1, session="a"), message(after(1.9), session="forged"))
    assert cam.receive(message(after(1.9), seq=1, session="a"), after(1.9)) == "same_id"
    assert cam.receive(message(after(2.5), seq=2, session="a"), after(2.5)) is None


# Steadiness


def jumping(seconds):
    """Two observers: the first changes its mind with each of 15 messages, the second never does."""
    cam = Cam1()
    for n in range(15):
        now_ns = after(n * seconds)
        cam.receive(message(now_ns, seq=n, p=OTHER_P if n % 2 else P), now_ns)
        cam.receive(message(now_ns, seq=n), now_ns, "cam2")
    return cam, now_ns


@pytest.mark.parametrize("seconds", [0.05, 0.25], ids=["20 Hz", "4 Hz"])
def test_an_observer_that_contradicts_itself_is_trusted_less_as_far_as_others_are_steady(seconds):
    cam, now_ns = jumping(seconds)
    neutral, steady = 1 / 4, HONEST
    overlap = 4 * ((1 - neutral) ** 2 * float(np.dot(P, OTHER_P)) + neutral**2)
    for _ in range(14):
        steady = after_message(steady, overlap, seconds)
    cam.roster.set_reliability(Reliability(evidence={"cam1": log_odds_of(HONEST / 2)}))
    first, second = cam.roster.posteriors(now_ns)
    assert first.reliability == pytest.approx(0.5 * steady / HONEST, abs=1e-3) and second.reliability == 1.0
    assert first.reliability < 0.4


@pytest.mark.parametrize(
    ("resting", "trust"), [({}, 1.0), ({"cam1": 0.7}, 1.0), ({"cam1": 0.3}, 0.5), ({"cam2": 0.3}, 1.0)]
)
def test_one_that_is_named_for_what_it_says_about_rest_counts_less_about_labels(resting, trust):
    cam = Cam1(message())
    first, _ = cam.roster.posteriors(NOW, resting)
    assert first.reliability == pytest.approx(trust) and first.p == pytest.approx(P)


@pytest.mark.parametrize("gone", [True, False], ids=["disappeared", "dropped"])
def test_a_course_is_compared_with_observers_that_are_pooled(gone):
    cam, now_ns = jumping(0.05)
    assert cam.at(now_ns).reliability < 1.0
    if gone:
        cam.roster.set_present(frozenset({"cam1", "cam2"}))
        cam.roster.set_present(frozenset({"cam1"}))
    else:
        now_ns += 3 * SECOND_NS
        cam.receive(message(now_ns, seq=9), now_ns)
    assert cam.at(now_ns).reliability == 1.0


# Foreign observers


@pytest.mark.parametrize(
    ("own_prior", "likelihood"), [([0.6, 0.3, 0.1], [0.2, 0.5, 0.9]), ([0.98, 0.01, 0.01], [1, 1, 1])]
)
def test_another_prior_is_replaced_by_ours(own_prior, likelihood):
    p = tempered(np.array(own_prior) * likelihood, 1)
    posterior = Cam1(message(p=p, prior=own_prior, rest=None)).at()
    assert posterior.p == pytest.approx(tempered(likelihood, 1))
    assert posterior.rest == pytest.approx(1) or len(set(likelihood)) > 1  # knowing nothing is rest


@pytest.mark.parametrize("fields", [{"p": (0.5, 0.5, 0), "prior": [0.5, 0, 0.5]}, {"p": (0.7, 0.2, 0.1004)}])
def test_zeros_in_a_prior_and_a_sum_that_is_not_quite_1_give_a_distribution(fields):
    assert Cam1(message(**fields)).at().p.sum() == pytest.approx(1, abs=1e-12)


@pytest.mark.parametrize(("p", "rest"), [((1, 0, 0), 0), ((1 / 3, 1 / 3, 1 / 3), 1), ((0.5, 0.5, 0), 0.6309)])
def test_without_rest_it_is_the_relative_entropy(p, rest):
    assert Cam1(message(p=p, rest=None)).at().rest == pytest.approx(rest, abs=1e-3)


# Any messages

MESSAGES = st.builds(
    message,
    captured_ns=st.integers(-5, 5).map(after),
    seq=st.integers(0, 3),
    session=st.sampled_from(["", "a", "b"]),
    vocabulary=st.sampled_from([VOCABULARY, VOCABULARY, VOCABULARY, OTHER_VOCABULARY]),
    p=st.sampled_from([P, (1, 0, 0), (0.5, 0.5), (1 / 3, 1 / 3, 1 / 3)]),
    rest=st.sampled_from([None, 0, 1]),
)
EVENTS = st.one_of(
    st.tuples(st.just("receive"), st.sampled_from(["cam1", "cam2", "cam9"]), MESSAGES),
    st.tuples(st.just("reject"), st.sampled_from(["cam1", "cam9"]), st.just("malformed")),
    st.tuples(st.just("present"), st.just(""), st.frozensets(st.sampled_from(["cam1", "cam2", "cam9"]))),
    st.tuples(st.just("time"), st.just(""), st.integers(-4, 4)),
)


def values(cam, now_ns):
    return [(o.observer, o.p.tolist(), o.rest, o.age_s) for o in cam.roster.posteriors(now_ns)]


@given(st.lists(EVENTS, max_size=25))
def test_any_events_raise_nothing_and_rejected_messages_change_no_posterior(events):
    cam, now_ns, rejected = Cam1(), NOW, 0
    for kind, observer, value in events:
        before, states = values(cam, now_ns), [o.state for o in cam.roster.posteriors(now_ns)]
        if kind == "time":
            now_ns += value * SECOND_NS
        elif kind == "present":
            cam.roster.set_present(value)
        elif kind == "reject" or cam.receive(value, now_ns, observer) is not None:
            if kind == "reject":
                cam.roster.reject(observer, value)
            rejected += observer != "cam9"
            assert values(cam, now_ns) == before
            new_states = [o.state for o in cam.roster.posteriors(now_ns)]
            assert all(old == new for old, new in zip(states, new_states, strict=True) if old in ("counted", "stale"))
        else:
            posterior = next(o for o in cam.roster.posteriors(now_ns) if o.observer == observer)
            # A message is as old as its own stamps are apart where its clock cannot be right.
            assert posterior.age_s in (0.0, (now_ns - value.captured_ns) / SECOND_NS)
        for posterior in cam.roster.posteriors(now_ns):
            assert posterior.p.shape == (3,) and posterior.p.sum() == pytest.approx(1) and (posterior.p >= 0).all()
            assert 0 <= posterior.rest <= 1
    assert sum(count.total() for count in cam.roster.rejected.values()) == rejected


@given(st.lists(MESSAGES, max_size=12), st.integers(0, 4))
def test_only_the_last_message_that_was_used_counts(messages, later_s):
    cam = Cam1(observers=["cam1"])
    used = [posterior for posterior in messages if cam.receive(copy.deepcopy(posterior)) is None]
    alone = Cam1(*used[-1:], observers=["cam1"])
    # Where stamps show that its clock stood still, a message is as old as they are apart.
    if cam.at(after(later_s)).age_s == alone.at(after(later_s)).age_s:
        assert values(cam, after(later_s)) == values(alone, after(later_s))
