"""Listens to a scene's mesh for a few seconds: who answers, who is alive, what is said."""

import json
import threading
import time
from dataclasses import dataclass, replace

from common.config import MeshConfig, Scene
from common.errors import LabanmeshError
from common.keys import observer_of
from common.link import Link
from deploy.doctor.heard import Heard
from deploy.doctor.look_security import as_whom
from deploy.doctor.network import Network

OPEN_S = 2.0
"""How long a router may take to let us in."""
ANSWER_S = 1.0
"""How long whoever listens at the endpoint may take to answer as Zenoh does: on one machine it takes 12 ms."""
ASK_S = 0.4
NOBODY_S = 1.0
"""After so long without any sign of life nobody is waited for any more."""
TAKE_S = 0.1
LOOK_AGAIN_S = 0.01
PEERS = "@/*/*"
"""Where every Zenoh process says with whom it is connected."""


@dataclass(frozen=True, slots=True)
class Overheard:
    """What came of it: the network with what Zenoh said, and what was heard; None where nobody could be heard.

    partly: access rules let this machine hear of the fusion services alone.
    """

    network: Network
    heard: Heard | None = None
    partly: bool = False


def listen(scene: Scene, network: Network, for_s: float) -> Overheard:
    """Join the scene's mesh as one who only listens, for `for_s` seconds; shorter where nobody is there."""
    if not _worth_trying(network):
        return Overheard(network)
    began_s = time.monotonic()
    role, named = as_whom(scene.mesh)
    try:
        link = Link.open(_reachable(scene.mesh), role, timeout_s=OPEN_S, process_id=named)
        if not _connected(link):
            # A session that has met nobody takes seconds to close; nobody need wait for that.
            threading.Thread(target=link.close, daemon=True, name="close").start()
            return Overheard(network)
        with link:
            network = replace(network, zenoh=time.monotonic() - began_s)
            return Overheard(network, _heard(scene, link, for_s), role == "observer")
    except LabanmeshError as error:
        return Overheard(replace(network, fault=str(error)))


def _worth_trying(network: Network) -> bool:
    return network.mesh.mode != "process" and (network.reached is None or network.reached.took_s is not None)


def _reachable(mesh: MeshConfig) -> MeshConfig:
    """Every interface is listened on, not connected to."""
    return mesh.at(mesh.endpoint.replace("/0.0.0.0:", "/127.0.0.1:").replace("/[::]:", "/[::1]:"))


def _connected(link: Link) -> bool:
    """Whether a Zenoh process is at the other end, by ANSWER_S: a peer's link opens before it has met anybody."""
    end_s = time.monotonic() + ANSWER_S
    while time.monotonic() < end_s:
        told = [json.loads(payload) for payload in link.ask(PEERS, ANSWER_S).values()]
        if any(each.get("sessions") for each in told):
            return True
        time.sleep(LOOK_AGAIN_S)
    return False


def _heard(scene: Scene, link: Link, for_s: float) -> Heard:
    keys, began_s = scene.keys, time.monotonic()
    heard = Heard(keys)
    observers, fusions = link.presence(keys.observer_alive()), link.presence(keys.fusion_alive())
    inbox = link.inbox(keys.posterior(), keys.judgement, keys.observer_status(), keys.fusion_status())
    for key, payload in link.ask(f"{keys.root}/**", min(ASK_S, for_s)).items():
        heard.hear(key, payload, time.time_ns(), asked=True)
    while (passed_s := time.monotonic() - began_s) < for_s:
        for arrival in inbox.take(min(TAKE_S, for_s - passed_s)):
            heard.hear(arrival.key, arrival.payload, arrival.arrived_ns)
        heard.alive_observers = frozenset(map(observer_of, observers.alive))
        heard.alive_fusions = frozenset(map(observer_of, fusions.alive))
        if heard.silent and passed_s > NOBODY_S:
            break
    heard.listened_s = time.monotonic() - began_s
    return heard
