"""The referee: messages of four observers in, judgements and verdicts out, as one story a test."""

import json

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from common.config_sections import FusionConfig
from common.errors import BadInput
from common.messages import PosteriorMessage, VerdictMessage, VocabularyReference
from common.probability import entropy_bits
from common.vocabulary import ABSTAIN, Vocabulary
from fusion.engine.engine import FusionEngine
from fusion.engine.rules import RULES

NAMES = Vocabulary(("bow", "lunge", "punch"), "karate")
CORNERS = ["door", "wheel", "table", "back"]
S = 1_000_000_000
START = 1_000 * S
STEP = S // 10
CONDUCT = {
    "id": "fusion", "rule": "robust_inverse_entropy", "temperature": 1.0, "quorum": 3, "threshold": 0.8, "hold_s": 0.3,
    "fresh_s": 0.2, "fade_s": 0.5, "blind_s": 0.15, "drop_s": 2.0,
}  # fmt: skip
UNSURE = (1 / 3, 1 / 3, 1 / 3)


def sure(label, p=0.9):
    return tuple(p if name == label else (1 - p) / 2 for name in NAMES.labels)


class Hall:
    """A referee and his observers, who speak in step."""

    def __init__(self, observers=CORNERS, **conduct):
        self.referee = FusionEngine("dojo", list(observers), NAMES, FusionConfig(**{**CONDUCT, **conduct}))
        self.now_ns, self.seq, self.verdicts = START, 0, []

    def say(self, observer, p, rest, **changed):
        fields = {
            "scene": "dojo", "observer": observer, "seq": self.seq, "session": observer, "captured_ns": self.now_ns,
            "sent_ns": self.now_ns, "vocabulary": VocabularyReference(name="karate", hash=NAMES.digest), "p": list(p),
            "rest": rest, "frames": self.seq,
        }  # fmt: skip
        return self.referee.receive(observer, PosteriorMessage(**{**fields, **changed}), self.now_ns)

    def step(self, views, rest):
        """A tenth of a second: each observer says what it believes."""
        self.now_ns += STEP
        self.seq += 1
        for observer, p in views.items():
            assert self.say(observer, p, rest) is None
        ruling = self.referee.step(self.now_ns)
        self.verdicts += ruling.verdicts
        return ruling.judgement

    def steps(self, n, views, rest):
        for _ in range(n):
            judgement = self.step(views, rest)
        return judgement


def all_say(p, *but):
    return {name: p for name in CORNERS if name not in but}


def test_the_story_of_one_bow():
    hall = Hall()
    judgement = hall.step({}, 0)
    assert judgement.p == pytest.approx(UNSURE) and judgement.certainty_bits == pytest.approx(np.log2(3))
    assert {v.state for v in judgement.votes.values()} == {"silent"} and judgement.agreement.n == 0

    hall.steps(5, all_say(UNSURE), rest=0.95)
    assert hall.verdicts == []
    hall.steps(3, all_say(UNSURE), rest=0.1)
    assert hall.verdicts == []
    began_ns = hall.now_ns - 2 * STEP

    judgement = hall.steps(4, {**all_say(sure("bow", 0.96)), "table": sure("punch", 0.5)}, rest=0.05)
    (verdict,) = hall.verdicts
    assert (verdict.label, verdict.began_ns, verdict.decided_ns, verdict.ended_ns) == (
        "bow",
        began_ns,
        hall.now_ns,
        None,
    )
    own = {"id", "began_ns", "decided_ns", "ended_ns", "movement", "contributions"}
    assert verdict.model_dump(exclude=own) == judgement.model_dump(exclude={"movement"})
    assert judgement.movement.model_dump() == verdict.model_dump(include={"id", "began_ns", "label", "decided_ns"})
    assert (judgement.agreement.k, judgement.agreement.n) == (3, 4)
    table, door = judgement.votes["table"], judgement.votes["door"]
    assert (table.label, table.state, door.label) == ("punch", "counted", "bow")
    assert sum(v.weight for v in judgement.votes.values()) == pytest.approx(1)
    assert door.entropy == pytest.approx(float(entropy_bits(np.array(sure("bow", 0.96)))))
    assert door.p == list(sure("bow", 0.96))

    hall.steps(10, all_say(UNSURE), rest=0.9)
    again = hall.verdicts[1]
    assert len(hall.verdicts) == 2 and again.id == verdict.id
    assert again.ended_ns == verdict.decided_ns + STEP
    assert again.at_ns == again.ended_ns + 3 * STEP and again.seq == verdict.seq + 4


def test_the_verdict_said_with_its_end_still_carries_the_votes_that_decided_it():
    hall = Hall()
    hall.steps(6, all_say(sure("bow")), rest=0.05)
    hall.steps(6, all_say(UNSURE), rest=0.9)
    decided, ended = hall.verdicts
    for name in ("p", "certainty_bits", "votes", "agreement", "rule", "label", "decided_ns", "began_ns", "id"):
        assert getattr(ended, name) == getattr(decided, name), name
    assert ended.agreement.k == 4 and ended.ended_ns is not None


def test_a_verdict_revised_at_its_end_carries_the_votes_of_the_revision():
    hall = Hall()
    hall.steps(6, all_say(sure("bow")), rest=0.05)
    hall.steps(6, all_say(sure("punch")), rest=0.05)
    hall.steps(1, all_say(sure("punch", 0.95)), rest=0.9)
    revised_ns = hall.now_ns
    hall.steps(6, all_say(UNSURE), rest=0.9)
    decided, ended = hall.verdicts
    assert (decided.label, ended.label, ended.id) == ("bow", "punch", decided.id)
    assert ended.decided_ns == ended.ended_ns == revised_ns
    assert {v.label for v in ended.votes.values()} == {"punch"} and ended.votes["door"].p == list(sure("punch", 0.95))


def test_every_movement_has_an_id_of_its_own():
    hall = Hall()
    for label in ("bow", "punch", "bow"):
        hall.steps(6, all_say(sure(label)), rest=0.05)
        hall.steps(6, all_say(UNSURE), rest=0.9)
    assert [v.label for v in hall.verdicts] == ["bow", "bow", "punch", "punch", "bow", "bow"]
    assert len({v.id for v in hall.verdicts}) == 3


def test_who_knows_nothing_agrees_with_nobody():
    hall = Hall(rule="min_entropy")
    judgement = hall.step({"door": sure("bow"), "wheel": UNSURE, "table": (0.335, 0.33, 0.335), "back": sure("bow")}, 0)
    assert [judgement.votes[name].label for name in CORNERS] == ["bow", None, None, "bow"]
    assert judgement.votes["wheel"].state == "counted" and judgement.votes["wheel"].p is not None
    assert (judgement.label, judgement.agreement.k, judgement.agreement.n) == ("bow", 2, 4)


def test_judges_who_cannot_agree_abstain():
    hall = Hall()
    torn = {"door": sure("bow"), "wheel": sure("bow"), "table": sure("punch"), "back": sure("punch")}
    hall.steps(8, torn, rest=0.05)
    hall.steps(1, torn, rest=0.9)
    hall.steps(8, all_say(UNSURE), rest=0.9)
    (verdict,) = hall.verdicts
    assert verdict.label == ABSTAIN and verdict.ended_ns is not None and verdict.agreement.k == 2
    assert [verdict.votes[name].label for name in CORNERS] == ["bow", "bow", "punch", "punch"]


def test_a_judge_whose_process_goes_is_silent_at_once_and_the_others_go_on():
    hall = Hall()
    hall.referee.set_present(frozenset(CORNERS))
    hall.steps(2, all_say(sure("bow")), rest=0.05)
    hall.referee.set_present(frozenset(CORNERS) - {"back"})
    judgement = hall.steps(4, all_say(sure("bow"), "back"), rest=0.05)
    assert (judgement.votes["back"].state, judgement.votes["back"].label) == ("silent", None)
    assert judgement.votes["back"].p is None and judgement.votes["back"].entropy is None
    assert (judgement.agreement.k, judgement.agreement.n) == (3, 3)
    assert [v.label for v in hall.verdicts] == ["bow"]


def test_all_states_of_a_vote_beside_each_other():
    hall = Hall(["counted", "stale", "late", "silent", "foreign", "invalid"], quorum=1)
    hall.say("counted", sure("bow"), 0.1)
    hall.say("stale", sure("bow"), 0.1, captured_ns=hall.now_ns - S)
    hall.say("late", sure("bow"), 0.1, captured_ns=hall.now_ns - 3 * S)
    assert hall.say("foreign", sure("bow"), 0.1, vocabulary=VocabularyReference(name="k", hash="x")) is not None
    hall.referee.reject("invalid", "malformed")
    votes = hall.referee.step(hall.now_ns).judgement.votes
    assert {name: vote.state for name, vote in votes.items()} == {name: name for name in votes}
    assert {name for name, vote in votes.items() if vote.label} == {"counted", "stale"}
    assert hall.referee.rejected["foreign"] == {"foreign_vocabulary": 1}
    assert hall.referee.rejected["invalid"] == {"malformed": 1}


@pytest.mark.parametrize("rule", sorted(set(RULES) - {"chernoff"}))
def test_silent_judges_do_not_speak_for_rest(rule):
    """Two of four cameras are off: whoever weighs them, the movement that the others see is a movement."""
    hall = Hall(rule=rule, quorum=2, threshold=0.5)
    hall.steps(6, all_say(sure("bow", 0.98), "table", "back"), rest=0.02)
    hall.steps(6, all_say(UNSURE, "table", "back"), rest=0.95)
    assert [v.label for v in hall.verdicts] == ["bow", "bow"]


def test_a_judge_who_is_sure_and_wrong_does_not_hold_the_movement_open():
    hall = Hall(["door", "wheel", "stuck"], quorum=2)
    for label in ("bow", "punch"):
        for views, rest in (({"door": sure(label, 0.99), "wheel": sure(label, 0.99)}, 0.05),
                            ({"door": sure(label, 0.5), "wheel": sure(label, 0.5)}, 0.95)):  # fmt: skip
            for _ in range(8):
                hall.now_ns, hall.seq = hall.now_ns + STEP, hall.seq + 1
                hall.say("stuck", sure("lunge", 0.97), 0.01)
                for observer, p in views.items():
                    hall.say(observer, p, rest)
                hall.verdicts += hall.referee.step(hall.now_ns).verdicts
    assert [(v.label, v.ended_ns is not None) for v in hall.verdicts] == [
        ("bow", False), ("bow", True), ("punch", False), ("punch", True)
    ]  # fmt: skip


def test_a_camera_that_stops_in_a_movement_does_not_end_it():
    hall = Hall(quorum=2)
    hall.steps(4, all_say(sure("bow")), rest=0.05)
    judgement = hall.steps(15, all_say(sure("bow"), "door"), rest=0.05)
    assert judgement.votes["door"].state == "stale" and [v.ended_ns for v in hall.verdicts] == [None]


def test_when_all_go_the_movement_ends():
    hall = Hall()
    hall.steps(6, all_say(sure("bow")), rest=0.05)
    judgement = hall.steps(30, {}, rest=0)
    assert {v.state for v in judgement.votes.values()} == {"silent"} and judgement.p == pytest.approx(UNSURE)
    assert [v.ended_ns is None for v in hall.verdicts] == [True, False]
    assert hall.verdicts[1].agreement.k == 4


def test_time_between_cameras_of_50_ms_changes_nothing():
    def judged(skew_ns):
        hall = Hall()
        for label, rest in [("bow", 0.05)] * 8 + [("bow", 0.95)] * 8:
            hall.now_ns, hall.seq = hall.now_ns + STEP, hall.seq + 1
            for n, name in enumerate(CORNERS):
                hall.say(name, sure(label), rest, captured_ns=hall.now_ns + skew_ns * (n - 1))
            hall.verdicts += hall.referee.step(hall.now_ns).verdicts
        return [(v.label, v.began_ns, v.decided_ns, v.ended_ns, v.p) for v in hall.verdicts]

    assert judged(0) == judged(50_000_000) and len(judged(0)) == 2


def test_a_rule_that_is_not_there_or_cannot_hear_so_many_is_refused():
    with pytest.raises(BadInput, match="logpol"):
        Hall(rule="logpol")
    with pytest.raises(BadInput, match="at most 2"):
        Hall(rule="chernoff")


# What verdicts say beside the label


def test_every_verdict_says_what_each_judge_contributed():
    views = {
        "door": sure("bow", 0.97),
        "wheel": sure("bow", 0.95),
        "table": (0.4, 0.35, 0.25),
        "back": sure("punch", 0.6),
    }
    hall = Hall(quorum=2)
    hall.steps(8, views, rest=0.05)
    hall.steps(8, all_say(UNSURE), rest=0.9)
    decided, ended = hall.verdicts
    assert decided.contributions == ended.contributions and set(decided.contributions) == set(CORNERS)
    assert decided.contributions["door"].nats > 0 > decided.contributions["back"].nats
    assert all(contribution.stands for contribution in decided.contributions.values())


def test_an_unlearned_movement_is_an_abstention_that_says_why():
    hall = Hall()
    for _ in range(8):
        hall.now_ns, hall.seq = hall.now_ns + STEP, hall.seq + 1
        for name in CORNERS:
            hall.say(name, sure("bow", 0.98), 0.05, unlearned=0.9)
        judgement = hall.referee.step(hall.now_ns).judgement
    assert judgement.unlearned > 0.8 and judgement.movement is not None and judgement.movement.label is None
    assert sum(judgement.p) == pytest.approx(1) and {v.label for v in judgement.votes.values()} == {None}
    hall.steps(8, all_say(UNSURE), rest=0.95)
    (verdict,) = hall.verdicts
    assert (verdict.label, verdict.id) == (ABSTAIN, judgement.movement.id) and verdict.ended_ns is not None


def test_the_threshold_is_among_all_answers():
    decided = {}
    for unlearned in (0.0, 0.3):
        hall = Hall(rule="linear")
        for _ in range(8):
            hall.now_ns, hall.seq = hall.now_ns + STEP, hall.seq + 1
            for name in CORNERS:
                hall.say(name, sure("bow", 0.9), 0.05, unlearned=unlearned)
            hall.verdicts += hall.referee.step(hall.now_ns).verdicts
        decided[unlearned] = [v.label for v in hall.verdicts]
    assert decided == {0.0: ["bow"], 0.3: []}


def test_a_decision_is_taken_back_when_at_rest_it_was_something_else():
    hall = Hall()
    said = [(0.0, 0.05)] * 6 + [(0.97, 0.05)] * 4 + [(0.97, 0.95)] * 6
    for unlearned, rest in said:
        hall.now_ns, hall.seq = hall.now_ns + STEP, hall.seq + 1
        for name in CORNERS:
            hall.say(name, sure("bow", 0.98), rest, unlearned=unlearned)
        hall.verdicts += hall.referee.step(hall.now_ns).verdicts
    assert [v.label for v in hall.verdicts] == ["bow", ABSTAIN]
    assert len({v.id for v in hall.verdicts}) == 1 and hall.verdicts[1].unlearned > 0.9


def test_facing_and_facets_are_judged_and_said():
    hall, table = Hall(), [[0, 20, 40, 20]] * 3
    for name in CORNERS[:2]:
        hall.say(name, sure("bow"), 0.05, facing={"surprise": table}, facets={"effort_time": [0.1, 0.9]})
    hall.say("table", sure("bow"), 0.05, facets={"effort_time": [0.3, 0.7], "own": [1.0]})
    judgement = hall.referee.step(hall.now_ns).judgement
    assert set(judgement.facets) == {"facing", "effort_time"} and np.argmax(judgement.facets["facing"]) == 0
    assert (judgement.facing_deg + 1) % 360 == pytest.approx(1, abs=0.5)
    assert judgement.facets["effort_time"][1] > 0.6
    assert judgement.votes["door"].facing.surprise == table and judgement.votes["table"].facing is None
    json.dumps(judgement.model_dump(), allow_nan=False)


def test_who_lied_in_verdict_after_verdict_counts_less_and_a_follower_knows_it_too():
    hall, follower = Hall(quorum=2), Hall(quorum=2)
    for label in ("bow", "punch") * 4:
        views = {**all_say(sure(label, 0.97)), "back": sure("lunge", 0.97)}
        views["wheel"] = sure(label, 0.9)
        hall.steps(6, views, rest=0.05)
        judgement = hall.steps(6, all_say(UNSURE), rest=0.95)
    back, door = judgement.votes["back"], judgement.votes["door"]
    assert back.reliability < 0.5 and door.reliability == 1.0
    for verdict in hall.verdicts:
        follower.referee.continue_from(verdict)
    assert follower.referee.reliability == hall.referee.reliability


DISTRIBUTIONS = st.sampled_from([UNSURE, sure("bow"), sure("punch"), (1.0, 0.0, 0.0), (0.0, 1.0, 0.0)])


@given(
    st.lists(st.tuples(st.dictionaries(st.sampled_from(CORNERS), DISTRIBUTIONS), st.floats(0, 1)), max_size=12),
    st.sampled_from(sorted(set(RULES) - {"chernoff"})),
)
def test_whatever_they_say_the_judgement_is_sound(said, rule):
    hall = Hall(rule=rule, quorum=1, hold_s=0.1)
    for n, (views, rest) in enumerate(said, 1):
        judgement = hall.step(views, rest)
        assert sum(judgement.p) == pytest.approx(1) and judgement.seq == n
        used = judgement.agreement.n
        assert judgement.label == (NAMES.labels[int(np.argmax(judgement.p))] if used else "")
        assert 0 <= judgement.agreement.k <= judgement.agreement.n <= 4
        heard = [v for v in judgement.votes.values() if v.p is not None]
        assert len(heard) == judgement.agreement.n
        assert sum(v.label == judgement.label for v in heard) == judgement.agreement.k
        json.dumps(judgement.model_dump(), allow_nan=False)
    for verdict in hall.verdicts:
        assert isinstance(verdict, VerdictMessage) and verdict.label in (*NAMES.labels, ABSTAIN)
        assert verdict.id == f"dojo-{verdict.began_ns // 1_000_000}"


@pytest.mark.parametrize("rule", sorted(set(RULES) - {"chernoff"}))
def test_without_a_vote_no_movement_is_named_and_none_is_decided(rule):
    hall = Hall(rule=rule, quorum=1, threshold=0.2, hold_s=0.0, drop_s=0.5)
    assert hall.steps(3, {}, rest=0).label == ""
    hall.say("door", sure("bow"), 0.05)
    assert hall.referee.step(hall.now_ns).judgement.label == "bow"
    judgement = hall.steps(10, {}, rest=0)
    assert (judgement.label, judgement.agreement.k, judgement.agreement.n) == ("", 0, 0)
    assert judgement.p == pytest.approx(UNSURE) and {v.label for v in judgement.votes.values()} == {None}
    assert {v.label for v in hall.verdicts} <= {"bow"}


def test_epoch_and_session_of_the_service_are_in_every_message():
    hall = Hall(quorum=1)
    assert (hall.step(all_say(UNSURE), 0.9).epoch, hall.verdicts) == (None, [])
    hall.referee.epoch, hall.referee.session = 3, "s1"
    hall.steps(6, all_say(sure("bow")), rest=0.05)
    hall.referee.epoch, hall.referee.session = 4, "s2"
    judgement = hall.steps(6, all_say(sure("bow")), rest=0.95)
    assert (judgement.epoch, judgement.session) == (4, "s2")
    assert [(v.epoch, v.session) for v in hall.verdicts] == [(3, "s1"), (4, "s2")]
