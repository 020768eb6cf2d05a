"""The instrument for taught models: few takes by one person, with synthetic people in place of recorded ones."""

import numpy as np
import pytest

from benchmarks.command_line import run_command
from benchmarks.taught.__main__ import taught
from benchmarks.taught.begins import and_back, seconds_until_still, watched
from benchmarks.taught.few_takes import MOVEMENTS, RecordedRoom, draws, few, judge_draw, streams_of
from benchmarks.taught.judging import TaughtModels
from benchmarks.taught.sensors import paired
from hub.teaching.beginning import STANDS_S
from observer.geometry.views import parse_view
from observer.motion.archive import Recording, labels_of
from observer.tracks import BODY_PARTS
from studies.performer import perform

LABELS = ("ok", "shake", "lunging", "byebye")


def room(trials=2):
    archive = perform(("1", "2"), LABELS, trials=trials, seed=3)
    views = {"sofa": parse_view("yaw:-20"), "shelf": parse_view("yaw:50")}
    return RecordedRoom("synthetic", dict.fromkeys(views, archive), views, trials)


def test_every_take_is_judged_by_models_of_the_others_and_so_are_other_movements():
    here = room()
    (draw,) = draws(here, 1, seed=5)
    result = judge_draw(draw, here, TaughtModels("phase"))
    assert (result.takes, result.learned) == (2 * MOVEMENTS, 1)
    assert result.right >= 4 and result.right <= result.named and result.minutes > 0


def test_both_cameras_see_the_same_performance_and_at_most_five_takes_are_learned():
    here = room(trials=6)
    takes = [r for r in here.space["sofa"].recordings if r.subject == "1"]
    assert len(few(takes)) == 5 * len(LABELS)
    streams = streams_of(here, takes[:2], seed=1)
    sofa, shelf = streams.values()
    assert sofa.spans == shelf.spans and [s.label for s in sofa.spans] == sorted(t.label for t in takes[:2])
    np.testing.assert_allclose(sofa.positions[..., 1], shelf.positions[..., 1], atol=1e-5)
    assert labels_of(here.seen({"sofa": takes})["sofa"]) == LABELS


def test_a_sign_is_given_once_somebody_stands_still_for_long_enough():
    moving, still = np.linspace(0, 300, 45), np.full(45, 300.0)
    hand = np.concatenate([moving, still])
    rest = np.array([[280.0, 300.0], [360.0, 300.0], [320.0, 100.0]])
    centres = np.array([rest + np.array([[0, 0], [0, -v], [0, 0]]) for v in hand])
    observer = watched(centres, 15.0, BODY_PARTS)
    assert seconds_until_still([observer], 0.5) == pytest.approx(2.5 + STANDS_S, abs=0.7)
    assert seconds_until_still([observer], 5.2) == float("inf")
    twice = and_back(Recording(np.repeat(rest[None], 10, 0).astype(np.float32), 10.0, "clap", "1", "1"))
    assert len(twice.positions) == 10 + 10 + 5 + 10


def test_differences_between_two_ways_are_paired_over_the_performances():
    change = np.array([[1.0, -1, 0, 0], [1, 0, 0, 0]])
    assert paired(change).startswith("+0.125 (") and paired(change).endswith("2 better, 1 worse of 8")


@pytest.mark.parametrize(
    ("place", "line"),
    [(None, "LABANMESH_DATA is not set: name the folder"), ("/nowhere", "LABANMESH_DATA = '/nowhere': no such folder")],
)
def test_recordings_that_are_not_there_are_one_line(monkeypatch, capsys, place, line):
    if place is None:
        monkeypatch.delenv("LABANMESH_DATA", raising=False)
    else:
        monkeypatch.setenv("LABANMESH_DATA", place)
    assert run_command(taught, "taught", ["clips"]) == 2
    err = capsys.readouterr().err
    assert err.startswith(f"taught: {line}") and err.count("\n") == 1
