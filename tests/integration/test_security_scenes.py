"""Two secured scenes at one router, in processes: two fusion services share them, and one takes over from the other."""

import os
import socket
import subprocess
import time
from contextlib import ExitStack, contextmanager
from datetime import UTC, datetime
from types import SimpleNamespace

import pytest
from mesh_stage import collect, posterior
from processes import SOON_S, labanmesh, until

from common.config import read_scene
from common.errors import LabanmeshError
from common.link import Link
from common.messages import JudgementMessage, VerdictMessage
from common.wire import decode
from deploy.doctor.mesh import listen
from deploy.doctor.network import network_facts
from deploy.doctor.security import check_security, security_facts
from labanmesh import main
from labanmesh_testing.mesh import running

SCENES, SERVICES = ("dojo", "garden"), ("north", "south")
SCENE = """
scene = "{name}"
vocabulary = ["bowing", "lunging"]
vocabulary_name = "karate"
mesh = {{mode = "router", endpoint = "tls/127.0.0.1:{port}", credentials = "secure/router.1"}}
[observers.cam1]
source = "m.npz"
"""


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """Two scene files, their authority, and a certificate for each process, all made by the command line."""
    folder = tmp_path_factory.mktemp("scenes")
    with socket.create_server(("127.0.0.1", 0)) as free:
        port = free.getsockname()[1]
    for name in SCENES:
        (folder / f"{name}.toml").write_text(SCENE.format(name=name, port=port))
    for words in (
        ["init"],
        ["add", "router"],
        ["add", "hub"],
        ["add", "tablet", "--hub-of", "garden"],
        *(["add", service, "--fusion", service] for service in SERVICES),
        *(["add", scene, "--observer", f"{scene}/cam1"] for scene in SCENES),
    ):
        assert main(["secure", words[0], str(folder), *words[1:]]) == 0
    return folder


@contextmanager
def process_of(folder, certificate, *words):
    """A process of ours with one of the certificates; it is killed at the end of the block."""
    environment = {**os.environ, "LABANMESH_MESH_CREDENTIALS": str(folder / "secure" / certificate)}
    with subprocess.Popen(labanmesh(*words), env=environment, stderr=subprocess.PIPE, text=True) as process:
        try:
            yield process
        finally:
            process.kill()


def read(folder, scene, certificate):
    environment = {"LABANMESH_MESH_CREDENTIALS": str(folder / "secure" / certificate)}
    return read_scene(folder / f"{scene}.toml", environment)


@pytest.fixture(scope="module")
def mesh(folder):
    """The router, both observers, and a hub: its judgements and verdicts, and what was performed in each scene."""
    with ExitStack() as stack:
        router = stack.enter_context(process_of(folder, "router.1", "router", "--scene", folder))
        assert "listening on tls/" in router.stderr.readline()
        performed = {name: [] for name in SCENES}
        for name in SCENES:
            scene = read(folder, name, f"{name}.1")
            link = stack.enter_context(Link.open(scene.mesh, "observer", process_id="cam1", scene=name))
            stack.enter_context(running(publish, link, scene, performed[name]))
        hub = stack.enter_context(Link.open(read(folder, "dojo", "hub.1").mesh, "hub"))
        judgements, verdicts = (
            hub.inbox(*(f"laban/{name}/{kind}" for name in SCENES), limit=100_000) for kind in ("judgement", "verdict")
        )
        yield SimpleNamespace(judgements=judgements, verdicts=verdicts, performed=performed)


def publish(link, scene, performed, stop):
    """An observer: its token, and 20 posteriors a second of a movement of 1.3 s, a rest of 0.7 s, and so on."""
    link.announce(scene.keys.observer_alive("cam1"))
    publisher, seq = link.publisher(scene.keys.posterior("cam1")), 0
    while not stop.wait(0.05):
        seq += 1
        if seq % 40 == 1:
            performed.append(time.time_ns())
        rest = 0.05 if seq % 40 in range(1, 27) else 0.95
        publisher.put(posterior(seq=seq, scene=scene.scene, p=[0.1, 0.9], rest=rest))


def wait_for_services(judgements, expected):
    """Wait until each scene is judged by exactly one of the `expected` services, with the observer's vote counted."""
    end_s = time.monotonic() + SOON_S
    recent = {}
    while time.monotonic() < end_s:
        judgements.take(0.0)
        came = judgements.take(0.5) + judgements.take(0.5)
        recent = {name: set() for name in SCENES}
        for arrival in came:
            judgement = decode(JudgementMessage, arrival.payload)
            if judgement.votes["cam1"].state == "counted":
                recent[judgement.scene].add(judgement.fusion)
        if all(len(services) == 1 and services <= set(expected) for services in recent.values()):
            return recent
    raise AssertionError(f"judged by {recent}, not each by one of {expected}")


def test_a_second_service_shares_the_scenes_and_takes_over_when_the_first_is_killed(folder, mesh):
    with (
        process_of(folder, "north.1", "fuse", folder, "--id", "north") as north,
        process_of(folder, "south.1", "fuse", folder, "--id", "south"),
    ):
        wait_for_services(mesh.judgements, SERVICES)
        since_ns = time.time_ns()
        scene = read(folder, "garden", "hub.1")
        with Link.open(scene.mesh, "hub") as hub:
            presence = hub.presence(scene.keys.fusion_alive())
            assert presence.wait_for(2, SOON_S)
            # A late joiner queries everything, which must not make anybody hand over. While the second service takes
            # its scene over, nobody has a judgement to answer with.
            kept = {scene.keys.judgement, scene.keys.vocabulary}
            until(lambda: kept <= hub.ask(f"{scene.keys.root}/**", SOON_S).keys(), "a judgement and a vocabulary")
        wait_for_services(mesh.judgements, SERVICES)
        verdicts = collect(
            mesh.verdicts, VerdictMessage, lambda _: all(mesh.performed[n][-1] > since_ns for n in SCENES)
        )
        north.kill()
        killed_ns = time.time_ns()
        after = dict.fromkeys(SCENES, False)

        def all_have_ended(verdicts):
            after.update((v.scene, True) for v in verdicts if v.began_ns > killed_ns and v.ended_ns)
            return all(after.values())

        verdicts += collect(mesh.verdicts, VerdictMessage, all_have_ended)
        wait_for_services(mesh.judgements, ["south"])
    for name in SCENES:
        last_ns = max(v.began_ns for v in verdicts if v.scene == name and v.ended_ns)
        for at_ns in (at_ns for at_ns in mesh.performed[name] if since_ns < at_ns <= last_ns):
            own = [v for v in verdicts if v.scene == name and abs(v.began_ns - at_ns) < 0.65e9]
            assert len({v.id for v in own}) == 1, f"{name}: a movement lost or doubled: {own}"
            assert {v.label for v in own} == {"lunging"} and own[-1].ended_ns is not None


def test_only_a_fusion_service_may_ask_another_one_to_hand_over(folder, mesh):
    """A hub may not: the router refuses its query."""
    scene = read(folder, "garden", "north.1")
    with Link.open(scene.mesh, "fusion", process_id="north") as north:
        north.answer(scene.keys.fusion_handover("north"), lambda: b"state")
        with Link.open(read(folder, "garden", "south.1").mesh, "fusion", process_id="south") as south:
            assert south.ask(scene.keys.fusion_handover("north"), SOON_S) == {
                scene.keys.fusion_handover("north"): b"state"
            }
        with Link.open(read(folder, "garden", "hub.1").mesh, "hub") as hub:
            assert hub.ask(scene.keys.fusion_handover("north"), 0.3) == {}


def test_a_hub_of_one_scene_receives_nothing_of_the_other(folder, mesh):
    garden = read(folder, "garden", "tablet.1")
    with Link.open(garden.mesh, "hub", scene="garden") as tablet:
        inbox = tablet.inbox("laban/garden/observer/*/posterior")
        foreign = tablet.inbox("laban/dojo/**")
        assert {arrival.key for arrival in inbox.take(SOON_S)} == {garden.keys.posterior("cam1")}
        assert foreign.take(0.2) == []


@pytest.mark.parametrize(
    ("certificate", "role", "line"),
    [
        ("garden.1", "observer", "certificate garden.1 is for observer garden/cam1, not for observer dojo/cam1"),
        ("tablet.1", "hub", "certificate tablet.1 is for hub garden, not for hub dojo"),
    ],
)
def test_a_process_of_another_scene_ends_with_one_line(folder, certificate, role, line):
    mesh = read(folder, "dojo", certificate).mesh
    with pytest.raises(LabanmeshError, match=line):
        Link.open(mesh, role, process_id="cam1" if role == "observer" else "", scene="dojo")


def test_the_doctor_reports_a_certificate_of_another_scene(folder, mesh):
    dojo = read(folder, "dojo", "tablet.1")
    facts = listen(dojo, network_facts(dojo.mesh), 0.5)
    (error,) = [each for each in check_security(security_facts(facts.network), datetime.now(UTC)) if each.mark != "ok"]
    assert "certificate tablet.1 is for hub garden, not for hub dojo" in error.what and "secure add" in error.to_do
