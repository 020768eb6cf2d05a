"""`labanmesh camera calibrate`: output, files and errors."""

import csv

import cv2
import numpy as np
import pytest
from observer_stage import printed_board, rejected

from observer.calibration.board import Chessboard
from observer.calibration.calibrated import CalibratedCamera, read_opencv, rotation, write_opencv
from observer.calibration.commands import ALL_CAMERAS, calibrate
from observer.geometry.camera_file import read_camera

K = np.array([[700.0, 0, 320], [0, 705, 240], [0, 0, 1]])
TRUE = CalibratedCamera("door", K, np.zeros(0), rotation([0.1, 3.0, 0.2], "test"), np.array([0.2, -0.1, 3.0]))
BOARD = "chessboard:4x7:0.06"


@pytest.fixture
def run(command):
    return command(calibrate)


def write_pairs(path, count=20, flat=False, camera=TRUE):
    points = np.random.default_rng(0).uniform(-0.7, 0.7, (count, 3)) * [1, 1, 0 if flat else 1]
    with path.open("w", newline="") as file:
        csv.writer(file).writerows([["x", "y", "z", "u", "v"], *np.hstack([points, camera.pixels(points)]).tolist()])
    return points


def test_known_points_become_a_camera_by_dlt(run, tmp_path):
    points = write_pairs(tmp_path / "door.csv")
    output = run("--points", "door.csv", "-o", "out")
    assert "door" in output and "0.00" in output
    camera = read_camera(tmp_path / "out/door.toml")
    assert camera.lens is None  # DLT does not estimate distortion
    assert camera.reprojection_error_px < 1e-3 and "20 points of door.csv" in camera.provenance
    (whole,) = read_opencv(tmp_path / "out" / ALL_CAMERAS)
    np.testing.assert_allclose(whole.K, K, atol=1e-3)
    np.testing.assert_allclose(whole.R, TRUE.R, atol=1e-6)
    np.testing.assert_allclose(whole.pixels(points), TRUE.pixels(points), atol=1e-3)


def test_coplanar_points_place_a_camera_with_a_known_lens(run, tmp_path):
    bent = CalibratedCamera("door", K, np.array([0.15, -0.2, 1e-3, 2e-3]), TRUE.R, TRUE.t)
    write_opencv(tmp_path / "lens.toml", [bent.moved(rotation([0, 1, 0], "test"), np.ones(3))])
    write_pairs(tmp_path / "door.csv", 8, flat=True, camera=bent)
    run("--points", "door.csv", "--lens", "lens.toml", "-o", "out")
    (camera,) = read_opencv(tmp_path / "out" / ALL_CAMERAS)
    np.testing.assert_allclose(camera.position, TRUE.position, atol=1e-4)


def test_a_foreign_file_with_z_up_is_converted_to_y_up(run, tmp_path):
    write_opencv(tmp_path / "theirs.toml", [TRUE])
    run("--read", "theirs.toml", "--up", "z", "-o", "out")
    (ours,) = read_opencv(tmp_path / "out" / ALL_CAMERAS)
    x, y, z = TRUE.position
    np.testing.assert_allclose(ours.position, [x, z, -y], atol=1e-9)


def drawn_board(folder):
    """Pictures of a printed chessboard, warped as a pinhole camera sees it."""
    folder.mkdir()
    side, board = 40, Chessboard(4, 7, 0.06)
    on_paper = (board.points[:, :2] / board.square * side + 2 * side - 0.5).astype(np.float32)
    rng = np.random.default_rng(2)
    for n in range(6):
        R, t = rotation(rng.uniform(-0.5, 0.5, 3), "test"), np.array([-0.1, -0.2, 0.9])
        image = (board.points @ R.T + t) @ K.T
        H, _ = cv2.findHomography(on_paper, (image[:, :2] / image[:, 2:]).astype(np.float32))
        cv2.imwrite(str(folder / f"{n}.png"), cv2.warpPerspective(printed_board(), H, (640, 480), borderValue=128))


def test_pictures_of_a_board_give_camera_file_and_annotated_picture(run, tmp_path):
    drawn_board(tmp_path / "cam1")
    output = run("cam1", "--board", BOARD, "-o", "out", "--origin", 2)
    assert "board in 6 of 6 pictures" in output and "5.png: 28 corners" in output and "picture 2" in output
    (camera,) = read_opencv(tmp_path / "out" / ALL_CAMERAS)
    np.testing.assert_allclose(np.diag(camera.K), np.diag(K), rtol=0.03)
    assert camera.error_px < 0.3 and camera.image_size_px == (640, 480)
    assert np.linalg.norm(camera.position) == pytest.approx(np.linalg.norm([0.1, 0.2, 0.9]), rel=0.03)
    assert camera.position[2] < 0  # in front of the performer who holds the board
    assert cv2.imread(str(tmp_path / "out/cam1.png")).shape == (480, 640, 3)
    written = read_camera(tmp_path / "out/cam1.toml")
    assert written.provenance.startswith("chessboard 4x7")
    np.testing.assert_array_equal(written.lens.intrinsic_matrix, camera.K)
    np.testing.assert_array_equal(written.lens.distortion, camera.distortion)


def test_cameras_that_share_the_board_refine_their_lenses(run, tmp_path):
    for name in ("cam1", "cam2"):
        drawn_board(tmp_path / name)
    run("cam1", "cam2", "--board", BOARD, "-o", "out")
    one, two = read_opencv(tmp_path / "out" / ALL_CAMERAS)
    assert one.K[0, 0] == one.K[1, 1] == pytest.approx(702.5, rel=0.03)
    np.testing.assert_allclose(one.position, two.position, atol=0.005)
    run("cam1", "cam2", "--board", BOARD, "-o", "again", "--lens", f"out/{ALL_CAMERAS}")
    known = read_opencv(tmp_path / "again" / ALL_CAMERAS)[0]
    np.testing.assert_array_equal(known.K, one.K)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ("", "is needed"),
        ("cam1 --points a.csv", "is needed"),
        ("cam1", "--board: missing"),
        ("cam1 --board x", "known: chessboard"),
        (f"gone --board {BOARD}", "gone: no such file"),
        (f"cam1 x/cam1 --board {BOARD}", "2 cameras of this name"),
        ("--points gone.csv", "no such file"),
        ("--points few.csv", "5 points"),
        ("--points flat.csv", "plane"),
        ("--points words.csv", "words.csv: line 2"),
        ("--points head.csv", "columns x,y,z,u,v"),
        ("--points few.csv --lens lens.toml", "no camera 'few'"),
        ("--read few.csv", "unknown kind"),
        ("--read lens.toml --up x", "--up 'x'"),
    ],
)
def test_bad_input_is_rejected_with_one_line_before_writing(run, tmp_path, arguments, message):
    write_pairs(tmp_path / "few.csv", 5)
    write_pairs(tmp_path / "flat.csv", 20, flat=True)
    (tmp_path / "words.csv").write_text("x,y,z,u,v\n1,2,three,4,5\n")
    (tmp_path / "head.csv").write_text("1,2,3,4,5\n")
    write_opencv(tmp_path / "lens.toml", [TRUE])
    with rejected(message):
        run(*arguments.split(), "-o", "out")
    assert not (tmp_path / "out").exists()
