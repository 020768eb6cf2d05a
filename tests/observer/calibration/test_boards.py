"""Board detection, intrinsics and extrinsics: synthetic boards, and recordings with known calibrations."""

from dataclasses import replace

import cv2
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from observer_stage import printed_board, rejected

from observer.calibration.board import Charuco, Chessboard, parse_chessboard, pictures, read_board
from observer.calibration.bundle import BoardCorners, RigidTransform, _Problem, bundle_adjust
from observer.calibration.calibrate import from_boards
from observer.calibration.calibrated import angle_between, read_opencv, rotation
from observer.calibration.detection import BoardDetection, CameraDetections, _upright, detector, find_boards, speeds
from observer.calibration.parameters import (
    FittedLens,
    _relative_pose,
    fit_lens,
    solve_extrinsics,
)

K = np.array([[700.0, 0, 320], [0, 700, 240], [0, 0, 1]])
LENS = FittedLens(K, np.array([0.1, -0.1, 0, 0, 0.0]), 0.0, {})
BOARD = Chessboard(4, 7, 0.06)


@pytest.mark.parametrize("turns", range(4))
def test_a_rotated_chessboard_has_the_same_corners(turns):
    gray = printed_board()
    _, upright, behind = detector(BOARD)(gray)
    assert not behind
    first = upright[0]
    np.testing.assert_allclose(np.ptp(upright, axis=0), [120, 240], atol=1)
    _, pixels, _ = detector(BOARD)(np.ascontiguousarray(np.rot90(gray, turns)))
    height, width = gray.shape
    x, y = first
    expected = [(x, y), (y, width - 1 - x), (width - 1 - x, height - 1 - y), (height - 1 - y, x)][turns]
    np.testing.assert_allclose(pixels[0], expected, atol=1)


def test_reversed_or_mirrored_corners_are_put_in_order():
    gray = printed_board()
    grid = detector(BOARD)(gray)[1].reshape(7, 4, 2)
    for other in (grid, grid[::-1, ::-1], grid[:, ::-1], grid[::-1]):
        np.testing.assert_array_equal(_upright(gray, other), grid)


def test_the_jacobian_equals_difference_quotients():
    cameras_seen, _ = shots()
    corners = [
        BoardCorners(c.name, s.number, BOARD.points[s.ids], s.pixels, np.full_like(s.pixels, 3.0), c.name == "two")
        for c in cameras_seen
        for s in c.boards[:2]
    ]
    start = solve_extrinsics(cameras_seen, {"one": LENS, "two": LENS}, BOARD)
    optics = dict.fromkeys(start.cameras, (K, LENS.distortion))
    boards = {n: start.boards[n] for n in (0, 1)}
    problem = _Problem(corners, optics, start.cameras, boards, {"two": (319.5, 239.5)})
    x = problem.start + np.random.default_rng(7).normal(0, 1e-3, len(problem.start))
    blocks = problem.evaluate(x)[1]
    slopes = blocks.matrix().toarray()
    for n in range(len(x)):
        step = 1e-6 * max(1.0, abs(x[n]) / 100)
        there, back = (problem.evaluate(x + sign * step * np.eye(len(x))[n])[0] for sign in (1, -1))
        np.testing.assert_allclose((there - back) / (2 * step), slopes[:, n], rtol=1e-4, atol=0.05, err_msg=str(n))


def test_bundle_adjustment_corrects_a_wrong_start_despite_a_wrong_corner():
    shown, second = shots()
    start = solve_extrinsics(shown, {"one": LENS, "two": LENS}, BOARD)
    corners = [
        BoardCorners(c.name, s.number, BOARD.points, s.pixels.copy(), np.zeros_like(s.pixels))
        for c in shown
        for s in c.boards
    ]
    corners[3].pixels[5] += 40
    turned = RigidTransform(rotation([0, 0.35, 0.02], "test"), second.t + 0.05)
    cameras = {**start.cameras, "two": turned}
    lenses = dict.fromkeys(cameras, (K, LENS.distortion))
    found = bundle_adjust(corners, lenses, cameras, start.boards).cameras["two"]
    np.testing.assert_allclose(found.t, second.t, atol=2e-3)
    assert angle_between(found.R, second.R) < 2e-3


def test_a_charuco_board_is_detected_from_behind():
    board = Charuco(4, 5, 0.054, 0.0405, "DICT_4X4_50")
    dictionary = cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_4X4_50)
    drawn = cv2.aruco.CharucoBoard((4, 5), 0.054, 0.0405, dictionary).generateImage((480, 600), marginSize=30)
    ids, pixels, behind = detector(board)(drawn)
    mirrored_ids, mirrored, from_behind = detector(board)(np.ascontiguousarray(drawn[:, ::-1]))
    assert (behind, from_behind) == (False, True)
    np.testing.assert_array_equal(mirrored_ids, ids)
    np.testing.assert_allclose(mirrored, pixels * [-1, 1] + [479, 0], atol=0.1)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("checkers", "known: chessboard"),
        ("chessboard:4x7", "not a board"),
        ("chessboard:2x7:0.06", "at least 3x3"),
        ("chessboard:99999999x99999999:1", "at most 100x100"),
        ("chessboard:4x7:60", "the unit is metres"),
        ("none.toml", "no such file"),
    ],
)
def test_an_invalid_board_is_rejected(text, message):
    with rejected(message):
        read_board(text)
    assert parse_chessboard("chessboard:4x7:0.06") == BOARD


def shots(moment_of_second=0):
    """Two cameras 0.5 m apart and 0.3 rad turned, a board at eight places; noiseless corners."""
    rng = np.random.default_rng(5)
    second = RigidTransform(rotation([0, 0.3, 0], "test"), np.array([-0.5, 0.02, 0.1]))
    turns, places = rng.uniform(-0.5, 0.5, (8, 3)), rng.uniform([-0.2, -0.2, 1.5], [0.1, 0.1, 1.5], (8, 3))
    boards = [RigidTransform(rotation(turn, "test"), place) for turn, place in zip(turns, places, strict=True)]
    cameras = []
    for name, camera, late in (("one", RigidTransform(np.eye(3), np.zeros(3)), 0), ("two", second, moment_of_second)):
        detections = []
        for n in range(8):
            pose = camera.after(boards[(n + late) % 8])
            drawn = cv2.projectPoints(BOARD.points, cv2.Rodrigues(pose.R)[0], pose.t, K, LENS.distortion)[0]
            detections.append(BoardDetection(n, f"{n}", np.arange(28), drawn.reshape(-1, 2)))
        cameras.append(CameraDetections(name, (640, 480), tuple(detections), 8))
    return cameras, second


def test_exact_corners_give_lens_and_poses():
    cameras, second = shots()
    lens = fit_lens(cameras[0], BOARD)
    np.testing.assert_allclose(lens.K, K, atol=0.5)
    solved = solve_extrinsics(cameras, {"one": LENS, "two": LENS}, BOARD).cameras["two"]
    np.testing.assert_allclose(solved.t, second.t, atol=1e-4)
    assert angle_between(solved.R, second.R) < 1e-4
    result = from_boards(cameras, {"one": LENS, "two": LENS}, BOARD, origin=3, lying=False, apart=False)
    one, two = result.cameras
    assert result.origin == 3 and max(c.error_px for c in result.cameras) < 0.01
    np.testing.assert_allclose(np.linalg.norm(one.position - two.position), np.linalg.norm(second.t), atol=1e-4)
    np.testing.assert_allclose(one.pixels(BOARD.points * [-1, -1, 1]), cameras[0].boards[3].pixels, atol=0.01)
    assert one.position[2] < 0  # in front of the performer who holds the board


def test_insufficient_detections_are_rejected():
    lenses = {"one": LENS, "two": LENS}
    cameras, _ = shots(moment_of_second=3)
    with rejected("one and two: their 8 shared pictures disagree"):
        solve_extrinsics(cameras, lenses, BOARD)
    first, second = shots()[0]
    later = CameraDetections(
        "two", (640, 480), tuple(BoardDetection(s.number + 8, s.label, s.ids, s.pixels) for s in second.boards), 8
    )
    with rejected("two: shares no picture of the board with one"):
        solve_extrinsics([first, later], lenses, BOARD)
    with rejected("looks the same upside down"):
        solve_extrinsics([first, second], lenses, Chessboard(4, 6, 0.06))
    with rejected("--origin 99"):
        from_boards([first], lenses, BOARD, origin=99, lying=False, apart=False)
    with rejected("board detected in 2 of 8 pictures"):
        fit_lens(CameraDetections("one", (640, 480), first.boards[:2], 8), BOARD)


def test_unreadable_pictures_are_rejected(tmp_path):
    for name, message in (("a.png", "not a readable picture"), ("a.mp4", "not a video"), ("gone.mp4", "no such file")):
        if name != "gone.mp4":
            (tmp_path / name).write_bytes(b"nothing of the kind" * 9)
        with rejected(message):
            list(pictures(tmp_path / name))
    (tmp_path / "empty").mkdir()
    with rejected("no pictures in this folder"):
        list(pictures(tmp_path / "empty"))
    with rejected("need one size"):
        for n in range(2):
            cv2.imwrite(str(tmp_path / "empty" / f"{n}.png"), np.zeros((9 + n, 9, 3), np.uint8))
        list(pictures(tmp_path / "empty"))


@pytest.mark.slow
@pytest.mark.parametrize("number", [1, 4])
def test_lenses_agree_with_pose2sim(data, number):
    home = data / "pose2sim_single"
    expected = read_opencv(home / "reference_3d/Pose2Sim_cameras.toml")[number - 1]
    folder = home / f"calibration/intrinsics/int_cam0{number}_img"
    lens = fit_lens(find_boards(folder.name, pictures(folder), BOARD), BOARD)
    np.testing.assert_allclose(np.diag(lens.K), np.diag(expected.K), rtol=0.01)
    assert lens.error_px < 0.3


def test_time_offsets_and_the_boards_back_are_estimated():
    """Two cameras, the second late by a tenth of a picture and behind a board 4 mm thick, printed 2 mm aside."""
    time_offsets, back = (0.0, 0.1), np.array([0.002, 0.0, 0.004])
    path = [np.array([0.4 * np.sin(n / 4), 0.3 * np.cos(n / 5), 0.1 * n / 9]) for n in range(-1, 20)]
    late = {"one": np.eye(3), "two": rotation([0, np.pi - 0.3, 0], "test")}
    away = {"one": np.zeros(3), "two": np.array([-0.3, 0.0, 2.9])}
    shown = []
    for (name, R), moment in zip(late.items(), time_offsets, strict=True):
        boards = []
        for n in range(18):
            points = BOARD.points + (back if name == "two" else 0)
            x, y, turn = path[n + 1] + moment * (path[n + 2] - path[n + 1])
            board = points @ rotation([2 * y, 2 * x, y + turn], "test").T + [x / 3, y / 3, 1.5]
            drawn = cv2.projectPoints(board, cv2.Rodrigues(R)[0], away[name], K, np.zeros(5))[0].reshape(-1, 2)
            boards.append(BoardDetection(n, f"frame {n}", np.arange(28), drawn, name == "two"))
        shown.append(CameraDetections(name, (640, 480), tuple(boards), 18, 1))
    lens = FittedLens(K, np.zeros(5), 0.0, {})
    solution = solve_extrinsics(shown, {"one": lens, "two": lens}, BOARD)
    assert angle_between(solution.cameras["two"].R, late["two"]) < 0.002
    np.testing.assert_allclose(solution.cameras["two"].t, away["two"], atol=0.004)
    # What lies along the board is partly a camera that stands elsewhere.
    np.testing.assert_allclose(solution.back[:3], back, atol=0.002)
    assert 0.003 < solution.back[2] < 0.005
    plain = [
        CameraDetections(s.name, s.image_size_px, tuple(replace(x, behind=False) for x in s.boards), 18) for s in shown
    ]
    off = solve_extrinsics(plain, {"one": lens, "two": lens}, BOARD)
    assert rms(off.residuals_px) > 3 * rms(solution.residuals_px)


def rms(residuals_px):
    return np.sqrt(
        np.mean([(part**2).sum(axis=1).mean() for parts in residuals_px.values() for part in parts.values()])
    )


def test_a_wrong_lens_is_corrected_by_the_other_cameras():
    shown, second = shots()
    wrong = FittedLens(K * np.array([[1.03], [1.03], [1]]), LENS.distortion, 0.0, {})
    solution = solve_extrinsics(shown, {"one": LENS, "two": wrong}, BOARD, adjust=["two"])
    np.testing.assert_allclose(solution.lenses["two"][0], K, atol=3)
    np.testing.assert_allclose(solution.cameras["two"].t, second.t, atol=3e-3)
    np.testing.assert_array_equal(solution.lenses["one"][0], K)
    left = solve_extrinsics(shown, {"one": LENS, "two": wrong}, BOARD)
    np.testing.assert_array_equal(left.lenses["two"][0], wrong.K)
    # Its pixels are not square: one focal length would not do.
    oblong = FittedLens(K * np.array([[1.1], [1], [1]]), LENS.distortion, 0.0, {})
    unchanged = solve_extrinsics(shown, {"one": LENS, "two": oblong}, BOARD, adjust=["two"])
    np.testing.assert_array_equal(unchanged.lenses["two"][0], oblong.K)


@pytest.fixture(scope="module")
def caliscope(data):
    """The board, the cameras as caliscope placed them, and what each of them sees of the board."""
    home = data / "caliscope_4_cam"
    board, truth = read_board(str(home / "charuco.toml")), read_opencv(home / "camera_array.toml")
    return board, truth, [find_boards(c.name, pictures(home / f"{c.name}.mp4"), board, 1) for c in truth]


@pytest.mark.slow
@pytest.mark.parametrize(("lenses", "most_deg", "most"), [("theirs", 0.75, 0.0075), ("ours", 2.0, 0.03)])
def test_poses_agree_with_caliscope(caliscope, lenses, most_deg, most):
    board, truth, cameras_seen = caliscope
    if lenses == "theirs":
        solved = solve_extrinsics(
            cameras_seen, {c.name: FittedLens(c.K, c.distortion, 0.0, {}) for c in truth}, board
        ).cameras
    else:
        fitted = {s.name: fit_lens(s, board) for s in cameras_seen}
        solved = solve_extrinsics(cameras_seen, fitted, board, adjust=list(fitted)).cameras
    for i, one in enumerate(truth):
        for other in truth[:i]:
            expected = RigidTransform(one.R, one.t).after(RigidTransform(other.R, other.t).inverse)
            got = solved[one.name].after(solved[other.name].inverse)
            length = np.linalg.norm(expected.t)
            turned, off = np.degrees(angle_between(expected.R, got.R)), np.linalg.norm(expected.t - got.t) / length
            assert turned < most_deg and off < most


IDS = np.arange(3)
CORNERS = np.array([[10.0, 20], [30, 20], [10, 40]])


@given(st.tuples(st.floats(-40, 40), st.floats(-40, 40)), st.integers(1, 5), st.integers(2, 6))
def test_a_constant_speed_is_measured_everywhere(way, step, count):
    shots = [(n * step, IDS, CORNERS + n * np.array(way)) for n in range(count)]
    for speed in speeds(shots, step):
        np.testing.assert_allclose(speed, np.tile(way, (3, 1)), atol=1e-9)


def test_corners_without_neighbours_move_as_the_others():
    shots = [
        (0, IDS[:2], CORNERS[:2]),
        (1, IDS, CORNERS + np.array([4, 0])),
        (3, IDS, CORNERS + np.array([50, 0])),  # picture 2 does not show the board
    ]
    before, now, later = speeds(shots, 1)
    np.testing.assert_array_equal(before, [[4, 0], [4, 0]])
    np.testing.assert_array_equal(now, [[4, 0]] * 3)
    np.testing.assert_array_equal(later, np.zeros((3, 2)))


@pytest.mark.parametrize("wrong", range(4))
def test_two_cameras_get_the_relative_pose_that_most_of_their_pictures_agree_with(wrong):
    """One picture of four was taken at another moment."""
    rng = np.random.default_rng(wrong)
    between = RigidTransform(rotation((0.1, 0.8, 0.0), "test"), np.array([1.0, 0.0, 0.5]))
    known = {n: RigidTransform(rotation(rng.normal(0, 0.3, 3), "test"), rng.normal(0, 1, 3)) for n in range(4)}
    tremor = [RigidTransform(rotation(rng.normal(0, 0.01, 3), "test"), rng.normal(0, 0.01, 3)) for _ in known]
    new = {n: tremor[n].after(between.after(pose)) for n, pose in known.items()}
    new[wrong] = RigidTransform(rotation((0.0, 0.0, 0.9), "test"), np.array([0.0, 1.0, 0.0])).after(new[wrong])
    pose = _relative_pose(known, new, "one and two")
    assert angle_between(pose.R, between.R) < 0.05 and np.linalg.norm(pose.t - between.t) < 0.05
