"""The verb `labanmesh history`: lines, CSV and JSON of a file, and one line for what cannot be read."""

import csv
import io
import json

import pytest

from common import SECOND_NS
from hub.history.history_file import HistoryFile
from hub.history.records import HistoryRow
from labanmesh import main

NOON = 1_700_000_000 * SECOND_NS


@pytest.fixture
def scene(tmp_path):
    path = tmp_path / "s.toml"
    path.write_text('scene = "room"\n[observers.cam1]\nsource = "a.npz"\n[history]\nfile = "h.db"\n')
    with HistoryFile.to_write(tmp_path / "h.db") as file:
        for number, label in enumerate(("wave", "clap", "wave")):
            at_ns = NOON + number * 86_400 * SECOND_NS
            detail = json.dumps({"repetitions": 8, "why": 'a, "b"\n'})
            file.add(HistoryRow("verdict", f"v{number}", label, "ended", at_ns, at_ns, at_ns + SECOND_NS * 3 // 2, 0.91,
                                3, 4, detail=detail))  # fmt: skip
        file.add(HistoryRow("fall", "fall-1", "fallen", "fallen", NOON + SECOND_NS, NOON + SECOND_NS, None, 0.8, 2, 2))
        file.correct({"v1": "wave"})
    return path


def test_lines_are_grouped_by_day_and_the_oldest_come_first(scene, capsys):
    assert main(["history", str(scene)]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert len(lines) == 7 and lines[0].startswith("2023-11-1")
    assert "wave 8 times  3 of 4 agree  91%  1.5 s" in lines[1]
    assert "somebody has fallen  2 of 2 saw it  80%  not seen up again" in lines[2]
    assert "clap 8 times (was wave)" in lines[4]


def test_filters(scene, capsys):
    for words, expected in (
        (["--label", "wave"], 2),
        (["--kind", "fall"], 1),
        (["--last", "1"], 1),
        (["--from", "2023-11-16"], 1),
        (["--to", "2023-11-14"], 0),
        (["--day", "2023-11-15"], 1),
    ):
        assert main(["history", str(scene), "--json", *words]) == 0
        assert len(capsys.readouterr().out.splitlines()) == expected, words


def test_json_and_csv_hold_the_same(scene, capsys):
    assert main(["history", str(scene), "--json"]) == 0
    rows = [json.loads(line) for line in capsys.readouterr().out.splitlines()]
    assert main(["history", str(scene), "--csv"]) == 0
    table = list(csv.DictReader(io.StringIO(capsys.readouterr().out)))
    assert [row["label"] for row in table] == [row["label"] for row in rows] == ["wave", "fallen", "clap", "wave"]
    assert table[0]["why"] == rows[0]["why"] == 'a, "b"\n' and rows[0]["began"] == "2023-11-14T22:13:20.000+00:00"


@pytest.mark.parametrize(
    ("words", "fault"),
    [
        (["--kind", "dance"], "verdict or fall is expected"),
        (["--day", "monday"], "YYYY-MM-DD"),
        (["--from", "2023-13-01"], "YYYY-MM-DD"),
        (["--day", "today", "--to", "2023-11-14"], "--day stands alone"),
    ],
)
def test_bad_options_are_one_line(scene, capsys, words, fault):
    assert main(["history", str(scene), *words]) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert fault in line


def test_files_that_cannot_be_read_are_one_line(scene, capsys):
    (scene.parent / "h.db").write_bytes(b"no database" * 1000)
    for wal in scene.parent.glob("h.db-*"):
        wal.unlink()
    assert main(["history", str(scene)]) == 1
    assert "not a SQLite file" in capsys.readouterr().err
    (scene.parent / "h.db").unlink()
    assert main(["history", str(scene)]) == 1
    assert "nothing has been kept yet" in capsys.readouterr().err
    scene.write_text('scene = "room"\n[observers.cam1]\nsource = "a.npz"\n')
    assert main(["history", str(scene)]) == 2
    assert "keeps no history" in capsys.readouterr().err


def test_an_unknown_movement_names_the_nearest(scene, capsys):
    assert main(["history", str(scene), "--label", "wav"]) == 0
    assert "wave" in capsys.readouterr().err
