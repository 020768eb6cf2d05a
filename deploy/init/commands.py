"""The verb `labanmesh init`: a commented scene file for the cameras that are found here."""

import re
import shlex
from pathlib import Path
from typing import Annotated

import typer

from common.errors import BadInput
from deploy.doctor.look_cameras import webcams
from deploy.init.scene_text import scene_text

NAME = "home"


def init(
    file: Annotated[Path, typer.Argument(help="The scene file to write; it must not be there yet.")] = Path(
        "scene.toml"
    ),
) -> None:
    """A commented scene file for the cameras of this machine, to be read and changed. Overwrites nothing.

    Example: labanmesh init livingroom.toml
    """
    if not file.name.isprintable():
        raise BadInput(f"{str(file)!r}: a name that cannot be printed; choose another")
    found = [webcam for webcam in webcams() if webcam.access != "absent"]
    text = scene_text(found, shlex.quote(file.name), _scene_name(file))
    try:
        with file.open("x", encoding="utf-8") as new:
            new.write(text)
    except FileExistsError:
        raise BadInput(f"{file}: is there already, and is not overwritten; name another file") from None
    except OSError as error:
        raise BadInput(f"{file}: cannot be written: {(error.strerror or str(error)).lower()}; name another") from None
    for webcam in found:
        typer.echo(f"{webcam.place}: {webcam.name or 'a webcam'}")
    if not found:
        typer.echo("no webcam found: the file has an example instead, change its source")
    typer.echo(f"{file}: written; read it, then: labanmesh doctor {shlex.quote(str(file))}")


def _scene_name(file: Path) -> str:
    """The scene is called as its file, where that is a legal name and says something."""
    name = re.sub(r"[^a-z0-9_-]+", "-", file.stem.lower()).strip("-")[:64]
    return name if name and name != "scene" else NAME
