"""The floor of the mesh benchmarks: sessions of bare Zenoh that put, echo and drain messages."""

import json
import time
from collections.abc import Iterator, Mapping
from contextlib import contextmanager

import zenoh

PUT, BACK = "bench/bare/put", "bench/bare/back"
LOOPBACK = "tcp/127.0.0.1:0"
TIMEOUT_S = 10.0


def open_bare(settings: Mapping[str, object]) -> zenoh.Session:
    """A session without multicast, with the settings of `zenoh.Config`."""
    config = zenoh.Config()
    for key, value in {"scouting/multicast/enabled": False, **settings}.items():
        config.insert_json5(key, json.dumps(value))
    return zenoh.open(config)


@contextmanager
def bare_peer(connect: str | None = None) -> Iterator["BarePeer"]:
    """A peer on this machine with the settings of `common.link`, which listens and optionally connects."""
    settings = {
        "mode": "peer",
        "scouting/delay": 0,
        "adminspace/enabled": True,
        "listen/endpoints": [LOOPBACK],
        "connect/endpoints": [connect] if connect else [],
    }
    with open_bare(settings) as session:
        yield BarePeer(session)


class BarePeer:
    """A bare session. arrived: payload -> arrival time (Unix epoch, ns)."""

    def __init__(self, session: zenoh.Session) -> None:
        self.arrived: dict[bytes, int] = {}
        self._session = session
        self._subscribers: list[object] = []

    @property
    def locator(self) -> str:
        """Where it listens."""
        for reply in self._session.get(f"@/{self._session.zid()}/peer", timeout=TIMEOUT_S):
            if reply.ok is not None:
                return str(json.loads(reply.ok.payload.to_string())["locators"][0])
        raise AssertionError("a bare Zenoh peer does not report where it listens")

    def publisher(self, key: str) -> zenoh.Publisher:
        """A publisher of bare Zenoh."""
        return self._session.declare_publisher(key)

    def fifo(self, key: str) -> zenoh.Subscriber[zenoh.handlers.Handler[zenoh.Sample]]:
        """A subscriber with bare Zenoh's own bounded queue."""
        return self._session.declare_subscriber(key)

    def note(self, key: str) -> None:
        """Record the messages under `key` in `arrived`."""
        self._subscribe(key, None)

    def echo(self, key: str, back: str) -> None:
        """Record the messages under `key` and put the same bytes under `back` from within the callback."""
        self._subscribe(key, self.publisher(back))

    def _subscribe(self, key: str, echo: zenoh.Publisher | None) -> None:
        def receive(sample: zenoh.Sample) -> None:
            arrived_ns = time.time_ns()
            payload = sample.payload.to_bytes()
            if echo is not None:
                echo.put(payload)
            self.arrived[payload] = arrived_ns

        self._subscribers.append(self._session.declare_subscriber(key, receive))
