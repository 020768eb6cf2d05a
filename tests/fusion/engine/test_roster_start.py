"""No verdict before the roster has begun: the wait at the start of a scene, on the engine with simulated time."""

import pytest
from engine_stage import CONFIG, MOVING, REST, STEP_NS, UNIFORM, VIEWS, VOCABULARY, EngineDriver, sure

from common.vocabulary import ABSTAIN, Vocabulary
from fusion.engine.segmenter import Segmenter
from fusion.engine.segments import PooledState

GRACE_STEPS = 30


def starting(**config):
    scene = EngineDriver(**config)
    scene.engine.wait_for_roster(3.0)
    return scene


def views(p, names=VIEWS):
    return dict.fromkeys(names, p)


def test_no_abstention_before_the_observers_have_begun():
    scene = starting()
    scene.step({}, REST, GRACE_STEPS * 2)
    judgement = scene.step(views(UNIFORM, VIEWS[:2]), MOVING, 10)
    assert judgement.why == "waiting for table, back to begin"
    assert judgement.movement is not None and judgement.movement.label is None
    scene.step(views(UNIFORM, VIEWS[:2]), REST, 10)
    assert scene.verdicts == []

    scene.step(views(UNIFORM), REST, 3)
    scene.step(views(sure("bow")), MOVING, 6)
    assert scene.labels == ["bow"]


def test_no_abstention_on_motion_that_the_last_observer_did_not_see_begin():
    scene = starting()
    scene.step(views(UNIFORM, VIEWS[:2]), MOVING, 3)
    scene.step(views(UNIFORM), MOVING, 5)
    scene.step(views(UNIFORM), REST, 8)
    assert scene.verdicts == []
    scene.step(views(UNIFORM), MOVING, 5)
    scene.step(views(UNIFORM), REST, 8)
    assert scene.labels == [ABSTAIN]


@pytest.mark.parametrize("steps", [8, GRACE_STEPS - 4])
def test_a_movement_goes_on_while_the_last_observers_begin(steps):
    """Nobody waits any longer than for the last one, and the movement has its own begin."""
    scene = starting(quorum=2)
    scene.step(views(sure("bow"), VIEWS[:3]), MOVING)
    began_ns = scene.now_ns
    scene.step(views(sure("bow"), VIEWS[:3]), MOVING, steps)
    assert scene.verdicts == []
    scene.step(views(sure("bow")), MOVING)
    scene.step(views(UNIFORM), REST, 6)
    assert [verdict.stage for verdict in scene.verdicts] == ["decided", "ended"]
    assert {verdict.began_ns for verdict in scene.verdicts} == {began_ns}


def test_after_the_grace_the_observers_that_have_begun_suffice():
    scene = starting(quorum=2)
    there = VIEWS[:3]
    scene.step(views(sure("bow"), there), MOVING, 6)
    scene.step(views(UNIFORM, there), REST, 6)
    assert scene.verdicts == []
    scene.step(views(UNIFORM, there), REST, GRACE_STEPS - 12)
    assert scene.verdicts == []
    # What they decided during the wait is late, but not lost.
    scene.step(views(UNIFORM, there), REST)
    assert [(each.label, each.stage) for each in scene.verdicts] == [("bow", "decided"), ("bow", "ended")]
    scene.step(views(sure("lunge"), there), MOVING, 5)
    assert scene.labels[2:] == ["lunge"]
    scene.step(views(UNIFORM, there), REST, 6)
    scene.step(views(UNIFORM, there), MOVING, 5)
    scene.step(views(UNIFORM, there), REST, 8)
    assert scene.labels[2:] == ["lunge", "lunge", ABSTAIN]


def test_an_observer_that_dies_later_delays_nothing():
    scene = starting(quorum=2)
    scene.step(views(UNIFORM), REST, 3)
    scene.step(views(UNIFORM, VIEWS[:2]), REST, GRACE_STEPS)
    scene.step(views(sure("bow"), VIEWS[:2]), MOVING, 5)
    assert scene.labels == ["bow"]


def test_an_observer_with_unusable_messages_has_begun():
    scene = starting(quorum=2)
    scene.step(views(UNIFORM, VIEWS[:3]), REST)
    scene.engine.roster.reject("back", "malformed")
    scene.step(views(sure("bow"), VIEWS[:3]), MOVING, 5)
    assert scene.labels == ["bow"]


def test_a_service_that_continues_does_not_wait():
    owner, second = EngineDriver(), starting()
    second.engine.continue_from(owner.step(views(UNIFORM), REST))
    second.step(views(sure("bow"), VIEWS[:3]), MOVING, 5)
    assert second.labels == ["bow"]


def test_a_clock_that_is_set_back_does_not_prolong_the_wait():
    scene = starting(quorum=2)
    scene.step(views(UNIFORM, VIEWS[:3]), REST, 5)
    scene.now_ns -= 600 * 10**9
    scene.step(views(UNIFORM, VIEWS[:3]), REST, GRACE_STEPS + 1, session="restarted")
    scene.step(views(sure("bow"), VIEWS[:3]), MOVING, 5, session="restarted")
    assert scene.labels == ["bow"]


def test_a_new_vocabulary_ends_the_wait():
    scene = starting(quorum=2)
    scene.step(views(sure("bow"), VIEWS[:3]), MOVING, 5)
    ended = scene.engine.change_vocabulary(Vocabulary(("bow", "kick", "punch"), "karate"), scene.now_ns)
    assert [(each.label, each.stage) for each in ended] == [("bow", "decided"), ("bow", "ended")]


@pytest.mark.parametrize(("began", "labels"), [(20, []), (21, [ABSTAIN])], ids=["as the wait ended", "later"])
def test_only_an_abstention_on_a_movement_begun_during_the_wait_is_dropped(began, labels):
    scene = EngineDriver()
    scene.engine.wait_for_roster(2.0)
    there = VIEWS[:3]
    scene.step(views(UNIFORM, there), REST, began)
    scene.step(views(UNIFORM, there), MOVING, 5)
    scene.step(views(UNIFORM, there), REST, 8)
    assert scene.labels == labels


def test_a_label_and_a_decision_taken_back_of_a_movement_begun_during_the_wait_are_published():
    segmenter = Segmenter(CONFIG, VOCABULARY)
    segmenter.wait(0.5)
    story = [("bow", 0.9, 0.1, 0.0, 8), ("bow", 0.05, 0.1, 0.9, 5), ("bow", 0.05, 0.9, 0.9, 8)]
    steps = [step for *step, times in story for _ in range(times)]
    published = [
        decision
        for n, (label, p, rest, unlearned) in enumerate(steps)
        for decision in segmenter.update(PooledState(n * STEP_NS, label, p, 3, rest, unlearned, complete=False))
    ]
    assert [(d.stage, d.label) for d in published] == [("decided", "bow"), ("revised", ABSTAIN), ("ended", ABSTAIN)]
