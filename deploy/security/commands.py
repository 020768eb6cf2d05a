"""The verb `labanmesh secure` with its sub-verbs: an authority for scenes, and a certificate for each machine."""

import json as json_text
import shlex
import sys
from collections.abc import Sequence
from datetime import UTC, datetime
from pathlib import Path
from typing import Annotated

import typer

from common.certificate_authority import CERTIFICATE_DAYS
from common.command_options import sub_verbs
from common.config import Scene, scene_files
from common.errors import BadInput
from deploy.security.issuing import (
    REGISTER,
    SECURE_FOLDER,
    Authority,
    create_authority,
    open_authority,
    read_register,
    read_scenes,
)
from deploy.security.register import IssuedCertificate, Roles, as_rows, as_table
from deploy.security.requested_roles import qualified_observers, roles_of
from deploy.security.router_config import host_of, listening, router_config

SceneFiles = Annotated[
    list[Path], typer.Argument(metavar="SCENE", help="The scene file (TOML); or several, or a folder of them.")
]
Name = Annotated[str, typer.Argument(help="The machine: an observer's or fusion service's id, router, or any name.")]
To = Annotated[
    Path | None, typer.Option("--to", help="The authority's folder; by default secure/ beside the first scene file.")
]
Host = Annotated[
    list[str] | None, typer.Option("--host", help="A name or address by which others reach it (a router); repeatable.")
]
Days = Annotated[float, typer.Option(min=0.0, max=36_500, help="How long the certificate is valid.")]

secure = sub_verbs(
    """Certificates and access rules for named machines, from an authority of one scene or of several.

    Example: labanmesh secure init scene.toml

    Example: labanmesh secure add scene.toml router
    """
)


@secure.command()
def init(files: SceneFiles, to: To = None) -> None:
    """Create an authority for the scenes that meet at one router; its key stays in its folder.

    With an authority of some of the scenes it adds the others to it.

    Example: labanmesh secure init scene.toml

    Example: labanmesh secure init scenes/
    """
    scenes, folder = read_scenes(files), _folder(files, to)
    create_authority(folder, scenes, _now())
    names = ", ".join(scene.scene for scene in scenes)
    print(f"{folder}: the authority of {names}; keep a copy of this folder in a safe place")
    if not scenes[0].mesh.credentials:
        print(f'\nIn {_words(files)}, for every machine:\n[mesh]\nmode = "router"')
        print('endpoint = "tls/ADDRESS-OF-THE-ROUTER:7447"')
        print('credentials = "credentials"   # a folder beside the scene file, on each machine its own')
    print("\nThen for each machine:")
    for machine in _machines(scenes):
        print(f"  labanmesh secure add {_words(files)} {machine}")


@secure.command()
def add(
    files: SceneFiles,
    name: Name,
    observer: Annotated[
        list[str] | None, typer.Option(help="It runs this observer (ID, or SCENE/ID); repeatable.")
    ] = None,
    fusion: Annotated[
        list[str] | None,
        typer.Option(help="It runs this fusion service: ID for all the scenes, SCENE/ID for one; repeatable."),
    ] = None,
    hub: Annotated[bool, typer.Option("--hub", help="It listens: watch, capture, doctor.")] = False,
    hub_of: Annotated[list[str] | None, typer.Option(help="It listens to this scene alone; repeatable.")] = None,
    router: Annotated[bool, typer.Option("--router", help="It is the router.")] = False,
    pictures: Annotated[
        bool, typer.Option("--pictures", help="As a hub it also gets the observers' live pictures.")
    ] = False,
    teach: Annotated[bool, typer.Option("--teach", help="As a hub it may also teach the observers.")] = False,
    history: Annotated[bool, typer.Option("--history", help="As a hub it may also show what was kept.")] = False,
    host: Host = None,
    days: Days = CERTIFICATE_DAYS,
    to: To = None,
) -> None:
    """Issue a certificate for a machine, in a folder to copy there; its rights follow from its name or the options.

    Example: labanmesh secure add scene.toml attic --observer sofa --observer shelf --hub

    Example: labanmesh secure add scenes/ north --fusion north
    """
    authority = _open(files, to)
    requested = Roles(
        observers=tuple(observer or ()),
        fusions=tuple(fusion or ()),
        hub=hub,
        hub_of=tuple(hub_of or ()),
        router=router,
        pictures=pictures,
        teach=teach,
        history=history,
    )
    roles = roles_of(authority.scenes, name, requested)
    hosts = _hosts(authority.scenes[0], host or []) if roles.router else tuple(host or ())
    _print_next_step(authority, authority.add(name, roles, hosts, _now(), days))


@secure.command()
def renew(files: SceneFiles, name: Name, host: Host = None, days: Days = CERTIFICATE_DAYS, to: To = None) -> None:
    """Issue the next certificate for a machine; both count until the old one expires or is revoked.

    Example: labanmesh secure renew scene.toml sofa
    """
    authority = _open(files, to)
    register = authority.register
    hosts = _hosts(authority.scenes[0], host) if host and register.newest(name).roles.router else host or ()
    before = [certificate for certificate in register.of(name) if certificate.revoked is None]
    _print_next_step(authority, authority.renew(name, hosts, _now(), days))
    for old in before:
        print(f"when it is in place: labanmesh secure revoke {_words(files)} {old.common_name}")


@secure.command()
def revoke(
    files: SceneFiles,
    name: Annotated[str, typer.Argument(help="A machine, or one certificate of it: NAME.NUMBER.")],
    to: To = None,
) -> None:
    """Refuse a machine, or one of its certificates, from now on.

    Example: labanmesh secure revoke scene.toml sofa.1
    """
    authority = _open(files, to)
    print(f"revoked: {', '.join(authority.revoke(name, _now()))}")
    _print_router_step(authority)


@secure.command("list")
def list_(
    files: SceneFiles, json: Annotated[bool, typer.Option("--json", help="As JSON.")] = False, to: To = None
) -> None:
    """List all certificates with their roles, states and days left.

    Example: labanmesh secure list scene.toml --json
    """
    scenes = read_scenes(files)
    certificates = read_register(_folder(files, to) / REGISTER, scenes).certificates
    if not certificates and not json:
        print(f"no certificate yet; the first: labanmesh secure add {_words(files)} {_machines(scenes)[0]}")
        return
    print(json_text.dumps(as_rows(certificates, _now()), indent=1) if json else as_table(certificates, _now()))


@secure.command()
def rules(
    files: SceneFiles,
    credentials: Annotated[
        str, typer.Option(help="Where ca.pem, certificate.pem, key.pem lie on the router's machine, an absolute path.")
    ] = "",
    listen: Annotated[str, typer.Option(help="Where the router listens: tls/0.0.0.0:7447.")] = "",
    to: To = None,
) -> None:
    """Print the router's whole Zenoh configuration with the access rules, for a zenohd or a router elsewhere.

    Example: labanmesh secure rules scene.toml --credentials /etc/zenohd/credentials > router.json5
    """
    scenes = read_scenes(files)
    register, mesh = read_register(_folder(files, to) / REGISTER, scenes), scenes[0].mesh
    if not (credentials or mesh.credentials):
        raise BadInput(
            f"{_words(files)}: mesh.credentials is empty, and rules without certificates have no effect; "
            "--credentials FOLDER"
        )
    endpoint = listen or listening(mesh.endpoint)
    if not endpoint.startswith(("tls/", "quic/")):
        raise BadInput(
            f"{endpoint!r}: is not encrypted; --listen tls/0.0.0.0:7447, or mesh.endpoint in {_words(files)}"
        )
    sys.stdout.write(router_config(scenes, register, [endpoint], credentials))


def _open(files: Sequence[Path], to: Path | None) -> Authority:
    return open_authority(_folder(files, to), read_scenes(files))


def _folder(files: Sequence[Path], to: Path | None) -> Path:
    return to or next(scene_files(files)).parent / SECURE_FOLDER


def _words(files: Sequence[Path]) -> str:
    return shlex.join(map(str, files))


def _machines(scenes: Sequence[Scene]) -> list[str]:
    """One machine for each process: the words that follow `labanmesh secure add SCENE`."""
    services = dict.fromkeys(service for scene in scenes for service in scene.services)
    if len(scenes) == 1:
        return ["router", *services, *scenes[0].roster, "hub"]
    observers = [f"{each.replace('/', '-')} --observer {each}" for each in qualified_observers(scenes)]
    return ["router", *services, *observers, "hub"]


def _hosts(scene: Scene, options: Sequence[str]) -> tuple[str, ...]:
    """The names by which a router is reached: the scene file's, those of the options, and its own."""
    return tuple(dict.fromkeys(filter(None, [host_of(scene.mesh.endpoint), *options, "localhost", "127.0.0.1"])))


def _print_next_step(authority: Authority, certificate: IssuedCertificate) -> None:
    place, roles, expires = authority.folder / certificate.common_name, certificate.roles, certificate.expires
    reached = f", reached as {', '.join(certificate.hosts)}" if certificate.hosts else ""
    print(f"{place}: certificate {certificate.common_name} for {roles}{reached}, until {expires:%Y-%m-%d}")
    target = f"{certificate.name}:FOLDER/{Path(authority.scenes[0].mesh.credentials or 'credentials').name}"
    # With -r a folder that is there already would get the new one inside it, and the old files would stay in use.
    copy = f"scp -rp {place} {target}" if certificate.generation == 1 else f"scp -p {place}/* {target}/"
    print(f"copy it as a whole to the machine {certificate.name}, beside its scene file: {copy}")
    _print_router_step(authority)


def _print_router_step(authority: Authority) -> None:
    register = authority.folder / REGISTER
    print(f"a router on this machine takes it up within a second; for one elsewhere copy {register} there")


def _now() -> datetime:
    return datetime.now(UTC)
