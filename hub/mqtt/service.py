"""The MQTT hub: listens to scenes on the mesh, and publishes what is due to one broker.

1. Each scene is listened to in a thread (hub/session.py). The loop looks at it four times a second, and at once for a
   verdict or an early word (bridge.py).
2. A broken connection is tried again, with growing pauses; its loss and its return are logged once each.
3. Everything is published again on each new connection and when Home Assistant announces its start.
"""

import asyncio
import logging
import threading
import time
from collections.abc import Sequence
from contextlib import ExitStack
from dataclasses import dataclass

from aiomqtt import Client, MqttError

from common.backoff import Backoff
from common.config import MqttConfig, Scene
from common.errors import BadInput
from common.link import Link
from common.messages import JudgementMessage, VerdictMessage, VocabularyMessage
from common.notify import Notifier
from common.text import plural
from hub.anticipation import is_early
from hub.instrumentation import HubInstrumentation, instrumented
from hub.mqtt.bridge import SceneBridge, require_one_broker
from hub.mqtt.broker import CONNECTION_TIMEOUT_S, MqttBroker, broker_of, fault_text, permanent_fault
from hub.mqtt.events import EVENT_S, Publication, recalled_ns
from hub.mqtt.states import FAST_S, OFFLINE, ONLINE
from hub.session import SceneListener, SceneUpdate

CONNECTING = Backoff(0.5, 15.0)
RECALL_S = 2.0
"""How long the broker may take to return what an earlier hub has left there."""
NEWS_CHECK_S = 0.05
BROKER = "the broker"

log = logging.getLogger("labanmesh.hub")


@dataclass(frozen=True, slots=True)
class _ServedScene:
    bridge: SceneBridge
    listener: SceneListener
    link: Link
    alive: str


class MqttHub:
    """All scenes of one process on their way to one broker."""

    def __init__(
        self, scenes: Sequence[Scene], broker: MqttBroker, stop: threading.Event, instrumentation: HubInstrumentation
    ) -> None:
        self._broker, self._stop, self._instrumentation = broker, stop, instrumentation
        self._config: MqttConfig = scenes[0].hub.mqtt
        self._scenes = scenes
        self._served: list[_ServedScene] = []
        self._supervisor = Notifier.from_environment()
        self._news = asyncio.Event()
        self._connected_once = False
        self._fault = ""
        self._unknown_movements: set[str] = set()
        self._reported: set[str] = set()

    async def run(self) -> None:
        """Serve until told to stop; raises BadInput when the broker refuses the first connection for good."""
        self._instrumentation.record_connection(BROKER, "not yet")
        with ExitStack() as stack:
            stack.enter_context(self._supervisor)
            links: dict[str, Link] = {}
            for scene in self._scenes:
                mesh = scene.mesh.model_dump_json()
                if mesh not in links:
                    links[mesh] = stack.enter_context(Link.open(scene.mesh, "hub", stop=self._stop))
                listener = stack.enter_context(self._listener(scene, links[mesh]))
                bridge, alive = SceneBridge(scene, self._broker.bridge), scene.keys.hub_alive("mqtt")
                self._served.append(_ServedScene(bridge, listener, links[mesh], alive))
            await self._stay_connected()

    def _listener(self, scene: Scene, link: Link) -> SceneListener:
        loop, certainty = asyncio.get_running_loop(), scene.hub.certainty

        def note(update: SceneUpdate) -> None:
            self._instrumentation.record(update)
            message = update.message
            early = isinstance(message, JudgementMessage) and is_early(message, certainty)
            if early or isinstance(message, (VerdictMessage, VocabularyMessage)):
                _set_from_thread(loop, self._news)

        return SceneListener(scene, link, note)

    async def _stay_connected(self) -> None:
        failures = 0
        while not self._stop.is_set():
            try:
                async with self._broker.client() as client:
                    failures = 0
                    await self._serve(client)
            except MqttError as error:
                failures += 1
                self._note_fault(error)
                log.debug("the next try in %g s", CONNECTING.wait_s(failures))
                await self._pause(CONNECTING.wait_s(failures))

    async def _serve(self, client: Client) -> None:
        await self._begin(client)
        with ExitStack() as announced:
            for served in self._served:
                # So the pages that teach and watch can tell that Home Assistant receives the scene.
                connected = served.link.sub_session()
                announced.callback(connected.close)
                connected.announce(served.alive)
            await self._publish_until_stopped(client)
        await client.publish(self._broker.bridge, OFFLINE, qos=1, retain=True)

    async def _publish_until_stopped(self, client: Client) -> None:
        each = (self._await_births(client), self._publish_all(client), self._end_in_time())
        done, pending = await asyncio.wait(map(asyncio.create_task, each), return_when=asyncio.FIRST_COMPLETED)
        for task in pending:
            task.cancel()
        await asyncio.gather(*pending, return_exceptions=True)
        for task in done:
            task.result()

    async def _end_in_time(self) -> None:
        """Return when the hub is to end although the broker stands still and confirms nothing."""
        while not self._stop.is_set():
            await asyncio.sleep(FAST_S)
        await asyncio.sleep(CONNECTION_TIMEOUT_S)

    async def _begin(self, client: Client) -> None:
        """Start a connection: publish that the hub is online, and the first time recall the last verdicts."""
        if not self._connected_once:
            await self._recall(client)
        await client.publish(self._broker.bridge, ONLINE, qos=1, retain=True)
        await client.subscribe(self._birth_topic)
        for served in self._served:
            for topic in served.bridge.counters.commands:
                await client.subscribe(topic)
            served.bridge.recall(None)
            served.bridge.forget()
        log.info("connected to the MQTT broker at %s as %s", self._broker.address, self._broker.identifier)
        self._supervisor.status(f"connected to the MQTT broker at {self._broker.address}")
        self._instrumentation.record_connection(BROKER)
        self._connected_once, self._fault = True, ""

    async def _recall(self, client: Client) -> None:
        bridges = {served.bridge.topics.of("last_verdict"): served.bridge for served in self._served}
        # Those of Home Assistant are the same for all scenes.
        left = {topic for served in self._served for topic in served.bridge.topics.of_movements}
        for topic in (*bridges, *left, self._broker.bridge):
            await client.subscribe(topic)
        # Retained messages arrive before the echo of this one, which is not marked as retained.
        await client.publish(self._broker.bridge, ONLINE, qos=1, retain=True)
        try:
            async with asyncio.timeout(RECALL_S):
                async for message in client.messages:
                    if not message.retain:
                        break
                    if str(message.topic) in bridges and isinstance(message.payload, bytes):
                        bridges[str(message.topic)].recall(recalled_ns(message.payload))
                    for served in self._served:
                        served.bridge.note_left(str(message.topic), message.payload)
        except TimeoutError:
            log.warning("the broker does not let %s read below %s", self._broker.identifier, self._config.topics)
        await client.unsubscribe([*bridges, *left, self._broker.bridge])
        self._connected_once = True

    @property
    def _birth_topic(self) -> str:
        return f"{self._config.discovery}/status"

    async def _await_births(self, client: Client) -> None:
        async for message in client.messages:
            if not message.retain and any(
                served.bridge.counters.obey(str(message.topic), message.payload) for served in self._served
            ):
                self._news.set()
                continue
            # A retained one is older than our connection, on which everything was published.
            if str(message.topic) == self._birth_topic and message.payload == ONLINE.encode() and not message.retain:
                log.info("Home Assistant has started: publishing everything again")
                for served in self._served:
                    served.bridge.forget()
                self._news.set()

    async def _publish_all(self, client: Client) -> None:
        while not self._stop.is_set():
            self._news.clear()
            await asyncio.gather(*(self._publish_scene(client, served) for served in self._served))
            await self._wait(FAST_S)

    async def _publish_scene(self, client: Client, served: _ServedScene) -> None:
        now_s = time.monotonic()
        self._take_verdicts(served, now_s)
        bridge, listener = served.bridge, served.listener
        if not listener.ready:
            return
        due = bridge.due_states(listener.state, listener.tokens, now_s)
        while (event := bridge.next_event(now_s)) is not None:
            await _publish(client, event, qos=1)
            bridge.confirm_event()
        for publication in due:
            await _publish(client, publication, qos=0)

    def _take_verdicts(self, served: _ServedScene, now_s: float) -> None:
        bridge, listener = served.bridge, served.listener
        listener.check()
        while listener.verdicts:
            arrived = listener.verdicts.popleft()
            bridge.receive(arrived.verdict, now_s, arrived.answered)
        if listener.state.rejected and bridge.topics.scene not in self._reported:
            self._reported.add(bridge.topics.scene)
            log.warning(
                "%s: unusable messages, or verdicts of no movement, are left out and counted", bridge.topics.scene
            )
        labels = listener.state.labels
        for label in bridge.unknown_movements(labels):
            if label in self._unknown_movements:
                continue
            self._unknown_movements.add(label)
            scene, known = bridge.topics.scene, ", ".join(labels)
            log.warning("hub.mqtt.movements: %r is no movement of %s; known: %s", label, scene, known)

    async def _pause(self, seconds: float) -> None:
        end_s = time.monotonic() + seconds
        while not self._stop.is_set() and time.monotonic() < end_s:
            for served in self._served:
                self._take_verdicts(served, time.monotonic())
            self._news.clear()
            await self._wait(min(FAST_S, max(0.0, end_s - time.monotonic())))

    async def _wait(self, seconds: float) -> None:
        self._supervisor.alive()
        end_s = time.monotonic() + seconds
        while not (self._stop.is_set() or self._news.is_set()) and (left_s := end_s - time.monotonic()) > 0:
            try:
                await asyncio.wait_for(self._news.wait(), min(NEWS_CHECK_S, left_s))
            except TimeoutError:
                continue

    def _note_fault(self, error: MqttError) -> None:
        permanent = None if self._connected_once else permanent_fault(error, self._broker, self._config)
        if permanent is not None:
            raise BadInput(permanent)
        fault = fault_text(error, self._broker)
        if not self._fault:
            log.warning("no MQTT broker at %s: %s; trying again until it is there", self._broker.address, fault)
            self._supervisor.status(f"no MQTT broker at {self._broker.address}: {fault}")
        self._instrumentation.record_connection(BROKER, fault)
        self._fault = fault

    def log_losses(self) -> None:
        """Log what was left out, if anything was."""
        for served in self._served:
            scene, left_out, dropped = served.bridge.topics.scene, served.bridge.left_out, served.listener.state.dropped
            if left_out:
                log.warning("%s: %s found no broker in time", scene, plural(left_out, "event"))
            if dropped:
                log.warning("%s: %s lost to a full queue", scene, plural(dropped, "message"))


def serve(scenes: Sequence[Scene], stop: threading.Event) -> None:
    """Publish `scenes` to their broker until `stop` is set; raises BadInput for settings that cannot be used."""
    broker = broker_of(scenes[0])
    require_one_broker(scenes)

    async def run(instrumentation: HubInstrumentation) -> None:
        hub = MqttHub(scenes, broker, stop, instrumentation)
        try:
            await hub.run()
        finally:
            hub.log_losses()

    with instrumented(scenes, "mqtt") as instrumentation:
        asyncio.run(run(instrumentation))


async def _publish(client: Client, publication: Publication, qos: int) -> None:
    # A broker that is busy confirms late; on a new connection, all that it has not confirmed would come twice.
    await client.publish(publication.topic, publication.payload, qos=qos, retain=publication.retain, timeout=EVENT_S)


def _set_from_thread(loop: asyncio.AbstractEventLoop, event: asyncio.Event) -> None:
    """Set `event` from another thread; nothing to do when the loop has ended."""
    try:
        loop.call_soon_threadsafe(event.set)
    except RuntimeError:
        if not loop.is_closed():
            raise
