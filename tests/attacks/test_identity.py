"""A process is known by its key: no message, answer or reply speaks for another process."""

import time

import pytest
from attack_stage import ASK_CLOCKS_S, JUDGES
from processes import SOON_S, until

from common import SECOND_NS
from common.messages import StatusMessage, VocabularyMessage
from common.teaching_messages import TeachReply, TeachRequest
from common.wire import encode
from hub.scene_state import SceneState
from hub.session import listen
from hub.teaching.teaching_client import TeachingClient

VICTIM, LIAR = JUDGES[0], JUDGES[1]
HOUR_NS = 3600 * SECOND_NS


def status_of_the_victim(scene, **fields):
    return encode(StatusMessage(scene=scene.scene, id=VICTIM, **{"state": "failed", "reason": "it lies", **fields}))


def listened(stage, scene, enough):
    """The state of a hub when `enough(state)`."""
    with stage.link() as link:
        end_s = time.monotonic() + SOON_S
        state = SceneState(scene.scene)
        for update in listen(scene, link, lambda: time.monotonic() < end_s):
            state = update.state
            if enough(state):
                break
        return state


def test_an_answer_to_the_clock_question_is_about_its_own_key(stage, long_form):
    if long_form:
        pytest.skip("a service of many scenes asks once a minute: the short form asks more often")
    scene, attacker = stage.scenes[1], stage.attacker()
    lie = status_of_the_victim(scene, state="running", at_ns=time.time_ns() + HOUR_NS)
    attacker.answer(scene.keys.observer_status(LIAR), lambda: [lie] * 3)
    attacker.answer(scene.keys.observer_status("nobody"), lambda: [lie])
    since = len(stage.witness.judgements[scene.scene])
    stage.await_judgements(3 * ASK_CLOCKS_S)
    judged = [message.votes[VICTIM] for _, message in stage.witness.judgements[scene.scene][since:]]
    assert judged and all(abs(vote.skew_s or 0.0) < 1.0 and vote.state != "late" for vote in judged)


def test_a_status_and_a_vocabulary_are_those_of_their_key_and_hash(stage):
    scene, attacker = stage.scenes[0], stage.attacker()
    true = stage.person.vocabulary
    forged = VocabularyMessage.model_construct(
        v=1, scene=scene.scene, name=true.name, hash=true.digest, labels=[*reversed(true.labels)]
    )
    lies = [encode(forged), b"\xc1"]
    attacker.answer(scene.keys.vocabulary, lambda: lies)

    def has_heard_lies(state):
        for name in (LIAR, "invented"):
            attacker.put(scene.keys.observer_status(name), status_of_the_victim(scene))
        attacker.put(scene.keys.vocabulary, lies[0])
        return state.judgement is not None and state.labels and state.rejected > 3

    state = listened(stage, scene, has_heard_lies)
    assert state.labels == true.labels
    assert VICTIM not in state.observer_status or state.observer_status[VICTIM].reason != "it lies"


def test_a_message_under_the_id_of_a_fusion_service_does_not_stop_it(stage, long_form):
    scene, attacker, since_ns = stage.scenes[0], stage.attacker(), time.time_ns()
    last = until(lambda: stage.witness.last(scene.scene))
    status = StatusMessage(scene=scene.scene, id=last.fusion, state="running", session="~", at_ns=since_ns)
    for n in range(50 if long_form else 2):
        forged = last.model_copy(update={"session": f"~{n}", "epoch": (last.epoch or 0) + 1 + n})
        attacker.put(scene.keys.judgement, encode(forged))
        attacker.put(scene.keys.fusion_status(last.fusion), encode(status))
        stage.await_judgements(0.1)
    forged_ns = time.time_ns()
    # A service younger than YOUNG_S (fusion/same_id.py) waits for answers, and the standby service may lead.
    until(lambda: (now := stage.witness.last(scene.scene)).session[0] != "~" and now.at_ns > forged_ns)
    if long_form:
        gaps = stage.gaps(since_ns)
        assert max(gaps.values()) <= stage.longest_gap_s, gaps


def test_a_reply_of_a_lesson_is_of_the_observer_that_was_asked(stage):
    scene, attacker = stage.scenes[-1], stage.attacker()
    liar = encode(TeachReply(state="learned", fault="", labels=["bow", "lunge"]))
    attacker.answer(scene.keys.teach(LIAR), lambda: [liar])
    with stage.link() as link:
        request = TeachRequest(command="status", teacher="t")
        answers = until(lambda: TeachingClient(link, scene.keys).ask(request, [LIAR]).replies)
        assert set(answers) == {LIAR}
        attacker.answer(f"{scene.keys.root}/observer/*/@teach", lambda: [liar])
        assert set(TeachingClient(link, scene.keys).ask(request, [LIAR]).replies) <= {LIAR}


def test_thousands_of_invented_processes_are_neither_shown_nor_counted_one_by_one(stage, long_form):
    scene, attacker = stage.scenes[0], stage.attacker()
    count = 15_000 if long_form else 100
    for n in range(count):
        keys = scene.keys
        status = encode(StatusMessage(scene=scene.scene, id=f"x{n}", state="failed", reason="n" * 5000))
        attacker.session.put(keys.observer_status(f"x{n}"), status)
        attacker.session.put(keys.posterior(f"x{n}"), b"\xc1")
        if n < 1000:
            attacker.token(keys.observer_alive(f"x{n}"))
    since_ns = time.time_ns()
    state = listened(stage, scene, lambda s: s.now_ns > since_ns + SECOND_NS // 4)
    assert len(state.observer_status) <= 64 + len(JUDGES)
    assert all(len(status.reason) <= 200 for status in state.observer_status.values())
    statistics = [status.observers or {} for status in state.fusion_status.values()]
    assert all(len(each) <= 256 + 1 + len(JUDGES) for each in statistics)
