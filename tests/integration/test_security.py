"""A secured mesh of real Zenoh sessions: who must not speak is refused, who may is heard, and the cause is named."""

import json
import os
import threading
import time
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from datetime import UTC, datetime, timedelta
from pathlib import Path

import pytest
import zenoh
from mesh_stage import FakePipeline, believed, first

from common.config import MeshConfig, read_scene
from common.errors import LabanmeshError
from common.link import Link
from common.messages import JudgementMessage, StatusMessage
from common.zenoh_settings import ADMITTED, settings
from deploy.security.authority import issue
from deploy.security.issuing import create_authority
from deploy.security.register import Register, Roles
from deploy.security.router_config import router_config
from fusion.server import serve as serve_fusion
from observer.runtime.service import serve as serve_observer
from observer.tracks import Frame

SOON_S = 20.0
PATIENCE_S = 1.0
PAGE = Path(__file__).parents[2] / "docs" / "design" / "security.md"
REWRITE = "LABANMESH_REWRITE=1 pytest tests/integration/test_security.py writes it anew"
HEAD = "| who tries | refused by | what is said there |\n|---|---|---|\n"
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
[observers.cam2]
source = "m.npz"
[fusion]
step_hz = 50
"""


def now():
    return datetime.now(UTC)


@pytest.fixture(scope="module", autouse=True)
def quick():
    """Who is not admitted need not wait for as long as a busy router might want."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("common.link.ADMISSION_TIMEOUT_S", 1.0)
        patch.setattr("common.tls.GREETING_S", SOON_S)
        yield


@pytest.fixture(scope="module")
def scene(tmp_path_factory):
    place = tmp_path_factory.mktemp("dojo") / "scene.toml"
    place.write_text(SCENE)
    return read_scene(place, {})


@pytest.fixture(scope="module")
def secure(scene):
    """The authority after its work: all machines, cam1 renewed and its old certificate revoked, garden revoked."""
    authority = create_authority(scene.place("secure"), [scene], now())
    authority.add("router", Roles(router=True), ["127.0.0.1"], now())
    for name, roles in {
        "cam1": Roles(observers=("cam1",)),
        "cam2": Roles(observers=("cam2",)),
        "fusion": Roles(fusions=("fusion",)),
        "hub": Roles(hub=True),
        "garden": Roles(observers=("cam2",)),
    }.items():
        authority.add(name, roles, (), now())
    authority.renew("cam1", (), now())
    authority.revoke("cam1.1", now())
    authority.revoke("garden", now())
    return authority


@pytest.fixture(scope="module")
def router(scene, secure):
    with Link.router(router_config([scene], secure.register, [scene.mesh.endpoint]), "the test's router") as link:
        yield link.locator


@pytest.fixture(scope="module")
def mesh(scene, router):
    """How the holder of one certificate sees the mesh."""

    def seen_with(certificate):
        return MeshConfig(mode="router", endpoint=router, credentials=str(scene.place(f"secure/{certificate}")))

    return seen_with


@contextmanager
def stranger(mesh):
    """A Zenoh client that keeps to no rule of labanmesh; None when TLS did not let it in."""
    config = zenoh.Config()
    for key, value in settings(mesh, "observer", None, PATIENCE_S).items():
        config.insert_json5(key, json.dumps(value))
    try:
        session = zenoh.open(config)
    except zenoh.ZError:
        yield None
        return
    with session:
        yield session


def heard_of(scene, mesh, attacker, key, who=""):
    """Who refuses what `attacker` says under `key`; None: a hub hears it. Told by what is said after it."""
    lie, truth = f"lie of {who}".encode(), f"truth after {who}".encode()
    with Link.open(mesh("hub.1"), "hub") as hub, Link.open(mesh("fusion.1"), "fusion") as fusion:
        inbox = hub.inbox(f"{scene.keys.root}/**")
        voice = fusion.publisher(scene.keys.verdict)
        with stranger(attacker) as session:
            if session is None:
                return "TLS"
            session.declare_publisher(key).put(lie)
            session.put(key, lie)
            # The router has read the lie when it has answered this, or has had long enough.
            list(session.get(ADMITTED, timeout=0.3))
            deadline, said = time.monotonic() + SOON_S, []
            while truth not in said:
                assert time.monotonic() < deadline, "the hub hears nothing"
                voice.put(truth)
                said += [arrival.payload for arrival in inbox.take(0.2)]
            return None if lie in said else "access rules"


def laid_out(folder, pair, authority):
    """A folder of credentials that no register knows."""
    folder.mkdir(exist_ok=True)
    for name, content in (("ca.pem", authority), ("certificate.pem", pair.certificate), ("key.pem", pair.key)):
        (folder / name).write_bytes(content)
        (folder / name).chmod(0o600)
    return str(folder)


@pytest.fixture(scope="module")
def cases(scene, secure, router, mesh, tmp_path_factory):
    """Who tries what: how they see the mesh, what they say, and as whom they say it."""
    other_scene = tmp_path_factory.mktemp("other") / "scene.toml"
    other_scene.write_text(SCENE)
    other = create_authority(other_scene.parent / "secure", [read_scene(other_scene, {})], now()).pair
    ours, keys, base = secure.pair, scene.keys, scene.place("")
    foreign = issue(other, "cam1.2", (), now()).pair
    late = issue(ours, "cam1.2", (), now() - timedelta(days=2), days=1).pair
    unknown = issue(ours, "attic.1", (), now()).pair
    own = keys.posterior("cam1")

    def with_(folder):
        return MeshConfig(mode="router", endpoint=router, credentials=folder)

    return {
        "a certificate of a foreign authority": (
            with_(laid_out(base / "foreign", foreign, other.certificate)), own, None, ""),
        "the same, with our authority's ca.pem beside it": (
            with_(laid_out(base / "mixed", foreign, ours.certificate)), own, None, ""),
        "no certificate": (MeshConfig(mode="router", endpoint=router), own, None, ""),
        "a plain-text client": (MeshConfig(mode="router", endpoint=router.replace("tls/", "tcp/")), own, None, ""),
        "an expired certificate": (with_(laid_out(base / "late", late, ours.certificate)), own, None, ""),
        "a certificate that is not in the register": (
            with_(laid_out(base / "unknown", unknown, ours.certificate)), own, None, ""),
        "a revoked machine": (mesh("garden.1"), keys.posterior("cam2"), None, ""),
        "a superseded certificate": (mesh("cam1.1"), own, None, ""),
        "observer cam1 speaks for cam2": (mesh("cam1.2"), keys.posterior("cam2"), "observer", "cam2"),
        "observer cam1 judges": (mesh("cam1.2"), keys.judgement, "fusion", "fusion"),
        "a hub judges": (mesh("hub.1"), keys.judgement, "fusion", "fusion"),
        "a hub speaks for cam1": (mesh("hub.1"), own, "observer", "cam1"),
        "fusion speaks for cam1": (mesh("fusion.1"), own, "observer", "cam1"),
        "the router's certificate speaks for cam1": (mesh("router.1"), own, "observer", "cam1"),
    }  # fmt: skip


@pytest.fixture(scope="module")
def table(scene, mesh, cases):
    """The rows of the page: who tries, who refuses, what is said on that machine."""

    def tried(case):
        who, (seen, key, role, named) = case
        refused_by = heard_of(scene, mesh, seen, key, who)
        try:
            # What a process of ours reads that is started there; where nothing is said of its role, an observer.
            Link.open(seen, role or "observer", process_id=named, timeout_s=SOON_S).close()
            says = "nothing"
        except LabanmeshError as error:
            says = plain(str(error).partition("; ")[0], scene, seen)
        return who, refused_by or "nobody", says

    # Most of the time is waiting for answers that do not come.
    with ThreadPoolExecutor(7) as pool:
        return list(pool.map(tried, cases.items()))


def plain(text, scene, seen):
    """Without what differs from run to run: folders, ports and days."""
    text = text.replace(f"{scene.place('')}/", "").replace(seen.endpoint.rpartition(":")[2], "7447")
    day = (now() - timedelta(days=1)).strftime("%Y-%m-%d")
    return text.replace(day, "2027-01-31")


def test_everybody_who_must_be_refused_is_refused(table):
    assert {who: by for who, by, _ in table if by == "nobody"} == {}


def test_the_cause_is_named_for_each(table):
    causes = {
        "a certificate of a foreign authority": "foreign authority",
        "the same, with our authority's ca.pem beside it": "not signed by the authority",
        "no certificate": "needs mesh.credentials",
        "a plain-text client": "accepts TLS only",
        "an expired certificate": "expired",
        "a certificate that is not in the register": "do not know certificate attic.1",
        "a revoked machine": "do not know certificate garden.1: revoked",
        "a superseded certificate": "do not know certificate cam1.1: revoked, superseded",
        "observer cam1 speaks for cam2": "certificate cam1.2 is for observer cam1, not for observer cam2",
        "observer cam1 judges": "certificate cam1.2 is for observer cam1, not for fusion",
        "a hub judges": "certificate hub.1 is for hub, not for fusion",
        "a hub speaks for cam1": "certificate hub.1 is for hub, not for observer cam1",
        "fusion speaks for cam1": "is for fusion fusion, not for observer cam1",
        "the router's certificate speaks for cam1": "is for router, not for observer cam1",
    }
    said = {who: says for who, _, says in table}
    assert said.keys() == causes.keys()
    assert {who: says for who, says in said.items() if causes[who] not in says} == {}


def test_the_page_shows_what_was_seen(table):
    written = "\n".join(f"| {who} | {by} | {says} |" for who, by, says in table)
    text = PAGE.read_text("utf-8")
    old = text.partition(HEAD)[2].partition("\n\n")[0]
    assert old, "docs/design/security.md has lost its table"
    if os.environ.get("LABANMESH_REWRITE"):
        PAGE.write_text(text.replace(old, written, 1), "utf-8")
        return
    assert old == written, f"docs/design/security.md is out of date; {REWRITE}"


@pytest.mark.parametrize("who", ["observer cam1 speaks for cam2", "a hub judges", "a revoked machine"])
def test_without_rules_the_same_lie_is_heard(scene, secure, cases, who):
    """The control: these attacks are real ones."""
    open_to_all = router_config([scene], None, [scene.mesh.endpoint])
    with Link.router(open_to_all, "the test's router") as link:
        seen, key, _, _ = cases[who]

        def at(certificate):
            return MeshConfig(
                mode="router", endpoint=link.locator, credentials=str(scene.place(f"secure/{certificate}"))
            )

        assert heard_of(scene, at, seen.at(link.locator), key) is None


def test_nobody_is_let_in_by_an_empty_register(scene, secure):
    with Link.router(router_config([scene], Register(("dojo",)), [scene.mesh.endpoint]), "the test's router") as link:
        mesh = MeshConfig(mode="router", endpoint=link.locator, credentials=str(scene.place("secure/hub.1")))
        with stranger(mesh) as session:
            assert session is not None
            assert not [reply for reply in session.get(ADMITTED, timeout=0.3) if reply.ok]


def test_a_hub_cannot_feign_presence(scene, mesh):
    keys = scene.keys
    with Link.open(mesh("hub.1"), "hub") as hub, Link.open(mesh("fusion.1"), "fusion") as fusion:
        presence = fusion.presence(keys.observer_alive())
        hub.announce(keys.observer_alive("cam1"))
        with Link.open(mesh("cam2.1"), "observer") as cam:
            cam.announce(keys.observer_alive("cam2"))
            assert presence.wait_for(1, SOON_S) and presence.alive == {keys.observer_alive("cam2")}
        assert presence.wait_for(0, SOON_S)


def test_an_observer_cannot_answer_for_another_nor_listen_in(scene, mesh):
    keys = scene.keys
    with (
        Link.open(mesh("cam1.2"), "observer") as liar,
        Link.open(mesh("cam2.1"), "observer") as cam,
        Link.open(mesh("hub.1"), "hub") as hub,
    ):
        liar.answer(keys.observer_status("cam2"), lambda: b"lie")
        liar.answer(keys.judgement, lambda: b"lie")
        overheard = liar.inbox(f"{keys.root}/**")
        cam.answer(keys.observer_status("cam2"), lambda: b"truth")
        assert hub.ask(f"{keys.root}/**", SOON_S) == {keys.observer_status("cam2"): b"truth"}
        heard = hub.inbox(keys.posterior())
        voice = cam.publisher(keys.posterior("cam2"))
        assert voice.wait_for_subscriber(SOON_S)
        voice.put(b"belief")
        assert [arrival.payload for arrival in heard.take(SOON_S)] == [b"belief"]
        assert overheard.take(0.0) == []


class FakeSource:
    """A frame each 20 ms until it is stopped."""

    rate_hz, body_parts = 50.0, ("head",)

    def frames(self, stop):
        while not stop.wait(0.02):
            yield Frame(time.time_ns(), None)


def sure(frame):
    return believed((0.1, 0.9), 0.1, {"head": True})


@contextmanager
def services(scene, mesh):
    """The referee and both observers, each with its own certificate, as their processes run them."""
    stop, links, faults = threading.Event(), [], []

    def run(serve, *arguments):
        try:
            serve(*arguments, stop)
        except Exception as error:  # noqa: BLE001 - told to the test below
            faults.append(error)

    links.append(Link.open(mesh("fusion.1"), "fusion", process_id="fusion"))
    threads = [threading.Thread(target=run, args=(serve_fusion, [scene], scene.fusion.id, links[0]))]
    for name, certificate in (("cam1", "cam1.2"), ("cam2", "cam2.1")):
        links.append(Link.open(mesh(certificate), "observer", process_id=name))
        arguments = (
            serve_observer,
            scene,
            name,
            FakePipeline(sure),
            FakeSource(),
            links[-1],
        )
        threads.append(threading.Thread(target=run, args=arguments))
    for thread in threads:
        thread.start()
    try:
        yield
    finally:
        stop.set()
        for thread in threads:
            thread.join(SOON_S)
        for link in links:
            link.close()
    assert faults == []


def test_all_that_is_legitimate_works_under_default_deny(scene, mesh):
    keys = scene.keys
    with Link.open(mesh("hub.1"), "hub") as hub:
        judgements, statuses = hub.inbox(keys.judgement), hub.inbox(keys.observer_status("cam1"))
        presence = hub.presence(f"{keys.root}/**")
        with services(scene, mesh):
            said = first(judgements, JudgementMessage, lambda j: all(v.state == "counted" for v in j.votes.values()))
            assert set(said.votes) == {"cam1", "cam2"} and said.label == "lunging"
            assert presence.wait_for(3, SOON_S)
            assert presence.alive == {
                keys.fusion_alive("fusion"),
                keys.observer_alive("cam1"),
                keys.observer_alive("cam2"),
            }
            first(statuses, StatusMessage, lambda s: s.skew_s is not None)  # an observer asks fusion for its clock
            told = hub.ask(f"{keys.root}/**", SOON_S)
            late = {keys.judgement, keys.vocabulary, keys.fusion_status("fusion")}
            assert told.keys() >= {*late, keys.observer_status("cam1"), keys.observer_status("cam2")}
            fusions = hub.inbox(keys.fusion_status())
            first(fusions, StatusMessage, lambda s: s.observers and s.observers["cam2"].skew_s is not None)
        assert presence.wait_for(0, SOON_S)


@pytest.mark.parametrize(
    ("certificate", "role", "named", "line"),
    [
        ("garden.1", "observer", "cam2", "access rules do not know certificate garden.1"),
        ("cam1.1", "observer", "cam1", "access rules do not know certificate cam1.1"),
        ("cam2.1", "observer", "cam1", "certificate cam2.1 is for observer cam2, not for observer cam1"),
        ("hub.1", "fusion", "", "certificate hub.1 is for hub, not for fusion; labanmesh secure add"),
        ("hub.1", "standby", "second", "certificate hub.1 is for hub, not for fusion second; labanmesh secure add"),
        ("nowhere", "hub", "", "no such folder; copy the folder here that `labanmesh secure add` made"),
    ],
)
def test_a_process_that_would_not_be_heard_ends_with_one_line(mesh, certificate, role, named, line):
    with pytest.raises(LabanmeshError) as caught:
        Link.open(mesh(certificate), role, process_id=named, timeout_s=PATIENCE_S)
    assert line in str(caught.value) and "\n" not in str(caught.value)


def test_a_service_without_credentials_learns_why(mesh):
    for endpoint in (mesh("hub.1").endpoint, mesh("hub.1").endpoint.replace("tls/", "tcp/")):
        with pytest.raises(LabanmeshError, match=r"needs mesh.credentials|accepts TLS only") as caught:
            Link.open(MeshConfig(mode="router", endpoint=endpoint), "hub", timeout_s=PATIENCE_S)
        assert "\n" not in str(caught.value)


def test_whoever_is_admitted_gets_in(mesh):
    for certificate, role, named in (
        ("cam1.2", "observer", "cam1"),
        ("fusion.1", "fusion", "fusion"),
        ("hub.1", "hub", ""),
    ):
        Link.open(mesh(certificate), role, process_id=named, timeout_s=SOON_S).close()
