"""The access rules of one scene and of several, read as Zenoh reads them: who may publish, hear, query and answer."""

import json
from datetime import UTC, datetime
from types import SimpleNamespace

import pytest
import zenoh
from hypothesis import given
from hypothesis import strategies as st

from common.config import MeshConfig, ObserverConfig, Scene, read_scene
from common.config_sections import ClipsConfig
from common.errors import BadInput
from deploy.security.register import IssuedCertificate, Register, Roles
from deploy.security.router_config import access_rules, host_of, listening, router_config

NOW = datetime(2027, 1, 31, tzinfo=UTC)
OBSERVERS, FUSIONS, SCENES = ("cam1", "cam2", "cam12"), ("north", "second"), ("dojo", "garden")


def names(of):
    """Ids alone, for all scenes, and ids of one scene."""
    known = [*of, *(f"{scene}/{name}" for scene in SCENES for name in of)]
    return st.lists(st.sampled_from(known), unique=True, max_size=3).map(tuple)


MACHINES = st.dictionaries(
    st.sampled_from(("cam1", "cam2", "north", "attic")),
    st.builds(
        SimpleNamespace,
        roles=st.builds(
            Roles,
            observers=names(OBSERVERS),
            fusions=names(FUSIONS),
            hub=st.booleans(),
            hub_of=st.lists(st.sampled_from(SCENES), unique=True).map(tuple),
            router=st.booleans(),
            pictures=st.booleans(),
            teach=st.booleans(),
        ),
        revoked=st.booleans(),
    ),
    max_size=4,
)


def scene(name="dojo", **sources):
    observers = {observer: ObserverConfig(source=sources.get(observer, "m.npz")) for observer in OBSERVERS}
    mesh = MeshConfig(mode="router", endpoint="tls/judge.example:7447", credentials="/c")
    return Scene(scene=name, observers=observers, mesh=mesh)


BOTH = [scene(name) for name in SCENES]


def certificate(name, roles, revoked=None):
    return IssuedCertificate(name=name, generation=1, roles=roles, serial="1", expires=NOW, revoked=revoked)


def register(**roles):
    return Register(SCENES, tuple(certificate(name, each) for name, each in roles.items()))


def register_of(machines):
    certificates = (certificate(name, each.roles, NOW if each.revoked else None) for name, each in machines.items())
    return Register(SCENES, tuple(certificates))


def may(control, common_name, flow, message, key):
    """Zenoh's way: an allowing rule of one of the subject's policies covers the whole of `key`, and no denying one."""
    subjects = {s["id"] for s in control["subjects"] if common_name in s["cert_common_names"]}
    ids = {rule for policy in control["policies"] if subjects & set(policy["subjects"]) for rule in policy["rules"]}
    permissions = {
        rule["permission"]
        for rule in control["rules"]
        if rule["id"] in ids and flow in rule["flows"] and message in rule["messages"]
        for covered in rule["key_exprs"]
        if zenoh.KeyExpr(covered).includes(zenoh.KeyExpr(key))
    }
    return permissions == {"allow"}


SEEN = ObserverConfig(source="0", picture_hz=2.0)
WITH_PICTURES = [each.model_copy(update={"observers": {**each.observers, "cam1": SEEN}}) for each in BOTH]
"""Both scenes, in which cam1 has its pictures switched on."""


def rights(where, machine):
    """What a machine may do in a scene, and what not: flow, message, key, whether."""
    keys, roles = where.keys, Roles() if machine.revoked else machine.roles
    observers, fusions, hub = (each(where.scene) for each in (roles.observers_in, roles.fusions_in, roles.is_hub_in))
    reads, everything = bool(fusions) or hub, f"{keys.root}/**"
    for observer in OBSERVERS:
        own, taught = observer in observers, keys.teach(observer)
        for key in (keys.posterior(observer), keys.observer_status(observer)):
            yield "ingress", "put", key, own
        yield "ingress", "liveliness_token", keys.observer_alive(observer), own
        for flow, message in (("ingress", "declare_queryable"), ("ingress", "reply"), ("egress", "query")):
            yield flow, message, taught, own
        for flow, message in (("ingress", "query"), ("egress", "reply")):
            yield flow, message, taught, roles.teach and hub
        yield "ingress", "put", taught, False
    for fusion in FUSIONS:
        yield "ingress", "put", keys.fusion_status(fusion), fusion in fusions
        yield "ingress", "liveliness_token", keys.fusion_alive(fusion), fusion in fusions
        for message in ("declare_queryable", "reply"):
            yield "ingress", message, keys.fusion_handover(fusion), fusion in fusions
    yield "ingress", "liveliness_token", keys.hub_alive("mqtt"), hub
    for key in (keys.judgement, keys.verdict, keys.vocabulary):
        yield "ingress", "put", key, bool(fusions)
    for asked in (keys.fusion_handover("north"), keys.fusion_handover()):
        yield "ingress", "query", asked, bool(fusions)
    for message in ("declare_subscriber", "query", "liveliness_query", "declare_liveliness_subscriber"):
        yield "ingress", message, everything, reads
    for watched in (keys.fusion_alive(), keys.observer_alive()):
        yield "ingress", "declare_liveliness_subscriber", watched, reads
    for message, key in (("put", keys.posterior("cam1")), ("liveliness_token", keys.fusion_alive("north"))):
        yield "egress", message, key, reads
    for key in (keys.picture(), keys.picture("cam1")):
        for flow, message in (("ingress", "declare_subscriber"), ("egress", "put")):
            yield flow, message, key, roles.pictures and hub
        yield "ingress", "query", key, False
    for flow, message in (("ingress", "put"), ("egress", "declare_subscriber")):
        yield flow, message, keys.picture("cam1"), "cam1" in observers
    for key in (keys.picture("cam2"), everything, "laban/elsewhere/judgement"):
        yield "ingress", "put", key, False


@given(MACHINES)
def test_each_machine_may_do_what_its_roles_say_in_its_scenes_and_nothing_else(machines):
    control = access_rules(WITH_PICTURES, register_of(machines))
    for name, each in machines.items():
        for where in WITH_PICTURES:
            for flow, message, key, may_it in rights(where, each):
                assert may(control, f"{name}.1", flow, message, key) == may_it, (name, flow, message, key)
            assert not may(control, f"{name}.2", "ingress", "query", f"{where.keys.root}/**")


@given(MACHINES, st.sampled_from([BOTH, BOTH[:1]]))
def test_zenoh_reads_the_rules(machines, scenes):
    text = router_config(scenes, register_of(machines), ["tls/0.0.0.0:7447"])
    control = json.loads(zenoh.Config.from_json5(text).get_json("access_control"))
    assert control["default_permission"] == "deny" and control["enabled"] is True
    ids = [rule["id"] for rule in control["rules"]]
    assert len(ids) == len(set(ids))
    assert {rule for policy in control["policies"] for rule in policy["rules"]} == set(ids)
    assert all("*" not in name for subject in control["subjects"] for name in subject["cert_common_names"])


def test_an_observer_answers_for_its_own_status_and_the_vocabulary():
    dojo = scene()
    keys = dojo.keys
    control = access_rules([dojo], register(cam1=Roles(observers=("cam1",))))
    asked = [
        keys.posterior("cam1"),
        keys.observer_status("cam1"),
        keys.observer_status("cam2"),
        keys.fusion_status("f"),
    ]
    asked += [keys.judgement, keys.verdict, keys.vocabulary, f"{keys.root}/**"]
    for message in ("declare_queryable", "reply"):
        answered = {key for key in asked if may(control, "cam1.1", "ingress", message, key)}
        assert answered == {keys.observer_status("cam1"), keys.vocabulary}


@pytest.mark.parametrize(("source", "key"), [("zenoh:wristband/tracks", "wristband/tracks"), ("phone", "")])
def test_tracks_are_read_and_published_with_the_certificate_of_their_observer_alone(source, key):
    dojo = scene(cam1=source)
    control = access_rules([dojo], register(cam1=Roles(observers=("cam1",)), cam2=Roles(observers=("cam2",))))
    key = key or dojo.keys.tracks("cam1")
    for message in ("put", "declare_subscriber"):
        assert may(control, "cam1.1", "ingress", message, key)
        assert not may(control, "cam2.1", "ingress", message, key)
    assert may(control, "cam1.1", "egress", "put", key)
    assert not zenoh.KeyExpr("**").intersects(zenoh.KeyExpr(dojo.keys.tracks("cam1"))), "no wildcard covers a phone's"


@pytest.mark.parametrize("wide", ["laban/dojo/**", "**", "*/*/*/*/*", "laban/dojo/observer/cam1/*"])
def test_no_wildcard_covers_a_picture(wide):
    picture = zenoh.KeyExpr(scene().keys.picture("cam1"))
    assert not zenoh.KeyExpr(wide).intersects(picture)
    assert zenoh.KeyExpr(scene().keys.picture()).intersects(picture)


def test_an_observer_hears_verdicts_if_it_keeps_clips():
    dojo = scene()
    clips = ObserverConfig(source="0", clips=ClipsConfig(folder="clips"))
    dojo = dojo.model_copy(update={"observers": {**dojo.observers, "cam1": clips}})
    control = access_rules([dojo], register(cam1=Roles(observers=("cam1",)), cam2=Roles(observers=("cam2",))))
    for flow, message in (("ingress", "declare_subscriber"), ("egress", "put")):
        assert may(control, "cam1.1", flow, message, dojo.keys.verdict)
        assert not may(control, "cam2.1", flow, message, dojo.keys.verdict)
        assert not may(control, "cam1.1", flow, message, dojo.keys.judgement)


def test_an_observer_that_the_scene_no_longer_names_has_no_rights():
    control = access_rules([scene()], register(gone=Roles(observers=("cam9",))))
    assert control["rules"] == control["subjects"] == control["policies"] == []


def test_a_secured_router_opens_no_plain_listener_and_asks_for_certificates():
    read = zenoh.Config.from_json5(router_config([scene()], register(), ["tls/0.0.0.0:7447"], "/run/credentials"))
    link = json.loads(read.get_json("transport/link"))
    assert link["protocols"] == ["tls"] and link["tls"]["enable_mtls"] is True
    assert link["tls"]["listen_private_key"] == "/run/credentials/key.pem"
    assert link["tls"]["close_link_on_expiration"] is True
    assert json.loads(read.get_json("scouting/multicast/enabled")) is False
    assert json.loads(read.get_json("adminspace/permissions")) == {"read": True, "write": False}


@pytest.mark.parametrize(
    ("endpoint", "listens", "host"),
    [
        ("tls/judge.example:7447", "tls/0.0.0.0:7447", "judge.example"),
        ("tls/192.168.1.10:7447", "tls/192.168.1.10:7447", "192.168.1.10"),
        ("tls/[fe80::1]:7447", "tls/[fe80::1]:7447", "fe80::1"),
        ("tcp/router:7447#iface=eth0", "tcp/0.0.0.0:7447#iface=eth0", "router"),
        ("unixsock-stream//run/mesh", "unixsock-stream//run/mesh", ""),
    ],
)
def test_where_a_router_listens(endpoint, listens, host):
    assert (listening(endpoint), host_of(endpoint)) == (listens, host)


def read(tmp_path, mesh, environment=None):
    (tmp_path / "scene.toml").write_text(f'scene = "dojo"\n[mesh]\n{mesh}\n[observers.cam1]\nsource = "m.npz"\n')
    return read_scene(tmp_path / "scene.toml", environment or {})


@pytest.mark.parametrize(
    ("credentials", "place"), [("credentials", "{}/credentials"), ("/etc/mesh", "/etc/mesh"), ("../c", "{}/../c")]
)
def test_the_folder_of_credentials_starts_from_the_scene_file(tmp_path, credentials, place):
    unsecured = 'mode = "router"\nendpoint = "tls/judge.example:7447"'
    in_the_file = read(tmp_path, f'{unsecured}\ncredentials = "{credentials}"')
    by_environment = read(tmp_path, unsecured, {"LABANMESH_MESH_CREDENTIALS": credentials})
    assert in_the_file.mesh.credentials == by_environment.mesh.credentials == place.format(tmp_path)


@pytest.mark.parametrize(
    ("mesh", "line"),
    [
        ('credentials = "c"', 'only a router checks certificates; set mesh.mode = "router" or remove this key'),
        ('mode = "process"\nendpoint = "tls/a:1"\ncredentials = "c"', "only a router checks certificates"),
        ('mode = "router"\ncredentials = "c"', "mesh.endpoint = 'tcp/127.0.0.1:7447' is not encrypted; write tls/"),
        ("credentials = 7", "mesh.credentials = 7"),
        ('credential = "c"', "mesh.credential: unknown key; did you mean credentials?"),
    ],
)
def test_incomplete_security_is_one_line(tmp_path, mesh, line):
    with pytest.raises(BadInput) as caught:
        read(tmp_path, mesh)
    assert line in str(caught.value) and "\n" not in str(caught.value)
