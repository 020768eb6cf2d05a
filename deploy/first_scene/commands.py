"""The verb `labanmesh init`: a scene file for this machine's cameras, what they see, and the first lesson."""

import json
import os
import re
import shlex
import subprocess
import sys
from collections.abc import Sequence
from contextlib import suppress
from pathlib import Path
from typing import Annotated

import typer

from common.config import Scene
from common.errors import BadInput, LabanmeshError, reason_of
from common.text import without_secrets
from common.tracker_choice import PHONE, is_recording
from deploy.doctor.cameras import Webcam, webcams
from deploy.first_scene.scene_text import SCHEMA_FILE, FirstCamera, scene_text

DEFAULT_NAME = "home"
EXAMPLE_LABELS = "wave point clap"
WITHOUT_WEBCAM = 'its source may also be a film ("film.mp4") or "phone": docs/guide/cameras.md'
REHEARSAL = (
    "without a camera: labanmesh teach --rehearse shows a whole lesson in three minutes, acted by a synthetic performer"
)
SEE_IT = "See it now? [Y/n] "
QUESTION = f"Teach them movements now? Name them, for example: {EXAMPLE_LABELS}. Enter: later\n> "


def init(
    file: Annotated[Path, typer.Argument(help="The scene file to write; it must not exist yet.")] = Path("scene.toml"),
    source: Annotated[
        list[str] | None,
        typer.Option(help="A camera in place of the webcams: an address, a film, ...; may be repeated."),
    ] = None,
    look: Annotated[bool, typer.Option("--look/--no-look", help="In a terminal show what each camera sees.")] = True,
) -> None:
    """Write a commented scene file for the cameras of this machine, to be read and changed. Overwrites nothing.

    In a terminal it shows each camera's picture with what the tracker finds in it, and offers to teach them movements.

    Example: labanmesh init livingroom.toml

    Example: labanmesh init scene.toml --source rtsp://10.0.0.7/stream --source 0
    """
    if not file.name.isprintable():
        raise BadInput(f"{str(file)!r}: this name cannot be printed; choose another")
    _require_new(file)
    cameras = [_named(text, file) for text in source or []] or _found()
    # An address may hold a password: the file is then for this user alone.
    private = any("://" in camera.source for camera in cameras)
    _write(file, scene_text(cameras, shlex.quote(file.name), _scene_name(file)), 0o600 if private else 0o666)
    _write_schema(file.with_name(SCHEMA_FILE))
    asks = sys.stdin.isatty() and sys.stdout.isatty()
    if asks and look:
        _show(cameras, file)
    name = shlex.quote(str(file))
    typer.echo(f"wrote {file}; read it, then: labanmesh doctor {name}")
    if cameras:
        if any(camera.phone for camera in cameras):
            typer.echo(f"show the code that makes a phone the camera: labanmesh phone {name}")
        typer.echo(f"and teach them your movements: labanmesh teach {name} {EXAMPLE_LABELS} --up")
    else:
        typer.echo(REHEARSAL)
    if asks and cameras:
        _offer_lesson(file)
    elif asks:
        with suppress(EOFError):
            if input(SEE_IT).strip().lower() in ("", "y", "yes"):
                _labanmesh(file, "teach", "--rehearse")


def _found() -> list[FirstCamera]:
    present = [webcam for webcam in webcams() if webcam.access != "absent"]
    for webcam in present:
        typer.echo(f"{webcam.place}: {webcam.name or 'a webcam'}")
    if not present:
        typer.echo(f"no webcam found: the file has an example; {WITHOUT_WEBCAM}")
    return [first_camera(webcam) for webcam in present]


def first_camera(webcam: Webcam) -> FirstCamera:
    """A webcam that was found, with its maker's name on one line."""
    name = "".join(filter(str.isprintable, webcam.name)) or "a webcam"
    return FirstCamera(webcam.place.removeprefix("/dev/video"), f"# {name}, {webcam.place}")


def _named(source: str, file: Path) -> FirstCamera:
    """A camera of --source; a file's path is written as seen from the scene file."""
    if not source.strip() or not source.isprintable():
        raise BadInput(f"--source {source!r}: an address, the number of a webcam, or a film is expected")
    path = Path(source)
    if path.exists() and not str(path).startswith("/dev/"):
        return FirstCamera(os.path.relpath(path, file.parent), "# A recording.", film=True)
    if is_recording(source):
        raise BadInput(
            f"--source {without_secrets(source)}: no such file or folder; "
            "name a webcam (0), an address (rtsp://...), a film or phone"
        )
    return FirstCamera(source, "# As named with --source.", phone=source == PHONE)


def _require_new(file: Path) -> None:
    if file.exists():
        raise BadInput(f"{file}: exists already and is not overwritten; name another file")
    if not os.access(file.parent, os.W_OK):
        reason = "permission denied" if file.parent.is_dir() else "no such file or directory"
        raise LabanmeshError(f"cannot write {file}: {reason}. Name another file")


def _write(file: Path, text: str, mode: int) -> None:
    """Write a new file. mode: its permissions, less the process's umask."""
    try:
        with open(file, "x", encoding="utf-8", opener=lambda name, flags: os.open(name, flags, mode)) as new:
            new.write(text)
    except FileExistsError:
        raise BadInput(f"{file}: exists already and is not overwritten; name another file") from None
    except OSError as error:
        raise LabanmeshError(f"cannot write {file}: {reason_of(error)}. Name another file") from None


def _write_schema(file: Path) -> None:
    """The JSON Schema of scene files, by which editors complete and check keys; that of another version is replaced."""
    text = json.dumps(Scene.model_json_schema(), indent=1) + "\n"
    # It helps to write the scene file and nothing needs it.
    with suppress(OSError):
        file.write_text(text, encoding="utf-8")


def _show(cameras: Sequence[FirstCamera], file: Path) -> None:
    for number, camera in enumerate(cameras, 1):
        typer.echo(f"\ncam{number}:")
        picture = file.with_name(f"cam{number}.png").absolute()
        _labanmesh(file, "camera", "look", camera.source, "--show", "-o", str(picture))
    typer.echo("")


def _offer_lesson(file: Path) -> None:
    try:
        labels = input(QUESTION).split()
    except EOFError:
        return
    if labels and _labanmesh(file, "teach", str(file.absolute()), *labels, "--up"):
        raise LabanmeshError(
            f"the lesson has ended early; it goes on with: labanmesh teach {file} {' '.join(labels)} --up"
        )


def _labanmesh(file: Path, *words: str) -> int:
    """Run another verb here, in the folder of the scene file; its exit status."""
    command = [sys.executable, "-P", "-m", "labanmesh", *words]
    return subprocess.run(command, cwd=file.absolute().parent, check=False).returncode  # noqa: S603 - it is ours


def _scene_name(file: Path) -> str:
    """The file's name, where that is a legal id and not the default of the command."""
    name = re.sub(r"[^a-z0-9_-]+", "-", file.stem.lower()).strip("-")[:64]
    return name if name and name != "scene" else DEFAULT_NAME
