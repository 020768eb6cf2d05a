"""The camera file: round trip, and one line for each invalid file."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from observer_stage import rejected

from common.errors import BadInput, LabanmeshError
from observer.geometry.camera_file import CameraModel, read_camera, write_camera
from observer.geometry.projection import LensDistortion, pinhole_matrix

MATRIX = pinhole_matrix(0.3, 0.1, 3.0, 812.5, (640, 360))
GOOD = 'name = "cam1"\nprojective_matrix = [[1,0,0,0],[0,1,0,0],[0,0,0,1]]\n'
K = np.array([[812.5, 0, 640], [0, 812.5, 360], [0, 0, 1]])
INTRINSIC = "intrinsic_matrix = [[800, 0, 320], [0, 800, 240], [0, 0, 1]]\n"
DISTORTION = "distortion = [0.1, -0.2, 0, 0, 0.1]\n"
WITH_LENS = (
    'name = "a"\nprojective_matrix = [[800, 0, 320, 0], [0, 800, 240, 0], [0, 0, 1, 2]]\n' + INTRINSIC + DISTORTION
)
TEXT = st.text(st.characters(exclude_categories=["Cs"]))


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    return tmp_path_factory.mktemp("cameras")


@given(
    TEXT.filter(bool),
    TEXT,
    st.none() | st.tuples(st.integers(1, 9999), st.integers(1, 9999)),
    st.none() | st.floats(0, 1e9),
    st.sampled_from([1e-30, -1.0, 1 / 3, 1e20]),
)
def test_a_written_camera_is_read_back(folder, name, provenance, size, error, scale):
    camera = CameraModel(name, MATRIX * scale, size, error, provenance)
    write_camera(folder / "camera.toml", camera)
    back = read_camera(folder / "camera.toml")
    np.testing.assert_array_equal(back.matrix, camera.matrix)
    assert (back.name, back.image_size_px, back.reprojection_error_px, back.provenance) == (
        name,
        size,
        error,
        provenance,
    )
    assert [path.name for path in folder.iterdir()] == ["camera.toml"]


def test_a_minimal_file_is_read(tmp_path):
    for text, has_lens in ((GOOD, False), (WITH_LENS, True)):
        (tmp_path / "c.toml").write_text(text)
        camera = read_camera(tmp_path / "c.toml")
        assert camera.matrix.dtype == np.float64 and camera.image_size_px is None
        assert (camera.lens is not None) is has_lens


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("name = ", "not a TOML file"),
        ('name = "a"', "projective_matrix: Field required"),
        (GOOD.replace("cam1", ""), "name: "),
        (GOOD.replace('"cam1"', "1"), "name: "),
        (GOOD.replace(",[0,0,0,1]", ""), "projective_matrix: "),
        (GOOD.replace("[0,0,0,1]", "[0,0,1]"), "projective_matrix.2: "),
        (GOOD.replace("[0,0,0,1]", "[0,0,0,nan]"), "projective_matrix.2.3: "),
        (GOOD.replace("[0,0,0,1]", "[0,0,0,'x']"), "projective_matrix.2.3: "),
        (GOOD.replace("[0,0,0,1]", "[0,0,0,1e300]"), "projective_matrix.2.3: "),
        (GOOD + "image_size_px = [640, 1000000]", "image_size_px.1: "),
        (GOOD.replace("[0,0,0,1]", "[0,2,0,0]"), "projective_matrix: not a camera"),
        (GOOD.replace("[0,1,0,0]", "[2,0,0,0]"), "projective_matrix: not a camera"),
        (GOOD.replace("[0,0,0,1]", "[0,0,0,0]"), "projective_matrix: not a camera"),
        (GOOD.replace("[0,0,0,1]", "[1,1,0,1]"), "projective_matrix: not a camera"),
        (GOOD + "image_size_px = [640]", "image_size_px"),
        (GOOD + "image_size_px = [640, 0]", "image_size_px.1: "),
        (GOOD + "reprojection_error_px = -1", "reprojection_error_px: "),
        (GOOD + "reprojection_eror_px = 1", "reprojection_eror_px: "),
        (WITH_LENS.replace(DISTORTION, ""), "intrinsic_matrix without distortion"),
        (WITH_LENS.replace(INTRINSIC, ""), "distortion without intrinsic_matrix"),
        (WITH_LENS.replace("[0.1, -0.2, 0, 0, 0.1]", "[0.1, -0.2]"), "distortion: 2 numbers"),
        (WITH_LENS.replace("[0.1, -0.2, 0, 0, 0.1]", "[0.1, -0.2, 0, inf]"), "distortion.3: "),
        (WITH_LENS.replace("[[800, 0, 320],", "[[-800, 0, 320],"), "not an intrinsic matrix"),
        (WITH_LENS.replace("[[800, 0, 320],", "[[700, 0, 320],"), "does not match projective_matrix"),
        (WITH_LENS.replace("[0, 800, 240], [0, 0, 1]]", "[0, 800, 200], [0, 0, 1]]"), "does not match projective"),
        (WITH_LENS.replace("[0, 800, 240], [0, 0, 1]]", "[0, 800, 240]]"), "intrinsic_matrix: "),
    ],
)
def test_an_invalid_file_is_rejected_with_its_key(tmp_path, text, message):
    path = tmp_path / "cam.toml"
    path.write_text(text)
    with rejected(message, path):
        read_camera(path)


def test_an_unreadable_file_is_rejected(tmp_path):
    with rejected("no such file"):
        read_camera(tmp_path / "none.toml")
    with rejected("directory"):
        read_camera(tmp_path)
    (tmp_path / "binary.toml").write_bytes(b"\xff\xfe")
    with rejected("not a TOML file"):
        read_camera(tmp_path / "binary.toml")


def test_a_failed_write_keeps_the_old_file(tmp_path):
    path = tmp_path / "cam.toml"
    write_camera(path, CameraModel("good", MATRIX))
    for bad in (CameraModel("", MATRIX), CameraModel("bad", MATRIX * np.nan), CameraModel("bad", MATRIX[:2])):
        with pytest.raises(BadInput):
            write_camera(path, bad)
    assert read_camera(path).name == "good"
    with pytest.raises(LabanmeshError, match=r"cannot write .*no such file or directory. Choose another path with -o"):
        write_camera(tmp_path / "nowhere" / "cam.toml", CameraModel("good", MATRIX))


@pytest.mark.parametrize("size", [4, 5, 8])
@pytest.mark.parametrize("scale", [1.0, -3.0, 1e-3])
def test_a_lens_is_read_back(tmp_path, size, scale):
    distortion = np.linspace(-0.1, 1 / 3, size)
    write_camera(tmp_path / "c.toml", CameraModel("c", MATRIX * scale, lens=LensDistortion(K, distortion)))
    lens = read_camera(tmp_path / "c.toml").lens
    np.testing.assert_array_equal(lens.intrinsic_matrix, K)
    np.testing.assert_array_equal(lens.distortion, distortion)
