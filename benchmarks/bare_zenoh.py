"""The floor of the mesh: a session of bare Zenoh, nothing of ours in between; bytes put, and bytes echoed."""

import json
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager

import msgpack
import zenoh

PUT, BACK = "bench/bare/put", "bench/bare/back"
LOOPBACK = "tcp/127.0.0.1:0"
SOON_S = 10.0
SILENT_S = 0.5


@contextmanager
def bare_peer(connect: str | None = None) -> Iterator["Bare"]:
    """A peer on this machine, set as `common.link` sets its own, that listens and, if told, connects to another."""
    settings = {
        "mode": "peer",
        "scouting/multicast/enabled": False,
        "scouting/delay": 0,
        "adminspace/enabled": True,
        "listen/endpoints": [LOOPBACK],
        "connect/endpoints": [connect] if connect else [],
    }
    config = zenoh.Config()
    for key, value in settings.items():
        config.insert_json5(key, json.dumps(value))
    with zenoh.open(config) as session:
        yield Bare(session)


def drained(listen: str, key: str, seconds: float, publishers: int, tell: Callable[[float], None]) -> None:
    """Tell how many messages a second a loop takes out of a FIFO channel in batches and unpacks, once all have spoken.

    Goes on draining until they are silent: a session whose channel is full does not close.
    """
    config = zenoh.Config()
    for name, value in {"mode": "peer", "scouting/multicast/enabled": False, "listen/endpoints": [listen]}.items():
        config.insert_json5(name, json.dumps(value))
    with zenoh.open(config) as session:
        channel = session.declare_subscriber(key, zenoh.handlers.FifoChannel(100_000))
        heard: set[str] = set()
        while len(heard) < publishers:
            heard.add(str(channel.recv().key_expr))
        count, begun_s = 0, time.monotonic()
        while time.monotonic() - begun_s < seconds:
            while (sample := channel.try_recv()) is not None:
                msgpack.unpackb(sample.payload.to_bytes())
                count += 1
                if not count % 1024 and time.monotonic() - begun_s >= seconds:
                    break
            time.sleep(0.001)
        tell(count / (time.monotonic() - begun_s))
        heard_s = time.monotonic()
        while time.monotonic() - heard_s < SILENT_S:
            while channel.try_recv() is not None:
                heard_s = time.monotonic()
            time.sleep(0.001)


class Bare:
    """What a bare session does here. arrived: payload -> when it came in (Unix epoch, ns)."""

    def __init__(self, session: zenoh.Session) -> None:
        self.arrived: dict[bytes, int] = {}
        self._session = session
        self._kept: list[object] = []

    @property
    def locator(self) -> str:
        """Where it listens."""
        for reply in self._session.get(f"@/{self._session.zid()}/peer", timeout=SOON_S):
            if reply.ok is not None:
                return str(json.loads(reply.ok.payload.to_string())["locators"][0])
        raise AssertionError("a bare Zenoh peer does not say where it listens")

    def publisher(self, key: str) -> zenoh.Publisher:
        """Bare Zenoh's own publisher."""
        return self._session.declare_publisher(key)

    def fifo(self, key: str) -> zenoh.Subscriber[zenoh.handlers.Handler[zenoh.Sample]]:
        """Bare Zenoh's own bounded queue of what comes under `key`."""
        return self._session.declare_subscriber(key)

    def note(self, key: str) -> None:
        """Note in `arrived` what comes under `key`."""
        self._subscribe(key, None)

    def echo(self, key: str, back: str) -> None:
        """Note what comes under `key`, and put the same bytes under `back` from within the callback."""
        self._subscribe(key, self.publisher(back))

    def _subscribe(self, key: str, echo: zenoh.Publisher | None) -> None:
        def came(sample: zenoh.Sample) -> None:
            arrived_ns = time.time_ns()
            payload = sample.payload.to_bytes()
            if echo is not None:
                echo.put(payload)
            self.arrived[payload] = arrived_ns

        self._kept.append(self._session.declare_subscriber(key, came))
