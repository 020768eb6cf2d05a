"""The demo without a terminal: real processes, from motion to a table of verdicts and figures."""

import re

import pytest

from common.config import read_scene
from common.vocabulary import Vocabulary
from labanmesh import main
from observer.camera.files import Video
from observer.tracking.head import have_cascade
from studies.demo_scene import Performance
from studies.performer import perform, perform_continuously

PATIENCE_S = 400.0
"""On a machine that does much else beside."""


def short_performance(seed):
    """Two people to learn from and one who does one movement: the demo in a fraction of its time."""
    learned = perform(("1", "2"), ("lunging", "shake"), trials=2, seed=2)
    stream = perform_continuously("3", ("lunging",), seed=2, rest_s=(0.5, 0.6))
    return Performance("SYNTHETIC, short", stream, learned, Vocabulary(("lunging", "shake")))


@pytest.mark.skipif(not have_cascade(), reason="this OpenCV has no face cascade")
@pytest.mark.timeout(PATIENCE_S)
def test_the_demo_ends_by_itself_with_films_verdicts_against_truth_figures_and_tracks(tmp_path, monkeypatch, capsys):
    """The number of right verdicts depends on the load of the machine; `make demo` shows it."""
    monkeypatch.setattr("studies.demo_scene.synthetic_performance", short_performance)
    monkeypatch.chdir(tmp_path)
    status = main(["demo", "--output", "shown"])
    shown = capsys.readouterr()
    assert status == 0, shown.err
    assert re.search(r"this machine tracks about \d+ pictures a second in 4 processes; the demo uses 4 x", shown.out)
    assert "of 1 right" in shown.out and "shown/front-left-tracks.mp4" in shown.out
    for name in ("verdicts.png", "scene.toml", "log.txt"):
        assert (tmp_path / "shown" / name).stat().st_size > 0
        assert f"shown/{name}" in shown.out
    assert list((tmp_path / "shown").glob("belief-*.png"))
    assert "labanmesh init" in shown.out and "labanmesh teach --rehearse" in shown.out
    corners = read_scene(tmp_path / "shown" / "scene.toml").observers
    films = [Video.open(tmp_path / "shown" / corner.source) for corner in corners.values()]
    tracks = Video.open(tmp_path / "shown" / "front-left-tracks.mp4")
    assert len({film.count for film in films}) == 1 and films[0].count == tracks.count > 30
    assert all(film.size_px == (320, 240) for film in films)
