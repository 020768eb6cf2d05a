"""Posteriors of an hour ago, played again under the keys of their judges, count nothing and silence nobody."""

import threading
import time

import pytest
from attack_judges import TICK_S
from attack_stage import JUDGES

from common import SECOND_NS

HOUR_NS = 3600 * SECOND_NS


def an_hour_ago(stage, scene, judge, n):
    """What a judge published an hour ago: of another session, and sure of one movement."""
    then_ns, labels = time.time_ns() - HOUR_NS, len(stage.person.vocabulary.labels)
    sure = {"p": [0.97] + [0.03 / (labels - 1)] * (labels - 1), "rest": 0.02}
    stamps = {"seq": n, "session": f"yesterday-{judge}", "captured_ns": then_ns, "sent_ns": then_ns}
    course = stage.person.course(judge)
    return stage.judges.posterior(scene, judge, course, 0, **sure, **stamps)


def test_captured_posteriors_of_an_hour_ago_count_nothing(stage, long_form):
    scene, attacker, since_ns = stage.scenes[-1], stage.attacker(), time.time_ns()
    for n in range(round((10.0 if long_form else 0.4) / TICK_S)):
        for judge in JUDGES:
            attacker.put(scene.keys.posterior(judge), an_hour_ago(stage, scene.scene, judge, n))
        threading.Event().wait(TICK_S)
    stage.await_judgements(0.0)
    judged = [message for at_ns, message in stage.witness.judgements[scene.scene] if at_ns > since_ns]
    states = {(name, vote.state) for message in judged for name, vote in message.votes.items()}
    assert states <= {(judge, state) for judge in JUDGES for state in ("counted", "stale")}, states


def test_they_count_nothing_where_the_judge_itself_is_away(stage, long_form):
    if not long_form:
        pytest.skip("it waits until a judge is silent: make attacks")
    scene, attacker, judge = stage.scenes[-1], stage.attacker(), JUDGES[-1]
    stage.judges.silent.add(judge)
    try:
        stage.wait_for_state(scene.scene, judge, "silent", "late")
        since_ns = time.time_ns()
        for n in range(10):
            attacker.put(scene.keys.posterior(judge), an_hour_ago(stage, scene.scene, judge, n))
            threading.Event().wait(TICK_S)
        stage.await_judgements(0.0)
        judged = [message for at_ns, message in stage.witness.judgements[scene.scene] if at_ns > since_ns]
        assert {message.votes[judge].state for message in judged} <= {"silent", "late"}
        assert {message.agreement.n for message in judged} <= {len(JUDGES) - 1}
    finally:
        stage.judges.silent.clear()
