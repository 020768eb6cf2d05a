"""What a bridge publishes, without a broker: topics, discovery, pace and events."""

import json
import re

import pytest
from played_scene import scene_of
from processes import until

from common.messages import Contribution
from hub.mqtt.bridge import SceneBridge
from hub.mqtt.entities import EXPIRE_S, Topics, bridge_topic, discovery
from hub.mqtt.events import EVENT_S, last_verdict_state, recalled_ns, verdict_event
from hub.mqtt.states import FAST_S, PRESENT_S, SLOW_S, STATE_REPEAT_S
from hub.scene_state import VERDICTS_WAIT_LIMIT, SceneState
from hub.session import SceneListener

TOPICS = Topics("room", bridge_topic("labanmesh", "room"))
OBSERVERS = ("cam1", "cam2")
HOW = {"effort_time": [0.2, 0.8], "shape_vertical": [0.1, 0.7, 0.2], "effort_flow": [0.4, 0.6], "mood": [1.0]}


class Driver:
    """A bridge, and what it publishes in one scene."""

    def __init__(self, make, recalled=True, movements=("nthrow",), **more):
        self.make, self.bridge = make, SceneBridge(scene_of(movements=movements, **more), TOPICS.bridge)
        if recalled:
            self.bridge.recall(None)

    def state(self, judgement=None, **more):
        """The state in which `judgement` has just arrived."""
        arrived = {} if judgement is None else {"judgement": judgement, "received_ns": self.make.NOON}
        return SceneState(
            "room", OBSERVERS, self.make.NOON, **{"vocabulary": self.make.vocabulary(), **arrived, **more}
        )

    def due(self, now_s, judgement=None, tokens=(), **more):
        """The due payload of each topic."""
        return self.due_in(now_s, self.state(judgement, **more), tokens)

    def due_in(self, now_s, state, tokens=()):
        return {each.topic: each.payload for each in self.bridge.due_states(state, frozenset(tokens), now_s)}

    def events(self, now_s=0.0):
        """The due events, confirmed as a broker does it: (topic, label, stage)."""
        events = []
        while (event := self.bridge.next_event(now_s)) is not None:
            assert not event.retain
            fields = json.loads(event.payload)
            events.append((event.topic.rpartition("/")[2], fields["event_type"], fields["stage"]))
            self.bridge.confirm_event()
        return events


@pytest.fixture
def driver(make):
    """A bridge that is connected and has no predecessor."""
    return Driver(make)


def sensor(what):
    return f"homeassistant/sensor/labanmesh_room_{what}/config"


def test_ids_are_legal_and_unique():
    ids = set()
    scenes = {"a": ("b_c", "b-c", "b"), "a_b": ("c", "observer"), "a-b": ("c",), "a_observer_b": ("c",)}
    for scene, observers in scenes.items():
        topics = discovery(Topics(scene, "x"), scene_of(scene, observers), ("wave", "b"), ("wave", "b"))
        for topic, payload in topics.items():
            head, _, unique_id, tail = topic.split("/")
            assert (head, tail) == ("homeassistant", "config") and re.fullmatch(r"[a-zA-Z0-9_-]+", unique_id)
            assert json.loads(payload).get("unique_id") == (None if "_automation" in topic else unique_id)
            assert unique_id not in ids
            ids.add(unique_id)


def test_words_that_may_be_null_are_unknown_in_home_assistant():
    configs = {t: json.loads(p) for t, p in discovery(TOPICS, scene_of(), ("ok",), ()).items()}
    for what, field in (("MOVEMENT", "movement"), ("OBSERVER_cam1_OPINION", "opinion"), ("LAST_VERDICT", "label")):
        assert configs[sensor(what)]["value_template"] == "{{ value_json." + field + " or 'unknown' }}"


def test_without_a_change_only_what_expires_is_repeated(driver, make):
    moving = make.moving(decided="nthrow")
    assert driver.due(0.0, moving)[TOPICS.movement("nthrow")] == "ON"
    assert driver.due(1.0, moving) == {}
    assert driver.due(STATE_REPEAT_S, moving) == {TOPICS.movement("nthrow"): "ON"} and STATE_REPEAT_S * 2 < EXPIRE_S
    driver.bridge.forget()
    again = list(driver.due(STATE_REPEAT_S + 1, moving))
    assert again[0].endswith("/config") and TOPICS.of("state") in again
    last_config = max(i for i, topic in enumerate(again) if topic.endswith("/config"))
    assert again.index(TOPICS.of("availability")) > last_config


def test_probabilities_are_paced_and_a_movement_is_not(driver, make):
    driver.due(0.0, make.moving(decided="nthrow"))
    other = make.moving(decided="nthrow", p=(0.1, 0.1, 0.1, 0.7))
    assert TOPICS.of("state") not in driver.due(FAST_S / 2, other)
    assert TOPICS.of("votes") not in driver.due(SLOW_S / 2, other)
    assert TOPICS.of("state") in driver.due(SLOW_S, make.moving(decided="nthrow", p=(0.2, 0.1, 0.1, 0.6)))
    ended = driver.due(SLOW_S + 0.01, make.judgement())
    assert json.loads(ended[TOPICS.of("state")])["movement"] == "rest" and ended[TOPICS.movement("nthrow")] == "OFF"


def test_without_observers_the_state_is_null(driver, make):
    due = driver.due(0.0, make.waiting())
    fields = ("movement", "label", "confidence", "entropy", "unlearned", "stage", "revises", "why")
    assert json.loads(due[TOPICS.of("state")]) == dict.fromkeys(fields)
    assert due[TOPICS.of("availability")] == "online" and due[TOPICS.movement("nthrow")] == "OFF"


def test_a_revision_is_an_event_of_its_own_and_an_automation_on_the_first_word_acts_once(driver, make):
    later = {"revises": "nthrow", "label": "ok", "at_ns": make.NOON + 1}
    words = [
        make.verdict(1), make.verdict(1, stage="revised", **later), make.verdict(1),
        make.verdict(1, ended_ns=make.NOON, **{**later, "at_ns": make.NOON + 2}),
        make.verdict(2, ended_ns=make.NOON), make.verdict(4, ended_ns=make.NOON, label="abstain"),
        make.verdict(3, stage="revised", **later),
    ]  # fmt: skip
    for word in words:
        driver.bridge.receive(word, 0.0)
        driver.bridge.receive(word, 0.0)
    due, events = driver.due(0.0), []
    while (event := driver.bridge.next_event(0.0)) is not None:
        events.append((event.topic.rpartition("/")[2], json.loads(event.payload)))
        driver.bridge.confirm_event()
    assert [(topic, e["id"], e["stage"], e["event_type"], e["revises"]) for topic, e in events] == [
        ("verdict", "v1", "decided", "nthrow", None), ("verdict", "v1", "revised", "ok", "nthrow"),
        ("ended", "v1", "ended", "ok", "nthrow"),
        ("verdict", "v2", "decided", "nthrow", None), ("ended", "v2", "ended", "nthrow", None),
        ("verdict", "v4", "decided", "abstain", None), ("ended", "v4", "ended", "abstain", None),
        ("verdict", "v3", "revised", "ok", "nthrow"),
    ]  # fmt: skip
    last = json.loads(due[TOPICS.of("last_verdict")])
    assert (last["label"], last["stage"], last["revises"]) == ("ok", "revised", "nthrow")


def test_the_state_carries_the_stage_at_once_and_why_there_is_none_yet(driver, make):
    def words(now_s, judgement):
        due = driver.due(now_s, judgement)
        states = [json.loads(due[TOPICS.of(name)]) for name in ("state", "votes") if TOPICS.of(name) in due]
        return [(state["stage"], state["revises"], state["why"]) for state in states]

    lacks = "nthrow 60 % of the 80 % needed"
    assert words(0.0, make.judgement()) == [(None, None, None)] * 2
    assert words(0.1, make.moving(why=lacks)) == [(None, None, lacks)] * 2, "the movement has changed"
    assert words(0.2, make.moving(decided="nthrow")) == [("decided", None, None)] * 2
    assert words(0.3, make.moving(decided="nthrow", revises="ok")) == [("revised", "ok", None)] * 2
    revoked = make.moving(decided="abstain", revises="ok")
    driver.due(0.4, revoked)
    states = json.loads(Driver(make).due(0.0, revoked)[TOPICS.of("state")])
    assert (states["movement"], states["stage"], states["revises"]) == ("undecided", "revised", "ok")
    config = json.loads(Driver(make).due(0.0, make.judgement())[sensor("MOVEMENT")])
    assert config["json_attributes_topic"] == TOPICS.of("votes")
    driver.bridge.receive(make.verdict(1, ended_ns=make.NOON, label="abstain", why=lacks), 1.0)
    assert json.loads(driver.due(1.0)[TOPICS.of("last_verdict")])["why"] == lacks
    assert json.loads(driver.bridge.next_event(1.0).payload)["why"] == lacks


def test_an_event_waits_for_the_broker_but_not_for_ever(driver, make):
    bridge = driver.bridge
    bridge.receive(make.verdict(1), 0.0)
    driver.due(0.0)
    assert bridge.next_event(1.0) == bridge.next_event(EVENT_S) is not None, "it was not confirmed"
    assert bridge.next_event(EVENT_S + 0.1) is None and bridge.left_out == 1
    for number in range(2, VERDICTS_WAIT_LIMIT + 4):
        bridge.receive(make.verdict(number), 50.0)
    driver.due(50.0)
    assert len(driver.events(50.0)) == VERDICTS_WAIT_LIMIT and bridge.left_out == 3


def test_a_verdict_from_while_the_hub_was_away_is_an_event_if_it_is_fresh(make):
    stale, known, missed = (make.verdict(n, at_ns=make.NOON + s * make.SECOND) for n, s in ((1, -60), (2, -5), (3, -1)))
    for said_ns, count in ((known.at_ns, 1), (stale.at_ns - make.SECOND, 2), (None, 0)):
        driver = Driver(make, recalled=False)
        for verdict in (stale, known, missed):
            driver.bridge.receive(verdict, 0.0, answered=True)
        driver.due(0.0, make.judgement())
        assert driver.events() == [], "nothing before it is known what was published"
        driver.bridge.recall(said_ns)
        driver.due(0.1, make.judgement())
        assert len(driver.events(0.1)) == count


def test_a_verdict_that_was_published_while_the_link_was_lost_is_an_event_if_it_is_fresh(driver, make):
    driver.bridge.receive(make.verdict(1, at_ns=make.NOON - 1), 0.0, answered=True)
    driver.due(0.0, make.judgement())
    late, newest_ns = (make.NOON + round(since_s * make.SECOND) for since_s in (1.0, 2 * EVENT_S))
    driver.bridge.receive(make.verdict(2, at_ns=late), 1.0, answered=True)
    driver.bridge.receive(make.verdict(3, at_ns=newest_ns), 1.0, answered=True)
    driver.due(1.0, make.judgement(2, newest_ns))
    assert len(driver.events(1.0)) == 1, "one of a minute ago, and one of now"


def test_facets_are_announced_once_an_observer_reports_them_and_stay(driver, make):
    def announced(topics):
        return {topic for topic in topics if any(kind in topic for kind in ("EFFORT", "SHAPE", "FACING"))}

    before = driver.due(0.0, make.judgement())
    assert not announced(before) and TOPICS.of("facets") not in before
    known = driver.due(1.0, make.moving(facets=HOW, facing_deg=359.8))
    assert announced(known) == set(map(sensor, ("EFFORT_TIME", "EFFORT_FLOW", "SHAPE_VERTICAL", "FACING")))
    state = json.loads(known[TOPICS.of("facets")])
    assert state["effort_time"] == {"pole": "sudden", "probability": 80} and state["facing"] == 0
    assert state["shape_vertical"]["pole"] == "neither" and set(state) == {*HOW, "facing"} - {"mood"}
    config = json.loads(known[sensor("EFFORT_TIME")])
    assert config["name"] == "Effort time"
    assert config["value_template"] == "{{ value_json.effort_time.pole or 'unknown' }}"
    assert config["state_topic"] == config["json_attributes_topic"] == TOPICS.of("facets")
    after = driver.due(2.0, make.judgement())
    assert not announced(after), "neither announced again nor taken away"
    assert json.loads(after[TOPICS.of("facets")])["effort_time"] == {"pole": None, "probability": None}


def test_a_verdict_event_has_facets_and_contributions(make):
    gave = {"cam1": Contribution(nats=0.614, stands=True), "cam2": Contribution(nats=float("inf"), stands=False)}
    how = {"facets": HOW, "facing_deg": 45.0, "unlearned": 0.5, "p": [0, 0, 0, 1.0]}
    event = verdict_event(make.verdict(1, contributions=gave, **how), "ended")
    assert event["contributions"] == {"cam1": {"nats": 0.61, "stands": True}, "cam2": {"nats": None, "stands": False}}
    assert (event["facing"], event["unlearned"], event["confidence"]) == (45, 50, 50)
    assert event["facets"]["effort_time"] == {"pole": "sudden", "probability": 80}
    unknown = verdict_event(make.verdict(1), "decided")
    assert [unknown[each] for each in ("facets", "facing", "contributions", "unlearned")] == [None] * 4


def test_an_ended_verdict_has_its_score_and_others_have_none(make):
    how = {"score": 7.84, "scores": {"cam1": 7.84}, "remarks": ["left knee: 12 degrees too straight at 60 %"]}
    verdict = make.verdict(1, ended_ns=make.NOON, **how)
    for fields in (verdict_event(verdict, "ended"), json.loads(last_verdict_state(verdict))):
        assert (fields["score"], fields["scores"], fields["remarks"]) == (7.8, {"cam1": 7.8}, how["remarks"])
    unknown = verdict_event(make.verdict(1), "decided")
    assert [unknown[each] for each in ("score", "scores", "remarks", "unscored")] == [None] * 4
    none = make.verdict(1, ended_ns=make.NOON, unscored="its begin was not seen")
    assert verdict_event(none, "ended")["unscored"] == "its begin was not seen"


@pytest.mark.parametrize(
    "payload", [b"", b"x", b"[]", b'{"said_ns": "1"}', b"\xff", b"null", b"[" * 100_000], ids=range(7)
)
def test_a_last_verdict_that_is_not_ours_is_ignored(payload):
    assert recalled_ns(payload) is None


def test_an_observer_is_present_while_frames_or_statuses_arrive(driver, make):
    votes = {"cam1": make.vote(None, state="silent", age_s=None), "cam2": make.vote(age_s=0.1)}

    def seen(now_s, tokens=("cam1",), **statuses):
        state = driver.state(make.judgement(votes=votes), observer_status=statuses)
        due = driver.due_in(now_s, state, tokens)
        return [due.get(TOPICS.observer("cam1", what)) for what in ("availability", "connected")]

    status = make.status("cam1")
    assert seen(0.0, cam1=status) == ["online", "ON"]
    assert seen(PRESENT_S + 0.1, cam1=status) == ["offline", "OFF"]
    assert seen(2.0, cam1=make.status("cam1")) == ["online", "ON"]
    assert seen(2.1, (), cam1=make.status("cam1")) == ["offline", "OFF"], "its token is gone"
    assert seen(2.2, cam1=make.status("cam1", "failed")) == [None, None], "still off"
    driver.bridge.forget()
    due = driver.due(3.0, make.judgement(votes=votes))
    assert due[TOPICS.observer("cam2", "availability")] == "online", "its frames arrive; it needs no status"


def test_a_fault_in_the_listening_thread_is_raised(scene, fake_link):
    def fail(update):
        raise ValueError("no")

    with SceneListener(scene, fake_link(), fail) as listener, pytest.raises(ValueError, match="no"):
        until(listener.check, "the fault")
