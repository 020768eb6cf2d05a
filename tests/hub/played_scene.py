"""A scene played by a test: a fusion service that publishes what the test wants, on a real mesh."""

import contextlib
import json
import os
import re
import subprocess
import sys
import threading
import time
from pathlib import Path

import zenoh
from processes import SOON_S, labanmesh

from common import SECOND_NS
from common.config import MeshConfig, Scene
from common.fall_messages import FallMessage
from common.keys import SceneKeys
from common.link import Link
from common.message_types import MovementTimes
from common.messages import Agreement, JudgementMessage, OngoingMovement, VerdictMessage, VocabularyReference, Vote
from common.vocabulary import Vocabulary
from common.wire import encode, encode_vocabulary

ROOT = Path(__file__).parents[2]
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
    publisher = link.publisher(keys.observer_status(name))
    while not stop.wait(0.5):
        publisher.put(encode(StatusMessage(scene=scene, id=name, state="running", rate_hz=15.0)))
"""


def scene_of(name="room", observers=("cam1", "cam2"), movements=(), certainty=1.0, area="", **sections):
    """A scene as its file has it; sections: further ones."""
    hub = {"certainty": certainty, "mqtt": {"movements": movements, "area": area}}
    roster = {observer: {"source": "a.npz"} for observer in observers}
    return Scene.model_validate({"scene": name, "observers": roster, "hub": hub, **sections})


def fall_of(stage="fallen", number=1, at_ns=1_700_000_000 * SECOND_NS, **more):
    """What a watch for falls publishes."""
    fields = {"scene": "room", "fusion": "fuse1", "session": "s", "at_ns": at_ns, "since_ns": at_ns, "lying": 0.93}
    return FallMessage(**{
        **fields, "stage": stage, "id": f"fall-{number}", "agreement": Agreement(k=2, n=3), **more
    })  # fmt: skip


def environment(**more):
    """The process's own environment, with this repository before an installed one."""
    return {**os.environ, "PYTHONPATH": str(ROOT), "PYTHONUNBUFFERED": "1", **more}


class PlayedScene:
    """Publishes a judgement ten times a second, and verdicts on request; a context manager. silent: observers without a
    vote. how: further fields of each judgement and verdict. doubts: at rest no movement is probable. session: of the
    fusion service, by which hubs know its falls."""

    def __init__(self, name="room", observers=("cam1", "cam2"), link=None, step_s=0.1, session=None):
        self.name, self.observers, self.keys = name, observers, SceneKeys(name)
        self.movement, self.silent, self.how, self.doubts = None, frozenset(), {}, False
        self._shared, self._step_s, self._session = link, step_s, session
        self._link = link or Link.open(MeshConfig(), "fusion", listen=["tcp/127.0.0.1:0"])
        self.endpoint = self._link.locator
        self._seq, self._verdicts, self._lock = 0, {}, threading.Lock()
        self._vocabulary = VOCABULARY
        self._stop, self._processes = threading.Event(), []
        self._published = (self.keys.judgement, self.keys.verdict, self.keys.vocabulary)
        self._publishers = {key: self._link.publisher(key) for key in self._published}
        self._link.answer(self.keys.judgement, lambda: encode(self.judgement()) if self._seq else None)
        self._link.answer(self.keys.verdict, lambda: [encode(each) for each in self._verdicts.values()])
        self._link.answer(self.keys.vocabulary, lambda: encode_vocabulary(name, self._vocabulary))
        self._thread = threading.Thread(target=self._judge)

    def scene_file(self, path, text="", views=()):
        """The scene file of this scene, with more `text` before the observers."""
        path.write_text(f'scene = "{self.name}"\n[mesh]\nendpoint = "{self.endpoint}"\n{text}' + "".join(
            f'[observers.{name}]\nsource = "a.npz"\n' + (f'view = "{views[i % len(views)]}"\n' if views else "")
            for i, name in enumerate(self.observers)))  # fmt: skip
        return path

    def vote(self, place, label, p):
        """The vote of the observer at `place`."""
        return Vote(label=label, entropy=0.4, weight=0.5, age_s=0.04, state="counted", p=list(p), skew_s=0.001)

    def _fields(self, label, p):
        self._seq += 1
        silent = Vote(label=None, entropy=None, weight=0.0, age_s=None, state="silent")
        votes = {name: silent if name in self.silent else self.vote(place, label, p)
                 for place, name in enumerate(self.observers)}  # fmt: skip
        counted = [vote for vote in votes.values() if vote is not silent]
        agreement = Agreement(k=sum(vote.label == label for vote in counted), n=len(counted))
        reference = VocabularyReference(name="movements", hash=self._vocabulary.digest)
        return {
            "scene": self.name, "fusion": "fusion", "seq": self._seq, "at_ns": time.time_ns(), "vocabulary": reference,
            "p": list(p), "label": label if counted else "", "certainty_bits": 0.5, "rule": "linear", "votes": votes,
            "agreement": agreement, "session": self._session, **self.how,
        }  # fmt: skip

    def judgement(self):
        label = self.movement.label if self.movement and self.movement.label else self._vocabulary.labels[0]
        with self._lock:
            p = (0.9, 0.05, 0.03, 0.02) if self.movement or not self.doubts else (0.4, 0.3, 0.2, 0.1)
            return JudgementMessage(**self._fields(label, p), movement=self.movement)

    def begin(self, number):
        """An undecided movement begins."""
        self.movement = OngoingMovement(id=f"{self.name}-{number}", began_ns=time.time_ns())

    def publish_verdict(self, label, number, ended=False, **more):
        """Publish a verdict; until it has ended its movement goes on. Returns its id. more: its other fields."""
        now_ns = time.time_ns()
        times = {"began_ns": now_ns - SECOND_NS, "decided_ns": now_ns, "ended_ns": now_ns if ended else None}
        with self._lock:
            fields = self._fields(label, (0.9, 0.05, 0.03, 0.02))
            verdict = VerdictMessage(**fields, id=f"{self.name}-{number}", **{**times, **more})
            self._verdicts[verdict.id] = verdict
            self._verdicts = dict(list(self._verdicts.items())[-10:])
        decision = {"label": label, "decided_ns": now_ns, "revises": verdict.revises}
        going_on = OngoingMovement(id=verdict.id, began_ns=now_ns - SECOND_NS, **decision)
        self.movement = None if ended else going_on
        # A publisher of ours drops what is due while Zenoh's queues are full, as on a busy machine.
        block = zenoh.CongestionControl.BLOCK
        self._link._session.put(self.keys.verdict, encode(verdict), congestion_control=block)
        return verdict.id

    def teach(self, labels):
        """The observers change to a vocabulary of four other `labels`, and the fusion service with them."""
        with self._lock:
            self._vocabulary = Vocabulary(labels)
        self._publishers[self.keys.vocabulary].put(encode_vocabulary(self.name, self._vocabulary))

    def repeat(self, *labels):
        """The takes show that these movements are repeated, once a second."""
        with self._lock:
            times = {label: MovementTimes(period_s=1.0) for label in labels}
            self._vocabulary = Vocabulary(self._vocabulary.labels, movements=times)
        self._publishers[self.keys.vocabulary].put(encode_vocabulary(self.name, self._vocabulary))

    def fall(self, stage, number=1):
        """The watch for falls says so."""
        own = {"scene": self.name, "fusion": "fusion", "session": self._session}
        message = fall_of(stage, number, time.time_ns(), agreement=Agreement(k=2, n=2), **own)
        self._link._session.put(self.keys.fall, encode(message))

    def _judge(self):
        while not self._stop.wait(self._step_s):
            self._publishers[self.keys.judgement].put(encode(self.judgement()))

    def stop_judging(self):
        if self._thread.is_alive():
            self._stop.set()
            self._thread.join()

    def observer(self, name):
        """An observer process that publishes its status; it can be seen when this returns."""
        presence = self._link.presence(self.keys.observer_alive(name))
        command = [sys.executable, "-c", OBSERVER, self.endpoint, self.name, name]
        self._processes.append(subprocess.Popen(command, cwd=ROOT, env=environment()))
        assert presence.wait_for(1, SOON_S)
        return self._processes[-1]

    def mqtt_hubs(self):
        """The MQTT hubs of the scene that are connected to a broker, now and later."""
        return self._link.presence(self.keys.hub_alive("mqtt"))

    def wait_for_hub(self):
        assert self._publishers[self.keys.verdict].wait_for_subscriber(SOON_S)

    def __enter__(self):
        self._thread.start()
        return self

    def __exit__(self, *_):
        self.stop_judging()
        for process in self._processes:
            with contextlib.suppress(ProcessLookupError):
                process.kill()
            process.wait()
        if not self._shared:
            self._link.close()


class Dashboard:
    """A `labanmesh dashboard` process at `url`; a context manager, at whose end SIGTERM must end it cleanly."""

    def __init__(self, *words):
        command = labanmesh("dashboard", *words, "--listen", "127.0.0.1:0")
        self.process = subprocess.Popen(command, cwd=ROOT, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
        for line in self.process.stdout:
            if match := re.match(r"(http://\S+) shows", line):
                self.url = match[1]
                return
        raise AssertionError(self.process.communicate())

    def memory_kb(self):
        return int(re.search(r"VmRSS:\s+(\d+)", Path(f"/proc/{self.process.pid}/status").read_text())[1])

    def __enter__(self):
        return self

    def __exit__(self, *_):
        self.process.terminate()
        _, err = self.process.communicate(timeout=SOON_S)
        assert self.process.returncode == 0 and not err, err


def hub_section(port, certainty=1.0, **keys):
    """The sections [hub] and [hub.mqtt] of a scene file, with a broker at `port`."""
    extra = "".join(f"{key} = {json.dumps(value)}\n" for key, value in keys.items())
    return f"[hub]\ncertainty = {certainty}\n[hub.mqtt]\nport = {port}\n{extra}"
