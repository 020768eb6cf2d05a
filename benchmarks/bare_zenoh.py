"""The floor of the mesh: a session of bare Zenoh, nothing of ours in between; bytes put, and bytes echoed."""

import json
import time
from collections.abc import Iterator
from contextlib import contextmanager

import zenoh

PUT, BACK = "bench/bare/put", "bench/bare/back"
LOOPBACK = "tcp/127.0.0.1:0"
SOON_S = 10.0


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
