"""The command `calibrate`: boards, known points or other programs' files become camera files."""

import re
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from common.errors import BadInput, LabanmeshError, reason_of
from common.text import plural

if TYPE_CHECKING:
    from observer.calibration.calibrate import BoardCalibration
    from observer.calibration.calibrated import CalibratedCamera
    from observer.calibration.detection import CameraDetections
    from observer.calibration.parameters import FittedLens

ALL_CAMERAS = "all.opencv.toml"
"""Written beside the camera files: all cameras with intrinsics and extrinsics, for OpenCV, Pose2Sim and --read."""


def calibrate(
    sources: Annotated[list[Path] | None, typer.Argument(help="One video, picture or folder per camera.")] = None,
    board: Annotated[str, typer.Option(help="chessboard:COLUMNSxROWS:METRES (inner corners), or a ChArUco file.")] = "",
    points: Annotated[
        list[Path] | None, typer.Option(help="CSV file x,y,z,u,v of known points; one per camera.")
    ] = None,
    read: Annotated[Path | None, typer.Option(help="Camera file of another program: .qca.txt or OpenCV .toml.")] = None,
    lens: Annotated[Path | None, typer.Option(help="Camera file whose lenses are used, matched by name.")] = None,
    output: Annotated[Path, typer.Option("-o", "--output", help="Output folder.")] = Path("cameras"),
    origin: Annotated[
        int | None, typer.Option(min=0, max=10**9, help="Picture whose board is the room's origin.")
    ] = None,
    lying: Annotated[bool, typer.Option("--lying", help="There the board lies on the floor; else it is held.")] = False,
    apart: Annotated[bool, typer.Option("--apart", help="The cameras' pictures were not taken together.")] = False,
    up: Annotated[str, typer.Option(help="The axis that points up in --points and --read: y or z.")] = "y",
    every: Annotated[int, typer.Option(min=1, max=10**6, help="Use every Nth picture of a video only.")] = 1,
) -> None:
    """Calibrate cameras from pictures of a board, from known points, or read them from another program's file.

    Example: labanmesh camera calibrate cam1.mp4 cam2.mp4 --board charuco.toml -o cameras

    Example: labanmesh camera calibrate --points cam1.csv --points cam2.csv -o cameras

    Example: labanmesh camera calibrate --read Calib.qca.txt --up z -o cameras
    """
    inputs = [bool(sources), bool(points), read is not None]
    if sum(inputs) != 1:
        raise BadInput("calibrate: one of pictures or videos with --board, --points FILE.csv, or --read FILE is needed")
    if up not in ("y", "z"):
        raise BadInput(f"--up {up!r}: known: y, z")
    lenses = {camera.name: camera for camera in _read(lens)} if lens else {}
    if sources:
        _from_sources(sources, board, lenses, output, origin, lying, apart, every)
        return
    cameras = _read(read) if read else [_from_points(file, lenses) for file in points or []]
    _write(output, [_with_y_up(camera) for camera in cameras] if up == "z" else cameras)


def _read(path: Path) -> list["CalibratedCamera"]:
    from observer.calibration.calibrated import read_opencv, read_qualisys

    if path.name.endswith(".qca.txt"):
        return read_qualisys(path)
    if path.suffix == ".toml":
        return read_opencv(path)
    raise BadInput(f"{path}: unknown kind; known: .qca.txt (Qualisys), .toml (OpenCV, Pose2Sim, caliscope, anipose)")


def _from_points(path: Path, lenses: dict[str, "CalibratedCamera"]) -> "CalibratedCamera":
    from observer.calibration.calibrate import from_points, placed_by_points, read_points

    points, pixels = read_points(path)
    if lenses:
        return placed_by_points(_lens_of(path.stem, lenses), points, pixels, path.name)
    camera, warnings = from_points(path.stem, points, pixels, path.name)
    for warning in warnings:
        typer.echo(f"{path}: {warning}", err=True)
    return camera


def _lens_of(name: str, lenses: dict[str, "CalibratedCamera"]) -> "CalibratedCamera":
    if name not in lenses:
        raise BadInput(f"--lens: has no camera {name!r}, only {', '.join(lenses)}; name the file as the camera")
    return lenses[name]


def _with_y_up(camera: "CalibratedCamera") -> "CalibratedCamera":
    """The same camera in a room with y up instead of z."""
    import numpy as np

    return camera.moved(np.array([[1.0, 0, 0], [0, 0, 1.0], [0, -1.0, 0]]), np.zeros(3))


def _from_sources(
    sources: Sequence[Path], board: str, lenses: dict[str, "CalibratedCamera"], output: Path,
    origin: int | None, lying: bool, apart: bool, every: int,
) -> None:  # fmt: skip
    from observer.calibration.board import is_video, pictures, read_board
    from observer.calibration.calibrate import from_boards
    from observer.calibration.detection import find_boards
    from observer.calibration.parameters import FittedLens, fit_lens

    if not board:
        raise BadInput("--board: missing; e.g. --board chessboard:4x7:0.06 or --board charuco.toml")
    plan, names = read_board(board), [source.stem for source in sources]
    _check_names(names)
    steps = [every if is_video(source) else 0 for source in sources]
    cameras = [find_boards(n, pictures(s, every), plan, k) for n, s, k in zip(names, sources, steps, strict=True)]
    known = {name: _lens_of(name, lenses) for name in names} if lenses else {}
    fitted = {camera.name: fit_lens(camera, plan) for camera in cameras if camera.name not in known}
    fitted |= {name: FittedLens(c.K, c.distortion, c.error_px or 0.0, {}) for name, c in known.items()}
    result = from_boards(cameras, fitted, plan, origin, lying, apart, adjust=fitted.keys() - known.keys())
    _print_errors(cameras, fitted, result)
    _write(output, list(result.cameras))
    for camera, source in zip(cameras, sources, strict=True):
        _write_annotated(output / f"{camera.name}.png", camera, source, every, result)


def _print_errors(
    cameras: Sequence["CameraDetections"], lenses: dict[str, "FittedLens"], result: "BoardCalibration"
) -> None:
    for camera in cameras:
        typer.echo(f"{camera.name}: board in {len(camera.boards)} of {plural(camera.picture_count, 'picture')}")
        for board in camera.boards:
            error = f"{result.errors_px[camera.name][board.number]:.2f} px"
            note = ", not used for the lens" if board.number in lenses[camera.name].left_out else ""
            typer.echo(f"  {board.label}: {len(board.ids)} corners, {error}{note}")
    if result.time_offset:
        typer.echo(f"time offset of pictures with the same number: {result.time_offset:.2f} frames; compensated")
    if result.back_m:
        typer.echo(f"offset of the pattern on the board's back: {result.back_m * 1000:.1f} mm; compensated")
    typer.echo(f"origin of the room: the board in picture {result.origin}")


def _write_annotated(
    path: Path, camera: "CameraDetections", source: Path, every: int, result: "BoardCalibration"
) -> None:
    """Write the camera's worst picture, which shows best what is wrong."""
    from observer.calibration.board import annotated, pictures
    from observer.camera.files import write_picture

    errors = result.errors_px[camera.name]
    worst = max(camera.boards, key=lambda board: errors[board.number])
    for number, label, picture in pictures(source, every):
        if number == worst.number:
            text = f"{camera.name}, {label}: {errors[number]:.2f} px (the worst)"
            write_picture(path, annotated(picture, worst.pixels, result.projected[camera.name][number], text))
            return


def _check_names(names: Sequence[str]) -> None:
    for name in names:
        if names.count(name) > 1:
            raise BadInput(f"{name}: {names.count(name)} cameras of this name; rename the files, they name the cameras")
        if not re.fullmatch(r"[\w][\w.-]*", name):
            raise BadInput(f"{name!r}: not a valid camera name; use letters, digits, _ . and -")


def _write(output: Path, cameras: Sequence["CalibratedCamera"]) -> None:
    from observer.calibration.calibrated import write_opencv
    from observer.geometry.camera_file import CameraModel, write_camera

    _check_names([camera.name for camera in cameras])
    try:
        output.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise LabanmeshError(f"cannot create {output}: {reason_of(error)}. Choose another folder with -o") from None
    typer.echo("camera            focal px      centre px     position (m)         error px")
    for c in cameras:
        file = CameraModel(c.name, c.matrix, c.image_size_px, c.error_px, c.provenance, c.lens)
        write_camera(output / f"{c.name}.toml", file)
        position = " ".join(f"{x:6.2f}" for x in c.position)
        error_px = "unknown" if c.error_px is None else f"{c.error_px:.2f}"
        lens = f"{c.K[0, 0]:6.0f} {c.K[1, 1]:6.0f} {c.K[0, 2]:6.0f} {c.K[1, 2]:6.0f}"
        typer.echo(f"{c.name:<16} {lens}  {position}   {error_px:>8}")
    write_opencv(output / ALL_CAMERAS, list(cameras))
    typer.echo(f"{output}: {plural(len(cameras), 'camera file')}, and all cameras in {ALL_CAMERAS}")
