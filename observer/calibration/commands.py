"""The verb `calibrate`: boards, known points or files of others become camera files."""

import re
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from common.errors import BadInput, LabanmeshError

if TYPE_CHECKING:
    from observer.calibration.calibrate import BoardResult
    from observer.calibration.calibrated import CalibratedCamera
    from observer.calibration.detection import CameraDetections
    from observer.calibration.intrinsics import FittedLens

ALL = "all.opencv.toml"
"""Beside the camera files: all cameras with lens and place apart, as OpenCV, Pose2Sim and --read have them."""


def calibrate(
    sources: Annotated[list[Path] | None, typer.Argument(help="Per camera a video, picture or folder.")] = None,
    board: Annotated[str, typer.Option(help="chessboard:COLUMNSxROWS:METRES (inner corners), or a ChArUco file.")] = "",
    points: Annotated[list[Path] | None, typer.Option(help="x,y,z,u,v of known points (CSV); one per camera.")] = None,
    read: Annotated[Path | None, typer.Option(help="Cameras of others: .qca.txt or OpenCV-style .toml.")] = None,
    lens: Annotated[Path | None, typer.Option(help="Cameras of others, by name, for their lenses alone.")] = None,
    output: Annotated[Path, typer.Option("-o", "--output", help="The folder for what is written.")] = Path("cameras"),
    origin: Annotated[int | None, typer.Option(min=0, help="The picture whose board is the room's origin.")] = None,
    lying: Annotated[bool, typer.Option("--lying", help="In it the board lies on the floor; else it is held.")] = False,
    apart: Annotated[bool, typer.Option("--apart", help="The cameras' pictures were not taken together.")] = False,
    up: Annotated[str, typer.Option(help="The axis that points up in --points and --read: y or z.")] = "y",
    every: Annotated[int, typer.Option(min=1, help="Look at each so many-th picture only.")] = 1,
) -> None:
    """Where cameras stand and what their lenses do, from a board, from known points, or read from a file of others.

    Example: labanmesh calibrate cam1.mp4 cam2.mp4 --board charuco.toml -o cameras

    Example: labanmesh calibrate --points cam1.csv --points cam2.csv -o cameras

    Example: labanmesh calibrate --read Calib.qca.txt --up z -o cameras
    """
    ways = [bool(sources), bool(points), read is not None]
    if sum(ways) != 1:
        raise BadInput("calibrate: one of pictures or videos with --board, --points FILE.csv, or --read FILE is needed")
    if up not in ("y", "z"):
        raise BadInput(f"--up {up!r}: known: y, z")
    lenses = {camera.name: camera for camera in _read(lens)} if lens else {}
    if sources:
        _from_sources(sources, board, lenses, output, origin, lying, apart, every)
        return
    found = _read(read) if read else [_from_file(file, lenses) for file in points or []]
    _write(output, [_upright(camera) for camera in found] if up == "z" else found)


def _read(path: Path) -> list["CalibratedCamera"]:
    from observer.calibration.formats import read_opencv, read_qualisys

    if path.name.endswith(".qca.txt"):
        return read_qualisys(path)
    if path.suffix == ".toml":
        return read_opencv(path)
    raise BadInput(f"{path}: unknown kind; known: .qca.txt (Qualisys), .toml (OpenCV, Pose2Sim, caliscope, anipose)")


def _from_file(path: Path, lenses: dict[str, "CalibratedCamera"]) -> "CalibratedCamera":
    from observer.calibration.calibrate import from_points, placed_by_points, read_points

    places, pixels = read_points(path)
    if lenses:
        return placed_by_points(_of(lenses, path.stem), places, pixels, path.name)
    camera, warnings = from_points(path.stem, places, pixels, path.name)
    for warning in warnings:
        typer.echo(f"{path}: {warning}", err=True)
    return camera


def _of(lenses: dict[str, "CalibratedCamera"], name: str) -> "CalibratedCamera":
    if name not in lenses:
        raise BadInput(f"--lens: no camera {name!r} in it; it has {', '.join(lenses)}; name the file as the camera")
    return lenses[name]


def _upright(camera: "CalibratedCamera") -> "CalibratedCamera":
    """The same camera in a room whose y is up, where z was."""
    import numpy as np

    return camera.moved(np.array([[1.0, 0, 0], [0, 0, 1.0], [0, -1.0, 0]]), np.zeros(3))


def _from_sources(
    sources: Sequence[Path], board: str, lenses: dict[str, "CalibratedCamera"], output: Path,
    origin: int | None, lying: bool, apart: bool, every: int,
) -> None:  # fmt: skip
    from observer.calibration.board import read_board
    from observer.calibration.calibrate import from_boards
    from observer.calibration.detection import find_boards
    from observer.calibration.intrinsics import FittedLens, fit_lens
    from observer.calibration.pictures import is_video, pictures

    if not board:
        raise BadInput("--board: missing; e.g. --board chessboard:4x7:0.06 or --board charuco.toml")
    plan, names = read_board(board), [source.stem for source in sources]
    _check_names(names)
    steps = [every if is_video(source) else 0 for source in sources]
    seen = [find_boards(n, pictures(s, every), plan, k) for n, s, k in zip(names, sources, steps, strict=True)]
    known = {n: _of(lenses, n) for n in names} if lenses else {}
    fitted = {s.name: fit_lens(s, plan) for s in seen if s.name not in known}
    fitted |= {name: FittedLens(c.K, c.distortion, c.error_px or 0.0, {}) for name, c in known.items()}
    result = from_boards(seen, fitted, plan, origin, lying, apart, adjust=fitted.keys() - known.keys())
    _tell(seen, fitted, result)
    _write(output, list(result.cameras))
    for s, source in zip(seen, sources, strict=True):
        _annotate(output / f"{s.name}.png", s, pictures(source, every), result)


def _tell(seen: Sequence["CameraDetections"], lenses: dict[str, "FittedLens"], result: "BoardResult") -> None:
    for s in seen:
        typer.echo(f"{s.name}: board in {len(s.seen)} of {s.looked_at} pictures")
        for shot in s.seen:
            note = ", left out for the lens" if shot.number in lenses[s.name].left_out else ""
            typer.echo(f"  {shot.label}: {len(shot.ids)} corners, {result.errors_px[s.name][shot.number]:.2f} px{note}")
    if result.moments:
        typer.echo(f"pictures of one number were {result.moments:.2f} of a picture apart in time; accounted for")
    if result.back_m:
        typer.echo(f"the board's back is printed {result.back_m * 1000:.1f} mm from its front; accounted for")
    typer.echo(f"the room's origin is the board in picture {result.origin}")


def _annotate(path: Path, s: "CameraDetections", taken: object, result: "BoardResult") -> None:
    """The camera's worst picture: whoever looks at one only should see what is wrong."""
    from collections.abc import Iterator
    from typing import cast

    from observer.calibration.pictures import Picture, annotated, write_picture

    errors = result.errors_px[s.name]
    shot = max(s.seen, key=lambda one: errors[one.number])
    for number, label, picture in cast("Iterator[tuple[int, str, Picture]]", taken):
        if number == shot.number:
            text = f"{s.name}, {label}: {errors[number]:.2f} px (the worst)"
            write_picture(path, annotated(picture, shot.pixels, result.drawn[s.name][number], text))
            return


def _check_names(names: Sequence[str]) -> None:
    for name in names:
        if names.count(name) > 1:
            raise BadInput(f"{name}: {names.count(name)} cameras of this name; rename the files, they name the cameras")
        if not re.fullmatch(r"[\w][\w.-]*", name):
            raise BadInput(f"{name!r}: no name for a file; letters, digits, _ . and - are")


def _write(output: Path, cameras: Sequence["CalibratedCamera"]) -> None:
    from observer.calibration.formats import write_opencv
    from observer.geometry.camera_file import CameraModel, write_camera

    _check_names([camera.name for camera in cameras])
    try:
        output.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise LabanmeshError(f"{output}: cannot be made: {error.strerror}") from None
    typer.echo("camera            focal px      centre px     stands at (m)          error px")
    for c in cameras:
        file = CameraModel(c.name, c.matrix, c.image_size_px, c.error_px, c.provenance, c.lens)
        write_camera(output / f"{c.name}.toml", file)
        place = " ".join(f"{x:6.2f}" for x in c.place)
        known = "not told" if c.error_px is None else f"{c.error_px:.2f}"
        lens = f"{c.K[0, 0]:6.0f} {c.K[1, 1]:6.0f} {c.K[0, 2]:6.0f} {c.K[1, 2]:6.0f}"
        typer.echo(f"{c.name:<16} {lens}  {place}   {known:>8}")
    write_opencv(output / ALL, list(cameras))
    typer.echo(f"{output}: {len(cameras)} camera files, and all of them in {ALL}")
