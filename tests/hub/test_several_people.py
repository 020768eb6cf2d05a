"""What hubs show of a scene that judges several people."""

import json

from played_scene import scene_of

from common import SECOND_NS
from hub.anticipation import Anticipation
from hub.dashboard.history import SceneHistory
from hub.dashboard.page_data import state_data, verdict_data
from hub.history.records import row_line, row_of
from hub.mqtt.bridge import SceneBridge
from hub.mqtt.entities import Topics, discovery
from hub.mqtt.events import verdict_event
from hub.scene_state import SceneState
from hub.session import SceneUpdate
from hub.watch import show_lines
from hub.wording import label_words, person_line, verdict_line

TOPICS = Topics("room", "labanmesh/bridge")


def folded(make, *messages):
    state = SceneState("room", ("cam1", "cam2"), make.NOON, vocabulary=make.vocabulary())
    for message in messages:
        state = state.fold(message, make.NOON)
    return state


def both(make, at_ns=0):
    return (
        make.judgement(1, make.NOON + at_ns, person="left"),
        make.moving(1, 2, "ok", make.NOON + at_ns, person="right", place=[-1.0, 0.5]),
    )


def test_the_first_person_is_shown_large_and_the_others_beside(make):
    state = folded(make, *both(make), *both(make, SECOND_NS // 10))
    assert state.judgement.person == "left" and [each.person for each in state.people] == ["left", "right"]
    assert person_line(state.people[0]) == "left: at rest"
    assert person_line(state.people[1]).startswith("right: ok 60%, decided")


def test_a_late_copy_of_another_person_changes_nothing(make):
    state = folded(make, *both(make, SECOND_NS // 10))
    assert state.fold(both(make)[1], make.NOON) is state


def test_who_is_not_judged_any_more_is_not_shown(make):
    left, _ = both(make, 3 * SECOND_NS)
    state = folded(make, *both(make), left)
    assert [each.person for each in state.people] == ["left"]


def test_if_the_first_one_is_not_judged_another_one_is_shown(make):
    _, right = both(make, 5 * SECOND_NS)
    assert folded(make, *both(make), right).judgement.person == "right"


def test_every_line_of_a_verdict_says_whose_it_is(make):
    verdict = make.verdict(ended_ns=make.NOON, person="left")
    assert label_words(verdict) == "left: nthrow" and "left: nthrow" in verdict_line(verdict)
    assert "left: nthrow" in row_line(row_of(verdict))[1] and row_of(verdict).as_json()["person"] == "left"
    assert verdict_event(verdict, "ended")["person"] == "left"
    assert "person" not in verdict_event(make.verdict(), "decided")


def test_watch_prints_a_line_for_each_person(make, capsys):
    state = folded(make, *both(make))
    show_lines([SceneUpdate(state, both(make)[1])])
    lines = capsys.readouterr().out.splitlines()
    assert ["judgement  left:" in lines[0], "judgement  right:" in lines[1]] == [True, True]


def test_the_page_gets_everybody_and_of_one_person_what_it_got(make):
    history = SceneHistory(folded(make, *both(make)))
    (left, right) = state_data(history)["people"]
    assert (left["person"], right["person"], right["place"]) == ("left", "right", [-1.0, 0.5])
    assert "people" not in state_data(SceneHistory(folded(make, make.judgement())))
    assert verdict_data(make.verdict(person="left"), history, None)["person"] == "left"
    assert "person" not in verdict_data(make.verdict(), history, None)


def test_mqtt_has_a_sensor_for_each_person(make):
    scene = scene_of(people={"most": 2, "names": ["left", "right"]})
    bridge = SceneBridge(scene, TOPICS.bridge)
    bridge.recall(None)
    due = {each.topic: each.payload for each in bridge.due_states(folded(make, *both(make)), frozenset(), 0.0)}
    states = {person: json.loads(due[f"labanmesh/room/person/{person}"])["movement"] for person in ("left", "right")}
    assert states == {"left": "rest", "right": "ok"}
    configs = discovery(TOPICS, scene, ("ok",), ())
    named = [json.loads(each)["name"] for each in configs.values() if "Movement of" in each]
    assert named == ["Movement of left", "Movement of right"]
    assert not any("person" in topic for topic in discovery(TOPICS, scene_of(), ("ok",), ()))


def test_an_early_word_on_one_person_is_not_withdrawn_by_the_rest_of_another(make):
    anticipation = Anticipation(0.5)
    anticipation.update(make.judgement(person="right", p=(0.25,) * 4), 0.0)
    words = anticipation.update(make.moving(2, person="right"), 0.1)
    assert [word.stage for word in words] == ["early"]
    for n in range(30):
        assert anticipation.update(make.judgement(3 + n, person="left"), 0.2 + n / 10) == []
        assert anticipation.update(make.moving(3 + n, person="right"), 0.25 + n / 10) == []
