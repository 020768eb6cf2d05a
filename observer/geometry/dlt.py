"""The projective matrix from points with known positions in space and in the image (DLT, section II.A)."""

from dataclasses import dataclass

import numpy as np

from common.errors import BadInput, LabanmeshError
from common.text import plural
from observer.geometry.projection import oriented, project
from observer.tracks import Floats

FEWEST_POINTS = 6
"""Eleven unknowns, two equations per point."""
ENOUGH_POINTS = 12
"""With fewer points, 1 px of noise causes several px of error on new points (measured)."""
FLATTEST = 0.02
"""Least thickness of the point set as a share of its length. At this value, 1 px of noise causes 6 px of error on new
points from 100 points, and 20 px from 12 (measured)."""
LEAST_SINGULAR_SHARE = 3e-3
"""Least second-smallest singular value of the design matrix as a share of the largest; below it, two cameras fit.
With 1 px of noise, all points but one in a plane give 0.001 to 0.0025; 12 or more points in a box, 0.07 (measured)."""


@dataclass(frozen=True, slots=True, eq=False)
class FittedMatrix:
    """The result of the DLT.

    matrix: (3, 4), scaled so that w is the depth in metres. error_px: root mean square of the distances between
    measured and projected points. warnings: for people, about the quality of the result.
    """

    matrix: Floats
    error_px: float
    warnings: tuple[str, ...]


def fit_projective_matrix(points_m: Floats, pixels: Floats) -> FittedMatrix:
    """(N, 3) metres, (N, 2) pixels -> the H with least sum of squared reprojection errors of I^T = H O^T.

    Normalised DLT (Hartley 1997), refined by least squares in the image. Lens distortion is not modelled: a strong one
    is absorbed, to about a pixel where the points were, by a wrong camera.

    Raises BadInput for fewer than six points, NaN, repeated points, (almost) coplanar points, other ambiguous sets, and
    points that would lie behind the camera; LabanmeshError when scipy is missing.
    """
    points_m, pixels = np.asarray(points_m, dtype=np.float64), np.asarray(pixels, dtype=np.float64)
    _check(points_m, pixels)
    in_space, in_image = _normaliser(points_m), _normaliser(pixels)
    points, image = _image(in_space, points_m), _image(in_image, pixels)
    vectors = _design_vectors(points, image)
    H = _in_metres(np.linalg.inv(in_image) @ _refined(vectors, points, image) @ in_space)
    _check_in_front(H, points_m)
    errors_px = np.linalg.norm(_image(H, points_m) - pixels, axis=1)
    return FittedMatrix(H, float(np.sqrt(np.mean(errors_px**2))), _warnings(len(points_m)))


def _check(points_m: Floats, pixels: Floats) -> None:
    if points_m.ndim != 2 or points_m.shape[1] != 3 or pixels.shape != (len(points_m), 2):
        raise BadInput(
            f"points {points_m.shape}, pixels {pixels.shape}: (N, 3) and (N, 2) are needed, in the same order"
        )
    if len(points_m) < FEWEST_POINTS:
        raise BadInput(
            f"{plural(len(points_m), 'point')}: a calibration needs {FEWEST_POINTS}, better {ENOUGH_POINTS} or more"
        )
    wrong = ~(np.isfinite(points_m).all(axis=1) & np.isfinite(pixels).all(axis=1))
    if wrong.any():
        raise BadInput(f"point {int(wrong.argmax())}: not a finite number; omit points that were not seen")
    _, first, count = np.unique(points_m, axis=0, return_index=True, return_counts=True)
    if count.max() > 1:
        raise BadInput(f"point {int(first[count.argmax()])}: appears {count.max()} times; give each point once")
    lengths = np.linalg.svd(points_m - points_m.mean(axis=0), compute_uv=False)
    if lengths[2] < FLATTEST * lengths[0]:
        raise BadInput(f"{len(points_m)} points (almost) in one plane: add points well in front of or behind it")


def _normaliser(points: Floats) -> Floats:
    """(N, d) -> (d+1, d+1) homogeneous similarity to mean 0 and mean distance √d (Hartley 1997)."""
    size = points.shape[1]
    centre = points.mean(axis=0)
    spread = np.linalg.norm(points - centre, axis=1).mean()
    if not spread > 0:
        raise BadInput(f"{len(points)} points, all at one position in the image: check the pairs")
    matrix: Floats = np.eye(size + 1) * (np.sqrt(size) / spread)
    matrix[:, size] = [*(-centre * np.sqrt(size) / spread), 1.0]
    return matrix


def _homogeneous(points: Floats) -> Floats:
    return np.column_stack([points, np.ones(len(points))])


def _design_vectors(points: Floats, image: Floats) -> Floats:
    """(N, 3), (N, 2) normalised -> (12, 12) right singular vectors of the DLT equations; the last one is the solution.

    Two rows per point: h1·X - u h3·X = 0 and h2·X - v h3·X = 0, X homogeneous.
    """
    X = _homogeneous(points)
    zero = np.zeros_like(X)
    rows_u = np.hstack([X, zero, -image[:, :1] * X])
    rows_v = np.hstack([zero, X, -image[:, 1:] * X])
    _, values, vectors = np.linalg.svd(np.vstack([rows_u, rows_v]), full_matrices=False)
    if values[10] < LEAST_SINGULAR_SHARE * values[0]:
        raise BadInput(f"{len(points)} points that fit more than one camera: spread them through the whole space")
    return vectors


def _refined(vectors: Floats, points: Floats, image: Floats) -> Floats:
    """(3, 4) the matrix near the linear solution with the least squared error in the image.

    The scale of H is arbitrary, so only the eleven directions orthogonal to the linear solution are searched, and each
    step lowers the error: the result is never worse than the linear solution.
    """
    try:
        from scipy.optimize import least_squares
    except ImportError:
        raise LabanmeshError("calibration needs scipy: pip install 'labanmesh[observer]'") from None

    def matrix(step: Floats) -> Floats:
        result: Floats = (vectors[-1] + step @ vectors[:-1]).reshape(3, 4)
        return result

    def residuals(step: Floats) -> Floats:
        return np.ravel(_image(matrix(step), points) - image)

    # Too large a step may put a point into the camera plane; its infinite error is rejected.
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        return matrix(least_squares(residuals, np.zeros(11), method="lm").x)


def _image(matrix: Floats, points: Floats) -> Floats:
    """(d+1, e+1), (N, e) -> (N, d); unlike `project` also behind the camera, since the fit does not know the side."""
    image = _homogeneous(points) @ matrix.T
    return image[:, :-1] / image[:, -1:]


def _in_metres(matrix: Floats) -> Floats:
    """The same camera with w the depth in metres: the third row becomes the unit viewing direction."""
    H = oriented(matrix)
    return H / np.linalg.norm(H[2, :3])


def _check_in_front(matrix: Floats, points_m: Floats) -> None:
    behind = int(np.isnan(project(matrix, points_m)).any(axis=1).sum())
    if behind:
        raise BadInput(
            f"{behind} of {len(points_m)} points would lie behind the camera: check the pairs; "
            "axes are right-handed, u to the right, v down"
        )


def _warnings(count: int) -> tuple[str, ...]:
    if count >= ENOUGH_POINTS:
        return ()
    return (f"{count} points: the error on new points may be several px; give {ENOUGH_POINTS} or more",)
