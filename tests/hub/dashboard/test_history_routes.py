"""The day page and the history as JSON: token, filters, faults in one line; corrections and forgetting."""

import pytest
from asgi_answers import answers_of

from common import SECOND_NS
from common.clip_name import clip_name
from common.config import read_scene
from common.teaching_messages import Unwanted
from hub.dashboard.access import AccessControl
from hub.dashboard.application import application
from hub.dashboard.history_routes import history_routes
from hub.history.history_file import HistoryFile, HistoryQuery, forget_in_history, note_corrections
from hub.history.records import HistoryRow

TOKEN = "a-word-of-sixteen-and-more"  # noqa: S105 - a test
NOON_MS = 1_700_000_000_000


def scene_of(tmp_path, more='[history]\nfile = "h.db"\n'):
    (tmp_path / "s.toml").write_text(f'scene = "room"\n[observers.cam1]\nsource = "a.npz"\n{more}')
    return read_scene(tmp_path / "s.toml", {})


@pytest.fixture
def scene(tmp_path):
    scene = scene_of(tmp_path)
    with HistoryFile.to_write(tmp_path / "h.db") as file:
        for number, label in enumerate(("wave", "clap", "wave")):
            at_ns = (NOON_MS + number * 1000) * 10**6
            detail = '{"repetitions": 8}'
            file.add(HistoryRow("verdict", f"v{number}", label, "ended", at_ns, at_ns, at_ns + SECOND_NS, 0.91, 3, 4,
                                detail=detail))  # fmt: skip
    return scene


def got(scene, path, token=None, allowed=True, given=None, teaches=True, shows_clips=True):
    app = application(
        AccessControl(token), None, lambda: False, more=history_routes(scene, teaches, allowed, shows_clips)
    )
    headers = {"authorization": f"Bearer {given}"} if given else {}
    return answers_of(app, ("GET", path, {"headers": headers}))[0]


def test_programs_get_the_rows_with_filters(scene):
    whole = got(scene, "/history/data").json()
    assert whole["labels"] == ["clap", "wave"] and whole["remembered"] == 600_000 and whole["scene"] == "room"
    rows = [dict(zip(whole["fields"], row, strict=True)) for row in whole["rows"]]
    assert [row["id"] for row in rows] == ["v2", "v1", "v0"] and rows[2]["began"] == NOON_MS
    assert rows[0]["repetitions"] == 8 and rows[0]["p"] == 0.91 and rows[0]["corrected"] is None
    assert len(got(scene, "/history/data?label=wave").json()["rows"]) == 2
    assert len(got(scene, f"/history/data?from={NOON_MS + 500}&until={NOON_MS + 1500}").json()["rows"]) == 1
    assert len(got(scene, "/history/data?kind=fall").json()["rows"]) == 0
    assert len(got(scene, "/history/data?limit=1").json()["rows"]) == 1
    assert got(scene, "/history/data", teaches=False).json()["remembered"] == 0


@pytest.mark.parametrize("query", ["kind=dance", "from=now", "from=-1", f"until={10**30}", "limit=1e9", "limit=20001"])
def test_bad_queries_are_one_line(scene, query):
    answer = got(scene, f"/history/data?{query}")
    assert answer.status_code == 400 and answer.text.count("\n") == 1 and "expected" in answer.text


def test_the_token_and_the_right_guard_the_history(scene):
    for path in ("/day", "/day.js", "/history/data"):
        assert got(scene, path, TOKEN).status_code == 401
        assert got(scene, path, TOKEN, given=TOKEN).status_code == 200
    answer = got(scene, "/history/data", allowed=False)
    assert answer.status_code == 403 and "secure add" in answer.text
    assert got(scene, "/history/data").headers["cache-control"] == "no-store"


def test_clips_on_this_machine_are_offered_with_the_right_to_pictures(scene, tmp_path):
    folder = tmp_path / "clips"
    folder.mkdir()
    name = clip_name(NOON_MS * 10**6, "cam1", "wave", "v0")
    (folder / name).write_bytes(b"film")
    (folder / "secret.txt").write_text("no clip")
    scene = scene_of(tmp_path, '[observers.cam1.clips]\nfolder = "clips"\n[history]\nfile = "h.db"\n')
    assert got(scene, "/history/data").json()["clips"] == {"v0": [["cam1", "v0"]]}
    answer = got(scene, "/history/clip/cam1/v0")
    assert answer.content == b"film" and name in answer.headers["content-disposition"]
    for wrong in ("cam1/v1", "cam2/v0", "cam1/..%2Fsecret.txt", "cam1/secret.txt"):
        assert got(scene, f"/history/clip/{wrong}").status_code == 404
    assert got(scene, "/history/clip/cam1/v0", TOKEN).status_code == 401
    assert got(scene, "/history/clip/cam1/v0", shows_clips=False).status_code == 404
    assert got(scene, "/history/data", shows_clips=False).json()["clips"] == {}


def test_what_cannot_be_read_is_one_line(scene, tmp_path):
    assert got(scene_of(tmp_path, ""), "/history/data").status_code == 404
    for each in tmp_path.glob("h.db*"):
        each.unlink()
    answer = got(scene, "/history/data")
    assert answer.status_code == 503
    assert (
        answer.text
        == "Nothing has been kept yet; labanmesh up, or labanmesh hub events, keeps what happens from then on.\n"
    )
    assert history_routes(None, teaches=False) == []


def test_corrections_and_forgetting_reach_the_file(scene, tmp_path):
    note_corrections(scene, {"v0": "clap", "moment-1": "bow"})
    assert forget_in_history(scene, Unwanted("anna", "", everything=False)).startswith("history: says of nobody")
    with HistoryFile.to_read(tmp_path / "h.db") as file:
        assert {row.id: row.corrected for row in file.select(HistoryQuery())} == {"v0": "clap", "v1": None, "v2": None}
    assert forget_in_history(scene, Unwanted("", "clap", everything=False)) == "history: 2 rows removed"
    assert forget_in_history(scene, Unwanted("", "", everything=True)) == "history: 1 row removed"
    assert forget_in_history(scene_of(tmp_path, ""), Unwanted("", "wave", everything=False)) == ""
    elsewhere = scene_of(tmp_path, '[history]\nfile = "other.db"\n')
    assert "not on this machine" in forget_in_history(elsewhere, Unwanted("", "wave", everything=False))
    assert not (tmp_path / "other.db").exists()


def test_a_correction_that_cannot_be_written_is_one_line(scene, tmp_path, caplog):
    (tmp_path / "h.db").write_bytes(b"no database" * 500)
    note_corrections(scene, {"v0": "clap"})
    assert caplog.text.count("not corrected there") == 1
