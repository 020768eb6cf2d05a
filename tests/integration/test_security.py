"""A secured mesh of real Zenoh sessions: attacks are refused, legitimate processes work, each cause is named."""

import json
import os
import threading
import time
from concurrent.futures import ThreadPoolExecutor
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from datetime import UTC, datetime, timedelta
from pathlib import Path

import pytest
import zenoh
from mesh_stage import FakePipeline, believed, first, lay_out
from processes import SOON_S, until

from common.certificate_authority import issue, make_authority
from common.config import MeshConfig, read_scene
from common.errors import LabanmeshError
from common.link import Link
from common.messages import JudgementMessage, StatusMessage
from common.tls import endpoint_fault
from common.zenoh_settings import ADMITTED, settings
from deploy.security.issuing import create_authority
from deploy.security.register import Register, Roles
from deploy.security.router_config import router_config
from fusion.server import serve as serve_fusion
from labanmesh_testing.mesh import running
from observer.runtime.service import serve as serve_observer
from observer.tracks import Frame

PAGE = Path(__file__).parents[2] / "docs" / "design" / "security.md"
REWRITE = "LABANMESH_REWRITE=1 pytest tests/integration/test_security.py rewrites it"
TRY_S = 1.0
"""Behind a TLS that refuses it a Zenoh client goes on trying for as long."""
HEAD = "| attack | refused by | message on that machine |\n|---|---|---|\n"
SCENE = """
scene = "dojo"
vocabulary = ["bowing", "lunging"]
vocabulary_name = "karate"
[mesh]
mode = "router"
endpoint = "tls/127.0.0.1:0"
credentials = "secure/router.1"
[observers.cam1]
source = "m.npz"
picture_hz = 2
[observers.cam1.clips]
folder = "clips"
[observers.cam2]
source = "m.npz"
[fusion]
step_hz = 50
"""


def now():
    return datetime.now(UTC)


@pytest.fixture(scope="module", autouse=True)
def quick():
    """A process that is not admitted need not wait for quite as long as a busy router might take."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("common.link.ADMISSION_TIMEOUT_S", 2.0)
        patch.setattr("common.tls.GREETING_S", SOON_S)
        yield


@pytest.fixture(scope="module")
def scene(tmp_path_factory):
    place = tmp_path_factory.mktemp("dojo") / "scene.toml"
    place.write_text(SCENE)
    return read_scene(place, {})


@pytest.fixture(scope="module")
def authority(scene):
    """The authority after its work: all machines, cam1 renewed and its old certificate revoked, garden revoked."""
    authority = create_authority(scene.place("secure"), [scene], now())
    authority.add("router", Roles(router=True), ["127.0.0.1"], now())
    for name, roles in {
        "cam1": Roles(observers=("cam1",)),
        "cam2": Roles(observers=("cam2",)),
        "fusion": Roles(fusions=("fusion",)),
        "hub": Roles(hub=True),
        "eyes": Roles(hub=True, pictures=True),
        "phone": Roles(hub=True, teach=True),
        "garden": Roles(observers=("cam2",)),
    }.items():
        authority.add(name, roles, (), now())
    authority.renew("cam1", (), now())
    authority.revoke("cam1.1", now())
    authority.revoke("garden", now())
    return authority


@contextmanager
def routed(scene, register):
    """A router with the rules of `register`; yields the mesh as the holder of a certificate has it."""
    with Link.router(router_config([scene], register, [scene.mesh.endpoint]), "the test's router") as link:
        endpoint = link.locator
        yield lambda certificate: MeshConfig(
            mode="router", endpoint=endpoint, credentials=str(scene.place(f"secure/{certificate}"))
        )


@pytest.fixture(scope="module")
def mesh(scene, authority):
    with routed(scene, authority.register) as mesh:
        yield mesh


@contextmanager
def bare_client(mesh):
    """A Zenoh client that follows no rule of labanmesh; None when TLS did not admit it."""
    session = admitted_session(mesh)
    if session is None:
        yield None
        return
    with session:
        yield session


def admitted_session(mesh):
    """A Zenoh session; None when it cannot be opened and a TLS handshake without Zenoh is refused too. On a busy
    machine a session that is admitted needs longer than one try."""
    config, end_s = zenoh.Config(), time.monotonic() + SOON_S
    for key, value in settings(mesh, "observer", None, TRY_S).items():
        config.insert_json5(key, json.dumps(value))
    while True:
        try:
            return zenoh.open(config)
        except zenoh.ZError:
            if endpoint_fault(mesh, now(), SOON_S) is not None:
                return None
            assert time.monotonic() < end_s, "TLS admits this client, and Zenoh does not"


@dataclass(frozen=True)
class Attack:
    """A client with such a mesh section publishes under `key`; a process of ours would be `role` `process_id` there."""

    mesh: MeshConfig
    key: str
    role: str = "observer"
    process_id: str = ""


def refused_by(scene, mesh, attack, name, answer_s=0.3):
    """What refuses the attack: TLS, access rules, or nobody, when a hub receives it before a message sent later.
    answer_s: how long the router may take to answer the attacker; one with access rules may never answer."""
    lie, truth = f"lie of {name}".encode(), f"truth after {name}".encode()
    with Link.open(mesh("hub.1"), "hub") as hub, Link.open(mesh("fusion.1"), "fusion") as fusion:
        inbox = hub.inbox(f"{scene.keys.root}/**")
        publisher = fusion.publisher(scene.keys.verdict)
        with bare_client(attack.mesh) as session:
            if session is None:
                return "TLS"
            session.declare_publisher(attack.key).put(lie)
            session.put(attack.key, lie)
            # The router has read the lie when it has answered this, or has had long enough.
            list(session.get(ADMITTED, timeout=answer_s))
            deadline, payloads = time.monotonic() + SOON_S, []
            while truth not in payloads:
                assert time.monotonic() < deadline, "the hub receives nothing"
                publisher.put(truth)
                payloads += [arrival.payload for arrival in inbox.take(0.2)]
            return "nobody" if lie in payloads else "access rules"


@pytest.fixture(scope="module")
def attacks(scene, authority, mesh):
    other, ours, keys, base = make_authority("dojo", now()), authority.pair, scene.keys, scene.place("")
    foreign = issue(other, "cam1.2", (), now()).pair
    late = issue(ours, "cam1.2", (), now() - timedelta(days=2), days=1).pair
    unknown = issue(ours, "attic.1", (), now()).pair
    own, open_mesh = keys.posterior("cam1"), mesh("cam1.2").model_copy(update={"credentials": ""})

    def with_(name, pair, certificate):
        return open_mesh.model_copy(update={"credentials": lay_out(base / name, pair, certificate)})

    return {
        "a certificate of a foreign authority": Attack(with_("foreign", foreign, other.certificate), own),
        "the same, with our authority's ca.pem beside it": Attack(with_("mixed", foreign, ours.certificate), own),
        "no certificate": Attack(open_mesh, own),
        "a plain-text client": Attack(open_mesh.at(open_mesh.endpoint.replace("tls/", "tcp/")), own),
        "an expired certificate": Attack(with_("late", late, ours.certificate), own),
        "a certificate that is not in the register": Attack(with_("unknown", unknown, ours.certificate), own),
        "a revoked machine": Attack(mesh("garden.1"), keys.posterior("cam2")),
        "a superseded certificate": Attack(mesh("cam1.1"), own),
        "observer cam1 publishes for cam2": Attack(mesh("cam1.2"), keys.posterior("cam2"), "observer", "cam2"),
        "observer cam1 publishes a judgement": Attack(mesh("cam1.2"), keys.judgement, "fusion", "fusion"),
        "a hub publishes a judgement": Attack(mesh("hub.1"), keys.judgement, "fusion", "fusion"),
        "a hub publishes for cam1": Attack(mesh("hub.1"), own, "observer", "cam1"),
        "fusion publishes for cam1": Attack(mesh("fusion.1"), own, "observer", "cam1"),
        "the router's certificate publishes for cam1": Attack(mesh("router.1"), own, "observer", "cam1"),
    }


@pytest.fixture(scope="module")
def table(scene, mesh, attacks):
    """The rows of the page: attack, what refuses it, the message of a process of ours that is started there."""

    def attempt(item):
        name, attack = item
        refusal = refused_by(scene, mesh, attack, name)
        timeout_s = TRY_S if refusal == "TLS" else SOON_S
        try:
            Link.open(attack.mesh, attack.role, process_id=attack.process_id, timeout_s=timeout_s).close()
            message = "nothing"
        except LabanmeshError as error:
            message = unvarying(str(error).partition("; ")[0], scene, attack.mesh)
        return name, refusal, message

    # Most of the time is waiting for answers that do not come.
    with ThreadPoolExecutor(7) as pool:
        return list(pool.map(attempt, attacks.items()))


def unvarying(text, scene, mesh):
    """The text without folders, ports and days, which differ from run to run."""
    text = text.replace(f"{scene.place('')}/", "").replace(mesh.endpoint.rpartition(":")[2], "7447")
    day = (now() - timedelta(days=1)).strftime("%Y-%m-%d")
    return text.replace(day, "2027-01-31")


def test_every_attack_is_refused_and_its_cause_is_named(table):
    assert {name: message for name, refusal, message in table if "nobody" in refusal or "nothing" in message} == {}


def test_the_page_has_the_table(table):
    written = "\n".join(f"| {name} | {refusal} | {message} |" for name, refusal, message in table)
    text = PAGE.read_text("utf-8")
    old = text.partition(HEAD)[2].partition("\n\n")[0]
    assert old, "docs/design/security.md has lost its table"
    if os.environ.get("LABANMESH_REWRITE"):
        PAGE.write_text(text.replace(old, written, 1), "utf-8")
        return
    assert old == written, f"docs/design/security.md is out of date; {REWRITE}"


@pytest.mark.parametrize(
    "name", ["observer cam1 publishes for cam2", "a hub publishes a judgement", "a revoked machine"]
)
def test_without_rules_the_same_attack_succeeds(scene, authority, attacks, name):
    """The control: these attacks are real ones."""
    with routed(scene, None) as open_to_all:
        attack = attacks[name]
        there = Attack(attack.mesh.at(open_to_all("hub.1").endpoint), attack.key)
        assert refused_by(scene, open_to_all, there, name, SOON_S) == "nobody"


def test_a_process_that_is_revoked_while_it_runs_says_so(scene, authority, monkeypatch, caplog):
    monkeypatch.setattr("common.link.CONNECTION_CHECK_S", 0.05)
    monkeypatch.setattr("common.link.ADMISSION_TIMEOUT_S", 0.5)
    certificates = authority.register.certificates
    before = Register(("dojo",), tuple(each.model_copy(update={"revoked": None}) for each in certificates))
    with routed(scene, before) as mesh:
        garden = mesh("garden.1")
        link = Link.open(garden, "observer")
    with link, Link.router(router_config([scene], authority.register, [garden.endpoint]), "the test's router"):
        until(lambda: "garden.1" in caplog.text)
    assert caplog.messages[-1].startswith("mesh.endpoint = ")


def test_an_empty_register_admits_nobody(scene, authority):
    with routed(scene, Register(("dojo",))) as mesh, bare_client(mesh("hub.1")) as session:
        assert session is not None
        assert not [reply for reply in session.get(ADMITTED, timeout=0.3) if reply.ok]


@pytest.fixture
def link(mesh):
    """Opens the link of a certificate's holder, until the test ends; of a hub, unless another role is named."""
    with ExitStack() as opened:
        yield lambda certificate, role="hub": opened.enter_context(Link.open(mesh(certificate), role))


def test_a_hub_cannot_feign_presence(scene, mesh):
    keys = scene.keys
    with Link.open(mesh("hub.1"), "hub") as hub, Link.open(mesh("fusion.1"), "fusion") as fusion:
        presence = fusion.presence(keys.observer_alive())
        hub.announce(keys.observer_alive("cam1"))
        with Link.open(mesh("cam2.1"), "observer") as cam:
            cam.announce(keys.observer_alive("cam2"))
            assert presence.wait_for(1, SOON_S) and presence.alive == {keys.observer_alive("cam2")}
        assert presence.wait_for(0, SOON_S)


def test_an_observer_cannot_answer_for_another_nor_receive_its_messages(scene, link):
    keys = scene.keys
    cam1, cam2, hub = link("cam1.2", "observer"), link("cam2.1", "observer"), link("hub.1")
    cam1.answer(keys.observer_status("cam2"), lambda: b"lie")
    cam1.answer(keys.judgement, lambda: b"lie")
    foreign = cam1.inbox(f"{keys.root}/**")
    cam2.answer(keys.observer_status("cam2"), lambda: b"truth")
    assert hub.ask(f"{keys.root}/**", SOON_S) == {keys.observer_status("cam2"): b"truth"}
    inbox = hub.inbox(keys.posterior())
    publisher = cam2.publisher(keys.posterior("cam2"))
    assert publisher.wait_for_subscriber(SOON_S)
    publisher.put(b"posterior")
    assert [arrival.payload for arrival in inbox.take(SOON_S)] == [b"posterior"]
    assert foreign.take(0.0) == []


def test_nobody_without_the_right_teaches(scene, link):
    keys, asked = scene.keys, []
    cam1, cam2 = link("cam1.2", "observer"), link("cam2.1", "observer")
    hub, fusion, phone = link("hub.1"), link("fusion.1", "fusion"), link("phone.1")

    def respond(payload):
        asked.append(payload)
        return b"done"

    def teach(teacher, key):
        replies, finished = [], threading.Event()
        teacher.request(key, lambda *reply: replies.append(reply), 1.0, finished.set, b"adopt")
        assert finished.wait(SOON_S)
        return replies

    cam1.answer_requests(keys.teach("cam1"), respond)
    until(lambda: teach(phone, keys.teach("cam1")))
    assert set(asked) == {b"adopt"}
    asked.clear()
    for other in (hub, fusion, cam2):
        for key in (keys.teach("cam1"), keys.teach(), f"{keys.root}/**"):
            assert teach(other, key) == []
    # With the right, but a wildcard: it changes nothing either.
    assert teach(phone, keys.teach()) == teach(phone, f"{keys.root}/**") == [] and asked == []
    cam2.answer_requests(keys.teach("cam1"), lambda _: b"lie")
    assert teach(phone, keys.teach("cam1")) == [(keys.teach("cam1"), b"done")]


def test_a_hub_without_the_right_gets_no_picture(scene, link):
    keys = scene.keys
    cam1, cam2 = link("cam1.2", "observer"), link("cam2.1", "observer")
    hub, fusion, eyes = link("hub.1"), link("fusion.1", "fusion"), link("eyes.1")
    asked = (keys.picture("cam1"), keys.picture(), "laban/*/observer/*/@picture", f"{keys.root}/**", "**")
    without = [each.inbox(*asked, remote=True) for each in (hub, fusion, cam2)]
    publisher, liar = (each.publisher(keys.picture("cam1"), priority="low") for each in (cam1, cam2))
    assert hub.ask(f"{keys.root}/**", 0.1) == {} and not publisher.has_subscriber
    wanted, whole = eyes.inbox(keys.picture("cam1")), eyes.inbox(f"{keys.root}/**")
    assert publisher.wait_for_subscriber(SOON_S)
    liar.put(b"lie")
    cam2.ask(keys.fusion_status(), 0.1)
    # Before the picture, so that the router knows of it once the picture has arrived.
    verdicts = cam1.inbox(keys.verdict)
    publisher.put(b"picture")
    assert [arrival.payload for arrival in wanted.take(SOON_S)] == [b"picture"]
    verdict = fusion.publisher(keys.verdict)
    assert verdict.wait_for_subscriber(SOON_S)
    verdict.put(b"verdict")
    # A verdict that was sent later has arrived: so would the picture have.
    assert [arrival.payload for arrival in verdicts.take(SOON_S)] == [b"verdict"]
    assert [arrival.payload for arrival in whole.take(SOON_S)] == [b"verdict"]
    assert not [a for inbox in without for a in inbox.take(0.1) if a.payload != b"verdict"]


class FakeSource:
    """A frame each 20 ms until it is stopped."""

    rate_hz, body_parts = 50.0, ("head",)

    def frames(self, stop):
        while not stop.wait(0.02):
            yield Frame(time.time_ns(), believed((0.1, 0.9), 0.1, {"head": True}))


@contextmanager
def services(scene, mesh):
    """A fusion service and both observers, each with its own certificate, as their processes run them."""
    with ExitStack() as stack:

        def link(certificate, role):
            return stack.enter_context(
                Link.open(mesh(certificate), role, process_id=certificate[:-2], scene=scene.scene)
            )

        stack.enter_context(running(serve_fusion, [scene], "fusion", link("fusion.1", "fusion")))
        for name, certificate in zip(scene.roster, ("cam1.2", "cam2.1"), strict=True):
            observer = (scene, name, FakePipeline(), FakeSource(), link(certificate, "observer"))
            stack.enter_context(running(serve_observer, *observer))
        yield


def test_all_legitimate_processes_work_under_default_deny(scene, mesh):
    keys = scene.keys
    with Link.open(mesh("hub.1"), "hub") as hub:
        judgements, statuses = hub.inbox(keys.judgement), hub.inbox(keys.observer_status("cam1"))
        presence = hub.presence(f"{keys.root}/**")
        with services(scene, mesh):
            judgement = first(
                judgements, JudgementMessage, lambda j: all(v.state == "counted" for v in j.votes.values())
            )
            assert set(judgement.votes) == {"cam1", "cam2"} and judgement.label == "lunging"
            assert presence.wait_for(3, SOON_S)
            observers = {keys.observer_alive(name) for name in scene.roster}
            assert presence.alive == {keys.fusion_alive("fusion"), *observers}
            first(statuses, StatusMessage, lambda s: s.skew_s is not None)  # an observer asks fusion for its clock
            answers = hub.ask(f"{keys.root}/**", SOON_S)
            late = {keys.judgement, keys.vocabulary, keys.fusion_status("fusion")}
            assert answers.keys() >= {*late, keys.observer_status("cam1"), keys.observer_status("cam2")}
            fusions = hub.inbox(keys.fusion_status())
            first(fusions, StatusMessage, lambda s: s.observers and s.observers["cam2"].skew_s is not None)
        assert presence.wait_for(0, SOON_S)


@pytest.mark.parametrize(
    ("certificate", "role", "line"),
    [
        ("hub.1", "standby", "certificate hub.1 is for hub, not for fusion second; labanmesh secure add"),
        ("nowhere", "hub", "no such folder; copy the folder here that `labanmesh secure add` made"),
    ],
)
def test_a_process_without_rights_ends_with_one_line(mesh, certificate, role, line):
    with pytest.raises(LabanmeshError) as caught:
        Link.open(mesh(certificate), role, process_id="second" if role == "standby" else "", timeout_s=1.0)
    assert line in str(caught.value) and "\n" not in str(caught.value)
