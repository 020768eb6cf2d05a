"""`labanmesh score`: from archives to scores, remarks, JSON and figures; what is not scored is one line."""

import json
from dataclasses import replace

import numpy as np
import pytest

import labanmesh
from observer.motion.archive import MotionArchive
from observer.motion.archive_file import write_archive
from studies.performer import perform
from studies.scoring.judging import mirrored

VIEWS = ("--views", "door,yaw:45")


@pytest.fixture(scope="module")
def archives(tmp_path_factory):
    """Three people who show a movement, and a fourth one who does it well, with half of the size, and another one."""
    folder = tmp_path_factory.mktemp("score")
    shown = perform(people=("1", "2", "3"), movements=("byebye",), trials=2)
    own = perform(people=("4",), movements=("byebye", "lunging"), trials=1)
    well, other = own.recordings
    middle = well.positions[:1]
    small = replace(well, trial="small", positions=(middle + 0.4 * (well.positions - middle)).astype(np.float32))
    write_archive(folder / "shown.npz", shown)
    write_archive(
        folder / "own.npz", MotionArchive(own.body_parts, (well, small, replace(other, label="byebye", trial="other")))
    )
    return folder


def run(archives, capsys, *words):
    status = labanmesh.main(["score", str(archives / "own.npz"), *words])
    return status, capsys.readouterr()


def test_a_good_performance_scores_higher_than_a_small_one(archives, capsys):
    status, shown = run(archives, capsys, "--references", str(archives / "shown.npz"), *VIEWS, "--json")
    rows = {row["trial"]: row for row in map(json.loads, shown.out.splitlines())}
    assert status == 0 and rows["1"]["score"] > rows["small"]["score"]
    assert set(rows["1"]["judges"]) == {"door", "yaw:45"} and rows["1"]["references"] == 6
    lines = run(archives, capsys, "--references", str(archives / "shown.npz"), *VIEWS, "--trials", "1")[1].out
    assert lines.startswith("byebye, person 4, trial 1: ") and "of 10 (door" in lines and "6 reference takes" in lines


def test_a_take_is_no_reference_for_itself(archives, capsys):
    file = str(archives / "own.npz")
    shown = run(archives, capsys, "--references", file, *VIEWS, "--trials", "1", "--label", "byebye")[1].out
    assert "not scored, 2 reference takes" in shown


def test_the_figure_is_a_picture(archives, capsys, tmp_path):
    words = (
        "--references",
        str(archives / "shown.npz"),
        *VIEWS,
        "--trials",
        "small",
        "--report",
        str(tmp_path / "out"),
    )
    assert run(archives, capsys, *words)[0] == 0
    (file,) = (tmp_path / "out").iterdir()
    text = file.read_text()
    assert text.startswith("<svg ") and text.endswith("</svg>\n") and "nan" not in text


def test_without_references_of_it_nothing_is_scored(archives, capsys):
    status, shown = run(archives, capsys, *VIEWS, "--trials", "1")
    assert status == 0 and "not scored, 0 reference takes: a score needs at least 3" in shown.out


@pytest.mark.parametrize(
    ("words", "rule"),
    [(("--label", "waltz"), "no recording of waltz"), (("--views", "door,,wheel"), "a name is missing between commas")],
)
def test_bad_input_is_one_line(archives, capsys, words, rule):
    status, shown = run(archives, capsys, *words)
    assert status == 2 and rule in shown.err and len(shown.err.splitlines()) == 1


def test_mirrored_twice_is_as_it_was():
    (take,) = perform(people=("1",), movements=("byebye",), trials=1).recordings
    parts = perform(people=("1",), movements=("byebye",), trials=1).body_parts
    assert np.array_equal(mirrored(mirrored(take, parts), parts).positions, take.positions)
    assert not np.array_equal(mirrored(take, parts).positions, take.positions)
