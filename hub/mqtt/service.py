"""The hub for MQTT: scenes on the mesh on one side, a broker on the other, and a loop that passes on what is due.

1. Each scene is listened to in a thread (ear.py) and looked at four times a second, at once for a verdict or when a
   movement can be named early (bridge.py).
2. A broken connection is tried again, ever more slowly; said once when it breaks and once when it is back.
3. On each new connection everything is said again, and when Home Assistant says that it has come.
"""

import asyncio
import logging
import threading
import time
from collections.abc import Sequence
from contextlib import ExitStack
from functools import partial

from aiomqtt import Client, MqttError

from common.config import MqttConfig, Scene
from common.errors import BadInput
from common.link import Link
from common.messages import JudgementMessage, VerdictMessage
from common.notify import Notifier
from hub.anticipation import is_early
from hub.mqtt.bridge import Publication, SceneBridge
from hub.mqtt.broker import Broker, broker_of, in_words, incurable
from hub.mqtt.ear import Ear
from hub.mqtt.picture import FAST_S, OFFLINE, ONLINE
from hub.mqtt.scenes import bridge_of, require_one_broker
from hub.mqtt.verdicts import recalled
from hub.session import Heard
from hub.telling import Teller, telling

LOOK_S = FAST_S
FIRST_PAUSE_S, LONGEST_PAUSE_S = 0.5, 15.0
RECALL_S = 2.0
"""How long the broker may take to tell what an earlier hub has left there."""
CHECK_S = 0.05
BROKER = "the broker"

log = logging.getLogger("labanmesh.hub")


class Hub:
    """All scenes of one process on their way to one broker."""

    def __init__(self, scenes: Sequence[Scene], broker: Broker, stop: threading.Event, teller: Teller) -> None:
        self._broker, self._stop, self._teller = broker, stop, teller
        self._asked: MqttConfig = scenes[0].hub.mqtt
        self._scenes = scenes
        self._bridges = [bridge_of(scene, broker.bridge) for scene in scenes]
        self._ears: list[Ear] = []
        self._supervisor = Notifier.from_environment()
        self._news = asyncio.Event()
        self._connected_once = False
        self._trouble = ""
        self._told_unknown: set[str] = set()

    async def run(self) -> None:
        """Until told to stop; raises LabanmeshError when the first connection is refused for good."""
        loop = asyncio.get_running_loop()

        def note(heard: Heard, certainty: float) -> None:
            self._teller.heard(heard)
            said = heard.message
            if isinstance(said, VerdictMessage) or (isinstance(said, JudgementMessage) and is_early(said, certainty)):
                _call(loop, self._news)

        self._teller.reaches(BROKER, "not yet")
        with ExitStack() as stack:
            stack.enter_context(self._supervisor)
            links: dict[str, Link] = {}
            for scene in self._scenes:
                mesh = scene.mesh.model_dump_json()
                if mesh not in links:
                    links[mesh] = stack.enter_context(Link.open(scene.mesh, "hub"))
                ear = Ear(scene, links[mesh], partial(note, certainty=scene.hub.certainty))
                self._ears.append(stack.enter_context(ear))
            await self._stay_connected()

    async def _stay_connected(self) -> None:
        pause_s = FIRST_PAUSE_S
        while not self._stop.is_set():
            try:
                async with self._broker.client() as client:
                    pause_s = FIRST_PAUSE_S
                    await self._serve(client)
            except MqttError as error:
                self._note_trouble(error)
                log.debug("the next try in %g s", pause_s)
                await self._pause(pause_s)
                pause_s = min(2 * pause_s, LONGEST_PAUSE_S)

    async def _serve(self, client: Client) -> None:
        await self._settle(client)
        births = asyncio.create_task(self._hear_births(client))
        speaking = asyncio.create_task(self._speak(client))
        done, pending = await asyncio.wait((births, speaking), return_when=asyncio.FIRST_COMPLETED)
        for task in pending:
            task.cancel()
        await asyncio.gather(*pending, return_exceptions=True)
        for task in done:
            task.result()
        await client.publish(self._broker.bridge, OFFLINE, qos=1, retain=True)

    async def _settle(self, client: Client) -> None:
        """First words on a new connection: we are there; and the first time, what an earlier hub has said last."""
        if not self._connected_once:
            await self._recall(client)
        await client.publish(self._broker.bridge, ONLINE, qos=1, retain=True)
        await client.subscribe(self._births)
        for bridge in self._bridges:
            bridge.recall(None)
            bridge.forget()
        log.info("connected to the MQTT broker at %s as %s", self._broker.address, self._broker.identifier)
        self._supervisor.status(f"connected to the MQTT broker at {self._broker.address}")
        self._teller.reaches(BROKER)
        self._connected_once, self._trouble = True, ""

    async def _recall(self, client: Client) -> None:
        left = {bridge.names.last_verdict: bridge for bridge in self._bridges}
        for topic in (*left, self._broker.bridge):
            await client.subscribe(topic)
        # What was left there comes before the echo of our own word, which is not a retained one.
        await client.publish(self._broker.bridge, ONLINE, qos=1, retain=True)
        try:
            async with asyncio.timeout(RECALL_S):
                async for message in client.messages:
                    if not message.retain:
                        break
                    if str(message.topic) in left and isinstance(message.payload, bytes):
                        left[str(message.topic)].recall(recalled(message.payload))
        except TimeoutError:
            log.warning("the broker does not let %s read below %s", self._broker.identifier, self._asked.topics)
        await client.unsubscribe([*left, self._broker.bridge])
        self._connected_once = True

    @property
    def _births(self) -> str:
        return f"{self._asked.discovery}/status"

    async def _hear_births(self, client: Client) -> None:
        async for message in client.messages:
            # A retained one is older than our connection, on which all was said.
            if str(message.topic) == self._births and message.payload == ONLINE.encode() and not message.retain:
                log.info("Home Assistant has come back: everything is said again")
                for bridge in self._bridges:
                    bridge.forget()
                self._news.set()

    async def _speak(self, client: Client) -> None:
        while not self._stop.is_set():
            self._news.clear()
            await asyncio.gather(
                *(self._pass_on(client, *pair) for pair in zip(self._bridges, self._ears, strict=True))
            )
            await self._wait(LOOK_S)

    async def _pass_on(self, client: Client, bridge: SceneBridge, ear: Ear) -> None:
        now_s = time.monotonic()
        self._look_after(bridge, ear, now_s)
        if not ear.listens:
            return
        due = bridge.look(ear.state, ear.tokens, now_s)
        while (event := bridge.event(now_s)) is not None:
            await _publish(client, event, qos=1)
            bridge.event_taken()
        for publication in due:
            await _publish(client, publication, qos=0)

    def _look_after(self, bridge: SceneBridge, ear: Ear, now_s: float) -> None:
        ear.check()
        while ear.verdicts:
            verdict, told = ear.verdicts.popleft()
            bridge.hear(verdict, now_s, told)
        unknown = set(bridge.movements) - set(ear.state.labels) if ear.state.labels else set()
        for label in sorted(unknown - self._told_unknown):
            self._told_unknown.add(label)
            known = ", ".join(ear.state.labels)
            log.warning("hub.mqtt.movements: %r is none of %s's movements; known: %s", label, bridge.names.scene, known)

    async def _pause(self, seconds: float) -> None:
        """So long without a broker; what is heard is kept for as long as it counts."""
        end_s = time.monotonic() + seconds
        while not self._stop.is_set() and time.monotonic() < end_s:
            for bridge, ear in zip(self._bridges, self._ears, strict=True):
                self._look_after(bridge, ear, time.monotonic())
            self._news.clear()
            await self._wait(min(LOOK_S, max(0.0, end_s - time.monotonic())))

    async def _wait(self, seconds: float) -> None:
        """Until news or for so long; a stop is seen soon."""
        self._supervisor.alive()
        end_s = time.monotonic() + seconds
        while not (self._stop.is_set() or self._news.is_set()) and (left_s := end_s - time.monotonic()) > 0:
            try:
                await asyncio.wait_for(self._news.wait(), min(CHECK_S, left_s))
            except TimeoutError:
                continue

    def _note_trouble(self, error: MqttError) -> None:
        final = None if self._connected_once else incurable(error, self._broker, self._asked)
        if final is not None:
            raise BadInput(final)
        trouble = in_words(error, self._broker)
        if not self._trouble:
            log.warning("no MQTT broker at %s: %s; trying again until it is there", self._broker.address, trouble)
            self._supervisor.status(f"no MQTT broker at {self._broker.address}: {trouble}")
        self._teller.reaches(BROKER, trouble)
        self._trouble = trouble

    def account(self) -> None:
        """Say what was left out, if anything was."""
        for bridge, ear in zip(self._bridges, self._ears, strict=True):
            if bridge.left_out:
                log.warning("%s: %d verdicts found no broker in time", bridge.names.scene, bridge.left_out)
            if ear.dropped:
                log.warning("%s: %d messages came faster than they were read", bridge.names.scene, ear.dropped)


def serve(scenes: Sequence[Scene], stop: threading.Event) -> None:
    """Pass on what is heard of `scenes` until `stop` is set; raises BadInput for what cannot be used."""
    broker = broker_of(scenes[0])
    require_one_broker(scenes)

    async def hub(teller: Teller) -> None:
        served = Hub(scenes, broker, stop, teller)
        try:
            await served.run()
        finally:
            served.account()

    with telling(scenes, "mqtt") as teller:
        asyncio.run(hub(teller))


async def _publish(client: Client, publication: Publication, qos: int) -> None:
    await client.publish(publication.topic, publication.payload, qos=qos, retain=publication.retain)


def _call(loop: asyncio.AbstractEventLoop, news: asyncio.Event) -> None:
    """From another thread; a loop that has ended needs no news."""
    try:
        loop.call_soon_threadsafe(news.set)
    except RuntimeError:
        if not loop.is_closed():
            raise
