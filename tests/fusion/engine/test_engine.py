"""The fusion engine: messages of four observers in, judgements and verdicts out."""

import numpy as np
import pytest
from engine_stage import (
    ALL_RULES,
    LABELS,
    MOVING,
    REST,
    STEP_NS,
    UNIFORM,
    VIEWS,
    EngineDriver,
    all_views,
    sure,
)

from common.errors import BadInput
from common.probability import entropy_bits
from common.vocabulary import ABSTAIN
from fusion.engine.segments import last_capture_ns


def test_the_story_of_one_bow():
    scene = EngineDriver()
    judgement = scene.step({}, 0)
    assert judgement.p == pytest.approx(UNIFORM) and judgement.certainty_bits == pytest.approx(np.log2(3))
    assert {v.state for v in judgement.votes.values()} == {"silent"} and judgement.agreement.n == 0

    scene.step(all_views(UNIFORM), REST, 5)
    scene.step(all_views(UNIFORM), 0.1, 3)
    assert scene.verdicts == []
    began_ns = scene.now_ns - 2 * STEP_NS

    # One votes for another label: three steps more than without it.
    views = {**all_views(sure("bow", 0.96)), "table": sure("punch", 0.5)}
    judgement = scene.step(views, MOVING, 6)
    assert scene.verdicts == [] and judgement.why == "bow for 0.5 of 0.6 s"
    judgement = scene.step(views, MOVING)
    (verdict,) = scene.verdicts
    assert (verdict.label, verdict.began_ns, verdict.decided_ns) == ("bow", began_ns, scene.now_ns)
    assert verdict.ended_ns is None
    own = {"id", "began_ns", "decided_ns", "ended_ns", "movement", "contributions", "stage", "revises", "same_as"}
    own |= {"score", "scores", "remarks", "unscored"}
    assert verdict.model_dump(exclude=own) == judgement.model_dump(exclude={"movement"})
    ours = {"id", "began_ns", "label", "decided_ns", "revises"}
    assert judgement.movement.model_dump(exclude={"outage_ns"}) == verdict.model_dump(include=ours)
    assert judgement.movement.outage_ns is None and judgement.why is None
    assert (judgement.agreement.k, judgement.agreement.n) == (3, 4)
    table, door = judgement.votes["table"], judgement.votes["door"]
    assert (table.label, table.state, door.label) == ("punch", "counted", "bow")
    assert sum(v.weight for v in judgement.votes.values()) == pytest.approx(1)
    assert door.entropy == pytest.approx(float(entropy_bits(np.array(sure("bow", 0.96)))))
    assert door.p == list(sure("bow", 0.96))

    scene.step(all_views(UNIFORM), 0.9, 10)
    decided, ended = scene.verdicts
    assert (decided.stage, ended.stage, ended.revises) == ("decided", "ended", None)
    assert ended.ended_ns == decided.decided_ns + STEP_NS
    assert ended.at_ns == ended.ended_ns + 3 * STEP_NS and ended.seq == decided.seq + 4
    for name in ("p", "certainty_bits", "votes", "agreement", "rule", "label", "decided_ns", "began_ns", "id"):
        assert getattr(ended, name) == getattr(decided, name), name


def test_a_revision_is_published_at_once_with_its_own_votes_and_the_end_repeats_it():
    scene = EngineDriver(hold_s=0.1)
    scene.step(all_views(sure("bow")), MOVING, 2)
    scene.step(all_views(sure("punch")), MOVING, 6)
    judgement = scene.step(all_views(sure("punch", 0.95)), 0.9)
    revised_ns = scene.now_ns
    assert (judgement.movement.label, judgement.movement.revises) == ("punch", "bow")
    assert [(v.stage, v.label, v.revises) for v in scene.verdicts] == [
        ("decided", "bow", None), ("revised", "punch", "bow"),
    ]  # fmt: skip
    scene.step(all_views(UNIFORM), 0.9, 6)
    decided, revised, ended = scene.verdicts
    assert revised.id == ended.id == decided.id and revised.began_ns == ended.began_ns == decided.began_ns
    assert (revised.at_ns, revised.decided_ns, revised.ended_ns) == (revised_ns, revised_ns, None)
    assert (ended.stage, ended.label, ended.revises) == ("ended", "punch", "bow")
    assert ended.decided_ns == ended.ended_ns == revised_ns and ended.at_ns == revised_ns + STEP_NS
    for verdict in (revised, ended):
        assert {v.label for v in verdict.votes.values()} == {"punch"} and verdict.votes["door"].p == list(
            sure("punch", 0.95)
        )
    assert ended.contributions == revised.contributions and ended.contributions is not None


def test_a_silence_says_why_and_an_abstention_too():
    scene = EngineDriver(rule="linear", temperature=1.0)
    assert scene.step(all_views(UNIFORM), REST, 3).why is None
    judgement = scene.step(all_views(sure("bow", 0.79)), MOVING, 2, unlearned=0.0)
    assert judgement.why == "bow 79 % of the 80 % needed"
    judgement = scene.step({**all_views(sure("bow", 0.98)), "table": UNIFORM, "back": UNIFORM}, MOVING)
    assert judgement.agreement.k == 2 and judgement.why.endswith("; 2 of 3 observers needed vote for it")
    lines = [scene.step(all_views(sure("bow", 0.95)), MOVING).why for _ in range(4)]
    assert lines == ["bow for 0.0 of 0.3 s", "bow for 0.1 of 0.3 s", "bow for 0.2 of 0.3 s", None]
    scene.step(all_views(UNIFORM), REST, 6)
    scene.step(all_views(sure("punch", 0.7)), MOVING, 5)
    scene.step(all_views(sure("punch", 0.77)), MOVING, 5)
    scene.step(all_views(sure("punch", 0.6)), REST)
    scene.step(all_views(UNIFORM), REST, 6)
    decided, ended, abstained = scene.verdicts
    assert (decided.why, ended.why) == (None, None)
    assert (abstained.label, abstained.stage, abstained.why) == (ABSTAIN, "ended", "punch 77 % of the 80 % needed")


def test_an_observer_that_knows_nothing_agrees_with_nobody():
    views = {"door": sure("bow"), "wheel": UNIFORM, "table": (0.335, 0.33, 0.335), "back": sure("bow")}
    judgement = EngineDriver(rule="min_entropy").step(views, 0)
    assert [judgement.votes[name].label for name in VIEWS] == ["bow", None, None, "bow"]
    assert judgement.votes["wheel"].state == "counted" and judgement.votes["wheel"].p is not None
    assert (judgement.label, judgement.agreement.k, judgement.agreement.n) == ("bow", 2, 4)


def test_observers_that_cannot_agree_abstain():
    scene, split = EngineDriver(), {**all_views(sure("bow")), "table": sure("punch"), "back": sure("punch")}
    scene.step(split, MOVING, 8)
    scene.step(split, 0.9)
    scene.step(all_views(UNIFORM), 0.9, 8)
    (verdict,) = scene.verdicts
    assert verdict.label == ABSTAIN and verdict.ended_ns is not None and verdict.agreement.k == 2
    assert (verdict.stage, verdict.revises) == ("ended", None) and "2 of 3 observers needed vote" in verdict.why
    assert [verdict.votes[name].label for name in VIEWS] == ["bow", "bow", "punch", "punch"]


@pytest.mark.parametrize("rule", ALL_RULES)
def test_without_a_vote_no_movement_is_named_and_none_is_decided(rule):
    scene = EngineDriver(rule=rule, quorum=1, threshold=0.2, hold_s=0.0, drop_s=0.5)
    assert scene.step({}, 0, 3).label == ""
    scene.publish("door", sure("bow"), MOVING)
    assert scene.fuse().label == "bow"
    judgement = scene.step({}, 0, 10)
    assert (judgement.label, judgement.agreement.k, judgement.agreement.n) == ("", 0, 0)
    assert judgement.p == pytest.approx(UNIFORM) and {v.label for v in judgement.votes.values()} == {None}
    assert set(scene.labels) <= {"bow"}


def test_an_observer_whose_process_disappears_is_silent_at_once_and_the_others_continue():
    scene = EngineDriver()
    scene.engine.roster.set_present(frozenset(VIEWS))
    scene.step(all_views(sure("bow")), MOVING, 2)
    scene.engine.roster.set_present(frozenset(VIEWS) - {"back"})
    judgement = scene.step(all_views(sure("bow"), "back"), MOVING, 4)
    back = judgement.votes["back"]
    assert (back.state, back.label, back.p, back.entropy) == ("silent", None, None, None)
    assert (judgement.agreement.k, judgement.agreement.n) == (3, 3) and scene.labels == ["bow"]


def test_what_the_last_frame_of_a_film_shows_is_decided_when_its_observer_has_gone():
    scene = EngineDriver(["film"], quorum=1)
    scene.engine.roster.set_present(frozenset({"film"}))
    scene.step({"film": sure("bow", 0.7)}, MOVING, 6)
    last = scene.step({"film": sure("bow", 0.85)}, MOVING)
    scene.engine.roster.set_present(frozenset())
    scene.tick()
    assert scene.verdicts == [] and scene.fuse().agreement.n == 0
    (verdict,) = scene.verdicts
    assert (verdict.label, verdict.stage, verdict.decided_ns) == ("bow", "decided", scene.now_ns)
    assert (verdict.p, verdict.votes, verdict.agreement) == (last.p, last.votes, last.agreement)
    for _ in range(30):
        scene.tick()
        scene.fuse()
    assert scene.labels == ["bow", "bow"] and scene.verdicts[-1].stage == "ended"


def test_an_observer_that_sees_nobody_has_no_say_in_whether_the_person_rests():
    scene = EngineDriver(VIEWS[:2], quorum=1)
    for _ in range(8):
        scene.tick()
        scene.publish("door", sure("bow"), MOVING, visible={"head": True})
        scene.publish("wheel", UNIFORM, REST, visible={"head": False})
        judgement = scene.fuse()
    assert scene.labels == ["bow"] and judgement.movement is not None
    assert (judgement.votes["door"].rest, judgement.votes["wheel"].rest) == (MOVING, None)


def test_where_nobody_is_seen_any_more_the_movement_ends_and_none_begins_until_somebody_is():
    scene = EngineDriver(["door"], quorum=1)
    scene.step({"door": sure("bow")}, MOVING, 6, visible={"head": True})
    scene.step({"door": sure("bow")}, MOVING, 20, visible={"head": False})
    assert [verdict.stage for verdict in scene.verdicts] == ["decided", "ended"]
    assert scene.step({"door": sure("lunge")}, MOVING, visible={"head": True}).movement is not None


def test_a_second_without_any_observer_neither_ends_a_movement_nor_is_forgotten_by_a_service_that_follows():
    scene = EngineDriver()
    scene.engine.roster.set_present(frozenset(VIEWS))
    scene.step(all_views(sure("bow")), MOVING, 6)
    captured_ns = scene.now_ns
    scene.engine.roster.set_present(frozenset())
    for _ in range(10):
        scene.tick()
        judgement = scene.fuse()
    assert judgement.agreement.n == 0 and last_capture_ns(judgement) == captured_ns
    scene.engine.roster.set_present(frozenset(VIEWS))
    scene.step(all_views(sure("bow")), MOVING, 6)
    assert [verdict.stage for verdict in scene.verdicts] == ["decided"]


def test_a_movement_that_is_closed_does_not_end_before_its_decision():
    scene = EngineDriver()
    scene.step(all_views(sure("bow")), MOVING, 6)
    (verdict,) = scene.verdicts
    closed = scene.engine.close(verdict, verdict.decided_ns - STEP_NS, scene.now_ns, "dojo-9")
    assert (closed.stage, closed.ended_ns, closed.same_as) == ("ended", verdict.decided_ns, "dojo-9")


def test_what_is_improbable_is_not_decided_when_the_observers_go():
    scene = EngineDriver(["film"], quorum=1)
    scene.engine.roster.set_present(frozenset({"film"}))
    scene.step({"film": sure("bow", 0.7)}, MOVING, 6)
    scene.engine.roster.set_present(frozenset())
    for _ in range(30):
        scene.tick()
        scene.fuse()
    assert scene.labels == [ABSTAIN]


def test_what_was_named_before_a_movement_is_not_decided_when_the_observers_go_just_after_its_begin():
    """The router is killed a tenth of a second after the person began to move."""
    scene = EngineDriver(quorum=2, hold_s=0.1)
    scene.engine.roster.set_present(frozenset(VIEWS))
    scene.step(all_views(sure("bow")), REST, 6)
    scene.step(all_views(sure("bow")), MOVING, 2)
    scene.engine.roster.set_present(frozenset())
    for _ in range(15):
        scene.tick()
        scene.fuse()
    scene.engine.roster.set_present(frozenset(VIEWS))
    scene.step(all_views(sure("punch")), MOVING, 8)
    scene.step(all_views(sure("punch")), REST, 4)
    assert [label for label in scene.labels if label != ABSTAIN] == ["punch", "punch"]


@pytest.mark.parametrize("rule", ALL_RULES)
def test_silent_observers_do_not_vote_for_rest(rule):
    scene = EngineDriver(rule=rule, quorum=2, threshold=0.5)
    scene.step(all_views(sure("bow", 0.98), "table", "back"), 0.02, 6)
    scene.step(all_views(UNIFORM, "table", "back"), REST, 6)
    assert scene.labels == ["bow", "bow"]


def test_an_observer_that_is_sure_and_wrong_does_not_hold_a_movement_open():
    scene = EngineDriver(["door", "wheel", "stuck"], quorum=2)
    for label in ("bow", "punch"):
        for p, rest in ((sure(label, 0.99), MOVING), (sure(label, 0.5), REST)):
            for _ in range(8):
                scene.tick()
                scene.publish("stuck", sure("lunge", 0.97), 0.01)
                for name in ("door", "wheel"):
                    scene.publish(name, p, rest)
                scene.fuse()
    verdicts = [(v.label, v.ended_ns is not None) for v in scene.verdicts]
    assert verdicts == [("bow", False), ("bow", True), ("punch", False), ("punch", True)]


HOSTILE = {
    "wrong from the first frame": lambda label, t, rng: (sure("lunge" if label == "bow" else "bow", 0.999), 0.0),
    "second best": lambda label, t, rng: (sure("punch" if label == "lunge" else "lunge", 0.6), 0.0),
    "always something else": lambda label, t, rng: (UNIFORM, 1.0),
    "flaps": lambda label, t, rng: (sure(LABELS[t % 3], 0.99), float(t % 2)),
    "noise": lambda label, t, rng: (tuple(rng.dirichlet([0.2] * 3)), rng.uniform()),
    "repeats the last movement": lambda label, t, rng: (sure(LABELS[LABELS.index(label) - 1], 0.97), 0.05),
}


@pytest.mark.parametrize("strategy", HOSTILE.values(), ids=HOSTILE)
@pytest.mark.parametrize("honest", [2, 3])
def test_one_hostile_observer_turns_and_blocks_no_verdict(strategy, honest):
    scene, rng = EngineDriver((*VIEWS[:honest], "liar"), quorum=2), np.random.default_rng(0)
    movements = list(LABELS * 3)
    for label in movements:
        for t in range(24):
            scene.tick()
            for n, name in enumerate(VIEWS[:honest]):
                p = min(0.34 + 0.06 * t, 0.93 - 0.02 * n) if t < 18 else 1 / 3
                scene.publish(name, sure(label, p), MOVING if t < 14 else REST, unlearned=0.05)
            p, unlearned = strategy(label, t, rng)
            scene.publish("liar", p, rng.uniform(), unlearned=unlearned)
            scene.fuse()
    assert [v.label for v in scene.verdicts if v.stage == "decided"] == movements
    assert [v.label for v in scene.verdicts if v.stage == "ended"] == movements


def test_a_camera_that_stops_does_not_end_a_movement_and_all_of_them_do():
    scene = EngineDriver(quorum=2)
    scene.step(all_views(sure("bow")), MOVING, 4)
    judgement = scene.step(all_views(sure("bow"), "door"), MOVING, 15)
    assert judgement.votes["door"].state == "stale" and [v.ended_ns for v in scene.verdicts] == [None]
    judgement = scene.step({}, 0, 30)
    assert {v.state for v in judgement.votes.values()} == {"silent"} and judgement.p == pytest.approx(UNIFORM)
    assert [v.ended_ns is None for v in scene.verdicts] == [True, False] and scene.verdicts[1].agreement.k == 4


def test_50_ms_between_cameras_change_nothing():
    def verdicts(skew_ns):
        scene = EngineDriver()
        for rest in [MOVING] * 8 + [REST] * 8:
            scene.tick()
            for n, name in enumerate(VIEWS):
                scene.publish(name, sure("bow"), rest, captured_ns=scene.now_ns + skew_ns * (n - 1))
            scene.fuse()
        return [(v.label, v.began_ns, v.decided_ns, v.ended_ns, v.p) for v in scene.verdicts]

    assert verdicts(0) == verdicts(50_000_000) and len(verdicts(0)) == 2


def test_a_rule_that_is_gone_is_rejected():
    with pytest.raises(BadInput, match="this rule is gone"):
        EngineDriver(rule="median")
