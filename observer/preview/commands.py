"""The command `look`: what a tracker finds in a source, as one picture and a few lines."""

import os
import shutil
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from common.errors import BadInput, LabanmeshError
from common.text import without_secrets

if TYPE_CHECKING:
    from common.config import ObserverConfig
    from common.tracker_choice import TrackerChoice
    from observer.camera.base import Report
    from observer.geometry.views import View
    from observer.preview.looking import LookReport
    from observer.preview.small_picture import Sighting
    from observer.tracking.tracker_kind import TrackerKind
    from observer.tracks import FrameSource, Picture, Tracker

LOOK_SIDE_PX, SHOWN_PX = 1280, 320
"""Longer side of the picture that is written, at most, and of the one in the terminal."""
WIDEST, LINES_BESIDE = 100, 8
"""Characters of a picture in the terminal, and lines that it leaves free."""
UPPER_HALF = "▀"
"""Its foreground is the upper pixel, its background the lower one."""
RESET = "\x1b[0m"
CUBE_LEVELS = 6
"""Of each colour in the cube of terminals with 256 colours, which begins at CUBE."""
CUBE = 16
SUFFIXES = (".png", ".jpg", ".jpeg")


def look(
    source: Annotated[str, typer.Argument(help="Webcam (0), address, video, folder of pictures, or motion archive.")],
    tracker: Annotated[str, typer.Option(help="auto, mediapipe or camshift.")] = "auto",
    output: Annotated[Path, typer.Option("-o", "--output", help="The picture to write.")] = Path("look.png"),
    frames: Annotated[int, typer.Option(min=1, max=10**9, help="Pictures to track; the newest is written.")] = 30,
    pose_model: Annotated[str, typer.Option(help="The model file of mediapipe (.task).")] = "",
    skin: Annotated[str, typer.Option(help="A histogram saved by --save-skin.")] = "",
    face: Annotated[str, typer.Option(help="X,Y,WIDTH,HEIGHT of the face in the first picture, px.")] = "",
    save_skin: Annotated[Path | None, typer.Option(help="Save the skin colour, for other cameras (.npz).")] = None,
    view: Annotated[str, typer.Option(help="Where the camera stands: door, yaw:DEG, a camera file, ...")] = "door",
    recording: Annotated[int, typer.Option(min=0, max=10**9, help="Which recording of a motion archive.")] = 0,
    show: Annotated[bool, typer.Option("--show", help="Also show the picture in the terminal.")] = False,
) -> None:  # fmt: skip
    """Check a source: write a picture with everything that the tracker finds, and print how to improve it.

    Example: labanmesh camera look 0

    Example: labanmesh camera look rtsp://10.0.0.7/stream --tracker mediapipe -o corner.png

    Example: labanmesh camera look motion.npz --view yaw:45 --save-skin skin.npz
    """
    from common.config import ObserverConfig
    from observer.camera.base import kind_of
    from observer.camera.files import write_picture
    from observer.geometry.views import parse_view, size_advice
    from observer.preview.looking import look_at
    from observer.preview.small_picture import small_picture

    _require_outputs(output, save_skin)
    section = ObserverConfig(
        source=source, view=view, tracker=tracker, pose_model=pose_model, skin=skin, face=_box(face)
    )
    reasons: list[str] = []
    opened, built, choice = _opened(
        section, recording, lambda _, reason: reasons.append(reason), saves_skin=save_skin is not None
    )
    name = Path(source).name if kind_of(source) == "path" else without_secrets(source)
    report, sighting = look_at(opened, built, frames, name, choice, reasons)
    write_picture(output, small_picture(sighting, LOOK_SIDE_PX))
    if show:
        _show(sighting)
    _print(replace(report, size_note=size_advice(parse_view(view), report.size_px)), output)
    if save_skin is not None:
        _save_skin(built, save_skin)


def _opened(
    section: "ObserverConfig", recording: int, report: "Report", *, saves_skin: bool
) -> "tuple[FrameSource, Tracker, TrackerChoice]":
    """Source, tracker, and the choice of the tracker as it came out.

    Wrong options are reported before a camera is opened, and before mediapipe is loaded for a camera that is absent.
    """
    from observer.geometry.views import parse_view
    from observer.tracking.registry import built_tracker
    from observer.tracking.tracker_kind import TrackerSettings
    from observer.tracks import BODY_PARTS

    view = parse_view(section.view)
    choice, kind = _choice(section, saves_skin)
    source = _source(section.source, view, recording, report)
    # From behind, camshift takes the hand on the right of the picture for the right one.
    return source, *built_tracker(choice, kind, TrackerSettings(view, (), BODY_PARTS, section, Path))


def _show(sighting: "Sighting") -> None:
    """The picture with the skeleton, as large as fits into the terminal with room for the lines."""
    from observer.preview.small_picture import small_picture

    size = shutil.get_terminal_size()
    exact = os.environ.get("COLORTERM", "") in ("truecolor", "24bit")
    lines = picture_lines(
        small_picture(sighting, SHOWN_PX), min(size.columns, WIDEST), max(size.lines - LINES_BESIDE, 8), exact=exact
    )
    for line in lines:
        typer.echo(line, color=True)


def picture_lines(picture: "Picture", columns: int, lines: int, *, exact: bool = True) -> list[str]:
    """(H, W, 3) uint8 BGR -> at most `lines` lines of at most `columns` characters, in the picture's shape.

    exact: in 16 million colours; else in 216, which more terminals know.
    """
    import cv2
    import numpy as np

    height, width = picture.shape[:2]
    scale = min(columns / width, 2 * lines / height)
    size = max(round(width * scale), 1), max(2 * round(height * scale / 2), 2)
    small = np.asarray(cv2.resize(picture, size, interpolation=cv2.INTER_AREA))[:, :, ::-1]
    return [
        "".join(_cell(upper, lower, exact) for upper, lower in zip(small[row], small[row + 1], strict=True)) + RESET
        for row in range(0, len(small), 2)
    ]


def _cell(upper: "Picture", lower: "Picture", exact: bool) -> str:
    return f"\x1b[38;{_colour(upper, exact)};48;{_colour(lower, exact)}m{UPPER_HALF}"


def _colour(rgb: "Picture", exact: bool) -> str:
    red, green, blue = (int(value) for value in rgb)
    if exact:
        return f"2;{red};{green};{blue}"
    red, green, blue = (round(value / 255 * (CUBE_LEVELS - 1)) for value in (red, green, blue))
    return f"5;{CUBE + CUBE_LEVELS * CUBE_LEVELS * red + CUBE_LEVELS * green + blue}"


def _print(report: "LookReport", output: Path) -> None:
    from observer.preview.looking import advice, report_lines

    for line in report_lines(report):
        typer.echo(line)
    typer.echo(f"{output}: the newest picture, with the tracks of {report.tracker}")
    for line in advice(report):
        typer.echo(f"-> {line}")


def _source(text: str, view: "View", recording: int, report: "Report") -> "FrameSource":
    if not text.endswith(".npz"):
        from observer.camera.capture import require_device
        from observer.camera.opening import open_pictures

        # `observe` waits for a webcam that is plugged in later; a check of the camera does not.
        require_device(text)
        return open_pictures(text, Path(), report=report, speed=0.0)
    from observer.motion.archive_file import read_archive
    from observer.motion.playback import RecordedMotion
    from observer.rendering.virtual_camera import VirtualCamera

    archive = read_archive(Path(text))
    if archive.camera is not None:
        raise BadInput(
            f"{text}: holds 2-D tracks, which no tracker can film; name a camera, a film or positions in 3-D"
        )
    if recording >= len(archive.recordings):
        raise BadInput(f"--recording {recording}: {text} has recordings 0 to {len(archive.recordings) - 1}")
    chosen = archive.recordings[recording : recording + 1]
    return VirtualCamera(RecordedMotion(archive.body_parts, chosen, speed=0.0), view)


def _choice(section: "ObserverConfig", saves_skin: bool) -> "tuple[TrackerChoice, TrackerKind]":
    """Which tracker, and why if that was left open; saves_skin: only camshift learns skin. Raises BadInput."""
    from common.tracker_choice import AUTO, TrackerChoice, chosen_tracker, content_of
    from observer.tracking.registry import tracker_named

    if content_of(section.source) == "tracks":
        raise BadInput(f"{section.source}: sends tracks and no pictures; labanmesh watch SCENE shows what it sees")
    choice = chosen_tracker(section)
    if section.tracker == AUTO and content_of(section.source) == "positions":
        choice = TrackerChoice("camshift", "pose models do not find drawn people")
    elif section.tracker == AUTO and saves_skin:
        choice = TrackerChoice("camshift", "--save-skin is set")
    return choice, tracker_named(choice.name, "--tracker", "pictures")


def _box(text: str) -> tuple[int, int, int, int] | None:
    if not text:
        return None
    numbers = [int(piece) for piece in text.split(",") if piece.strip().isdecimal()]
    if len(numbers) != 4 or text.count(",") != 3 or not (numbers[2] and numbers[3]):
        raise BadInput(f"--face {text!r}: X,Y,WIDTH,HEIGHT in px is expected, e.g. --face 140,50,40,40")
    return numbers[0], numbers[1], numbers[2], numbers[3]


def _require_outputs(output: Path, save_skin: Path | None) -> None:
    """Check the output paths before the expensive work."""
    if output.suffix.lower() not in SUFFIXES:
        raise BadInput(f"--output {output}: a name that ends in {', '.join(SUFFIXES)} is expected")
    for path in filter(None, (output, save_skin)):
        if not path.parent.is_dir() or path.is_dir():
            reason = "it is a folder" if path.is_dir() else "its folder does not exist"
            raise BadInput(f"cannot write {path}: {reason}. Name a file in an existing folder")


def _save_skin(tracker: "Tracker", path: Path) -> None:
    skin = getattr(tracker, "skin", None)
    if skin is None:
        raise LabanmeshError(
            f"{path}: not written: no skin was learned; let camshift see a face longer (--frames), or mark it (--face)"
        )
    skin.save(path)
    typer.echo(f'{path}: the skin colour; set skin = "{path}" in the scene file for cameras that see no face')
