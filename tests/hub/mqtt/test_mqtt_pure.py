"""What is said to a broker, without one: topics, discovery, pace, events, and what is not said."""

import json
import re
from dataclasses import replace

import pytest

from common.errors import BadInput
from common.messages import Contribution, OngoingMovement
from hub.mqtt.bridge import WAITING_LIMIT, SceneBridge
from hub.mqtt.entities import EXPIRE_S, Topics, bridge_topic, checked_prefix, discovery
from hub.mqtt.events import EVENT_S, recalled_ns, verdict_event
from hub.mqtt.states import FAST_S, PRESENT_S, REPEAT_S, SLOW_S
from hub.scene_state import SceneState

TOPICS = Topics("room", bridge_topic("labanmesh", "room"))
OBSERVERS = ("cam1", "cam2")
IDS = re.compile(r"[a-zA-Z0-9_-]+\Z")


@pytest.fixture
def bridge():
    """A bridge that is connected, and knows of no earlier one."""
    made = SceneBridge(TOPICS, OBSERVERS, ("nthrow",))
    made.recall(None)
    return made


def at(said, judgement=None, **more):
    """The state in which `judgement` was heard just now."""
    heard = {} if judgement is None else {"judgement": judgement, "received_ns": said.NOON}
    return SceneState("room", OBSERVERS, said.NOON, vocabulary=said.vocabulary(), **heard, **more)


def payloads(publications):
    return {each.topic: each.payload for each in publications}


def taken(bridge, now_s):
    """All events that are due, as a broker takes them: (topic, label, stage)."""
    found = []
    while (event := bridge.next_event(now_s)) is not None:
        assert not event.retain
        said = json.loads(event.payload)
        found.append((event.topic.rpartition("/")[2], said["event_type"], said["stage"]))
        bridge.confirm_event()
    return found


def going_on(said, label="nthrow", **more):
    movement = OngoingMovement(id="v1", began_ns=said.NOON, label=label, decided_ns=said.NOON)
    return said.judgement(**more).model_copy(update={"movement": movement})


def test_ids_are_legal_and_no_two_scenes_or_observers_share_one():
    ids = set()
    scenes = {"a": ("b_c", "b-c", "b"), "a_b": ("c", "observer"), "a-b": ("c",), "a_observer_b": ("c",)}
    for scene, observers in scenes.items():
        topics = discovery(Topics(scene, "x"), observers, ("wave", "b"), ("wave", "b"), "")
        for topic, payload in topics.items():
            head, _, unique_id, tail = topic.split("/")
            assert (head, tail) == ("homeassistant", "config") and IDS.match(unique_id)
            assert json.loads(payload)["unique_id"] == unique_id
            assert unique_id not in ids
            ids.add(unique_id)


def test_discovery_hangs_observers_under_their_scene_and_needs_bridge_and_judge():
    said = {t: json.loads(p) for t, p in discovery(TOPICS, OBSERVERS, ("ok",), (), "Dojo").items()}
    assert len(said) == 6 + 10 * len(OBSERVERS)
    age = said["homeassistant/sensor/labanmesh_room_OBSERVER_cam1_AGE/config"]
    assert (
        age["device"]["via_device"]
        == said["homeassistant/event/labanmesh_room_VERDICT/config"]["device"]["identifiers"][0]
    )
    assert age["availability_mode"] == "all" and age["entity_category"] == "diagnostic"
    assert [a["topic"] for a in age["availability"]] == [
        "labanmesh/room/bridge",
        TOPICS.observer("cam1", "availability"),
    ]
    connected = said["homeassistant/binary_sensor/labanmesh_room_OBSERVER_cam1_CONNECTED/config"]
    assert [a["topic"] for a in connected["availability"]] == ["labanmesh/room/bridge"]
    assert {each["device"]["suggested_area"] for each in said.values()} == {"Dojo"}


def test_verdicts_are_discovered_when_the_movements_are_known(bridge, said):
    config = "homeassistant/event/labanmesh_room_VERDICT/config"
    assert config not in payloads(bridge.due_states(replace(at(said), vocabulary=None), frozenset(), 0.0))
    known = payloads(bridge.due_states(at(said, said.judgement()), frozenset(), 1.0))
    assert json.loads(known[config])["event_types"] == [*said.vocabulary().labels, "abstain"]
    # Forgotten for a moment, as while a new vocabulary is asked for: nothing is taken away.
    assert config not in payloads(bridge.due_states(replace(at(said), vocabulary=None), frozenset(), 2.0))


@pytest.mark.parametrize(
    "value", ["", "home#assistant", "home/+", "/home", "home/", "ho me", "höme", "$SYS", "a//b", "a\n"]
)
def test_a_prefix_with_odd_characters_is_one_clear_line(value):
    with pytest.raises(BadInput) as caught:
        checked_prefix(value, "hub.mqtt.discovery")
    assert repr(value) in str(caught.value) and "'homeassistant'" in str(caught.value)


def test_nothing_changed_nothing_said_but_what_expires(bridge, said):
    state = at(said, going_on(said))
    assert payloads(bridge.due_states(state, frozenset(), 0.0))[TOPICS.movement("nthrow")] == "ON"
    assert bridge.due_states(state, frozenset(), 1.0) == []
    assert payloads(bridge.due_states(state, frozenset(), REPEAT_S)) == {TOPICS.movement("nthrow"): "ON"}
    assert REPEAT_S * 2 < EXPIRE_S
    bridge.forget()
    again = [each.topic for each in bridge.due_states(state, frozenset(), REPEAT_S + 1)]
    assert again[0].endswith("/config") and TOPICS.of("state") in again
    assert again.index(TOPICS.of("availability")) > max(i for i, topic in enumerate(again) if topic.endswith("/config"))


def test_a_belief_that_wavers_is_paced_and_a_movement_is_not(bridge, said):
    bridge.due_states(at(said, going_on(said)), frozenset(), 0.0)
    wavering = at(said, going_on(said, p=(0.1, 0.1, 0.1, 0.7)))
    assert TOPICS.of("state") not in payloads(bridge.due_states(wavering, frozenset(), FAST_S / 2))
    assert TOPICS.of("votes") not in payloads(bridge.due_states(wavering, frozenset(), SLOW_S / 2))
    assert TOPICS.of("state") in payloads(
        bridge.due_states(at(said, going_on(said, p=(0.2, 0.1, 0.1, 0.6))), frozenset(), SLOW_S)
    )
    ended = payloads(bridge.due_states(at(said, said.judgement()), frozenset(), SLOW_S + 0.01))
    assert json.loads(ended[TOPICS.of("state")])["movement"] == "rest" and ended[TOPICS.movement("nthrow")] == "OFF"


def test_each_verdict_is_an_event_once_and_its_end_another(bridge, said):
    state = at(said, said.judgement())
    for verdict in (
        said.verdict(1),
        said.verdict(1),
        said.verdict(1, ended_ns=said.NOON),
        said.verdict(1, ended_ns=said.NOON),
    ):
        bridge.receive(verdict, 0.0)
    look = payloads(bridge.due_states(state, frozenset(), 0.0))
    assert taken(bridge, 0.0) == [("verdict", "nthrow", "decided"), ("ended", "nthrow", "ended")]
    assert json.loads(look[TOPICS.of("last_verdict")])["label"] == "nthrow"


def test_another_label_at_the_end_is_told_as_revised(bridge, said):
    bridge.receive(said.verdict(1), 0.0)
    bridge.receive(said.verdict(1, ended_ns=said.NOON, label="ok"), 0.0)
    bridge.receive(said.verdict(2, ended_ns=said.NOON, label="abstain"), 0.0)
    bridge.due_states(at(said), frozenset(), 0.0)
    assert taken(bridge, 0.0) == [
        ("verdict", "nthrow", "decided"), ("verdict", "ok", "revised"), ("ended", "ok", "ended"),
        ("verdict", "abstain", "decided"), ("ended", "abstain", "ended"),
    ]  # fmt: skip


def test_an_event_waits_for_the_broker_but_not_for_ever(bridge, said):
    bridge.receive(said.verdict(1), 0.0)
    bridge.due_states(at(said), frozenset(), 0.0)
    assert bridge.next_event(1.0) == bridge.next_event(EVENT_S) is not None, "it was not taken"
    assert bridge.next_event(EVENT_S + 0.1) is None and bridge.left_out == 1
    for number in range(2, WAITING_LIMIT + 4):
        bridge.receive(said.verdict(number), 50.0)
    bridge.due_states(at(said), frozenset(), 50.0)
    assert len(taken(bridge, 50.0)) == WAITING_LIMIT and bridge.left_out == 3


def test_what_was_said_before_is_no_event(bridge, said):
    bridge.receive(said.verdict(1), 0.0, answered=True)
    look = payloads(bridge.due_states(at(said), frozenset(), 0.0))
    assert taken(bridge, 0.0) == [] and "nthrow" in look[TOPICS.of("last_verdict")]
    bridge.receive(said.verdict(1, ended_ns=said.NOON), 1.0)
    bridge.due_states(at(said), frozenset(), 1.0)
    assert taken(bridge, 1.0) == [("ended", "nthrow", "ended")]


def test_what_was_said_while_the_hub_was_away_is_said_once_if_it_is_fresh(said):
    second = said.SECOND
    stale, known, missed = (said.verdict(n, at_ns=said.NOON + s * second) for n, s in ((1, -60), (2, -5), (3, -1)))
    for left, expected in ((known.at_ns, ["missed"]), (stale.at_ns - second, ["known", "missed"]), (None, [])):
        bridge = SceneBridge(TOPICS, OBSERVERS, ())
        for verdict in (stale, known, missed):
            bridge.receive(verdict, 0.0, answered=True)
        bridge.due_states(at(said, said.judgement()), frozenset(), 0.0)
        assert taken(bridge, 0.0) == [], "nothing before it is known what was said"
        bridge.recall(left)
        bridge.due_states(at(said, said.judgement()), frozenset(), 0.1)
        assert len(taken(bridge, 0.1)) == len(expected)


HOW = {"effort_time": [0.2, 0.8], "shape_vertical": [0.1, 0.7, 0.2], "effort_flow": [0.4, 0.6], "mood": [1.0]}


def test_how_it_is_done_is_announced_once_somebody_says_it_and_stays(bridge, said):
    def facets(publications):
        return {topic for topic in publications if "EFFORT" in topic or "SHAPE" in topic or "FACING" in topic}

    silent = payloads(bridge.due_states(at(said, said.judgement()), frozenset(), 0.0))
    assert not facets(silent) and TOPICS.of("facets") not in silent
    speaks = going_on(said).model_copy(update={"facets": HOW, "facing_deg": 359.8})
    known = payloads(bridge.due_states(at(said, speaks), frozenset(), 1.0))
    sensors = ("EFFORT_TIME", "EFFORT_FLOW", "SHAPE_VERTICAL", "FACING")
    assert facets(known) == {f"homeassistant/sensor/labanmesh_room_{what}/config" for what in sensors}
    state = json.loads(known[TOPICS.of("facets")])
    assert state["effort_time"] == {"pole": "sudden", "probability": 80} and state["facing"] == 0
    assert state["shape_vertical"]["pole"] == "neither" and set(state) == {*HOW, "facing"} - {"mood"}
    config = json.loads(known["homeassistant/sensor/labanmesh_room_EFFORT_TIME/config"])
    assert config["name"] == "Effort time"
    assert config["value_template"] == "{{ value_json.effort_time.pole or 'unknown' }}"
    assert config["state_topic"] == config["json_attributes_topic"] == TOPICS.of("facets")
    after = payloads(bridge.due_states(at(said, said.judgement()), frozenset(), 2.0))
    assert not facets(after), "not announced again, and not taken away"
    assert json.loads(after[TOPICS.of("facets")])["effort_time"] == {"pole": None, "probability": None}


def test_a_verdict_tells_how_it_was_done_and_what_each_judge_gave(bridge, said):
    gave = {"cam1": Contribution(nats=0.614, stands=True), "cam2": Contribution(nats=float("inf"), stands=False)}
    verdict = said.verdict(1, contributions=gave)
    verdict = verdict.model_copy(update={"facets": HOW, "facing_deg": 45.0, "unlearned": 0.5, "p": [0, 0, 0, 1.0]})
    event = verdict_event(verdict, "ended")
    assert event["contributions"] == {"cam1": {"nats": 0.61, "stands": True}, "cam2": {"nats": None, "stands": False}}
    assert (event["facing"], event["unlearned"], event["confidence"]) == (45, 50, 50)
    assert event["facets"]["effort_time"] == {"pole": "sudden", "probability": 80}
    silent = verdict_event(said.verdict(1), "decided")
    assert [silent[each] for each in ("facets", "facing", "contributions", "unlearned")] == [None] * 4


def test_an_observers_reliability_is_a_diagnosis(bridge, said):
    votes = {"cam1": said.vote().model_copy(update={"reliability": 0.456}), "cam2": said.vote()}
    due = payloads(bridge.due_states(at(said, said.judgement(votes=votes)), frozenset(), 0.0))
    assert json.loads(due[TOPICS.observer("cam1", "state")])["reliability"] == 0.46
    assert json.loads(due[TOPICS.observer("cam2", "state")])["reliability"] is None
    config = json.loads(due["homeassistant/sensor/labanmesh_room_OBSERVER_cam1_RELIABILITY/config"])
    assert config["entity_category"] == "diagnostic"


def test_an_early_word_is_an_event_and_so_is_its_end(said):
    bridge = SceneBridge(TOPICS, OBSERVERS, (), certainty=0.55)
    bridge.recall(None)
    undecided = going_on(said, None)
    undecided = undecided.model_copy(update={"movement": OngoingMovement(id="v1", began_ns=said.NOON)})
    doubted = undecided.model_copy(update={"p": [0.1, 0.2, 0.2, 0.5]})
    config = payloads(bridge.due_states(at(said, doubted), frozenset(), 0.0))
    assert bridge.next_event(0.0) is None
    bridge.due_states(at(said, undecided), frozenset(), 0.0)
    assert json.loads(config["homeassistant/event/labanmesh_room_EARLY/config"])["state_topic"] == TOPICS.of("early")
    event = json.loads(bridge.next_event(0.0).payload)
    assert (event["event_type"], event["stage"], event["id"], event["confidence"]) == ("nthrow", "early", "v1", 60)
    assert taken(bridge, 0.0) == [("early", "nthrow", "early")]
    bridge.receive(said.verdict(1, ended_ns=said.NOON, label="ok"), 1.0)
    bridge.due_states(at(said, said.judgement()), frozenset(), 1.0)
    assert taken(bridge, 1.0) == [("early", "ok", "corrected"), ("verdict", "ok", "decided"), ("ended", "ok", "ended")]
    second = undecided.model_copy(update={"movement": OngoingMovement(id="v2", began_ns=said.NOON)})
    bridge.due_states(at(said, second.model_copy(update={"p": doubted.p})), frozenset(), 1.9)
    bridge.due_states(at(said, second), frozenset(), 2.0)
    for now_s in (3.0, 4.0):
        bridge.due_states(at(said, said.judgement()), frozenset(), now_s)
    assert taken(bridge, 4.0) == [("early", "nthrow", "early"), ("early", "abstain", "withdrawn")]


def test_without_a_certainty_nothing_is_early(bridge, said):
    sure = said.judgement(p=(0.0, 0.0, 0.0, 1.0))
    sure = sure.model_copy(update={"movement": OngoingMovement(id="v1", began_ns=said.NOON)})
    due = payloads(bridge.due_states(at(said, sure), frozenset(), 0.0))
    assert not any("EARLY" in topic for topic in due) and bridge.next_event(0.0) is None


@pytest.mark.parametrize("payload", [b"", b"x", b"[]", b'{"said_ns": "1"}', b"\xff", b"null"])
def test_a_memory_that_is_not_ours_is_none(payload):
    assert recalled_ns(payload) is None


def test_a_judge_is_there_while_frames_or_words_come(said):
    status = {"cam1": said.status("cam1")}
    silent = {"cam1": said.vote(None, state="silent", age_s=None), "cam2": said.vote(age_s=0.1)}
    bridge = SceneBridge(TOPICS, OBSERVERS, ())
    state = at(said, said.judgement(votes=silent), observer_status=status)
    there = payloads(bridge.due_states(state, frozenset({"cam1"}), 0.0))
    assert (there[TOPICS.observer("cam1", "availability")], there[TOPICS.observer("cam1", "connected")]) == (
        "online",
        "ON",
    )
    assert there[TOPICS.observer("cam2", "availability")] == "online", "its frames come; it need not say how it is"
    gone = payloads(bridge.due_states(state, frozenset({"cam1"}), PRESENT_S + 0.1))
    assert (gone[TOPICS.observer("cam1", "availability")], gone[TOPICS.observer("cam1", "connected")]) == (
        "offline",
        "OFF",
    )
    back = payloads(
        bridge.due_states(replace(state, observer_status={"cam1": said.status("cam1")}), frozenset({"cam1"}), 2.0)
    )
    assert back[TOPICS.observer("cam1", "availability")] == "online"
    assert payloads(bridge.due_states(state, frozenset(), 2.1))[TOPICS.observer("cam1", "connected")] == "OFF", (
        "its token went"
    )
    failed = replace(state, observer_status={"cam1": said.status("cam1", "failed")})
    assert TOPICS.observer("cam1", "connected") not in payloads(bridge.due_states(failed, frozenset({"cam1"}), 2.2)), (
        "still off"
    )


def test_without_a_referee_the_scene_is_offline_and_nothing_goes_on(bridge, said):
    state = at(said, going_on(said))
    bridge.due_states(state, frozenset(), 0.0)
    gone = payloads(bridge.due_states(state.at(said.NOON + 2 * said.SECOND), frozenset(), 2.0))
    assert gone[TOPICS.of("availability")] == "offline" and gone[TOPICS.movement("nthrow")] == "OFF"
    assert json.loads(gone[TOPICS.observer("cam2", "state")])["weight"] is None
