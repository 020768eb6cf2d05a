"""Distortion and projection against OpenCV, and the readers of other programs' files."""

import cv2
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from observer_stage import rejected

from observer.calibration.calibrated import CalibratedCamera, read_opencv, read_qualisys, rotation, write_opencv
from observer.geometry.projection import project

K = np.array([[800.0, 0, 330], [0, 810, 250], [0, 0, 1]])
LENSES = ([], [-0.3, 0.1, 1e-3, -2e-3], [0.19, -0.25, 2e-3, -5e-3, 0.11], [0.2, -0.1, 0, 0, 0.02, 0.1, 0.01, 0.001])
GOOD = """
[one]
matrix = [[800, 0, 330], [0, 810, 250], [0, 0, 1]]
distortions = [0.1, 0, 0, 0]
rotation = [0.1, 0.2, 0.3]
translation = [1, 2, 3]
size = [640, 480]
"""


def camera(lens, turned=(0.1, -0.2, 0.05)):
    return CalibratedCamera("c", K, np.array(lens, dtype=float), rotation(turned, "test"), np.array([0.1, 0.2, 3.0]))


@pytest.mark.parametrize("lens", LENSES)
def test_projection_agrees_with_opencv_and_is_invertible(lens):
    one = camera(lens)
    points = np.random.default_rng(1).uniform(-0.8, 0.8, (50, 3))
    expected = cv2.projectPoints(points, cv2.Rodrigues(one.R)[0], one.t, K, one.distortion if lens else None)[0]
    drawn = one.pixels(points)
    np.testing.assert_allclose(drawn, expected.reshape(-1, 2), atol=1e-6)
    plain = one.lens.undistorted(drawn) if lens else drawn
    np.testing.assert_allclose(plain, project(one.matrix, points), atol=1e-3)


@given(st.tuples(*[st.floats(-3, 3)] * 3), st.tuples(*[st.floats(-3, 3)] * 3))
def test_a_camera_moved_with_its_room_sees_the_same(turned, shift):
    one, R, t = camera([]), rotation(turned, "test"), np.array(shift)
    points = np.array([[0.1, 0.2, 0.3], [-0.5, 0, 0.1]])
    np.testing.assert_allclose(one.moved(R, t).pixels(points @ R.T + t), one.pixels(points), atol=1e-6)


def test_a_written_file_is_read_back(tmp_path):
    path = tmp_path / "all.toml"
    write_opencv(path, [camera(lens) for lens in LENSES])
    for lens, back in zip(LENSES, read_opencv(path), strict=True):
        np.testing.assert_allclose(back.R, camera(lens).R, atol=1e-12)
        np.testing.assert_array_equal(back.distortion, lens)
        np.testing.assert_array_equal(back.K, K)


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("matrix = [[800, 0, 330], [0, 810, 250], [0, 0, 1]]", "", "one.matrix: missing"),
        ("[0, 810, 250]", "[0, -810, 250]", "one.matrix: not an intrinsic"),
        ("[0, 810, 250]", "[0, 810]", "one.matrix"),
        ("[0.1, 0, 0, 0]", "[0.1]", "one.distortions: 1 number;"),
        ("[0.1, 0.2, 0.3]", "[[1,0,0],[0,1,0],[0,0,2]]", "one.rotation: not a rotation"),
        ("[0.1, 0.2, 0.3]", '"x"', "one.rotation"),
        ("[1, 2, 3]", "[1, nan, 3]", "one.translation"),
        ("[640, 480]", "[640, 0]", "one.size"),
        ("[one]", "fisheye = true\n[two]", "two"),
        ("size =", "fisheye = true\nsize =", "one.fisheye"),
        (GOOD, "a = 1", "no camera"),
        (GOOD, "a = ", "not a TOML file"),
    ],
)
def test_an_invalid_file_is_rejected_with_its_key(tmp_path, old, new, message):
    path = tmp_path / "c.toml"
    assert old in GOOD
    path.write_text(GOOD.replace(old, new))
    if message == "two":
        assert read_opencv(path)[0].name == "two"
        return
    with rejected(message, path):
        read_opencv(path)


@pytest.mark.parametrize("text", ["", "<a/>", "{", "<!DOCTYPE a [<!ENTITY b 'c'>]><a/>", "<camera serial='x'/>"])
def test_other_files_are_rejected_with_one_line(tmp_path, text):
    path = tmp_path / "c.qca.txt"
    path.write_text(text)
    with rejected("c.qca.txt"):
        read_qualisys(path)


def test_qualisys_agrees_with_pose2sim(data):
    cameras = read_qualisys(data / "pose2sim_single/calibration/Calib.qca.txt")
    expected = read_opencv(data / "pose2sim_single/reference_3d/Pose2Sim_cameras.toml")
    for one, other in zip(cameras, expected, strict=True):
        np.testing.assert_allclose(one.matrix, other.matrix, atol=1e-4)
        assert one.image_size_px == other.image_size_px == (1088, 1920)
        # Pose2Sim also divides the distortion by 64; the board pictures confirm the file's own numbers.
        np.testing.assert_allclose(one.distortion[:4] / 64, other.distortion, atol=1e-9)
