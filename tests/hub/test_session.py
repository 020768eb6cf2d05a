"""Listening: late joiners know the last values, unusable messages are rejected, a vocabulary is queried again."""

from itertools import count

import pytest
from played_scene import fall_of

from common.config import read_scene
from common.messages import VocabularyReference
from common.wire import encode
from hub.session import listen

ROOT = "laban/room"


def looks(number):
    """Go on for this many looks into the inbox."""
    left = iter(range(number))
    return lambda: next(left, None) is not None


def pairs(**messages):
    return [(f"{ROOT}/{key.replace('__', '/')}", encode(message)) for key, message in messages.items()]


def in_vocabulary(message, digest):
    return message.model_copy(update={"vocabulary": VocabularyReference(name="other", hash=digest)})


def last(updates):
    *_, update = updates
    return update.state


def test_a_late_joiner_knows_the_last_values(scene, make, fake_link):
    link = fake_link(pairs(judgement=make.judgement(), vocabulary=make.vocabulary()))
    *answered, end = listen(scene, link, looks(1), lambda: make.NOON + 60 * make.SECOND)
    assert end.state.labels == tuple(make.vocabulary().labels)
    assert end.state.silence_s == 60, "a last value dates from when it was published"
    assert [update.answered for update in (*answered, end)] == [True, True, False]


def test_messages_arrive_in_order_and_once(scene, make, fake_link):
    messages = [make.judgement(1), make.verdict(1), make.judgement(1), make.judgement(2, make.NOON + 1)]
    arrivals = [(f"{ROOT}/{'verdict' if hasattr(each, 'id') else 'judgement'}", encode(each)) for each in messages]
    received = [each.message for each in listen(scene, fake_link((), arrivals), looks(1)) if each.message]
    assert received == [messages[0], messages[1], messages[3]]


def test_a_stage_of_the_watch_for_falls_is_news_once_and_its_state_the_newest(scene, fake_link):
    falls = [fall_of("low", lying=0.6), fall_of("low", lying=0.7), fall_of("fallen"), fall_of("fallen", 2)]
    arrivals = [(f"{ROOT}/fall", encode(each)) for each in falls]
    updates = list(listen(scene, fake_link((), arrivals), looks(1)))
    assert [each.message for each in updates if each.message] == [falls[0], falls[2], falls[3]]
    assert updates[1].state.fall.lying == 0.7


def test_a_verdict_published_during_the_query_is_new_and_of_many_judgements_only_the_newest_is_decoded(
    scene, make, fake_link
):
    old, new = (pairs(verdict=make.verdict(number))[0] for number in (1, 2))
    judgements = [pairs(judgement=make.judgement(seq, make.NOON + seq))[0] for seq in range(1, 9)]
    updates = list(listen(scene, fake_link([old, new], [new, *judgements]), looks(1), newest_only=True))
    received = [(update.message.id, update.answered) for update in updates if hasattr(update.message, "id")]
    assert received == [("v1", True), ("v2", False)]
    assert updates[-1].state.judgement.seq == 8 and sum(update.message is not None for update in updates) == 3


def test_the_key_tells_an_observer_from_a_fusion_service_of_the_same_id(scene, make, fake_link):
    arrivals = pairs(observer__cam1__status=make.status("cam1"), fusion__cam1__status=make.status("cam1", "failed"))
    link = fake_link((), arrivals[:1])
    state = last(listen(scene, link, looks(1)))
    assert [each.status is not None for each in state.observers] == [True, False] and not state.fusion_status
    state = last(listen(scene, fake_link(arrivals), looks(0)))
    assert state.fusion_status["cam1"].state == "failed" and state.observers[0].status.state == "running"


@pytest.mark.parametrize("key", ["observer/cam1/status", "judgement", "verdict", "vocabulary"])
def test_a_message_that_names_another_sender_than_its_key_is_rejected(scene, make, fake_link, key):
    other = {
        "observer/cam1/status": make.status("cam2", "failed"),
        "judgement": make.judgement().model_copy(update={"scene": "kitchen"}),
        "verdict": make.verdict().model_copy(update={"scene": "kitchen"}),
        "vocabulary": make.vocabulary().model_copy(update={"hash": "0" * 16}),
    }[key]
    state = last(listen(scene, fake_link([(f"{ROOT}/{key}", encode(other))]), looks(0)))
    assert state.rejected == 1 and state.is_empty and state.vocabulary is None


def test_unusable_messages_are_counted_and_other_keys_are_ignored(scene, make, fake_link):
    answers = [(f"{ROOT}/judgement", b"nonsense"), *((f"{ROOT}/{key}", b"x") for key in ("new", "status", "a/b/c/d"))]
    state = last(listen(scene, fake_link([*answers, *pairs(judgement=make.judgement())]), looks(0)))
    assert state.rejected == 1 and state.judgement == make.judgement()


def test_an_unknown_vocabulary_is_queried_until_it_is_answered(scene, make, fake_link):
    link, seconds = fake_link((), pairs(judgement=make.judgement())), count(make.NOON, make.SECOND)
    states = listen(scene, link, looks(8), lambda: next(seconds))
    while f"{ROOT}/vocabulary" not in link.queries:
        next(states)
    link.answers = pairs(vocabulary=make.vocabulary())
    assert last(states).labels and link.queries.count(f"{ROOT}/vocabulary") <= 3


def test_verdicts_that_were_published_while_the_link_was_lost_arrive_once_it_is_back(scene, make, fake_link):
    keys = scene.keys
    known = pairs(verdict=make.verdict(1, make.NOON, stage="ended"))
    link, seconds = fake_link([*pairs(judgement=make.judgement()), *known]), count(make.NOON, make.SECOND)
    updates = listen(scene, link, looks(9), lambda: next(seconds))
    received = [next(updates) for _ in range(4)]
    link.answers = [*known, *pairs(verdict=make.verdict(2)), *pairs(verdict=make.verdict(2, make.NOON, stage="ended"))]
    received += [next(updates) for _ in range(3)]
    assert keys.verdict not in link.queries, "the link was not lost"
    link.present.note(keys.fusion_alive("fuse1"), alive=True)
    received += updates
    verdicts = [update.message for update in received if hasattr(update.message, "id")]
    assert [(each.id, each.stage) for each in verdicts] == [("v1", "ended"), ("v2", "decided"), ("v2", "ended")]
    assert link.queries.count(keys.verdict) == 1 and all(update.answered for update in received if update.message)


def test_a_verdict_of_no_movement_is_rejected_and_counted(scene, make, fake_link):
    foreign = in_vocabulary(make.verdict(3, label="forged"), "0" * 16)
    forged = [make.verdict(1, label="forged"), make.verdict(2, revises="forged", stage="revised"), foreign]
    forged += [make.judgement(2, make.NOON + 1, label="forged"), make.judgement(3, make.NOON + 2, p=(0.5, 0.5))]
    good = [make.verdict(4), make.verdict(5, label="abstain")]
    arrivals = [(f"{ROOT}/{'verdict' if hasattr(each, 'id') else 'judgement'}", encode(each)) for each in forged + good]
    link = fake_link(pairs(vocabulary=make.vocabulary(), judgement=make.judgement()), arrivals)
    updates = list(listen(scene, link, looks(1)))
    state = updates[-1].state
    assert [each.id for each in state.verdicts] == ["v5", "v4"] and state.rejected == len(forged)
    assert state.judgement.label == "nthrow" and {getattr(each.message, "id", "v4") for each in updates} == {"v4", "v5"}


def test_a_verdict_of_no_service_that_judges_is_rejected_and_counted(scene, make, fake_link):
    """Anybody may copy a vocabulary; and a capture of yesterday may be played onto the mesh."""

    def other(fusion, message):
        return message.model_copy(update={"fusion": fusion})

    forged = [make.verdict(1, session="yesterday"), other("nobody", make.verdict(2, session="s1"))]
    taken = [make.verdict(3, session="s1"), other("cam1", make.verdict(4, session="s2", label="ok"))]
    standby = (f"{ROOT}/fusion/cam1/status", encode(make.status("cam1", session="s2")))
    arrivals = [
        *pairs(judgement=make.judgement(session="s1")),
        standby,
        *(p for v in forged + taken for p in pairs(verdict=v)),
    ]
    link = fake_link(pairs(vocabulary=make.vocabulary()), arrivals)
    state = last(listen(scene, link, looks(1)))
    assert [each.id for each in state.verdicts] == ["v4", "v3"] and state.rejected == len(forged)
    # Before anything is known of a scene, a verdict is taken; and one that was asked for may be of a service long gone.
    assert last(listen(scene, fake_link((), pairs(verdict=forged[0])), looks(1))).rejected == 0
    asked = fake_link([*pairs(judgement=make.judgement(session="s1")), *pairs(verdict=forged[0])])
    assert last(listen(scene, asked, looks(1))).rejected == 0


def test_a_verdict_of_the_vocabulary_before_is_known_to_late_joiners_and_ends(scene, make, fake_link):
    old = make.verdict(1)
    ended = make.verdict(1, at_ns=make.NOON + 1, ended_ns=make.NOON + 1, stage="ended")
    new = make.vocabulary(("wave", "point"))
    judgement = in_vocabulary(make.judgement(1, p=(0.5, 0.5), label="wave", votes={}), new.hash)
    link = fake_link(pairs(vocabulary=new, judgement=judgement, verdict=old), pairs(verdict=ended))
    state = last(listen(scene, link, looks(1)))
    assert state.rejected == 0 and state.verdicts[0].ended_ns == make.NOON + 1


def test_of_the_judgements_of_two_people_the_newest_of_each_is_decoded(make, fake_link, tmp_path):
    """A fusion service publishes them at once, at every step: of one only the last person's would ever be seen."""
    text = 'scene = "room"\n[people]\nmost = 2\nnames = ["left", "right"]\n[observers.cam1]\nsource = "a.npz"\n'
    (tmp_path / "s.toml").write_text(text)
    judgements = [
        pairs(judgement=make.judgement(seq, make.NOON + seq, person=person))[0]
        for seq in range(1, 9)
        for person in ("left", "right")
    ]
    link = fake_link((), judgements)
    state = last(listen(read_scene(tmp_path / "s.toml", {}), link, looks(1), lambda: make.NOON, newest_only=True))
    assert [(each.person, each.seq) for each in state.people] == [("left", 8), ("right", 8)]
