"""The router's access rules, from the scene and who holds which certificate. Pure; what Zenoh reads is a dict.

1. Default deny. A rule names the exact common names of the certificates it is for: Zenoh knows no patterns there.
2. `ingress` is what a machine may say to the router, `egress` what the router may pass on to it.
3. A machine that publishes must be told of who subscribes, or Zenoh suppresses its puts at their source: hence egress
   `declare_subscriber` on all of the scene, which covers every subscriber's key.
4. Who asks needs `query` in and `reply` out; who answers the reverse, and `declare_queryable` in.
5. Every admitted machine may ask the router for `ADMITTED`: the answer shows that its certificate counts.
"""

from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING, Any, Literal

from common.zenoh_settings import ADMITTED
from deploy.security.register import Register, Roles

if TYPE_CHECKING:
    from common.config import Scene

Flow = Literal["ingress", "egress"]
Rule = dict[str, Any]

TRACKS = "zenoh:"
"""How a source in the scene file says that its tracks come over the mesh, on the key that follows."""


def access_rules(scene: "Scene", register: Register) -> dict[str, Any]:
    """Zenoh's `access_control`: what each certificate in force may do; without any, nobody may do anything."""
    rules: list[Rule] = []
    subjects: list[Rule] = []
    policies: list[Rule] = []
    for machine in register.in_force():
        own = list(machine_rules(scene, machine.common_name, machine.roles))
        if own:
            rules += own
            subjects.append({"id": machine.common_name, "cert_common_names": [machine.common_name]})
            policies.append({"rules": [rule["id"] for rule in own], "subjects": [machine.common_name]})
    # All three lists, also empty ones: Zenoh opens no session whose access control lacks one.
    return {"enabled": True, "default_permission": "deny", "rules": rules, "subjects": subjects, "policies": policies}


def machine_rules(scene: "Scene", common_name: str, roles: Roles) -> Iterator[Rule]:
    """The rules for one certificate; ids are unique by its common name. A router alone needs none: it is the judge."""
    for observer in roles.observers:
        if observer in scene.observers:
            yield from _numbered(f"{common_name} observer {observer}", _observer(scene, observer))
    for fusion in roles.fusions:
        yield from _numbered(f"{common_name} fusion {fusion}", _fusion(scene, fusion))
    if roles.hub:
        yield from _numbered(f"{common_name} hub", _reads(scene))


def _observer(scene: "Scene", observer: str) -> Iterator[Rule]:
    """It says below its own key alone, tells its vocabulary, and reads the referees' status and its own tracks."""
    keys = scene.keys
    status, alive = keys.observer_status(observer), keys.observer_alive(observer)
    tracks = _tracks(scene, observer)
    yield from _says([keys.posterior(observer), status, *tracks])
    yield from _answers(scene, [status, keys.vocabulary])
    yield from _lives(alive)
    yield from _asks([keys.fusion_status()])
    if tracks:
        yield _rule("ingress", ["declare_subscriber"], tracks)
        yield _rule("egress", ["put"], tracks)
        yield _rule("egress", ["declare_subscriber"], tracks)


def _fusion(scene: "Scene", fusion: str) -> Iterator[Rule]:
    """It judges, tells how it is and the vocabulary, and reads all of the scene."""
    keys = scene.keys
    status, alive = keys.fusion_status(fusion), keys.fusion_alive(fusion)
    yield from _says([keys.judgement, keys.verdict, status])
    yield from _answers(scene, [keys.judgement, keys.verdict, status, keys.vocabulary, keys.fusion_handover(fusion)])
    yield from _lives(alive)
    yield from _reads(scene)


def _says(spoken: Sequence[str]) -> Iterator[Rule]:
    yield _rule("ingress", ["put"], spoken)


def _answers(scene: "Scene", answered: Sequence[str]) -> Iterator[Rule]:
    yield _rule("ingress", ["declare_queryable", "reply"], answered)
    # Whoever asks for all of the scene asks with a wildcard, which a narrower rule would not cover.
    yield _rule("egress", ["declare_subscriber", "query"], _whole(scene))


def _lives(token: str) -> Iterator[Rule]:
    yield _rule("ingress", ["liveliness_token"], [token])
    yield _rule("egress", ["declare_liveliness_subscriber", "liveliness_query"], [token.rpartition("/")[0] + "/**"])


def _asks(asked: Sequence[str]) -> Iterator[Rule]:
    yield _rule("ingress", ["query"], [*asked, ADMITTED])
    yield _rule("egress", ["reply", "declare_queryable"], [*asked, ADMITTED])


def _reads(scene: "Scene") -> Iterator[Rule]:
    whole = _whole(scene)
    yield from _asks(whole)
    yield _rule("ingress", ["declare_subscriber", "declare_liveliness_subscriber", "liveliness_query"], whole)
    yield _rule("egress", ["put", "liveliness_token"], whole)


def _whole(scene: "Scene") -> list[str]:
    return [f"{scene.keys.root}/**"]


def _tracks(scene: "Scene", observer: str) -> list[str]:
    """The key of its tracks, if they come over the mesh: its tracker speaks with the same certificate."""
    source = scene.observers[observer].source
    return [source.removeprefix(TRACKS)] if source.startswith(TRACKS) else []


def _rule(flow: Flow, messages: Sequence[str], keys: Sequence[str]) -> Rule:
    return {"flows": [flow], "messages": list(messages), "key_exprs": list(keys), "permission": "allow"}


def _numbered(what: str, rules: Iterator[Rule]) -> Iterator[Rule]:
    return ({"id": f"{what} {number}", **rule} for number, rule in enumerate(rules, 1))
