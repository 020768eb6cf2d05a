"""The demo as a visitor runs it, without a terminal: real processes, from motion to a table of verdicts and figures."""

import re

import pytest
from e2e_stage import run

from common.config import read_scene
from labanmesh import main
from observer.camera.files import Video
from observer.motion.archive import MotionArchive
from observer.motion.archive_file import write_archive
from observer.tracking.head import have_cascade
from studies.performer import perform, perform_continuously

PATIENCE_S = 400.0
"""On a machine that does much else beside."""


@pytest.fixture
def short_archive(tmp_path):
    """Two people to learn from and one who does one movement: the demo in a fraction of its time."""
    learned = perform(("1", "2"), ("lunging", "shake"), trials=2, seed=2)
    stream = perform_continuously("3", ("lunging",), seed=2, rest_s=(0.5, 0.6))
    path = tmp_path / "short.npz"
    write_archive(path, MotionArchive(learned.body_parts, (*learned.recordings, stream)))
    return path


@pytest.mark.skipif(not have_cascade(), reason="this OpenCV has no face cascade")
@pytest.mark.timeout(PATIENCE_S)
def test_the_demo_ends_by_itself_with_films_verdicts_against_truth_figures_and_tracks(short_archive, tmp_path):
    """The number of right verdicts depends on the load of the machine; `make demo` shows it."""
    done = run(tmp_path, "demo", "--motion", str(short_archive), "--output", "shown", timeout_s=PATIENCE_S)
    assert done.returncode == 0, done.stderr
    assert "recorded person 3 of short.npz; models learned from 2 others" in done.stdout
    assert re.search(r"this machine tracks about \d+ pictures a second in 4 processes; the demo uses 4 x", done.stdout)
    assert "of 1 right" in done.stdout and "shown/front-left-tracks.mp4" in done.stdout
    for name in ("verdicts.png", "scene.toml", "log.txt"):
        assert (tmp_path / "shown" / name).stat().st_size > 0
        assert f"shown/{name}" in done.stdout
    assert list((tmp_path / "shown").glob("belief-*.png"))
    assert "labanmesh init" in done.stdout and "labanmesh teach --rehearse" in done.stdout
    corners = read_scene(tmp_path / "shown" / "scene.toml").observers
    films = [Video.open(tmp_path / "shown" / corner.source) for corner in corners.values()]
    tracks = Video.open(tmp_path / "shown" / "front-left-tracks.mp4")
    assert len({film.count for film in films}) == 1 and films[0].count == tracks.count > 30
    assert all(film.size_px == (320, 240) for film in films)


@pytest.mark.parametrize(
    ("words", "line"),
    [
        (("--motion", "none.npz"), "none.npz"),
        (("--motion", "short.npz", "--subject", "9"), "--subject '9': not in short.npz; it has 1, 2, 3"),
    ],
)
def test_bad_input_is_one_line_and_exit_2(short_archive, tmp_path, words, line, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    assert main(["demo", *words]) == 2
    error = capsys.readouterr().err
    assert line in error and error.count("\n") == 1
