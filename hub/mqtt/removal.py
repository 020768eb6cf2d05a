"""Taking a scene out of a broker: its entities leave Home Assistant, and nothing that it retained stays behind."""

import asyncio
import json
from collections.abc import Iterable

from aiomqtt import Client, Message, MqttError

from common.config import Scene
from common.errors import BadInput, LabanmeshError
from hub.mqtt.broker import Broker, broker_of, in_words, incurable
from hub.mqtt.names import ORIGIN, Names
from hub.mqtt.picture import ONLINE
from hub.mqtt.scenes import names_of

COLLECT_S = 10.0


def remove(scene: Scene) -> int:
    """Take out all that hubs have left of `scene` at its broker; how many retained messages that were.

    Raises BadInput while a hub still speaks for the scene, LabanmeshError when there is no broker.
    """
    broker = broker_of(scene, "remove")
    try:
        return asyncio.run(_remove(scene, broker))
    except MqttError as error:
        final = incurable(error, broker, scene.hub.mqtt)
        if final is not None:
            raise BadInput(final) from None
        raise LabanmeshError(f"no MQTT broker at {broker.address}: {in_words(error, broker)}; is it running?") from None


async def _remove(scene: Scene, broker: Broker) -> int:
    names = names_of(scene, broker.bridge)
    async with broker.client() as client:
        retained = await _collect(client, names)
        ours = {topic for topic, payload in retained.items() if _is_of(topic, payload, names)}
        for bridge in _bridges(retained[topic] for topic in ours):
            if retained.get(bridge) == ONLINE.encode():
                raise BadInput(f"{scene.scene}: a hub still speaks for it ({bridge}); stop that first")
        for topic in sorted(ours):
            await client.publish(topic, b"", qos=1, retain=True)
    return len(ours)


async def _collect(client: Client, names: Names) -> dict[str, bytes]:
    """All that is retained below the prefixes; raises LabanmeshError when the broker does not let us see it."""
    mark = f"{names.root}/removing"
    for topic in (f"{names.discovery}/+/+/config", f"{names.root}/#", f"{names.topics}/+/bridge"):
        await client.subscribe(topic)
    # It comes back after all that was retained.
    await client.publish(mark, b"", qos=1)
    found: dict[str, bytes] = {}
    try:
        async with asyncio.timeout(COLLECT_S):
            async for message in client.messages:
                if str(message.topic) == mark:
                    return found
                _note(found, message)
    except TimeoutError:
        pass
    raise LabanmeshError(f"hub.mqtt: the broker does not let us read below {names.root}; look at its access rules")


def _note(found: dict[str, bytes], message: Message) -> None:
    if isinstance(message.payload, bytes):
        found[str(message.topic)] = message.payload


def _is_of(topic: str, payload: bytes, names: Names) -> bool:
    if topic.startswith(f"{names.root}/"):
        return True
    said = _table(payload)
    origin = said.get("origin")
    ours = isinstance(origin, dict) and origin.get("name") == ORIGIN
    return ours and str(said.get("state_topic", "")).startswith(f"{names.root}/")


def _bridges(payloads: Iterable[bytes]) -> set[str]:
    """Under which topics the hubs of these entities say whether they are connected."""
    listed = [_table(payload).get("availability") for payload in payloads]
    return {
        str(each["topic"])
        for some in listed
        if isinstance(some, list)
        for each in some
        if isinstance(each, dict) and str(each.get("topic")).endswith("/bridge")
    }


def _table(payload: bytes) -> dict[str, object]:
    try:
        said = json.loads(payload)
    except ValueError:
        return {}
    return said if isinstance(said, dict) else {}
