"""`labanmesh hub mqtt` with a real broker: what it publishes when, and what survives a restart."""

import json
import os
import signal
import subprocess
import threading
from datetime import UTC, datetime

import pytest
from mqtt_stage import Broker, Hub, Listener
from played_scene import LABELS, ROOT, hub_section
from processes import SOON_S, until, within

from benchmarks.timing import free_port
from common.certificate_authority import issue, make_authority
from common.config import read_scene
from hub.home_assistant import home_assistant_advice
from hub.mqtt.service import serve
from labanmesh import main

T = "labanmesh/room"


def test_a_scene_appears_is_judged_and_is_deleted(room, hub, listener, broker):
    room.doubts = True
    running = hub(movements=["nthrow"], area="Dojo", certainty=0.85).connected()
    listener.wait_for_state("labanmesh/room/bridge", "online")
    listener.wait_for_state(f"{T}/availability", "online")
    listener.wait_for(lambda: f"{T}/movement/nthrow" in listener.last and f"{T}/state" in listener.last)
    config = json.loads(listener.last["homeassistant/event/labanmesh_room_VERDICT/config"])
    assert config["event_types"] == [*LABELS, "abstain"] and config["device"]["suggested_area"] == "Dojo"
    assert [each["topic"] for each in config["availability"]] == ["labanmesh/room/bridge", f"{T}/availability"]
    age = json.loads(listener.last["homeassistant/sensor/labanmesh_room_OBSERVER_cam1_AGE/config"])
    assert age["device"]["via_device"] == config["device"]["identifiers"][0] and age["availability_mode"] == "all"
    own = f"{T}/observer/cam1/availability"
    assert [each["topic"] for each in age["availability"]] == ["labanmesh/room/bridge", own]
    assert json.loads(listener.last[f"{T}/state"])["movement"] == "rest"
    listener.wait_for(lambda: json.loads(listener.last[f"{T}/state"])["confidence"] == 40)
    room.begin(1)
    listener.wait_for(lambda: f"{T}/early" in listener.last)
    with within(0.3, running.process.pid, broker.pid):
        room.publish_verdict("nthrow", 1)
        listener.wait_for(lambda: f"{T}/verdict" in listener.last)
    assert len(listener.events(f"{T}/verdict")) == 1
    listener.wait_for_state(f"{T}/movement/nthrow", "ON")
    room.publish_verdict("nthrow", 1, ended=True)
    listener.wait_for_state(f"{T}/movement/nthrow", "OFF")
    listener.wait_for(lambda: f"{T}/ended" in listener.last)
    early = [(event["id"], event["stage"], event["event_type"]) for event in listener.events(f"{T}/early")]
    assert early == [("room-1", "early", "byebye"), ("room-1", "corrected", "nthrow")]
    (event,) = listener.events(f"{T}/verdict")
    assert event["event_type"] == "nthrow" and event["stage"] == "decided" and set(event["votes"]) == {"cam1", "cam2"}
    with Listener(broker.port) as late:
        late.wait_for(lambda: f"{T}/last_verdict" in late.last)
        assert not late.events(f"{T}/verdict") and not late.events(f"{T}/ended"), "events are not retained"
        retained = {topic for _, topic, _, kept in late.messages if kept}
        assert f"{T}/state" in retained and f"{T}/availability" in retained
    room.publish_verdict("nthrow", 2)
    listener.wait_for_state(f"{T}/movement/nthrow", "ON")
    room.stop_judging()
    listener.wait_for_state(f"{T}/availability", "offline")
    listener.wait_for_state(f"{T}/movement/nthrow", "OFF")
    assert running.end() == 0, running.log
    listener.wait_for_state("labanmesh/room/bridge", "offline")
    taken = subprocess.run(
        [*running.process.args, "--remove"], cwd=ROOT, capture_output=True, text=True, timeout=SOON_S, check=True
    )
    assert "retained messages deleted from the broker" in taken.stdout
    with Listener(broker.port) as empty:
        empty.publish("mark", "")
        empty.wait_for(lambda: "mark" in empty.last)
        assert set(empty.last) == {"mark"}


def test_a_killed_hub_is_offline_and_the_next_publishes_what_it_missed_once(room, hub, listener):
    first = hub().connected()
    room.wait_for_hub()
    room.publish_verdict("ok", 1, ended=True)
    listener.wait_for(lambda: f"{T}/ended" in listener.last)
    listener.wait_for(lambda: '"ended": "' in listener.last.get(f"{T}/last_verdict", ""))
    first.end(signal.SIGKILL)
    listener.wait_for_state("labanmesh/room/bridge", "offline")
    room.publish_verdict("maestro", 2)
    hub().connected()
    listener.wait_for(lambda: len(listener.events(f"{T}/verdict")) == 2)
    room.publish_verdict("maestro", 2, ended=True)
    listener.wait_for(lambda: len(listener.events(f"{T}/ended")) == 2)
    assert [each["event_type"] for each in listener.events(f"{T}/verdict")] == ["ok", "maestro"]


def test_a_broker_that_restarts_gets_everything_again_and_no_verdict_is_lost(room, hub, broker):
    running = hub().connected()
    room.wait_for_hub()
    broker.stop()
    running.wait_for("no MQTT broker")
    room.publish_verdict("byebye", 1)
    broker.start()
    with Listener(broker.port) as listener:
        listener.wait_for(lambda: f"{T}/availability" in listener.last)
        listener.wait_for(lambda: "homeassistant/sensor/labanmesh_room_MOVEMENT/config" in listener.last)
        # A client that subscribes a moment later misses the event, but not the retained state.
        listener.wait_for(lambda: '"byebye"' in listener.last.get(f"{T}/last_verdict", ""))
    running.connected(2)
    assert running.log.count("no MQTT broker") == 1, running.log


@pytest.fixture
def hurried(room, broker, listener, tmp_path, monkeypatch):
    """A hub in this process that waits for half a second where others wait for five; what ends it."""
    for module in ("broker", "service"):
        monkeypatch.setattr(f"hub.mqtt.{module}.CONNECTION_TIMEOUT_S", 0.5)
    scene, stop = read_scene(room.scene_file(tmp_path / "room.toml", hub_section(broker.port))), threading.Event()
    serving = threading.Thread(target=serve, args=([scene], stop))

    def end():
        stop.set()
        serving.join(SOON_S)

    serving.start()
    listener.wait_for_state("labanmesh/room/bridge", "online")
    listener.wait_for(lambda: f"{T}/state" in listener.last)
    yield end
    os.kill(broker.pid, signal.SIGCONT)
    end()


def test_a_broker_that_confirms_late_passes_each_event_on_once(room, broker, listener, hurried):
    os.kill(broker.pid, signal.SIGSTOP)
    ids, judged = {room.publish_verdict("ok", number) for number in (1, 2)}, room._seq
    until(lambda: room._seq > judged + 15, "the broker stood still for much longer than connecting may take")
    os.kill(broker.pid, signal.SIGCONT)
    ids.add(room.publish_verdict("maestro", 3))
    listener.wait_for(lambda: {each["id"] for each in listener.events(f"{T}/verdict")} == ids)
    hurried()
    listener.wait_for_state("labanmesh/room/bridge", "offline")
    assert len(listener.events(f"{T}/verdict")) == 3


def test_a_hub_ends_beside_a_broker_that_stands_still(room, broker, hurried):
    os.kill(broker.pid, signal.SIGSTOP)
    judged = room._seq
    room.publish_verdict("ok", 1)
    until(lambda: room._seq > judged + 10, "the hub waits for the confirmation")
    with within(5.0, broker.pid):
        hurried()


def test_when_home_assistant_starts_everything_is_published_again(room, hub, listener):
    hub().connected()
    config = "homeassistant/sensor/labanmesh_room_MOVEMENT/config"
    listener.wait_for(lambda: config in listener.last and f"{T}/state" in listener.last)
    before = len(listener.messages)
    listener.publish("homeassistant/status", "online")

    def again():
        topics = [topic for _, topic, *_ in listener.messages[before:]]
        return config in topics and f"{T}/state" in topics[topics.index(config) :]

    listener.wait_for(again)


@pytest.mark.parametrize("number", [signal.SIGKILL, signal.SIGSTOP])
def test_a_dead_observer_is_unavailable_within_two_seconds(room, hub, listener, broker, number):
    room.silent = frozenset({"cam1"})  # no frames arrive; its process publishes that it runs
    process, topics = room.observer("cam1"), f"{T}/observer"
    running = hub().connected()
    for topic, payload in (("cam1/availability", "online"), ("cam1/connected", "ON"), ("cam2/availability", "online")):
        listener.wait_for_state(f"{topics}/{topic}", payload)
    pids = (running.process.pid, broker.pid)
    with within(2.5, *pids):
        with within(2.0, *pids):
            process.send_signal(number)
            listener.wait_for_state(f"{topics}/cam1/availability", "offline")
        listener.wait_for_state(f"{topics}/cam1/connected", "OFF")
    assert listener.last[f"{topics}/cam2/availability"] == "online"


@pytest.fixture
def guarded(tmp_path):
    """A broker with one user, anna."""
    place = tmp_path / "guarded"
    place.mkdir()
    passwords = place / "passwords"
    subprocess.run(["mosquitto_passwd", "-b", "-c", passwords, "anna", "secret"], check=True, timeout=SOON_S)
    with Broker(place, ["allow_anonymous false", f"password_file {passwords}"]) as running:
        yield running


def test_a_password_from_a_file_and_a_wrong_one(broker, guarded, room, tmp_path):
    (tmp_path / "word").write_text("secret\n")
    keys = {"username": "anna", "password_file": "word"}
    file = room.scene_file(tmp_path / "room.toml", hub_section(guarded.port, **keys))
    right = Hub(file).connected()
    assert right.end() == 0
    (tmp_path / "word").write_text("guess\n")
    wrong = Hub(file)
    assert wrong.process.wait(SOON_S) == 2
    wrong.end()
    assert wrong.log.count("\n") == 1 and "refuses user 'anna': not authorized" in wrong.log, wrong.log


@pytest.fixture
def encrypted(tmp_path):
    """A broker with a certificate from its own authority; both are in its folder."""
    place, now = tmp_path / "encrypted", datetime.now(UTC)
    place.mkdir()
    authority = make_authority("a broker", now)
    pair = issue(authority, "broker.1", ["localhost"], now, roles=("router",)).pair
    files = {"cafile": authority.certificate, "certfile": pair.certificate, "keyfile": pair.key}
    for what, content in files.items():
        (place / f"{what}.pem").write_bytes(content)
    with Broker(place, ["allow_anonymous true", *(f"{what} {place / what}.pem" for what in files)]) as running:
        yield running


def test_tls_by_the_brokers_authority_and_not_without(broker, encrypted, room, tmp_path):
    keys = {"host": "localhost", "tls": True}
    section = hub_section(encrypted.port, **keys, ca_file="encrypted/cafile.pem")
    file = room.scene_file(tmp_path / "room.toml", section)
    assert Hub(file).connected().end() == 0
    doubtful = Hub(room.scene_file(tmp_path / "room.toml", hub_section(encrypted.port, **keys)))
    assert doubtful.process.wait(SOON_S) == 2
    doubtful.end()
    assert doubtful.log.count("\n") == 1 and "hub.mqtt.ca_file = ''" in doubtful.log, doubtful.log


def test_a_missing_broker_is_logged_once_and_awaited(room, tmp_path, broker):
    broker.stop()
    running = Hub(room.scene_file(tmp_path / "room.toml", hub_section(broker.port)), level="debug")
    running.wait_for("no MQTT broker at 127.0.0.1").wait_for("the next try in", 2)
    broker.start()
    running.connected()
    lines = [line for line in running.log.splitlines() if "INFO" in line or "WARNING" in line]
    assert running.end() == 0 and len(lines) == 2, running.log


@pytest.mark.parametrize(
    ("keys", "words"),
    [
        ({"discovery": "home#assistant"}, "hub.mqtt.discovery = 'home#assistant'"),
        ({"host": "mqtt://broker"}, "hub.mqtt.host = 'mqtt://broker'"),
        ({"host": "a..b"}, "hub.mqtt.host = 'a..b'"),
        ({"movements": ["byby"]}, "hub.mqtt.movements = 'byby': no movement of the vocabulary; known: byebye"),
        ({"topics": "a b"}, "hub.mqtt.topics = 'a b'"),
        ({"username": "anna", "password_file": "nowhere"}, "hub.mqtt.password_file = 'nowhere': no such file"),
        ({"password_file": "nowhere"}, "set hub.mqtt.username too"),
        ({"ca_file": "ca.pem"}, "set hub.mqtt.tls = true"),
        ({"tls": True, "ca_file": "nowhere.pem"}, "hub.mqtt.ca_file = 'nowhere.pem': no such file"),
    ],
)
def test_bad_input_is_one_line(room, tmp_path, capsys, keys, words):
    file = room.scene_file(tmp_path / "room.toml", hub_section(free_port(), **keys))
    file.write_text(f"vocabulary = {json.dumps(LABELS)}\n" + file.read_text())
    assert main(["hub", "mqtt", str(file)]) == 2
    error = capsys.readouterr().err
    assert error.count("\n") == 1 and words in error


def test_scenes_of_one_hub_have_one_broker_and_names_of_their_own(room, tmp_path, capsys):
    one, other = (room.scene_file(tmp_path / f"{port}.toml", hub_section(port)) for port in (1, 2))
    for second, words in ((other, "start a hub for each broker"), (one, "two of the scene files have this name")):
        assert main(["hub", "mqtt", str(one), str(second)]) == 2
        assert words in capsys.readouterr().err
    assert main(["hub", "mqtt", str(one), "--remove"]) == 1
    assert "no MQTT broker at 127.0.0.1:1: connection refused" in capsys.readouterr().err


def test_taught_movements_are_discovered_at_once_and_the_old_ones_removed(room, hub, broker, tmp_path):
    def trigger(label):
        return f"homeassistant/device_automation/labanmesh_room_RECOGNISED_{label}/config"

    first, second, third = LABELS, ("wave", "maestro", "ok", "nthrow"), ("wave", "clap", "ok", "nthrow")
    hubs = room.mqtt_hubs()
    running = hub(movements=["*"]).connected()
    assert hubs.wait_for(1, SOON_S) and home_assistant_advice(read_scene(tmp_path / "room.toml"), hubs.alive).connected
    with Listener(broker.port) as listener:
        listener.wait_for(lambda: set(map(trigger, first)) <= set(listener.last))
        room.teach(second)
        # The broker passes an empty retained message on to who listens.
        listener.wait_for_state(trigger("byebye"), "")
        listener.wait_for(lambda: trigger("wave") in listener.last and f"{T}/movement/wave" in listener.last)
        listener.wait_for_state(f"{T}/movement/byebye", "")
        event = "homeassistant/event/labanmesh_room_VERDICT/config"
        listener.wait_for(lambda: json.loads(listener.last[event])["event_types"] == [*second, "abstain"])
        assert running.end() == 0
        room.teach(third)
        running = hub(movements=["*"]).connected()
        listener.wait_for_state(trigger("maestro"), "")
        listener.wait_for(lambda: trigger("clap") in listener.last)
    broker.stop()
    assert hubs.wait_for(0, SOON_S)
    advice = home_assistant_advice(read_scene(tmp_path / "room.toml"), hubs.alive)
    assert not advice.connected and f"the scene file names the broker 127.0.0.1:{broker.port}" in advice.steps[1]
    running.wait_for("no MQTT broker")
    room.teach(first)
    broker.start()
    with Listener(broker.port) as late:
        late.wait_for(lambda: set(map(trigger, first)) <= {topic for topic in late.last if late.last[topic]})
        assert not late.last.get(trigger("wave")) and not late.last.get(trigger("clap"))


def test_a_scene_that_a_hub_serves_is_not_deleted(room, hub, listener, tmp_path, capsys):
    running = hub().connected()
    listener.wait_for(lambda: f"{T}/state" in listener.last)
    assert main(["hub", "mqtt", str(tmp_path / "room.toml"), "--remove"]) == 2
    assert "a hub still serves it" in capsys.readouterr().err and running.process.poll() is None
