"""`labanmesh capture` over real links on this machine."""

import threading
import time

import pytest
from processes import SOON_S

import labanmesh
from common.arrival import APPEARED, GONE
from common.capture_file import CaptureFile, CaptureWriter
from common.config import read_scene
from common.link import Link
from common.wire import encode
from hub import capture as capturing
from hub.capture import CaptureSummary, SceneCapture, record

JUDGEMENT, VERDICT, ANYTHING = "laban/room/judgement", "laban/room/verdict", "laban/room/observer/x/anything"
VOCABULARY, ALIVE = "laban/room/vocabulary", "laban/room/observer/cam1/alive"


@pytest.fixture
def scene_file(fusion, scene_file):
    return scene_file(fusion.locator, "# mine\n")


class Steps:
    """A capture that goes on step by step, until a condition on its records holds."""

    def __init__(self, capture, writer):
        self.capture, self.writer = capture, writer

    def until(self, condition):
        deadline_s = time.monotonic() + SOON_S
        while True:
            self.capture.step()
            records = list(CaptureFile(self.writer.path).records())
            if condition(records):
                return records
            assert time.monotonic() < deadline_s, records


@pytest.fixture
def steps(scene_file, tmp_path):
    scene = read_scene(scene_file, {})
    with (
        Link.open(scene.mesh, "hub") as link,
        CaptureWriter(tmp_path / "a.mcap", scene, scene_file.read_text(), 5) as writer,
    ):
        yield Steps(SceneCapture(scene, link, writer, time.time_ns), writer)


def of(records, kind, key):
    return [each.payload for each in records if (each.kind, each.key) == (kind, key)]


def test_everything_below_the_scene_is_written_with_its_time(fusion, steps):
    began_ns = time.time_ns()
    judgements, other = fusion.publisher(JUDGEMENT), fusion.publisher(ANYTHING)
    assert judgements.wait_for_subscriber(SOON_S) and other.wait_for_subscriber(SOON_S)
    fusion.publisher("laban/elsewhere/judgement").put(b"not ours")
    payloads = [bytes([number]) for number in range(20)]
    for payload in payloads:
        judgements.put(payload)
    other.put(b"not MessagePack")
    records = steps.until(lambda records: of(records, "put", ANYTHING))
    assert of(records, "put", JUDGEMENT) == payloads
    times = [each.arrived_ns for each in records if each.kind == "put"]
    assert len(times) == len(payloads) + 1
    assert times == sorted(times) and began_ns <= times[0] <= times[-1] <= time.time_ns()
    assert steps.capture.summary.kinds == {"judgement": 20, "anything": 1}


def test_an_observer_that_comes_and_goes_is_written_in_order(steps, scene_file):
    posterior = "laban/room/observer/cam1/posterior"
    with Link.open(read_scene(scene_file, {}).mesh, "observer") as observer:
        publisher = observer.publisher(posterior)
        observer.announce(ALIVE)
        steps.until(lambda records: of(records, "token", ALIVE) == [APPEARED])
        assert publisher.wait_for_subscriber(SOON_S)
        publisher.put(b"the last message")
        steps.until(lambda records: of(records, "put", posterior))
    records = steps.until(lambda records: GONE in of(records, "token", ALIVE))
    assert [each.payload for each in records if each.kind != "answer"] == [APPEARED, b"the last message", GONE]


def test_last_values_are_queried_at_the_start_and_progress_is_lines(
    fusion, scene_file, tmp_path, make, monkeypatch, capsys
):
    monkeypatch.setattr(capturing, "PROGRESS_EVERY_S", 0.0)
    verdicts = [encode(make.verdict(number)) for number in (1, 2)]
    fusion.answer(VERDICT, lambda: verdicts)
    fusion.answer(VOCABULARY, lambda: encode(make.vocabulary()))
    scene, go_on = read_scene(scene_file, {}), iter((True, True))
    with Link.open(scene.mesh, "hub") as link, CaptureWriter(tmp_path / "a.mcap", scene, "", 5) as writer:
        summary = record(scene, link, writer, lambda: next(go_on, False))
    file = CaptureFile(tmp_path / "a.mcap")
    assert of(file.records(), "answer", VERDICT) == verdicts
    assert of(file.records(), "answer", VOCABULARY) == [encode(make.vocabulary())]
    assert summary.messages == 3 and file.complete
    assert capsys.readouterr().err.splitlines()[-1].startswith(f"{tmp_path / 'a.mcap'}: 3 messages, 0.0 MB in ")


def test_a_missing_vocabulary_is_queried_again(fusion, steps, make, monkeypatch):
    monkeypatch.setattr(capturing, "QUERY_AGAIN_NS", 1)
    fusion.announce("laban/room/fusion/fusion/alive")
    steps.until(lambda records: of(records, "token", "laban/room/fusion/fusion/alive"))
    queried = threading.Event()

    def late():
        queried.set()
        return encode(make.vocabulary())

    fusion.answer(VOCABULARY, late)
    records = steps.until(lambda records: of(records, "answer", VOCABULARY))
    assert of(records, "answer", VOCABULARY) == [encode(make.vocabulary())]
    queried.clear()
    for _ in range(3):
        steps.capture.step()
    assert not queried.is_set(), "it is known"
    fusion.announce("laban/room/fusion/second/alive")
    alive = "laban/room/fusion/second/alive"
    records = steps.until(lambda records: of(records, "token", alive) and queried.is_set())
    assert of(records, "answer", VOCABULARY) == [encode(make.vocabulary())], "the same answer is written once"


def test_what_was_captured_is_one_line():
    assert str(CaptureSummary(5, 100, 1.0, {}, 7)) == "5 messages, 0.0 MB in 1 s; 7 messages lost to a full queue"
    assert str(CaptureSummary(1, 100, 1.0, {}, 1)) == "1 message, 0.0 MB in 1 s; 1 message lost to a full queue"


def capture(words, capsys):
    status = labanmesh.main(["capture", *map(str, words)])
    output = capsys.readouterr()
    return status, output.out, output.err


def test_the_verb_writes_a_file_that_holds_the_scene(scene_file, tmp_path, capsys):
    status, out, _ = capture([scene_file, "-o", tmp_path / "b.mcap", "--for", "0"], capsys)
    assert status == 0 and out.splitlines()[0].startswith(f"{tmp_path / 'b.mcap'}: 0 messages")
    assert "received nothing at tcp/127.0.0.1:" in out and f"labanmesh up {scene_file}" in out
    file = CaptureFile(tmp_path / "b.mcap")
    assert file.text == scene_file.read_text() and file.scene.roster == ("cam1", "cam2")


def test_refusals_are_one_line(scene_file, tmp_path, capsys):
    (tmp_path / "old.mcap").write_text("old")
    for words, expected, reason in (
        ([scene_file, "-o", tmp_path / "old.mcap"], 2, "old.mcap"),
        ([scene_file, "-o", tmp_path / "a.bag"], 2, ".mcap"),
        ([scene_file, "-o", tmp_path / "nowhere" / "a.mcap"], 1, "no such file or directory"),
        ([tmp_path / "no.toml", "-o", tmp_path / "c.mcap"], 2, "no.toml"),
        ([scene_file], 2, "--output"),
    ):
        status, out, err = capture(words, capsys)
        assert (status, err.count("\n"), out) == (expected, 1, ""), err
        assert reason in err
    assert (tmp_path / "old.mcap").read_text() == "old"
    assert not (tmp_path / "c.mcap").exists()
