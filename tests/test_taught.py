"""The instrument for taught models: few takes by one person, with synthetic people in place of recorded ones."""

import numpy as np
import pytest

from benchmarks.command_line import run_command
from benchmarks.taught.__main__ import taught
from benchmarks.taught.few_takes import MOVEMENTS, RecordedRoom, draws, few, judge_draw, streams_of
from benchmarks.taught.judging import TaughtModels
from observer.geometry.views import parse_view
from observer.motion.archive import labels_of
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


@pytest.mark.parametrize(
    ("place", "line"),
    [(None, "LABANMESH_DATA is not set: name the folder"), ("/nowhere", "LABANMESH_DATA = '/nowhere': no such folder")],
)
def test_recordings_that_are_not_there_are_one_line(monkeypatch, capsys, place, line):
    if place is None:
        monkeypatch.delenv("LABANMESH_DATA", raising=False)
    else:
        monkeypatch.setenv("LABANMESH_DATA", place)
    assert run_command(taught, "taught", ["life"]) == 2
    err = capsys.readouterr().err
    assert err.startswith(f"taught: {line}") and err.count("\n") == 1
