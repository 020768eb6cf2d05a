"""The roster: one test a rule, the fading against its formula, and what hostile messages cannot do."""

import copy
import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from common.config_sections import FusionConfig
from common.messages import PosteriorMessage, VocabularyReference
from common.vocabulary import Vocabulary
from fusion.engine.roster import SESSIONS_KEPT, Roster

NAMES = Vocabulary(("bow", "lunge", "punch"))
OTHER = Vocabulary(("bow", "punch", "lunge"))
CONFIG = FusionConfig(fresh_s=0.2, fade_s=0.5, blind_s=0.15, drop_s=2.0)
S = 1_000_000_000
NOW = 100_000 * S
SAID = (0.7, 0.2, 0.1)


def message(captured_ns=NOW, p=SAID, seq=0, session="a", vocabulary=NAMES, **more):
    fields = {"rest": 0.1, "sent_ns": captured_ns, **more}
    reference = VocabularyReference(name="m", hash=vocabulary.digest)
    return PosteriorMessage(scene="dojo", observer="cam1", seq=seq, session=session, captured_ns=captured_ns,
                            vocabulary=reference, p=list(p), frames=seq + 1, **fields)  # fmt: skip


def roster(*heard, now_ns=NOW, observers=("cam1", "cam2")):
    made = Roster(list(observers), NAMES, CONFIG)
    for said in heard:
        made.receive("cam1", said, now_ns)
    return made


def first(made, now_ns=NOW):
    return made.opinions(now_ns)[0]


def at(age_s):
    return NOW + round(age_s * S)


def test_a_fresh_opinion_counts_as_it_was_said():
    opinion = first(roster(message()), at(0.2))
    assert opinion.observer == "cam1" and opinion.p == pytest.approx(SAID)
    assert (opinion.rest, opinion.age_s, opinion.state) == (pytest.approx(0.1), pytest.approx(0.2), "counted")


SEES, BLIND = {"visible": {"head": True, "left_hand": False}}, {"visible": {"head": False, "left_hand": False}}


def test_who_sees_nothing_fades_by_the_formula_and_comes_back_whole():
    made = roster(message(at(0), seq=0, **SEES))
    for seq in range(1, 11):
        made.receive("cam1", message(at(seq / 10), seq=seq, **BLIND), at(seq / 10))
        keeps = math.exp(-max(seq / 10 - CONFIG.fresh_s, 0) / CONFIG.blind_s)
        wanted = np.array(SAID) ** keeps / (np.array(SAID) ** keeps).sum()
        opinion = first(made, at(seq / 10))
        assert opinion.p == pytest.approx(wanted)
        assert opinion.state == ("counted" if seq <= 2 else "stale")
    made.receive("cam1", message(at(1.1), seq=11, **SEES), at(1.1))
    assert first(made, at(1.1)).p == pytest.approx(SAID) and first(made, at(1.1)).state == "counted"


def test_who_does_not_say_what_he_sees_is_not_blind():
    made = roster(message(at(0), seq=0), message(at(1), seq=1), now_ns=at(1))
    assert first(made, at(1)).p == pytest.approx(SAID)


def test_every_judge_has_its_place_in_the_roster_whoever_spoke_first():
    made = Roster(["c", "a", "b"], NAMES, CONFIG)
    made.receive("b", message(), NOW)
    assert [(o.observer, o.state) for o in made.opinions(NOW)] == [("c", "silent"), ("a", "silent"), ("b", "counted")]


# Rule 1


def test_rule_1_the_newest_by_capture_time_counts_and_two_are_never_multiplied():
    made = roster(message(NOW - 2, seq=1), message(NOW, seq=3, p=(0.1, 0.1, 0.8)))
    assert made.receive("cam1", message(NOW - 1, seq=2), NOW) == "out_of_order"
    assert first(made).p == pytest.approx((0.1, 0.1, 0.8))


def test_rule_1_a_copy_is_not_a_second_word():
    made = roster(message())
    assert made.receive("cam1", message(), NOW) == "repeated"
    assert made.receive("cam1", message(seq=1), NOW) == "out_of_order"  # nothing newer was seen
    assert first(made).p == pytest.approx(SAID) and first(made).state == "counted"


# Rule 2


def test_rule_2_a_new_session_is_heard_at_once_even_if_its_clock_is_behind():
    made = roster(message(seq=90))
    assert made.receive("cam1", message(NOW - S, session="b", p=(0.1, 0.1, 0.8)), NOW) is None
    assert first(made).p.argmax() == 2
    assert made.receive("cam1", message(NOW + 1, seq=91), NOW) == "past_session"
    assert made.receive("cam1", message(NOW + 1, session="b", seq=1), NOW) is None


def test_rule_2_no_name_of_a_session_is_special():
    made = roster(message(session="b"))
    assert made.receive("cam1", message(NOW + 1, session=""), NOW + 1) is None


def test_rule_2_an_observer_that_restarts_for_ever_costs_no_memory():
    made = roster()
    for n in range(3 * SESSIONS_KEPT):
        assert made.receive("cam1", message(NOW + n, session=str(n)), NOW + n) is None
    assert made.receive("cam1", message(NOW + S, session=str(n - 1)), NOW + S) == "past_session"
    assert len(made._seats["cam1"].past_sessions) == SESSIONS_KEPT


def test_rule_2_one_mad_or_forged_message_silences_nobody_for_good():
    mad = [message(seq=2**62), message(NOW + 1, session="forged", seq=0)]
    for said in mad:
        made = roster(message(NOW - 1, seq=1), said)
        refused = [made.receive("cam1", message(at(s / 10), seq=2 + s), at(s / 10)) for s in range(1, 30)]
        assert refused[0] in ("out_of_order", "past_session") and refused[-1] is None
        assert refused.count(None) >= 8 and first(made, at(2.9)).state == "counted"


# Rule 3


def faded(p, age_s):
    """The formula, word for word."""
    prior = [1 / len(p)] * len(p)
    mass = [(x / q) ** math.exp(-(age_s - CONFIG.fresh_s) / CONFIG.fade_s) * q for x, q in zip(p, prior, strict=True)]
    return [m / sum(mass) for m in mass]


@given(
    st.lists(st.floats(0.001, 1), min_size=3, max_size=3).map(lambda m: [x / sum(m) for x in m]),
    st.floats(0.21, 2.0),
    st.floats(0, 1),
)
def test_rule_3_an_old_opinion_fades_by_the_formula(p, age_s, rest):
    age_s = round(age_s, 6)
    opinion = first(roster(message(p=p, rest=rest)), at(age_s))
    assert opinion.state == "stale"
    assert opinion.p == pytest.approx(faded(p, age_s), rel=1e-6)
    assert opinion.rest == pytest.approx(rest)  # silence is no sign of rest


@given(st.floats(0, 2), st.floats(0, 2))
def test_rule_3_older_is_never_surer(one, other):
    young, old = sorted((one, other))
    made = roster(message())
    assert first(made, at(old)).p.max() <= first(made, at(young)).p.max() + 1e-12
    assert first(made, at(old)).rest >= first(made, at(young)).rest - 1e-12


def test_rule_3_even_a_certainty_fades_without_a_nan():
    made = roster(message(p=(1, 0, 0)))
    assert first(made, at(1.9)).p.tolist() == [1, 0, 0]  # 0 to any power: an exclusion stays, until it is dropped
    made = Roster(["cam1"], NAMES, FusionConfig(fresh_s=0.0, fade_s=1e-4, blind_s=0.15, drop_s=2.0))
    made.receive("cam1", message(p=(1, 0, 0)), NOW)
    assert first(made, at(1.9)).p == pytest.approx([1 / 3] * 3)


# Rule 4


def test_rule_4_who_said_nothing_is_the_prior_and_silent():
    opinion = first(roster())
    assert opinion.p == pytest.approx([1 / 3] * 3)
    assert (opinion.rest, opinion.age_s, opinion.state) == (1.0, None, "silent")


def test_rule_4_past_the_drop_one_is_the_prior_and_silent():
    opinion = first(roster(message()), at(2.01))
    assert opinion.p == pytest.approx([1 / 3] * 3)
    assert (opinion.rest, opinion.state) == (1.0, "silent") and opinion.age_s == pytest.approx(2.01)


@pytest.mark.parametrize("sent_s", [0.0, 2.5], ids=["late on the way or by its clock", "slow observer"])
def test_rule_4_who_speaks_of_what_is_long_past_is_late_and_silent_when_he_stops(sent_s):
    made = roster(message(NOW - 3 * S, sent_ns=NOW - 3 * S + round(sent_s * S)))
    assert first(made).state == "late" and first(made, at(1.9)).state == "late"
    assert first(made, at(2.1)).state == "silent"
    assert first(made).p == pytest.approx([1 / 3] * 3)


def test_rule_4_who_was_on_time_and_stops_was_never_late():
    made = roster(message(NOW - S // 10))
    assert first(made, at(1.95)).state == "silent"


# Rule 5


def test_rule_5_who_goes_is_silent_at_once_until_he_speaks_again():
    made = roster(message())
    made.present(frozenset({"cam1", "cam2"}))
    assert first(made).state == "counted"
    made.present(frozenset({"cam2"}))
    assert first(made).state == "silent" and first(made).p == pytest.approx([1 / 3] * 3)
    # It may be the line that broke: what he said of rest stays for as long as it would have.
    assert first(made).rest == pytest.approx(0.1) and first(made, at(2.1)).rest == 1
    assert made.receive("cam1", message(), NOW) == "repeated"  # a copy is no word of a living judge
    assert first(made).state == "silent"
    assert made.receive("cam1", message(NOW + 1, seq=1), NOW + 1) is None
    assert first(made).state == "counted"


def test_rule_5_who_was_late_and_goes_is_silent():
    made = roster(message(NOW - 3 * S))
    made.present(frozenset({"cam1"}))
    made.present(frozenset())
    assert first(made).state == "silent"


def test_rule_5_who_never_announced_himself_is_heard():
    made = roster(message())
    made.present(frozenset({"cam2"}))
    made.present(frozenset())
    assert first(made).state == "counted"


def test_rule_5_strangers_who_come_and_go_mean_nothing():
    made = roster(message())
    made.present(frozenset({"stranger"}))
    made.present(frozenset())
    assert first(made).state == "counted"


def test_rule_5_who_went_after_a_bad_word_is_silent_not_invalid():
    made = roster(message())
    made.present(frozenset({"cam1"}))
    made.reject("cam1", "malformed")
    made.present(frozenset())
    assert first(made).state == "silent"


# Rule 6


@pytest.mark.parametrize(
    ("bad", "reason", "state"),
    [
        (message(vocabulary=OTHER), "foreign_vocabulary", "foreign"),
        (message(p=(0.5, 0.5)), "wrong_length", "invalid"),
        (message(at(2.1)), "from_the_future", "invalid"),
    ],
)
def test_rule_6_what_cannot_be_used_is_counted_and_says_why_there_is_no_opinion(bad, reason, state):
    made = roster()
    assert made.receive("cam1", bad, NOW) == reason
    assert made.rejected["cam1"] == {reason: 1} and not made.rejected["cam2"]
    assert (first(made).state, first(made).age_s) == (state, None)


def test_rule_6_a_judge_who_counts_goes_on_to_count():
    made = roster(message())
    made.receive("cam1", message(NOW + 1, seq=1, vocabulary=OTHER), NOW)
    made.reject("cam1", "malformed")
    assert first(made).state == "counted" and first(made, at(1)).state == "stale"
    assert first(made, at(2.1)).state == "invalid"  # and when it is dropped, it is said why nothing came after it
    made.receive("cam1", message(NOW + 1, seq=1), NOW)
    assert first(made, at(2.1)).state == "silent"


def test_rule_6_stragglers_and_copies_say_nothing_against_a_judge():
    made = roster(message(session="old"), message(seq=1))
    for straggler in (message(session="old", seq=2), message(seq=1), message(NOW - 1, seq=0)):
        assert made.receive("cam1", straggler, NOW) in ("past_session", "repeated", "out_of_order")
        assert first(made, at(2.1)).state == "silent"


def test_rule_6_a_stranger_is_refused():
    made = roster()
    assert made.receive("cam9", message(), NOW) == "unknown_observer"
    made.reject("cam9", "malformed")
    assert list(made.rejected) == ["cam1", "cam2"]


# Rule 7


def test_rule_7_a_clock_set_back_deafens_nobody_and_leaves_no_opinion_for_ever():
    made = roster(message(seq=5))
    before = NOW - 3600 * S
    assert first(made, before).state == "silent"
    assert made.receive("cam1", message(before, seq=6), before) is None
    assert first(made, before).state == "counted"


def test_rule_7_a_little_ahead_is_only_another_clock():
    made = roster()
    assert made.receive("cam1", message(at(1.9)), NOW) is None
    assert first(made).state == "counted" and first(made).age_s == pytest.approx(-1.9)


# Foreign judges


def test_another_prior_is_taken_out():
    own, likelihood = np.array([0.6, 0.3, 0.1]), np.array([0.2, 0.5, 0.9])
    said = own * likelihood / (own * likelihood).sum()
    opinion = first(roster(message(p=said, prior=own.tolist())))
    assert opinion.p == pytest.approx(likelihood / likelihood.sum())


def test_who_holds_only_his_own_prior_knows_nothing():
    own = [0.98, 0.01, 0.01]
    opinion = first(roster(message(p=own, prior=own, rest=None)))
    assert opinion.p == pytest.approx([1 / 3] * 3) and opinion.rest == pytest.approx(1)


def test_a_prior_with_zeros_gives_no_nan():
    opinion = first(roster(message(p=(0.5, 0.5, 0), prior=[0.5, 0, 0.5])))
    assert np.isfinite(opinion.p).all() and opinion.p.sum() == pytest.approx(1)


def test_a_sum_that_is_not_quite_one_is_made_one():
    assert first(roster(message(p=(0.7, 0.2, 0.1004)))).p.sum() == pytest.approx(1, abs=1e-12)


@pytest.mark.parametrize(("p", "rest"), [((1, 0, 0), 0), ((1 / 3, 1 / 3, 1 / 3), 1), ((0.5, 0.5, 0), 0.6309)])
def test_who_says_nothing_of_rest_moves_as_far_as_he_knows_something(p, rest):
    assert first(roster(message(p=p, rest=None))).rest == pytest.approx(rest, abs=1e-3)


# Whatever comes

MESSAGES = st.builds(
    message,
    captured_ns=st.integers(-5, 5).map(lambda s: NOW + s * S),
    seq=st.integers(0, 3),
    session=st.sampled_from(["", "a", "b"]),
    vocabulary=st.sampled_from([NAMES, NAMES, NAMES, OTHER]),
    p=st.sampled_from([SAID, (1, 0, 0), (0.5, 0.5), (1 / 3, 1 / 3, 1 / 3)]),
    rest=st.sampled_from([None, 0, 1]),
)
EVENTS = st.one_of(
    st.tuples(st.just("receive"), st.sampled_from(["cam1", "cam2", "cam9"]), MESSAGES),
    st.tuples(st.just("reject"), st.sampled_from(["cam1", "cam9"]), st.just("malformed")),
    st.tuples(st.just("present"), st.just(""), st.frozensets(st.sampled_from(["cam1", "cam2", "cam9"]))),
    st.tuples(st.just("time"), st.just(""), st.integers(-4, 4)),
)


def stances(made, now_ns):
    return [(o.observer, o.p.tolist(), o.rest, o.age_s) for o in made.opinions(now_ns)]


@given(st.lists(EVENTS, max_size=25))
def test_nothing_raises_and_what_is_refused_changes_no_opinion(events):
    made, now_ns, refused = roster(), NOW, 0
    for kind, who, what in events:
        before, states = stances(made, now_ns), [o.state for o in made.opinions(now_ns)]
        if kind == "time":
            now_ns += what * S
        elif kind == "present":
            made.present(what)
        elif kind == "reject" or made.receive(who, what, now_ns) is not None:
            if kind == "reject":
                made.reject(who, what)
            refused += who != "cam9"
            assert stances(made, now_ns) == before
            after = [o.state for o in made.opinions(now_ns)]
            assert all(old == new for old, new in zip(states, after, strict=True) if old in ("counted", "stale"))
        else:
            mine = next(o for o in made.opinions(now_ns) if o.observer == who)
            assert mine.age_s == (now_ns - what.captured_ns) / S
        for opinion in made.opinions(now_ns):
            assert opinion.p.shape == (3,) and opinion.p.sum() == pytest.approx(1) and (opinion.p >= 0).all()
            assert 0 <= opinion.rest <= 1
    assert sum(count.total() for count in made.rejected.values()) == refused


@given(st.lists(MESSAGES, max_size=12), st.integers(0, 4))
def test_what_counts_is_one_message_and_only_that(heard, later_s):
    """Oracle: forget all but the last that was taken, and the opinion is the same."""
    made = roster(observers=["cam1"])
    last = None
    for said in heard:
        if made.receive("cam1", copy.deepcopy(said), NOW) is None:
            last = said
    alone = roster(*([last] if last else []), observers=["cam1"])
    assert stances(made, at(later_s)) == stances(alone, at(later_s))


# What may be said beside the belief


def test_what_is_said_beside_the_belief_fades_with_it():
    more = {"unlearned": 0.7, "facing": {"surprise": [[0, 40], [16, 2], [8, 5]]}, "facets": {"effort_time": [0.1, 0.9]}}
    made = roster(message(**more))
    fresh, faded, gone = first(made), first(made, at(0.7)), first(made, at(2.5))
    assert fresh.unlearned == 0.7 and fresh.surprise.tolist() == more["facing"]["surprise"]
    assert fresh.facets["effort_time"] == pytest.approx([0.1, 0.9])
    keeps = math.exp(-1)
    all_answers = (np.append(np.array(SAID) * 0.3, 0.7)) ** keeps
    assert faded.unlearned == pytest.approx(all_answers[-1] / all_answers.sum())
    assert faded.p == pytest.approx(np.array(SAID) ** keeps / (np.array(SAID) ** keeps).sum())
    inside = np.exp(-np.array([0, 40]) * keeps / 8)
    assert np.exp(-faded.surprise[0] / 8) == pytest.approx(inside / inside.sum(), abs=0.06)
    assert 0.5 < faded.facets["effort_time"][1] < 0.9
    assert (gone.unlearned, gone.surprise, dict(gone.facets)) == (None, None, {})
