"""What the tests with a broker share: mosquitto, a listener at it, and the hub as a process."""

import contextlib
import json
import os
import shutil
import signal
import socket
import subprocess
import threading
import time

import paho.mqtt.client as paho
from played_scene import ROOT, environment
from processes import SOON_S, labanmesh, until

from benchmarks.timing import free_port


def mosquitto():
    """Where the broker's program is, or None."""
    return shutil.which("mosquitto", path=os.environ.get("PATH", "") + ":/usr/sbin:/usr/local/sbin")


class Broker:
    """A mosquitto; a context manager. It retains nothing over a restart."""

    def __init__(self, place, lines=("allow_anonymous true",)):
        place.mkdir(parents=True, exist_ok=True)
        self.port, self._place = free_port(), place
        # Started by root, mosquitto would become a user that may not read here.
        fixed = ("user root", "log_type subscribe", "log_type error", "persistence false")
        (place / "broker.conf").write_text("\n".join([f"listener {self.port} 127.0.0.1", *fixed, *lines, ""]))
        self._process = None

    def start(self):
        command = [mosquitto(), "-c", self._place / "broker.conf"]
        log = (self._place / "broker.log").open("ab")
        self._process = subprocess.Popen(command, stdout=log, stderr=subprocess.STDOUT)
        log.close()
        until(self._answers, f"mosquitto at {self.port}")
        return self

    @property
    def pid(self):
        return self._process.pid

    def _answers(self):
        with contextlib.suppress(OSError), socket.create_connection(("127.0.0.1", self.port), 1.0):
            return True
        return False

    def wait_for_subscriber(self, topic, timeout_s=SOON_S):
        """Wait until a client has subscribed to `topic`; the broker logs it."""
        until(lambda: topic in (self._place / "broker.log").read_text(), f"a subscriber of {topic}", timeout_s)

    def stop(self):
        if self._process:
            self._process.terminate()
            self._process.wait(SOON_S)
            self._process = None

    def __enter__(self):
        return self.start()

    def __exit__(self, *_):
        self.stop()


class Listener:
    """Everything from a broker: the last payload of each topic, and each message in order; a context manager."""

    def __init__(self, port, *topics):
        self.last, self.messages = {}, []
        self._changed = threading.Condition()
        self._topics = topics or ("#",)
        self.client = paho.Client(paho.CallbackAPIVersion.VERSION2)
        self.client.on_message, self.client.on_connect = self._receive, self._subscribe
        self.client.reconnect_delay_set(1, 1)
        self._listening = threading.Event()
        self.client.on_subscribe = lambda *_: self._listening.set()
        self._port = port

    def _subscribe(self, client, *_):
        for topic in self._topics:
            client.subscribe(topic, qos=1)

    def _receive(self, client, data, message):
        with self._changed:
            payload = message.payload.decode()
            self.last[message.topic] = payload
            self.messages.append((time.monotonic(), message.topic, payload, message.retain))
            self._changed.notify_all()

    def wait_for(self, condition, timeout_s=SOON_S):
        """Wait until `condition()` holds of what has arrived."""
        with self._changed:
            assert self._changed.wait_for(condition, timeout_s), json.dumps(self.last, indent=1)

    def wait_for_state(self, topic, payload, timeout_s=SOON_S):
        self.wait_for(lambda: self.last.get(topic) == payload, timeout_s)

    def arrived_s(self, topic, payload=None):
        """When the first message of a topic arrived (monotonic clock); payload: the first that is this."""
        with self._changed:
            return next(at_s for at_s, own, text, _ in self.messages if own == topic and payload in (None, text))

    def events(self, topic):
        """The events under `topic`, in order."""
        with self._changed:
            return [json.loads(payload) for _, own, payload, _ in self.messages if own == topic]

    def publish(self, topic, payload):
        self.client.publish(topic, payload, qos=1).wait_for_publish(SOON_S)

    def __enter__(self):
        self.client.connect("127.0.0.1", self._port)
        self.client.loop_start()
        assert self._listening.wait(SOON_S)
        return self

    def __exit__(self, *_):
        self.client.disconnect()
        self.client.loop_stop()


class Hub:
    """`labanmesh hub mqtt` as a process; its log can be waited for."""

    def __init__(self, *words, level="info"):
        command = labanmesh("hub", "mqtt", *words)
        pipes = {"stderr": subprocess.PIPE, "stdout": subprocess.PIPE, "text": True}
        self.process = subprocess.Popen(command, cwd=ROOT, env=environment(LABANMESH_LOG=level), **pipes)
        self.log, self._changed = "", threading.Condition()
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
