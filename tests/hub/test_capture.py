"""`labanmesh capture` over real links on this machine."""

import threading
import time

import pytest

import labanmesh
from common.capture_file import APPEARED, GONE, CaptureFile, CaptureWriter
from common.config import MeshConfig, read_scene
from common.link import Link
from common.wire import encode
from hub import capture as capturing
from hub.capture import CaptureProgress, CaptureSummary, SceneCapture, record

SOON_S = 10.0
JUDGEMENT, VERDICT = "laban/room/judgement", "laban/room/verdict"
VOCABULARY, ALIVE = "laban/room/vocabulary", "laban/room/observer/cam1/alive"


@pytest.fixture
def meeting():
    """The link of a fusion service, where all meet."""
    with Link.open(MeshConfig(), "fusion", listen=["tcp/127.0.0.1:0"]) as link:
        yield link


@pytest.fixture
def scene_file(tmp_path, meeting):
    file = tmp_path / "scene.toml"
    file.write_text(
        f'scene = "room"\n[mesh]\nendpoint = "{meeting.locator}"\n[observers.cam1]\nsource = "a.npz"\n# mine\n'
    )
    return file


@pytest.fixture
def capturer(scene_file, tmp_path):
    """A capture that goes on lap by lap; `until(condition on the records so far)` and the file's name."""
    scene = read_scene(scene_file, {})
    with (
        Link.open(scene.mesh, "hub") as link,
        CaptureWriter(tmp_path / "a.mcap", scene, scene_file.read_text(), 5) as writer,
    ):
        yield Laps(SceneCapture(scene, link, writer, time.time_ns), writer)


class Laps:
    def __init__(self, capture, writer):
        self.capture, self.writer = capture, writer

    def until(self, condition):
        deadline_s = time.monotonic() + SOON_S
        while True:
            self.capture.step()
            found = list(CaptureFile(self.writer.path).records())
            if condition(found):
                return found
            assert time.monotonic() < deadline_s, found


def of(records, kind, key):
    return [record.payload for record in records if (record.kind, record.key) == (kind, key)]


def test_everything_below_the_scene_is_written_with_its_time(meeting, capturer):
    began_ns = time.time_ns()
    mouth, other = meeting.publisher(JUDGEMENT), meeting.publisher("laban/room/observer/x/anything")
    assert mouth.wait_for_subscriber(SOON_S) and other.wait_for_subscriber(SOON_S)
    meeting.publisher("laban/elsewhere/judgement").put(b"not ours")
    payloads = [bytes([number]) for number in range(20)]
    for payload in payloads:
        mouth.put(payload)
    other.put(b"not MessagePack")
    found = capturer.until(lambda records: of(records, "put", "laban/room/observer/x/anything"))
    assert of(found, "put", JUDGEMENT) == payloads
    assert len([record for record in found if record.kind == "put"]) == len(payloads) + 1
    times = [record.arrived_ns for record in found if record.kind == "put"]
    assert times == sorted(times) and began_ns <= times[0] <= times[-1] <= time.time_ns()
    assert capturer.capture.summary.kinds == {"judgement": 20, "anything": 1}


def test_who_comes_and_goes_is_written_in_order_with_its_last_words(meeting, capturer, scene_file):
    with Link.open(read_scene(scene_file, {}).mesh, "observer") as observer:
        mouth = observer.publisher("laban/room/observer/cam1/posterior")
        observer.announce(ALIVE)
        capturer.until(lambda records: of(records, "token", ALIVE) == [APPEARED])
        assert mouth.wait_for_subscriber(SOON_S)
        mouth.put(b"last words")
        capturer.until(lambda records: of(records, "put", "laban/room/observer/cam1/posterior"))
    found = capturer.until(lambda records: GONE in of(records, "token", ALIVE))
    assert [record.payload for record in found if record.kind != "answer"] == [APPEARED, b"last words", GONE]


def test_last_values_are_asked_for_at_the_beginning(meeting, scene_file, tmp_path, said):
    verdicts = [encode(said.verdict(number)) for number in (1, 2)]
    meeting.answer(VERDICT, lambda: verdicts)
    meeting.answer(VOCABULARY, lambda: encode(said.vocabulary()))
    scene, laps = read_scene(scene_file, {}), iter((True, True))
    with (
        Link.open(scene.mesh, "hub") as link,
        CaptureWriter(tmp_path / "a.mcap", scene, "", 5) as writer,
    ):
        account = record(scene, link, writer, lambda: next(laps, False))
    found = CaptureFile(tmp_path / "a.mcap")
    assert of(found.records(), "answer", VERDICT) == verdicts
    assert of(found.records(), "answer", VOCABULARY) == [encode(said.vocabulary())]
    assert account.messages == 3 and "3 messages" in str(account) and found.complete


def test_a_vocabulary_that_comes_later_is_asked_for_again(meeting, capturer, said, monkeypatch):
    monkeypatch.setattr(capturing, "QUERY_AGAIN_NS", 1)
    meeting.announce("laban/room/fusion/fusion/alive")
    capturer.until(lambda records: of(records, "token", "laban/room/fusion/fusion/alive"))
    asked = threading.Event()

    def late():
        asked.set()
        return encode(said.vocabulary())

    meeting.answer(VOCABULARY, late)
    found = capturer.until(lambda records: of(records, "answer", VOCABULARY))
    assert of(found, "answer", VOCABULARY) == [encode(said.vocabulary())]
    asked.clear()
    for _ in range(3):
        capturer.capture.step()
    assert not asked.is_set(), "it is known: nobody needs to be asked again"
    meeting.announce("laban/room/fusion/second/alive")
    found = capturer.until(lambda records: of(records, "token", "laban/room/fusion/second/alive") and asked.is_set())
    assert of(found, "answer", VOCABULARY) == [encode(said.vocabulary())], "the same answer twice is one"


def test_progress_is_a_line_now_and_then(monkeypatch, capsys):
    now_s = [100.0]
    monkeypatch.setattr(capturing.time, "monotonic", lambda: now_s[0])
    with CaptureProgress("a.mcap") as tell:
        for second in range(25):
            now_s[0] = 100.0 + second
            tell(CaptureSummary(second, 2_500_000, second, {"judgement": second}, 0))
    said = capsys.readouterr().err.splitlines()
    assert said == [f"a.mcap: {n} messages, 2.5 MB in {n} s ({n} judgement)" for n in (10, 20)]


def test_what_came_too_fast_is_told():
    account = CaptureSummary(5, 100, 1.0, {}, 7)
    assert str(account) == "5 messages, 0.0 MB in 1 s; 7 messages lost to a full queue"


def verb(words, capsys):
    status = labanmesh.main(["capture", *map(str, words)])
    heard = capsys.readouterr()
    return status, heard.out, heard.err


def test_the_verb_writes_a_file_that_carries_the_scene(scene_file, tmp_path, capsys):
    status, out, _ = verb([scene_file, "-o", tmp_path / "b.mcap", "--for", "0"], capsys)
    assert status == 0
    assert out.splitlines()[0].startswith(f"{tmp_path / 'b.mcap'}: 0 messages")
    assert "received nothing at tcp/127.0.0.1:" in out
    found = CaptureFile(tmp_path / "b.mcap")
    assert found.text == scene_file.read_text() and found.scene.roster == ("cam1",)


def test_refusals_are_one_line(scene_file, tmp_path, capsys):
    (tmp_path / "old.mcap").write_text("old")
    for words, expected, why in (
        ([scene_file, "-o", tmp_path / "old.mcap"], 2, "captures are not overwritten"),
        ([scene_file, "-o", tmp_path / "a.bag"], 2, "ends in .mcap"),
        ([scene_file, "-o", tmp_path / "nowhere" / "a.mcap"], 1, "no such file or directory"),
        ([tmp_path / "no.toml", "-o", tmp_path / "c.mcap"], 2, "name a scene file"),
        ([scene_file], 2, "--output"),
    ):
        status, out, err = verb(words, capsys)
        assert (status, err.count("\n"), out) == (expected, 1, ""), err
        assert why in err
    assert (tmp_path / "old.mcap").read_text() == "old"
    assert not (tmp_path / "c.mcap").exists()
