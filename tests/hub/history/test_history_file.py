"""The file of a scene's history, and what happens when it cannot be used."""

import json
import os
import signal
import sqlite3
import subprocess
import sys

import pytest
from played_scene import fall_of

from benchmarks.history import WRITER
from common import SECOND_NS
from common.config_hub import HistoryConfig
from hub.database import DatabaseFault
from hub.history.history_file import DAY_NS, HistoryFile, HistoryQuery
from hub.history.records import HistoryRow, row_line, row_of
from hub.history.service import HistoryKeeper

NOON = 1_700_000_000 * SECOND_NS


def row(number=1, label="wave", at_ns=NOON, **more):
    fields = {"stage": "ended", "began_ns": at_ns - SECOND_NS, "ended_ns": at_ns, "p": 0.9, "k": 3, "n": 4, **more}
    return HistoryRow("verdict", f"v{number}", label, at_ns=at_ns, **fields)


@pytest.fixture
def path(tmp_path):
    return tmp_path / "history.db"


def test_the_last_word_on_a_movement_is_kept(path, make):
    with HistoryFile.to_write(path) as file:
        decided = make.verdict(label="ok", stage="decided", at_ns=NOON)
        ended = make.verdict(
            label="nthrow", stage="ended", at_ns=NOON + SECOND_NS, ended_ns=NOON + SECOND_NS, revises="ok"
        )
        for message in (decided, ended, decided):
            file.add(row_of(message))
        (kept,) = file.select(HistoryQuery())
        assert (kept.label, kept.stage, kept.revises, kept.ended_ns) == ("nthrow", "ended", "ok", NOON + SECOND_NS)
    assert path.stat().st_mode & 0o077 == 0


def test_a_score_is_kept_with_those_of_the_judges_or_why_there_is_none(path, make):
    remarks = ["left knee: 12 degrees too straight at 60 %"]
    scored = make.verdict(1, ended_ns=NOON, score=7.84, scores={"cam1": 7.84}, remarks=remarks)
    with HistoryFile.to_write(path) as file:
        file.add(row_of(scored), row_of(make.verdict(2, ended_ns=NOON, unscored="its begin was not seen")))
        unknown, kept = file.select(HistoryQuery())
    fields = kept.as_json()
    assert (fields["score"], fields["scores"], fields["remarks"]) == (7.84, {"cam1": 7.84}, remarks)
    assert "nthrow 7.8 of 10" in row_line(kept)[1] and kept.as_page()[-1] == 7.84
    assert unknown.as_json()["unscored"] == "its begin was not seen" and unknown.as_page()[-1] is None
    assert "nthrow (not scored, its begin was not seen)" in row_line(unknown)[1]


def test_a_fall_is_kept_from_the_alarm_on_and_ends_when_the_person_is_up(path):
    with HistoryFile.to_write(path) as file:
        assert row_of(fall_of("low")) is None and row_of(fall_of("up", id=None)) is None
        file.add(row_of(fall_of()))
        assert file.select(HistoryQuery(kind="fall"))[0].ended_ns is None
        file.add(row_of(fall_of("up", at_ns=NOON + 9 * SECOND_NS)))
        (kept,) = file.select(HistoryQuery(kind="fall"))
        assert kept.ended_ns == NOON + 9 * SECOND_NS and kept.began_ns == NOON and kept.k == 2
        file.add(row_of(fall_of("up", id="fall-2")))
        assert file.rows == 1, "whoever lay for a moment has not fallen"
        assert "up again after 9.0 s" in row_line(kept)[1]


def test_what_is_old_or_too_much_is_deleted_and_leaves_nothing(path):
    with HistoryFile.to_write(path) as file:
        file.add(*(row(n, "secretword", NOON - n * DAY_NS) for n in range(10)))
        assert file.delete_old(NOON, 3.5, 100) == 0, "a fusion machine whose clock is wrong costs no row"
        file._connection.execute("UPDATE events SET kept_s = at_ns / 1000000000")
        assert file.delete_old(NOON, 3.5, 100) == 6 and file.rows == 4
        file.add(*(row(n, at_ns=NOON + n, detail=json.dumps({"why": "x" * 2000})) for n in range(100, 2000)))
        file.delete_old(NOON, 30, 1)
        assert 0 < file.rows < 600
        assert file.select(HistoryQuery(limit=1))[0].id == "v1999"
        file.forget("secretword")
    content = b"".join(each.read_bytes() for each in path.parent.iterdir())
    assert b"secretword" not in content


def test_corrections_and_forgetting(path):
    with HistoryFile.to_write(path) as file:
        file.add(row(1), row(2, "clap"), row(3, "bow"))
        assert file.correct({"v1": "clap", "v3": "", "unknown": "bow"}) == 2
        kept = {each.id: each.corrected for each in file.select(HistoryQuery())}
        assert kept == {"v1": "clap", "v2": None, "v3": ""}
        file.add(row(1, at_ns=NOON + 1))
        assert {each.id: each.corrected for each in file.select(HistoryQuery())}["v1"] == "clap"
        assert file.forget("clap") == 2 and file.labels() == ["bow"]
        assert file.forget() == 1 and file.rows == 0


def test_no_row_that_was_acknowledged_is_lost_by_a_kill(path):
    """Ten kills here; `python -m benchmarks.history` does a hundred."""
    for _ in range(10):
        with subprocess.Popen([sys.executable, "-c", WRITER, str(path)], stdout=subprocess.PIPE) as writer:
            lines = [writer.stdout.readline() for _ in range(5)]
            os.kill(writer.pid, signal.SIGKILL)
            lines += writer.stdout.read().splitlines(keepends=True)
        acknowledged = max(int(line) for line in lines if line.endswith(b"\n"))
        with HistoryFile.to_read(path) as file:
            assert file.rows >= acknowledged


class Keeper:
    """A keeper whose time the test sets."""

    def __init__(self, path):
        self.now_s, self.path = 0.0, path
        self.keeper = HistoryKeeper(path, HistoryConfig(file="h.db"), lambda: self.now_s, lambda: NOON)

    def later(self):
        self.now_s += 10
        self.keeper.work()

    def kept(self):
        with HistoryFile.to_read(self.path) as file:
            return file.rows


def test_a_locked_file_loses_nothing_and_is_one_line(path, caplog, monkeypatch):
    monkeypatch.setattr("hub.history.service.KEEPER_BUSY_S", 0.05)
    keeper = Keeper(path)
    keeper.keeper.add(row(1))
    other = sqlite3.connect(path, isolation_level=None)
    other.execute("BEGIN EXCLUSIVE")
    for number in range(2, 5):
        keeper.keeper.add(row(number))
        keeper.later()
    assert caplog.text.count("locked by another program") == 1
    other.execute("ROLLBACK")
    other.close()
    keeper.later()
    assert keeper.kept() == 4 and "can be written again" in caplog.text


def test_a_damaged_file_is_moved_aside_and_a_new_one_begun(path, caplog):
    path.write_bytes(b"this is no database at all, and long enough to be looked at" * 50)
    keeper = Keeper(path)
    keeper.keeper.add(row(1))
    keeper.later()
    assert keeper.kept() == 1 and caplog.text.count("not a SQLite file") == 1
    assert [each.name for each in path.parent.glob("*damaged-*")] == [f"history.db.damaged-{NOON // SECOND_NS}"]


def test_a_file_of_a_newer_version_is_left_alone(path, caplog):
    with HistoryFile.to_write(path) as file:
        file.add(row(1))
    with sqlite3.connect(path) as newer:
        newer.execute("PRAGMA user_version = 7")
    newer.close()
    with pytest.raises(DatabaseFault, match="version 7, written by a newer labanmesh; this one reads up to 1"):
        HistoryFile.to_read(path)
    Keeper(path).keeper.add(row(2))
    assert caplog.text.count("newer labanmesh") == 1 and not list(path.parent.glob("*damaged*"))


def test_a_full_disk_loses_nothing_that_fits_into_memory(path, caplog):
    keeper = Keeper(path)
    keeper.keeper.add(row(1))
    connection = keeper.keeper._file._connection
    pages = connection.execute("PRAGMA page_count").fetchone()[0]
    connection.execute(f"PRAGMA max_page_count = {pages}")
    keeper.keeper.add(row(2, detail=json.dumps({"why": "x" * 100_000})))
    assert caplog.text.count("the disk is full; make room") == 1
    keeper.later()
    assert keeper.kept() == 2


def test_a_folder_that_is_not_there_is_one_line(tmp_path, caplog):
    Keeper(tmp_path / "nowhere" / "history.db").keeper.add(row(1))
    assert "no such file or directory" in caplog.text


def test_a_clock_that_was_set_back_is_one_line_and_loses_nothing(path, caplog):
    keeper = Keeper(path)
    for number, hour in enumerate((10, 11, 5, 6, 7)):
        keeper.keeper.add(row(number, at_ns=NOON + hour * 3600 * SECOND_NS))
    assert keeper.kept() == 5 and caplog.text.count("was set back by 21600 s") == 1


def test_waiting_rows_are_bounded_and_counted(path, monkeypatch):
    monkeypatch.setattr("hub.history.service.WAITING_LIMIT", 3)
    keeper = Keeper(path.parent / "nowhere" / "h.db")
    keeper.keeper._waiting = type(keeper.keeper._waiting)(maxlen=3)
    for number in range(5):
        keeper.keeper.add(row(number))
    assert keeper.keeper.lost == 2
