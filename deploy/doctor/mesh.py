"""Listens to the mesh for a few seconds; finds processes that are missing, unknown, or different from the others.

The checks at the end are pure.
"""

import json
import threading
import time
from collections.abc import Iterator
from dataclasses import dataclass, replace

from common.config import Scene
from common.errors import LabanmeshError
from common.keys import observer_of
from common.link import Link
from common.text import nearest, plural
from deploy.doctor.findings import Finding, Mark, error, hint, ok, warning
from deploy.doctor.network import NetworkFacts
from deploy.doctor.security import listener_for
from deploy.doctor.traffic import (
    REJECTION_WAYS_OUT,
    MeshTraffic,
    ProcessTraffic,
    check_process,
    rejected,
    relative_clock,
)

OPEN_S = 2.0
"""How long a router may take to admit this process."""
STATUS_ANSWER_S = 1.0
"""How long the process at the endpoint may take to answer as Zenoh does: on one machine it takes 12 ms."""
MESH_QUERY_S = 0.4
MESH_SILENCE_S = 1.0
"""After so long without any sign of life the doctor stops listening."""
DOCTOR_TAKE_S = 0.1
STATUS_RETRY_S = 0.01
PEERS = "@/*/*"
"""Every Zenoh process answers here with whom it is connected."""
SKEW_S = 0.5
"""A clock that is off by more than this is reported; fusion corrects the ages of posteriors for it."""
STRANGERS = 6
"""So many strangers are named in one line."""
REVOKE = "; or it lies: labanmesh secure revoke"
"""Where there are certificates."""
SYNCHRONISE = "timedatectl set-ntp true, or chrony"


@dataclass(frozen=True, slots=True)
class MeshFacts:
    """The network with what Zenoh answered, and the traffic; None if the mesh could not be joined.

    partly: this machine's certificate lets it hear of the fusion services alone.
    """

    network: NetworkFacts
    traffic: MeshTraffic | None = None
    partly: bool = False


@dataclass(frozen=True, slots=True)
class ExpectedMesh:
    """What a mesh should hold. version: of this labanmesh. path: of the scene file, for commands to type."""

    scene: Scene
    version: str
    path: str
    partly: bool = False

    @property
    def shareable(self) -> bool:
        """Whether fusion services that stand in no scene file may share this scene with others."""
        return not self.scene.fusion.standby

    @property
    def digest(self) -> str:
        """The vocabulary's hash, where the scene names one."""
        vocabulary = self.scene.named_vocabulary
        return vocabulary.digest if vocabulary else ""


def listen(scene: Scene, network: NetworkFacts, for_s: float) -> MeshFacts:
    """Join the scene's mesh as a listener for `for_s` seconds; less if no process is there."""
    reachable = network.connection is None or network.connection.took_s is not None
    if network.mesh.mode == "process" or not reachable:
        return MeshFacts(network)
    began_s, (role, process_id) = time.monotonic(), listener_for(scene)
    try:
        # An endpoint that means every interface is reached over loopback.
        mesh = scene.mesh.at(scene.mesh.endpoint.replace("/0.0.0.0:", "/127.0.0.1:").replace("/[::]:", "/[::1]:"))
        link = Link.open(mesh, role, timeout_s=OPEN_S, process_id=process_id, scene=scene.scene)
        if not _is_connected(link):
            # A session without peers takes seconds to close; do not wait for it.
            threading.Thread(target=link.close, daemon=True, name="close").start()
            return MeshFacts(network)
        with link:
            network = replace(network, zenoh_s=time.monotonic() - began_s)
            return MeshFacts(network, _traffic(scene, link, for_s), role == "observer")
    except LabanmeshError as error:
        return MeshFacts(replace(network, fault=str(error)))


def _is_connected(link: Link) -> bool:
    """Whether a Zenoh process answers within STATUS_ANSWER_S: a peer's link opens before it has a connection."""
    end_s = time.monotonic() + STATUS_ANSWER_S
    while time.monotonic() < end_s:
        answers = [json.loads(payload) for payload in link.ask(PEERS, STATUS_ANSWER_S).values()]
        if any(answer.get("sessions") for answer in answers):
            return True
        time.sleep(STATUS_RETRY_S)
    return False


def _traffic(scene: Scene, link: Link, for_s: float) -> MeshTraffic:
    keys, began_s = scene.keys, time.monotonic()
    traffic = MeshTraffic(keys)
    observers = link.presence(keys.observer_alive(), map(keys.observer_alive, scene.roster))
    fusions = link.presence(keys.fusion_alive(), map(keys.fusion_alive, scene.services))
    inbox = link.inbox(keys.posterior(), keys.judgement, keys.observer_status(), keys.fusion_status())
    for key, payload in link.ask(f"{keys.root}/**", min(MESH_QUERY_S, for_s)).items():
        traffic.record(key, payload, time.time_ns(), queried=True)
    while (passed_s := time.monotonic() - began_s) < for_s:
        for arrival in inbox.take(min(DOCTOR_TAKE_S, for_s - passed_s)):
            traffic.record(arrival.key, arrival.payload, arrival.arrived_ns)
        traffic.alive_observers = frozenset(map(observer_of, observers.alive))
        traffic.alive_fusions = frozenset(map(observer_of, fusions.alive))
        if traffic.silent and passed_s > MESH_SILENCE_S:
            break
    traffic.listened_s = time.monotonic() - began_s
    return traffic


def check_mesh(expected: ExpectedMesh, traffic: MeshTraffic) -> list[Finding]:
    """The findings on a mesh that was listened to."""
    if traffic.silent:
        return [no_process(expected)]
    if expected.partly:
        what = "this machine's certificate is an observer's: the doctor hears of the fusion services alone"
        to_do = (
            "run doctor on the fusion machine, or with a certificate for a hub: labanmesh secure add SCENE NAME --hub"
        )
        return [*_fusions(expected, traffic), warning(what, to_do)]
    return [*_fusions(expected, traffic), *_judgements(traffic), *_observers(expected, traffic)]


def no_process(expected: ExpectedMesh) -> Finding:
    """The finding on a mesh without any process of the scene."""
    what = f"no process of scene {expected.scene.scene} is on the mesh"
    if expected.scene.mesh.mode == "machine":
        return hint(what, f"labanmesh up {expected.path}")
    return warning(what, f"labanmesh up {expected.path}, or fuse and observe each on its machine")


def _fusions(expected: ExpectedMesh, traffic: MeshTraffic) -> Iterator[Finding]:
    services = expected.scene.services
    present = list(dict.fromkeys([*sorted(traffic.alive_fusions), *traffic.fusions]))
    for name in present:
        process, service = traffic.fusions.get(name, ProcessTraffic()), f"fusion service {name}"
        if name not in services and expected.shareable:
            yield ok(f"{service} is not in this scene file: it shares this scene with other services")
        elif name not in services:
            what = f"{service} is on the mesh and not in this scene file"
            to_do = f"stop it, or name it: fusion.standby = [{name!r}]; every machine needs the same file"
            yield error(what, to_do)
        alive = name in traffic.alive_fusions or expected.partly
        yield from check_process(service, process, expected.version, alive, is_fusion=True)
        if process.skew_s is not None and abs(process.skew_s) > SKEW_S:
            what = f"this machine's clock is {relative_clock(-process.skew_s)} that of {service}"
            yield warning(what, f"synchronise both clocks (NTP): {SYNCHRONISE}")
    for name in services:
        if name not in present and present and not expected.shareable:
            what = f"fusion service {name} is missing"
            yield warning(what, f"labanmesh fuse {expected.path} --id {name}")
    if not present:
        hint = "" if expected.digest else "; it waits until an observer publishes the vocabulary"
        what = "no fusion service is alive: there are no judgements"
        yield error(what, f"labanmesh fuse {expected.path}{hint}")


def _judgements(traffic: MeshTraffic) -> Iterator[Finding]:
    judging = {name: process for name, process in traffic.fusions.items() if process.judgements}
    if len(judging) > 1:
        what = f"{len(judging)} fusion services judge at once: {', '.join(judging)}"
        to_do = "stop all but one, or let the others stand by: fusion.standby in the scene file of all"
        yield error(what, to_do)
    for name, process in judging.items():
        if process.turns > 1:
            what = f"two processes judge as fusion service {name}"
            yield error(what, "stop one, or give it an id of its own: fuse --id")
    if judging:
        many, listened_s = sum(process.judgements for process in judging.values()), traffic.listened_s
        yield ok(f"{plural(many, 'judgement')} in {listened_s:.1f} s by {', '.join(judging)}")
        yield from (ok(f"a movement goes on without a verdict yet: {p.why}") for p in judging.values() if p.why)
    elif traffic.alive_fusions and traffic.listened_s > 0 and not traffic.bad_judgements:
        what = f"no judgement within {traffic.listened_s:.1f} s"
        if any(process.posteriors for process in traffic.observers.values()):
            yield error(f"{what}, though observers publish posteriors", "see fusion's log; start it again")
        else:
            yield warning(f"{what}: no observer publishes posteriors", "see the findings on the observers")
    for reason, count in sorted(traffic.bad_judgements.items()):
        yield rejected("judgements", reason, count)


def _observers(expected: ExpectedMesh, traffic: MeshTraffic) -> Iterator[Finding]:
    scene = expected.scene
    present = set(traffic.alive_observers) | set(traffic.observers)
    judged = (digest for process in traffic.fusions.values() for digest in sorted(process.hashes))
    digest = expected.digest or next(judged, "")
    for name in scene.roster:
        if name in present:
            process = traffic.observers.get(name, ProcessTraffic())
            yield from check_process(name, process, expected.version, name in traffic.alive_observers)
            yield from _vocabulary(name, process, digest)
            if process.turns > 1:
                to_do = "stop one of them, or give it an id of its own in the scene file"
                yield error(f"two processes publish as {name}", to_do)
            yield from _statistics(name, process, traffic, secured=bool(scene.mesh.credentials))
    yield from _missing(expected, [name for name in scene.roster if name not in present])
    yield from _strangers(expected, sorted(present - set(scene.roster)))


def _missing(expected: ExpectedMesh, missing: list[str]) -> Iterator[Finding]:
    total, quorum = len(expected.scene.roster), expected.scene.fusion.quorum
    left = total - len(missing)
    mark: Mark = "warning" if left >= quorum else "error"
    for name in missing:
        what = f"{name} is missing"
        if mark == "error":
            what += f": {left} of {plural(total, 'observer')} present, a verdict needs {quorum}"
        yield Finding(mark, what, f"labanmesh observe {expected.path} {name}, on its machine; see its log")


def _vocabulary(name: str, process: ProcessTraffic, digest: str) -> Iterator[Finding]:
    foreign = sorted(process.hashes - {digest})
    if digest and foreign:
        what = f"{name} has another vocabulary ({', '.join(foreign)}) than the scene ({digest}): it does not count"
        yield error(what, "learn its model again from the movements of the others: labanmesh learn")


def _statistics(name: str, process: ProcessTraffic, traffic: MeshTraffic, *, secured: bool) -> Iterator[Finding]:
    """The fusion service's statistics of an observer: its clock, and rejected messages."""
    revoke = REVOKE if secured else ""
    for fusion in traffic.fusions.values():
        statistics = (fusion.status.observers or {}).get(name) if fusion.status and fusion.judgements else None
        if statistics is None:
            continue
        if statistics.skew_s is not None and abs(statistics.skew_s) > SKEW_S:
            what = f"{name}: its clock is {relative_clock(statistics.skew_s)} that of fusion"
            yield warning(what, f"synchronise it (NTP): {SYNCHRONISE}, on its machine")
        if name in fusion.contradicted:
            what = f"{name}: the others contradict it in most verdicts, so it is hardly relied on"
            to_do = f"labanmesh camera look shows what it sees; else its model or its place is wrong{revoke}"
            yield warning(what, to_do)
        if name in fusion.about_rest:
            trusted = f"{fusion.about_rest[name]:.0%} trusted"
            what = f"{name}: its rest contradicts the others ({trusted}), so it does not decide when a movement ends"
            to_do = f"labanmesh camera look shows what it sees: its picture may stand still or tremble{revoke}"
            yield warning(what, to_do)
        known = {*process.bad, *({"foreign_vocabulary"} if process.hashes else ())}
        if statistics.rejected.get("same_id") and process.turns <= 1:
            # Not of this doctor's own hearing: it may have been before, or is heard by fusion alone.
            what = f"two processes published as {name}: {plural(statistics.rejected['same_id'], 'message')} rejected"
            yield warning(what, REJECTION_WAYS_OUT["same_id"])
        known.add("same_id")
        for reason, count in sorted(statistics.rejected.items()):
            if count and reason not in known:
                yield replace(rejected(name, reason, count), mark="warning")
        return


def _strangers(expected: ExpectedMesh, strangers: list[str]) -> Iterator[Finding]:
    if strangers:
        more = f" and {len(strangers) - STRANGERS} more" if len(strangers) > STRANGERS else ""
        names = ", ".join(strangers[:STRANGERS]) + more
        near = nearest(strangers[0], expected.scene.roster)
        to_do = f"name it under [observers.ID] in every machine's scene file, or stop it; {near}"
        yield warning(f"on the mesh and not in the scene: {names}; their posteriors do not count", to_do)
