"""The verb `labanmesh secure` with its sub-verbs: an authority for a scene, and a certificate for each machine."""

import json as json_text
import sys
from collections.abc import Sequence
from datetime import UTC, datetime
from pathlib import Path
from typing import Annotated

import typer

from common.config import Scene, read_scene
from common.errors import BadInput
from deploy.security.authority import CERTIFICATE_DAYS
from deploy.security.issuing import FOLDER, REGISTER, found, opened, read_register
from deploy.security.listing import as_rows, as_table
from deploy.security.register import Machine, Roles
from deploy.security.roles import roles_of
from deploy.security.router_config import host_of, listening, router_config

SceneFile = Annotated[Path, typer.Argument(help="The scene file (TOML).")]
Name = Annotated[str, typer.Argument(help="The machine: an observer's or fusion service's id, router, or any name.")]
To = Annotated[
    Path | None, typer.Option("--to", help="The authority's folder; without it secure/ beside the scene file.")
]
Host = Annotated[
    list[str] | None, typer.Option("--host", help="A name or address by which others reach it (a router); repeatable.")
]
Days = Annotated[float, typer.Option(min=0.0, help="How long the certificate is valid.")]

secure = typer.Typer(
    add_completion=False,
    pretty_exceptions_enable=False,
    no_args_is_help=False,
    help="""Certificates and access rules for named machines, from an authority of the scene's own.

    Example: labanmesh secure init scene.toml

    Example: labanmesh secure add scene.toml router
    """,
)
# What the front door shows of a verb is its docstring.
secure.__doc__ = secure.info.help


@secure.command()
def init(scene: SceneFile, to: To = None) -> None:
    """A new authority for the scene; its key stays in its folder.

    Example: labanmesh secure init scene.toml
    """
    named, folder = _scene_and_folder(scene, to)
    found(folder, named, _now())
    print(f"{folder}: a new authority for scene {named.scene}; keep a copy of this folder where nobody else gets at it")
    if not named.mesh.credentials:
        print(f'\nIn {scene}, for every machine:\n[mesh]\nmode = "router"\nendpoint = "tls/ADDRESS-OF-THE-ROUTER:7447"')
        print('credentials = "credentials"   # a folder beside the scene file, on each machine its own')
    machines = ["router", *named.services, *named.roster, "hub"]
    print("\nThen for each machine:", *(f"  labanmesh secure add {scene} {machine}" for machine in machines), sep="\n")


@secure.command()
def add(
    scene: SceneFile,
    name: Name,
    observer: Annotated[list[str] | None, typer.Option(help="It runs this observer; repeatable.")] = None,
    fusion: Annotated[list[str] | None, typer.Option(help="It runs this fusion service; repeatable.")] = None,
    hub: Annotated[bool, typer.Option("--hub", help="It listens: watch, capture, doctor.")] = False,
    router: Annotated[bool, typer.Option("--router", help="It is the router.")] = False,
    host: Host = None,
    days: Days = CERTIFICATE_DAYS,
    to: To = None,
) -> None:
    """A certificate for a machine, in a folder to be copied there; what it may do follows from its name or the options.

    Example: labanmesh secure add scene.toml attic --observer sofa --observer shelf --hub
    """
    named, folder = _scene_and_folder(scene, to)
    asked = Roles(observers=tuple(observer or ()), fusions=tuple(fusion or ()), hub=hub, router=router)
    roles = roles_of(named, name, asked)
    hosts = _hosts(named, host or []) if roles.router else tuple(host or ())
    place = opened(folder, named).add(named, name, roles, hosts, _now(), days)
    _tell(named, folder, place, name)


@secure.command()
def renew(scene: SceneFile, name: Name, host: Host = None, days: Days = CERTIFICATE_DAYS, to: To = None) -> None:
    """The next certificate for a machine that has one; both count until the old one expires or is revoked.

    Example: labanmesh secure renew scene.toml sofa
    """
    named, folder = _scene_and_folder(scene, to)
    authority = opened(folder, named)
    hosts = _hosts(named, host) if host and authority.register.newest(name).roles.router else host or ()
    before = [machine for machine in authority.register.of(name) if machine.revoked is None]
    place = authority.renew(named, name, hosts, _now(), days)
    _tell(named, folder, place, name)
    for old in before:
        print(f"when it is in place: labanmesh secure revoke {scene} {old.common_name}")


@secure.command()
def revoke(
    scene: SceneFile,
    name: Annotated[str, typer.Argument(help="A machine, or one certificate of it: NAME.NUMBER.")],
    to: To = None,
) -> None:
    """Refuse a machine, or one of its certificates, from now on.

    Example: labanmesh secure revoke scene.toml sofa.1
    """
    named, folder = _scene_and_folder(scene, to)
    gone = opened(folder, named).revoke(named, name, _now())
    print(f"revoked: {', '.join(gone)}")
    _tell_router(named, folder)


@secure.command("list")
def list_(
    scene: SceneFile,
    json: Annotated[bool, typer.Option("--json", help="As JSON.")] = False,
    to: To = None,
) -> None:
    """All certificates, what they are for, and for how many days yet.

    Example: labanmesh secure list scene.toml --json
    """
    named, folder = _scene_and_folder(scene, to)
    machines: Sequence[Machine] = read_register(folder / REGISTER, named).machines
    print(json_text.dumps(as_rows(machines, _now()), indent=1) if json else as_table(machines, _now()))


@secure.command()
def rules(
    scene: SceneFile,
    credentials: Annotated[
        str, typer.Option(help="Where ca.pem, certificate.pem, key.pem lie on the router's machine, an absolute path.")
    ] = "",
    listen: Annotated[str, typer.Option(help="Where the router listens: tls/0.0.0.0:7447.")] = "",
    to: To = None,
) -> None:
    """The router's whole Zenoh configuration with the access rules, for a zenohd or a router elsewhere.

    Example: labanmesh secure rules scene.toml --credentials /etc/zenohd/credentials > router.json5
    """
    named, folder = _scene_and_folder(scene, to)
    register = read_register(folder / REGISTER, named)
    if not (credentials or named.mesh.credentials):
        raise BadInput(
            f"{scene}: mesh.credentials is empty: rules without certificates bind nobody; --credentials FOLDER"
        )
    endpoint = listen or listening(named.mesh.endpoint)
    if not endpoint.startswith(("tls/", "quic/")):
        raise BadInput(f"{endpoint!r}: is not encrypted; --listen tls/0.0.0.0:7447, or mesh.endpoint in {scene}")
    sys.stdout.write(router_config(named, register, [endpoint], credentials))


def _scene_and_folder(scene: Path, to: Path | None) -> tuple[Scene, Path]:
    return read_scene(scene), to or scene.parent / FOLDER


def _hosts(scene: Scene, asked: Sequence[str]) -> tuple[str, ...]:
    """By which names a router is reached: what the scene file says, what was asked, and by itself."""
    return tuple(dict.fromkeys(filter(None, [host_of(scene.mesh.endpoint), *asked, "localhost", "127.0.0.1"])))


def _tell(scene: Scene, folder: Path, place: Path, name: str) -> None:
    machine = read_register(folder / REGISTER, scene).newest(name)
    reached = f", reached as {', '.join(machine.hosts)}" if machine.hosts else ""
    print(f"{place}: certificate {machine.common_name} for {machine.roles}{reached}, until {machine.expires:%Y-%m-%d}")
    where = Path(scene.mesh.credentials or "credentials").name
    print(f"copy it as a whole to the machine {name}, beside its scene file: scp -rp {place} {name}:FOLDER/{where}")
    _tell_router(scene, folder)


def _tell_router(scene: Scene, folder: Path) -> None:
    print(f"a router on this machine takes it up within a second; for one elsewhere copy {folder / REGISTER} there")


def _now() -> datetime:
    return datetime.now(UTC)
