"""The router's whole Zenoh configuration, for `labanmesh router` and zenohd alike. Pure: scenes and register to text.

The access rules:

1. Default deny. A rule names the exact common names of the certificates it is for: Zenoh knows no patterns there.
2. `ingress` is what a machine may send to the router, `egress` what the router may pass on to it.
3. A machine that publishes must learn of subscribers, or Zenoh suppresses its puts at their source: hence egress
   `declare_subscriber` on all of the scene, which covers every subscriber's key.
4. To query, a machine needs `query` in and `reply` out; to answer, the reverse, and `declare_queryable` in.
5. Every admitted machine may ask the router for `ADMITTED`: the answer shows that its certificate counts.
6. Only fusion services may ask for a handover. A hub may query all of the scene with a wildcard, so a rule denies it
   the handover keys; Zenoh puts deny before allow. A fusion service answers its own exact key alone, no wildcard.
7. Live pictures and requests to teach have keys that no wildcard covers, so no other rule allows them
   (docs/design/security.md).
8. A put that no process of a scene would accept for its size stops at the router, and costs no listener anything.
"""

import ipaddress
import json
import re
from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING, Any, Literal

from common.keys import SceneKeys
from common.tracker_choice import MESH_KEY, PHONE
from common.wire import SIZE_LIMIT
from common.zenoh_settings import ADMITTED, nested, settings
from deploy.security.register import IssuedCertificate, Register

if TYPE_CHECKING:
    from common.config import Scene

Flow = Literal["ingress", "egress"]
Rule = dict[str, Any]

ROUTER_ENDPOINT = re.compile(r"(?P<protocol>[\w-]+)/(?P<host>\[[^\]]+\]|[^/\[\]]+):(?P<port>\d+)(?P<more>[#?].*)?\Z")
ROUTER_HEAD = """\
// The router of {scenes}, made by labanmesh secure; do not edit: print it anew after a change.
// labanmesh router --config FILE, or zenohd --config FILE
"""


def router_config(
    scenes: Sequence["Scene"], register: Register | None, listen: Sequence[str], credentials: str = ""
) -> str:
    """JSON5 for a router that listens on `listen`; without a register everybody may do everything.

    scenes: they have one [mesh]. credentials: where ca.pem, certificate.pem and key.pem lie on the router's machine,
    if not where the scene says.
    """
    mesh = scenes[0].mesh
    if credentials:
        mesh = mesh.model_copy(update={"credentials": credentials})
    flat = settings(mesh, "router", listen, 0.0)
    if mesh.credentials:
        # Otherwise a plain listener could be opened beside the secured one.
        flat["transport/link/protocols"] = sorted({endpoint.partition("/")[0] for endpoint in listen})
    flat["low_pass_filter"] = [_fitting(scenes)]
    tree = nested(flat)
    if register is not None:
        tree["access_control"] = access_rules(scenes, register)
    names = ", ".join(scene.scene for scene in scenes)
    return ROUTER_HEAD.format(scenes=f"scene{'s' * (len(scenes) > 1)} {names}") + json.dumps(tree, indent=1) + "\n"


def _fitting(scenes: Sequence["Scene"]) -> dict[str, Any]:
    """Zenoh's low pass filter: what is published in a scene has at most SIZE_LIMIT bytes (rule 8)."""
    keys = [key for scene in scenes for key in (f"{scene.keys.root}/**", scene.keys.picture())]
    return {"id": "fitting", "flows": ["ingress"], "messages": ["put"], "key_exprs": keys, "size_limit": SIZE_LIMIT}


def access_rules(scenes: Sequence["Scene"], register: Register) -> dict[str, Any]:
    """Zenoh's `access_control`: what each certificate in force allows; without any, no process may do anything."""
    rules: list[Rule] = []
    subjects: list[Rule] = []
    policies: list[Rule] = []
    for certificate in register.in_force():
        name = certificate.common_name
        own = [{"id": f"{name} {number}", **rule} for number, rule in enumerate(_rules(scenes, certificate), 1)]
        if own:
            rules += own
            subjects.append({"id": name, "cert_common_names": [name]})
            policies.append({"rules": [rule["id"] for rule in own], "subjects": [name]})
    # All three lists, also empty ones: Zenoh opens no session whose access control lacks one.
    return {"enabled": True, "default_permission": "deny", "rules": rules, "subjects": subjects, "policies": policies}


def _rules(scenes: Sequence["Scene"], certificate: IssuedCertificate) -> Iterator[Rule]:
    """The rules for one certificate. A router's needs none: the rules do not bind the router itself."""
    roles = certificate.roles
    for scene in scenes:
        keys, fusions = scene.keys, roles.fusions_in(scene.scene)
        for observer in roles.observers_in(scene.scene):
            if observer in scene.observers:
                yield from _observer(keys, observer, _tracks(scene, observer))
                yield from _shares(scene, observer)
        for fusion in fusions:
            yield from _fusion(keys, fusion)
        if fusions or roles.is_hub_in(scene.scene):
            yield from _reads(keys)
        if roles.is_hub_in(scene.scene):
            yield from _lives(keys.hub_alive("mqtt"))
        if roles.pictures and roles.is_hub_in(scene.scene):
            yield _rule("ingress", ["declare_subscriber"], [keys.picture()])
            yield _rule("egress", ["put"], [keys.picture()])
        if roles.teach and roles.is_hub_in(scene.scene):
            yield from _queries([keys.teach()])
        if not fusions and roles.is_hub_in(scene.scene):
            yield _rule("ingress", ["query"], [f"{keys.root}/**/handover"], "deny")


def _observer(keys: SceneKeys, observer: str, tracks: Sequence[str]) -> Iterator[Rule]:
    """It publishes below its own key, answers for its vocabulary, reads the fusion services' status and its tracks."""
    status = keys.observer_status(observer)
    yield _rule("ingress", ["put"], [keys.posterior(observer), keys.posture(observer), status, *tracks])
    yield from _answers(keys, [status, keys.vocabulary])
    yield from _lives(keys.observer_alive(observer))
    yield from _queries([keys.fusion_status()])
    yield _rule("ingress", ["declare_queryable", "reply"], [keys.teach(observer)])
    yield _rule("egress", ["query"], [keys.teach(observer)])
    if tracks:
        yield _rule("ingress", ["declare_subscriber"], tracks)
        yield _rule("egress", ["put", "declare_subscriber"], tracks)


def _shares(scene: "Scene", observer: str) -> Iterator[Rule]:
    """What the scene file switches on: it publishes its own live pictures, and reads who judges what, to keep clips."""
    keys, section = scene.keys, scene.observers[observer]
    if section.picture_hz:
        yield _rule("ingress", ["put"], [keys.picture(observer)])
        yield _rule("egress", ["declare_subscriber"], [keys.picture()])
    if section.clips.folder:
        judged = [keys.verdict, keys.fusion_status()]
        yield _rule("ingress", ["declare_subscriber"], judged)
        yield _rule("egress", ["put"], judged)


def _fusion(keys: SceneKeys, fusion: str) -> Iterator[Rule]:
    """It publishes judgements, verdicts, the vocabulary and its status, and answers for these and its handover."""
    status = keys.fusion_status(fusion)
    yield _rule("ingress", ["put"], [keys.judgement, keys.votes, keys.verdict, keys.fall, keys.vocabulary, status])
    yield from _answers(
        keys, [keys.judgement, keys.verdict, keys.fall, status, keys.vocabulary, keys.fusion_handover(fusion)]
    )
    yield from _lives(keys.fusion_alive(fusion))


def _answers(keys: SceneKeys, answered: Sequence[str]) -> Iterator[Rule]:
    yield _rule("ingress", ["declare_queryable", "reply"], answered)
    # Late joiners query all of the scene with a wildcard, which a narrower rule would not cover.
    yield _rule("egress", ["declare_subscriber", "query"], [_whole(keys)])


def _lives(token: str) -> Iterator[Rule]:
    yield _rule("ingress", ["liveliness_token"], [token])
    yield _rule("egress", ["declare_liveliness_subscriber", "liveliness_query"], [token.rpartition("/")[0] + "/**"])


def _queries(queried: Sequence[str]) -> Iterator[Rule]:
    yield _rule("ingress", ["query"], [*queried, ADMITTED])
    yield _rule("egress", ["reply", "declare_queryable"], [*queried, ADMITTED])


def _reads(keys: SceneKeys) -> Iterator[Rule]:
    whole = [_whole(keys)]
    yield from _queries(whole)
    yield _rule("ingress", ["declare_subscriber", "declare_liveliness_subscriber", "liveliness_query"], whole)
    yield _rule("egress", ["put", "liveliness_token"], whole)


def _whole(keys: SceneKeys) -> str:
    return f"{keys.root}/**"


def _tracks(scene: "Scene", observer: str) -> list[str]:
    """The key of its tracks, if they come over the mesh: its tracker publishes with the same certificate."""
    source = scene.observers[observer].source
    if source == PHONE:
        return [scene.keys.tracks(observer)]
    return [source.removeprefix(MESH_KEY)] if source.startswith(MESH_KEY) else []


def _rule(flow: Flow, messages: Sequence[str], keys: Sequence[str], permission: str = "allow") -> Rule:
    return {"flows": [flow], "messages": list(messages), "key_exprs": list(keys), "permission": permission}


def listening(endpoint: str) -> str:
    """Where a router listens that others meet at `endpoint`: there, or on every interface if it is a name.

    A machine's own name often stands for its loopback interface alone, where no other machine would find it.
    """
    parts = ROUTER_ENDPOINT.match(endpoint)
    if parts is None or _is_number(parts["host"]):
        return endpoint
    return f"{parts['protocol']}/0.0.0.0:{parts['port']}{parts['more'] or ''}"


def host_of(endpoint: str) -> str:
    """The host in `PROTOCOL/HOST:PORT`, without brackets; "" if there is none."""
    parts = ROUTER_ENDPOINT.match(endpoint)
    return parts["host"].strip("[]") if parts else ""


def _is_number(host: str) -> bool:
    try:
        return bool(ipaddress.ip_address(host.strip("[]")))
    except ValueError:
        return False
