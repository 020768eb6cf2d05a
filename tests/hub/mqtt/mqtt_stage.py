"""What the tests with a broker share: mosquitto, a scene that is judged by hand, observers to kill, who listens."""

import contextlib
import json
import os
import shutil
import signal
import socket
import subprocess
import sys
import threading
import time
from pathlib import Path

import paho.mqtt.client as paho

from common.config import MeshConfig
from common.keys import SceneKeys
from common.link import Link
from common.messages import (
    Agreement,
    JudgementMessage,
    OngoingMovement,
    VerdictMessage,
    VocabularyMessage,
    VocabularyReference,
    Vote,
)
from common.vocabulary import Vocabulary
from common.wire import encode

ROOT = Path(__file__).parents[3]
SOON_S = 20.0
SECOND = 1_000_000_000
LABELS = ("byebye", "maestro", "ok", "nthrow")
VOCABULARY = Vocabulary(LABELS)
REFERENCE = VocabularyReference(name="movements", hash=VOCABULARY.digest)

OBSERVER = """
import sys, threading
from common.config import MeshConfig
from common.link import Link
from common.messages import StatusMessage
from common.wire import encode
from common.keys import SceneKeys

endpoint, scene, name = sys.argv[1:]
keys, stop = SceneKeys(scene), threading.Event()
with Link.open(MeshConfig(endpoint=endpoint), "observer") as link:
    link.announce(keys.observer_alive(name))
    mouth = link.publisher(keys.observer_status(name))
    while not stop.wait(0.5):
        mouth.put(encode(StatusMessage(scene=scene, id=name, state="running", rate_hz=15.0)))
"""


def mosquitto():
    """Where the broker's program is, or None."""
    return shutil.which("mosquitto", path=os.environ.get("PATH", "") + ":/usr/sbin:/usr/local/sbin")


def free_port():
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return probe.getsockname()[1]


def environment():
    """The process's own, with this repository before an installed one."""
    return {**os.environ, "PYTHONPATH": str(ROOT), "PYTHONUNBUFFERED": "1"}


class Broker:
    """A mosquitto of its own; a context manager. What it retains is gone when it ends, unless `kept`."""

    def __init__(self, place, lines=("allow_anonymous true",), kept=False):
        place.mkdir(parents=True, exist_ok=True)
        self.port, self._place = free_port(), place
        keep = ["persistence true", f"persistence_location {place}/"] if kept else ["persistence false"]
        # As root it would become another user, who may not read here.
        text = "\n".join(
            [f"listener {self.port} 127.0.0.1", "user root", "log_type subscribe", "log_type error", *keep, *lines]
        )
        (place / "broker.conf").write_text(text + "\n")
        self._process = None

    def start(self):
        command = [mosquitto(), "-c", self._place / "broker.conf"]
        log = (self._place / "broker.log").open("ab")
        self._process = subprocess.Popen(command, stdout=log, stderr=subprocess.STDOUT)
        log.close()
        until(lambda: answers(self.port), f"mosquitto at {self.port}")
        return self

    def wait_for_subscriber(self, topic, seconds=SOON_S):
        """Until somebody listens to `topic`: the broker writes it down."""
        until(lambda: topic in (self._place / "broker.log").read_text(), f"nobody listens to {topic}", seconds)

    def stop(self):
        if self._process:
            self._process.terminate()
            self._process.wait(SOON_S)
            self._process = None

    def __enter__(self):
        return self.start()

    def __exit__(self, *_):
        self.stop()


def answers(port):
    with contextlib.suppress(OSError), socket.create_connection(("127.0.0.1", port), 1.0):
        return True
    return False


def until(condition, what, seconds=SOON_S):
    """Wait for what nobody tells."""
    pause, end_s = threading.Event(), time.monotonic() + seconds
    while not (found := condition()):
        assert time.monotonic() < end_s, f"not within {seconds} s: {what() if callable(what) else what}"
        pause.wait(0.02)
    return found


class Listener:
    """All that comes from a broker: the last payload of each topic, and each message in order."""

    def __init__(self, port, *topics, **credentials):
        self.last, self.messages = {}, []
        self._changed = threading.Condition()
        self._topics = topics or ("#",)
        self.client = paho.Client(paho.CallbackAPIVersion.VERSION2)
        if credentials:
            self.client.username_pw_set(**credentials)
        self.client.on_message, self.client.on_connect = self._hear, self._subscribe
        self.client.reconnect_delay_set(1, 1)
        self._listening = threading.Event()
        self.client.on_subscribe = lambda *_: self._listening.set()
        self._port = port

    def _subscribe(self, client, *_):
        for topic in self._topics:
            client.subscribe(topic, qos=1)

    def _hear(self, client, data, message):
        with self._changed:
            payload = message.payload.decode()
            self.last[message.topic] = payload
            self.messages.append((time.monotonic(), message.topic, payload, message.retain))
            self._changed.notify_all()

    def wait_for(self, condition, seconds=SOON_S):
        """Until `condition()` holds of what was heard."""
        with self._changed:
            assert self._changed.wait_for(condition, seconds), json.dumps(self.last, indent=1)

    def wait_for_state(self, topic, payload, seconds=SOON_S):
        self.wait_for(lambda: self.last.get(topic) == payload, seconds)

    def events(self, topic):
        """The events under `topic`, in order."""
        with self._changed:
            return [json.loads(payload) for _, heard, payload, _ in self.messages if heard == topic]

    def say(self, topic, payload, retain=False):
        self.client.publish(topic, payload, qos=1, retain=retain).wait_for_publish(SOON_S)

    def __enter__(self):
        self.client.connect("127.0.0.1", self._port)
        self.client.loop_start()
        assert self._listening.wait(SOON_S)
        return self

    def __exit__(self, *_):
        self.client.disconnect()
        self.client.loop_stop()


class Room:
    """A scene that is judged: what the test wants a referee to say is said ten times a second; a context manager.

    how: further fields of each judgement and verdict. doubts: at rest nothing is believed much.
    """

    def __init__(self, name="room", observers=("cam1", "cam2"), link=None, step_s=0.1):
        self.name, self.observers, self.keys = name, observers, SceneKeys(name)
        self.movement, self.silent, self.how, self.doubts = None, frozenset(), {}, False
        self._shared, self._step_s = link, step_s
        self._link = link or Link.open(MeshConfig(), "fusion", listen=["tcp/127.0.0.1:0"])
        self.endpoint = self._link.locator
        self._seq, self._verdicts, self._lock = 0, {}, threading.Lock()
        self._stop, self.processes = threading.Event(), []
        self._mouths = {k: self._link.publisher(k) for k in (self.keys.judgement, self.keys.verdict)}
        self._link.answer(self.keys.judgement, lambda: encode(self.judgement()) if self._seq else None)
        self._link.answer(self.keys.verdict, lambda: [encode(each) for each in self._verdicts.values()])
        vocabulary = VocabularyMessage(scene=name, name="movements", hash=VOCABULARY.digest, labels=list(LABELS))
        self._link.answer(self.keys.vocabulary, lambda: encode(vocabulary))
        self._thread = threading.Thread(target=self._judge)

    def scene_file(self, path, port, certainty=1.0, **keys):
        """The scene file of this room, with a broker at `port`."""
        extra = "".join(f"{key} = {json.dumps(value)}\n" for key, value in keys.items())
        observers = "".join(f'[observers.{name}]\nsource = "a.npz"\n' for name in self.observers)
        text = f'scene = "{self.name}"\n[mesh]\nendpoint = "{self.endpoint}"\n[hub]\ncertainty = {certainty}\n'
        text += f"[hub.mqtt]\nport = {port}\n{extra}"
        path.write_text(text + observers)
        return path

    def _facts(self, label, p):
        self._seq += 1
        votes = {name: self._vote(name, label, p) for name in self.observers}
        heard = sum(vote.state == "counted" for vote in votes.values())
        return {
            "scene": self.name, "fusion": "fusion", "seq": self._seq, "at_ns": time.time_ns(), "vocabulary": REFERENCE,
            "p": list(p), "label": label, "certainty_bits": 0.5, "rule": "linear", "votes": votes,
            "agreement": Agreement(k=heard, n=heard), **self.how,
        }  # fmt: skip

    def _vote(self, name, label, p):
        if name in self.silent:
            return Vote(label=None, entropy=None, weight=0.0, age_s=None, state="silent")
        return Vote(label=label, entropy=0.4, weight=0.5, age_s=0.04, state="counted", p=list(p), skew_s=0.001)

    def judgement(self):
        label = self.movement.label if self.movement and self.movement.label else LABELS[0]
        with self._lock:
            p = (0.9, 0.05, 0.03, 0.02) if self.movement or not self.doubts else (0.4, 0.3, 0.2, 0.1)
            return JudgementMessage(**self._facts(label, p), movement=self.movement)

    def begin(self, number):
        """A movement goes on, undecided."""
        self.movement = OngoingMovement(id=f"{self.name}-{number}", began_ns=time.time_ns())

    def say_verdict(self, label, number, ended=False, at_ns=None):
        """A verdict as the referee says it, and the movement that goes on until it has ended."""
        now = time.time_ns()
        with self._lock:
            facts = self._facts(label, (0.9, 0.05, 0.03, 0.02))
            verdict_id = f"{self.name}-{number}"
            times = {"began_ns": now - SECOND, "decided_ns": now, "ended_ns": now if ended else None}
            verdict = VerdictMessage(**{**facts, "at_ns": at_ns or now}, id=verdict_id, **times)
            self._verdicts[verdict.id] = verdict
            self._verdicts = dict(list(self._verdicts.items())[-10:])
        going = OngoingMovement(id=verdict_id, began_ns=now - SECOND, label=label, decided_ns=now)
        self.movement = None if ended else going
        self._mouths[self.keys.verdict].put(encode(verdict))
        return verdict_id

    def _judge(self):
        while not self._stop.wait(self._step_s):
            self._mouths[self.keys.judgement].put(encode(self.judgement()))

    def stop_judging(self):
        """The referee falls silent."""
        if self._thread.is_alive():
            self._stop.set()
            self._thread.join()

    def observer(self, name):
        """A process of an observer that runs and says so; it is seen when this returns."""
        presence = self._link.presence(self.keys.observer_alive(name))
        command = [sys.executable, "-c", OBSERVER, self.endpoint, self.name, name]
        self.processes.append(subprocess.Popen(command, cwd=ROOT, env=environment()))
        assert presence.wait_for(1, SOON_S)
        return self.processes[-1]

    def heard_by_a_hub(self):
        assert self._mouths[self.keys.verdict].wait_for_subscriber(SOON_S)

    def __enter__(self):
        self._thread.start()
        return self

    def __exit__(self, *_):
        self.stop_judging()
        for each in self.processes:
            each.kill()
            each.wait()
        if not self._shared:
            self._link.close()


class Hub:
    """`labanmesh hub mqtt` as a process; its log can be waited for."""

    def __init__(self, *words, level="info"):
        command = [sys.executable, "-P", "-m", "labanmesh", "hub", "mqtt", *map(str, words)]
        self.process = subprocess.Popen(
            command,
            cwd=ROOT,
            stderr=subprocess.PIPE,
            stdout=subprocess.PIPE,
            text=True,
            env={**environment(), "LABANMESH_LOG": level},
        )
        self.cwd, self.log, self._changed = ROOT, "", threading.Condition()
        self._reader = threading.Thread(target=self._read, daemon=True)
        self._reader.start()

    def _read(self):
        for line in self.process.stderr:
            with self._changed:
                self.log += line
                self._changed.notify_all()

    def wait_for(self, words, times=1):
        with self._changed:
            assert self._changed.wait_for(lambda: self.log.count(words) >= times, SOON_S), f"{words!r}:\n{self.log}"
        return self

    def connected(self, times=1):
        return self.wait_for("connected to the MQTT broker", times)

    def end(self, number=signal.SIGTERM):
        """Its exit status after a signal."""
        if self.process.poll() is None:
            self.process.send_signal(number)
        status = self.process.wait(SOON_S)
        self._reader.join(SOON_S)
        self.process.stdout.close()
        self.process.stderr.close()
        return status


__all__ = ["LABELS", "SECOND", "Broker", "Hub", "Listener", "Room", "free_port", "mosquitto", "until"]
