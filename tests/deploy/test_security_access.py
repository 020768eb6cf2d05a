"""The access rules, read as Zenoh reads them: who may say, hear, ask and answer what."""

import json
from datetime import UTC, datetime

import pytest
import zenoh
from hypothesis import given
from hypothesis import strategies as st

from common.config import MeshConfig, ObserverConfig, Scene
from deploy.security.access import access_rules
from deploy.security.register import Machine, Register, Roles
from deploy.security.router_config import host_of, listening, router_config

NOW = datetime(2027, 1, 31, tzinfo=UTC)
NAMES = ("cam1", "cam2", "cam12", "judge", "second", "attic")
ROLES = st.builds(
    Roles,
    observers=st.lists(st.sampled_from(["cam1", "cam2", "cam12"]), unique=True).map(tuple),
    fusions=st.lists(st.sampled_from(["judge", "second"]), unique=True).map(tuple),
    hub=st.booleans(),
    router=st.booleans(),
)
PLAYERS = st.dictionaries(st.sampled_from(NAMES), st.tuples(ROLES, st.booleans()), max_size=4)


def scene(**sources):
    observers = {name: ObserverConfig(source=sources.get(name, "m.npz")) for name in ("cam1", "cam2", "cam12")}
    mesh = MeshConfig(mode="router", endpoint="tls/judge.example:7447", credentials="/c")
    return Scene(scene="dojo", observers=observers, mesh=mesh)


def machine(name, roles, revoked=None):
    return Machine(name=name, generation=1, roles=roles, serial="1", expires=NOW, revoked=revoked)


def register(**roles):
    return Register("dojo", tuple(machine(name, said) for name, said in roles.items()))


def may(control, common_name, flow, message, key):
    """Zenoh's way: a rule of one of the subject's policies whose key covers the whole of `key`."""
    subjects = {s["id"] for s in control["subjects"] if common_name in s["cert_common_names"]}
    ids = {rule for policy in control["policies"] if subjects & set(policy["subjects"]) for rule in policy["rules"]}
    return any(
        flow in rule["flows"] and message in rule["messages"] and zenoh.KeyExpr(allowed).includes(zenoh.KeyExpr(key))
        for rule in control["rules"]
        if rule["id"] in ids and rule["permission"] == "allow"
        for allowed in rule["key_exprs"]
    )


def spoken(scene):
    """Each key that somebody speaks under, and whose it is."""
    keys = scene.keys
    for observer in scene.observers:
        yield keys.posterior(observer), ("observer", observer)
        yield keys.observer_status(observer), ("observer", observer)
    for fusion in ("judge", "second"):
        yield keys.fusion_status(fusion), ("fusion", fusion)
    yield keys.judgement, ("fusion", None)
    yield keys.verdict, ("fusion", None)


def owns(roles, whose):
    kind, name = whose
    held = roles.observers if kind == "observer" else roles.fusions
    return bool(held) if name is None else name in held


@given(PLAYERS)
def test_each_says_what_is_its_own_and_nothing_else(players):
    dojo = scene()
    machines = tuple(machine(name, roles, NOW if gone else None) for name, (roles, gone) in players.items())
    control = access_rules(dojo, Register("dojo", machines))
    for name, (roles, gone) in players.items():
        for key, whose in spoken(dojo):
            assert may(control, f"{name}.1", "ingress", "put", key) == (owns(roles, whose) and not gone), (name, key)
        for observer in dojo.observers:
            alive = may(control, f"{name}.1", "ingress", "liveliness_token", dojo.keys.observer_alive(observer))
            assert alive == (observer in roles.observers and not gone)
        reads = (roles.hub or bool(roles.fusions)) and not gone
        for message in ("declare_subscriber", "query", "liveliness_query", "declare_liveliness_subscriber"):
            assert may(control, f"{name}.1", "ingress", message, f"{dojo.keys.root}/**") == reads
        for message in ("put", "liveliness_token"):
            assert may(control, f"{name}.1", "egress", message, dojo.keys.posterior("cam1")) == reads
        assert not may(control, f"{name}.1", "ingress", "put", f"{dojo.keys.root}/**")
        assert not may(control, f"{name}.1", "ingress", "put", "laban/garden/judgement")
        assert not may(control, f"{name}.2", "ingress", "query", f"{dojo.keys.root}/**")


@given(PLAYERS)
def test_zenoh_opens_with_the_rules(players):
    machines = tuple(machine(name, roles, NOW if gone else None) for name, (roles, gone) in players.items())
    text = router_config(scene(), Register("dojo", machines), ["tls/0.0.0.0:7447"])
    control = json.loads(zenoh.Config.from_json5(text).get_json("access_control"))
    assert control["default_permission"] == "deny" and control["enabled"] is True
    ids = [rule["id"] for rule in control["rules"]]
    assert len(ids) == len(set(ids))
    assert {rule for policy in control["policies"] for rule in policy["rules"]} == set(ids)
    assert all("*" not in name for subject in control["subjects"] for name in subject["cert_common_names"])


def test_only_its_own_status_and_the_vocabulary_are_answered_by_an_observer():
    dojo = scene()
    control = access_rules(dojo, register(cam1=Roles(observers=("cam1",))))
    keys = [key for key, _ in spoken(dojo)] + [dojo.keys.vocabulary, f"{dojo.keys.root}/**"]
    answered = {key for key in keys if may(control, "cam1.1", "ingress", "declare_queryable", key)}
    assert answered == {key for key in keys if may(control, "cam1.1", "ingress", "reply", key)}
    assert answered == {dojo.keys.observer_status("cam1"), dojo.keys.vocabulary}


def test_tracks_over_the_mesh_are_read_and_said_by_their_observer_alone():
    dojo = scene(cam1="zenoh:wristband/tracks")
    control = access_rules(dojo, register(cam1=Roles(observers=("cam1",)), cam2=Roles(observers=("cam2",))))
    for message in ("put", "declare_subscriber"):
        assert may(control, "cam1.1", "ingress", message, "wristband/tracks")
        assert not may(control, "cam2.1", "ingress", message, "wristband/tracks")
    assert may(control, "cam1.1", "egress", "put", "wristband/tracks")


def test_an_observer_that_the_scene_no_longer_names_may_nothing():
    control = access_rules(scene(), register(gone=Roles(observers=("cam9",))))
    assert control["rules"] == control["subjects"] == control["policies"] == []


def test_a_secured_router_opens_no_plain_listener_and_asks_for_certificates():
    read = zenoh.Config.from_json5(router_config(scene(), register(), ["tls/0.0.0.0:7447"], "/run/credentials"))
    link = json.loads(read.get_json("transport/link"))
    assert link["protocols"] == ["tls"] and link["tls"]["enable_mtls"] is True
    assert link["tls"]["listen_private_key"] == "/run/credentials/key.pem"
    assert link["tls"]["close_link_on_expiration"] is True
    assert json.loads(read.get_json("scouting/multicast/enabled")) is False
    assert json.loads(read.get_json("adminspace/permissions")) == {"read": True, "write": False}


@pytest.mark.parametrize(
    ("met_at", "listens", "host"),
    [
        ("tls/judge.example:7447", "tls/0.0.0.0:7447", "judge.example"),
        ("tls/192.168.1.10:7447", "tls/192.168.1.10:7447", "192.168.1.10"),
        ("tls/[fe80::1]:7447", "tls/[fe80::1]:7447", "fe80::1"),
        ("tcp/router:7447#iface=eth0", "tcp/0.0.0.0:7447#iface=eth0", "router"),
        ("unixsock-stream//run/mesh", "unixsock-stream//run/mesh", ""),
    ],
)
def test_where_a_router_listens(met_at, listens, host):
    assert (listening(met_at), host_of(met_at)) == (listens, host)
