"""Calibration: exact without noise, as good as measured with it, refused where it cannot work, tried on real ones."""

import csv
import sys
import tomllib

import cv2
import numpy as np
import pytest
from observer_stage import rejected

from common.errors import BadInput, LabanmeshError
from observer.geometry import dlt
from observer.geometry.dlt import fit_projective_matrix
from observer.geometry.projection import pinhole_matrix, project

CAMERA = pinhole_matrix(0.4, 0.15, 3.5, 900.0, (640.0, 360.0), (0.0, 1.0, 0.0))


def box(seed, count):
    """Points in the space that a person fills: 2 m wide, high and deep."""
    return np.random.default_rng(seed).uniform((-1, 0, -1), (1, 2, 1), (count, 3))


def noisy(seed, points, noise_px=1.0):
    return project(CAMERA, points) + np.random.default_rng(seed + 1000).normal(0, noise_px, (len(points), 2))


CORNERS = np.array([[x, y, z] for x in (-1.0, 1) for y in (0.0, 2) for z in (-1.0, 1)])


@pytest.mark.parametrize("points", [box(3, 6), box(3, 8), box(3, 28), CORNERS], ids=["6", "8", "28", "corners"])
def test_exact_without_noise(points):
    for scale in (1.0, -7.0):
        fit = fit_projective_matrix(points, project(CAMERA * scale, points))
        np.testing.assert_allclose(fit.matrix, CAMERA, rtol=1e-6, atol=1e-5)  # w is the depth in both
        assert fit.error_px < 1e-6
        assert len(fit.warnings) == (len(points) < 12)


@pytest.mark.parametrize(("count", "between_px"), [(6, (1.5, 12)), (28, (0.3, 1.2)), (100, (0.12, 0.5))])
def test_error_on_new_points_is_what_was_measured(count, between_px):
    fresh, medians = box(99, 200), []
    for seed in range(25):
        points = box(seed, count)
        try:
            matrix = fit_projective_matrix(points, noisy(seed, points)).matrix
        except BadInput:  # six points may happen to lie badly
            assert count == 6
            continue
        medians.append(np.nanmedian(np.linalg.norm(project(matrix, fresh) - project(CAMERA, fresh), axis=1)))
    assert len(medians) >= 22
    assert between_px[0] < np.median(medians) < between_px[1]


@pytest.mark.parametrize("count", [7, 12, 40])
def test_refinement_is_never_worse_than_the_linear_solution(count, monkeypatch):
    cases = [(points, noisy(seed, points, 3.0)) for seed in range(10) for points in [box(seed, count)]]
    refined = [fit_projective_matrix(*case).error_px for case in cases]
    monkeypatch.setattr(dlt, "_refined", lambda vectors, points, image: vectors[-1].reshape(3, 4))
    linear = [fit_projective_matrix(*case).error_px for case in cases]
    assert (np.array(refined) <= np.array(linear) + 1e-9).all()
    assert np.median(np.array(refined) / np.array(linear)) < 0.9999  # the refinement has an effect


def test_error_px_is_the_root_mean_square():
    points = box(1, 20)
    pixels = noisy(1, points)
    fit = fit_projective_matrix(points, pixels)
    distances = np.linalg.norm(project(fit.matrix, points) - pixels, axis=1)
    assert fit.error_px == pytest.approx(np.sqrt((distances**2).mean()))


PLANE = box(7, 30) * [1, 1, 0] + box(7, 30)[:, :2] @ [[0, 0, 0.3], [0, 0, 0.1]]


@pytest.mark.parametrize("noise_px", [0.0, 1.0])
@pytest.mark.parametrize(
    ("points", "message"),
    [
        (box(1, 5), "5 points: a calibration needs 6"),
        (box(1, 1), "1 point: a calibration needs 6"),
        (PLANE, "in one plane"),
        (PLANE + np.random.default_rng(0).normal(0, 0.002, (30, 3)), "in one plane"),
        (np.outer(np.linspace(-1, 1, 10), (1, 1, 1)), "in one plane"),
        (PLANE + np.eye(30, 3, 2), "more than one camera"),
        (np.vstack([box(1, 9), box(1, 1)]), "appears 2 times"),
        (np.vstack([box(1, 9), [[0, np.nan, 0]]]), "point 9: not a finite number"),
        (box(1, 9)[:, :2], "are needed"),
    ],
)
def test_unusable_points_are_rejected(points, message, noise_px):
    pixels = noisy(0, np.pad(points, ((0, 0), (0, 3 - points.shape[1]))), noise_px)
    with rejected(message):
        fit_projective_matrix(points, np.nan_to_num(pixels))


def test_unusable_pixels_are_rejected():
    points = box(1, 9)
    with rejected("are needed"):
        fit_projective_matrix(points, np.zeros((8, 2)))
    with rejected("one position in the image"):
        fit_projective_matrix(points, np.zeros((9, 2)))
    with rejected("right-handed"):
        fit_projective_matrix(points, project(CAMERA, points) * (1, -1))  # v upwards: a mirror image


def test_without_scipy_the_error_says_what_to_install(monkeypatch):
    monkeypatch.setitem(sys.modules, "scipy.optimize", None)
    points = box(1, 9)
    with rejected("pip install 'labanmesh[observer]'", error=LabanmeshError):
        fit_projective_matrix(points, project(CAMERA, points))


@pytest.mark.parametrize(("pair", "side", "camera_id"), [("01", "A", "0"), ("01", "B", "1"), ("12", "A", "1")])
def test_recorded_cameras_and_a_hand_held_board(data, pair, side, camera_id):
    """Half of a board's triangulated corners predict the other half, and the pose found by caliscope."""
    folder = data / "caliscope_4_cam"
    with (folder / "stereotriangulated_points.csv").open() as lines:
        rows = [row for row in csv.DictReader(lines) if row["cam_id_A"] + row["cam_id_B"] == pair]
    points = np.array([[float(row[f"{axis}_pos"]) for axis in "xyz"] for row in rows])
    pixels = np.array([[float(row[f"{axis}_{side}"]) for axis in "xy"] for row in rows])
    reference = tomllib.loads((folder / "camera_array.toml").read_text())["cameras"][camera_id]
    K, distortions, rotation, translation = (
        np.array(reference[key]) for key in ("matrix", "distortions", "rotation", "translation")
    )
    undistorted = cv2.undistortPoints(pixels[:, None], K, distortions, P=K)[:, 0]
    for measured, worst_px in ((pixels, 2.0), (undistorted, 0.6)):  # camera 0 bends straight lines by 20 px
        fit = fit_projective_matrix(points[::2], measured[::2])
        assert np.median(np.linalg.norm(project(fit.matrix, points[1::2]) - measured[1::2], axis=1)) < worst_px
    centre = -np.linalg.solve(fit.matrix[:, :3], fit.matrix[:, 3])
    assert fit.matrix[2, :3] @ rotation[2] > np.cos(np.radians(2))
    np.testing.assert_allclose(centre, -rotation.T @ translation, atol=0.02)
