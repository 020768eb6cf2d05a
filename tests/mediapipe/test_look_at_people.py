"""`labanmesh camera look` on recorded people: it gives advice only where tracks are bad."""

import pytest

from labanmesh import main
from observer.tracking.head import have_cascade

pytest.importorskip("mediapipe")
pytestmark = [pytest.mark.slow, pytest.mark.skipif(not have_cascade(), reason="this OpenCV has no face cascade")]


@pytest.fixture
def advice(data, tmp_path, capsys):
    """The lines of advice on a film of the recordings."""

    def of(film, *options):
        assert main(["camera", "look", str(data / film), "-o", str(tmp_path / "look.png"), *options]) == 0
        return [line[3:] for line in capsys.readouterr().out.splitlines() if line.startswith("-> ")]

    return of


@pytest.mark.parametrize("film", ["wave_webcam/wave.mp4", "wave_webcam/stand.mp4", "florence3d_videos/1_1.avi"])
def test_mediapipe_leaves_nothing_to_do(advice, film):
    assert advice(film, "--tracker", "mediapipe") == ['nothing to do: tracker = "mediapipe" suits this picture']


@pytest.mark.parametrize(
    ("film", "options", "doubt"),
    [
        ("wave_webcam/stand.mp4", (), "the hands change places"),
        ("wave_webcam/stand.mp4", (), "the head is seen in only"),
        ("wave_webcam/wave.mp4", ("--view", "yaw:180"), "the left hand is on the right hand's side"),
        ("florence3d_videos/2_2.avi", (), "the right hand is seen in only"),
        ("pose2sim_single/videos/cam01.mp4", (), "no face tracked"),
    ],
)
def test_camshift_is_distrusted_where_it_fails(advice, film, options, doubt):
    lines = advice(film, "--tracker", "camshift", *options)
    assert any(line.startswith(doubt) for line in lines) and any("--tracker mediapipe" in line for line in lines)
