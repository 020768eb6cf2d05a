"""Capture files: what was flushed is readable, whenever the writer is killed."""

import json
import subprocess
import sys
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from mcap.reader import make_reader
from mcap.writer import CompressionType, Writer
from processes import SOON_S

from common import capture_file
from common.arrival import APPEARED, GONE, CaptureRecord
from common.capture_file import CHANNELS_LIMIT, CaptureFile, CaptureWriter
from common.config import ObserverConfig, Scene
from common.errors import BadInput, LabanmeshError

ROOT = Path(__file__).parents[2]
SCENE = Scene(scene="dojo", observers={"cam1": ObserverConfig(source="m.npz", size_px=(640, 480), recording="all")})
TEXT = 'scene = "dojo"\n# Dōjō\n'
RECORDS = [
    CaptureRecord("token", "laban/dojo/observer/cam1/alive", APPEARED, 900),
    CaptureRecord("answer", "laban/dojo/vocabulary", b"names", 1000),
    CaptureRecord("put", "laban/dojo/vocabulary", b"", 1001),
    CaptureRecord("put", "laban/dojo/judgement", b"\xff" * 300, 1002),
    CaptureRecord("token", "laban/dojo/observer/cam1/alive", GONE, 999),
]
ONE = st.builds(
    CaptureRecord,
    kind=st.sampled_from(("put", "answer", "token")),
    key=st.sampled_from(("laban/dojo/judgement", "laban/dojo/observer/cam1/posterior", "laban/dojo/é")),
    payload=st.binary(max_size=50),
    arrived_ns=st.integers(0, 2**63 - 1),
)


def write(path, records=RECORDS, scene=SCENE):
    with CaptureWriter(path, scene, TEXT, 5) as writer:
        for record in records:
            writer.write(record)
    return path


@settings(max_examples=30, suppress_health_check=[HealthCheck.function_scoped_fixture], deadline=None)
@given(records=st.lists(ONE, max_size=20))
def test_records_survive_the_round_trip(tmp_path, records):
    path = tmp_path / "a.mcap"
    path.unlink(missing_ok=True)
    capture = CaptureFile(write(path, records))
    assert list(capture.records()) == records == list(capture.records())
    assert capture.complete and capture.text == TEXT
    assert capture.scene.model_dump() == SCENE.model_dump()


def test_a_file_truncated_anywhere_gives_its_complete_records(tmp_path):
    whole = write(tmp_path / "whole.mcap").read_bytes()
    cut, counts = tmp_path / "cut.mcap", set()
    for size in range(len(whole)):
        cut.write_bytes(whole[:size])
        try:
            capture = CaptureFile(cut)
        except BadInput as error:
            assert str(error).count("\n") == 0 and "cut.mcap" in str(error)
            counts.add(-1)
            continue
        records = list(capture.records())
        assert records == RECORDS[: len(records)] and not capture.complete
        counts.add(len(records))
    assert counts == {-1, *range(len(RECORDS) + 1)}


def test_flushed_records_are_readable_before_the_end(tmp_path):
    writer = CaptureWriter(tmp_path / "a.mcap", SCENE, TEXT, 5)
    assert list(CaptureFile(writer.path).records()) == []
    for count, record in enumerate(RECORDS, 1):
        writer.write(record)
        writer.flush()
        assert list(CaptureFile(writer.path).records()) == RECORDS[:count]
        assert writer.size == writer.path.stat().st_size
    writer.close()
    writer.close()


@settings(max_examples=60, suppress_health_check=[HealthCheck.function_scoped_fixture], deadline=None)
@given(place=st.floats(0, 1, exclude_max=True), value=st.integers(0, 255))
def test_a_damaged_file_is_one_line(tmp_path, place, value):
    path = tmp_path / "a.mcap"
    path.unlink(missing_ok=True)
    damaged = bytearray(write(path).read_bytes())
    damaged[int(place * len(damaged))] = value
    path.write_bytes(damaged)
    try:
        assert len(list(CaptureFile(path).records())) <= len(RECORDS) + 1
    except LabanmeshError as error:
        assert str(error).count("\n") == 0 and str(path) in str(error)


def test_a_time_that_no_message_can_have_is_one_line(tmp_path):
    with CaptureWriter(tmp_path / "a.mcap", SCENE, TEXT, 5) as writer:
        writer.write(replace(RECORDS[0], arrived_ns=2**63))
    with pytest.raises(LabanmeshError, match=r"a\.mcap: damaged: a message from after the year 2262"):
        list(CaptureFile(tmp_path / "a.mcap").records())


def test_a_damaged_length_reserves_no_memory(tmp_path):
    path = write(tmp_path / "a.mcap")
    damaged = bytearray(path.read_bytes())
    place = damaged.index(TEXT.encode())
    damaged[place - 8 : place] = (2**62).to_bytes(8, "little")
    path.write_bytes(damaged)
    assert list(CaptureFile(path).records()) == []


def test_any_mcap_reader_can_read_a_capture(tmp_path):
    with write(tmp_path / "a.mcap").open("rb") as stream:
        reader = make_reader(stream)
        topics = [channel.topic for _, channel, _ in reader.iter_messages(log_time_order=False)]
        assert topics == [record.key for record in RECORDS]
        assert {channel.message_encoding for channel in reader.get_summary().channels.values()} == {"msgpack"}
        assert [each.data.decode() for each in reader.iter_attachments()] == [TEXT]


def test_a_capture_of_an_earlier_version_is_read_without_the_keys_that_are_gone(tmp_path):
    """An earlier version wrote all keys with their defaults, also those that nobody had set."""
    written = json.loads(SCENE.model_dump_json())
    name = next(iter(written["observers"]))
    written["observers"][name] |= {"virtual": {"noise": 2.0, "seed": 1}, "preview": False}
    before = SimpleNamespace(model_dump_json=lambda: json.dumps(written))
    assert CaptureFile(write(tmp_path / "a.mcap", scene=before)).scene == SCENE

    written["observers"][name]["sauce"] = "0"
    path = write(tmp_path / "b.mcap", scene=before)
    with pytest.raises(BadInput, match="its scene cannot be used here"):
        CaptureFile(path)


def test_errors_of_reading_name_the_reason(tmp_path, monkeypatch):
    def fault(name, content=None):
        if content is not None:
            (tmp_path / name).write_bytes(content)
        with pytest.raises(BadInput) as error:
            CaptureFile(tmp_path / name)
        return str(error.value)

    assert "no such file" in fault("none.mcap")
    assert "is a directory" in fault(".")
    assert "empty; nothing was captured" in fault("empty.mcap", b"")
    assert "not a capture; name a file" in fault("picture.mcap", b"\x89PNG\r\n\x1a\n" + bytes(100))
    whole = write(tmp_path / "whole.mcap").read_bytes()
    assert "cut off before the first message" in fault("cut.mcap", whole[:40])
    with (tmp_path / "robot.mcap").open("wb") as stream:
        writer = Writer(stream, compression=CompressionType.NONE)
        writer.start("ros2")
        writer.finish()
    assert "profile 'ros2'" in fault("robot.mcap")
    monkeypatch.setattr(capture_file, "FORMAT", "2")
    write(tmp_path / "later.mcap")
    monkeypatch.undo()
    assert "capture format '2', this version reads '1'" in fault("later.mcap")


def test_a_full_disk_is_one_line_and_keeps_what_was_written(tmp_path):
    script = (
        "import resource, sys\n"
        "from pathlib import Path\n"
        "from common.capture_file import CaptureWriter\n"
        "from common.arrival import CaptureRecord\n"
        "from common.config import ObserverConfig, Scene\n"
        "scene = Scene(scene='dojo', observers={'cam1': ObserverConfig(source='m.npz')})\n"
        "resource.setrlimit(resource.RLIMIT_FSIZE, (20_000, 20_000))\n"
        "try:\n"
        "    with CaptureWriter(Path(sys.argv[1]), scene, '', 5) as writer:\n"
        "        while True:\n"
        "            writer.write(CaptureRecord('put', 'laban/dojo/judgement', b'x' * 1000, writer.messages))\n"
        "            writer.flush()\n"
        "except Exception as error:\n"
        "    print(type(error).__name__, error)\n"
    )
    path = tmp_path / "a.mcap"
    command = [sys.executable, "-W", "error", "-c", script, path]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, timeout=SOON_S)
    assert done.stdout.startswith(f"LabanmeshError cannot write {path}: file too large, after ")
    assert "messages that stay readable; make room" in done.stdout and done.stdout.count("\n") == 1
    assert done.stderr == ""
    records = list(CaptureFile(path).records())
    assert len(records) >= 15 and all(len(record.payload) == 1000 for record in records)


def test_invented_keys_do_not_fill_the_table_of_channels(tmp_path):
    with CaptureWriter(tmp_path / "a.mcap", SCENE, TEXT, 5) as writer:
        for number in range(CHANNELS_LIMIT + 3):
            writer.write(CaptureRecord("put", f"laban/dojo/{number}", b"", 1))
        writer.write(CaptureRecord("put", "laban/dojo/0", b"", 1))
        assert (writer.messages, writer.left_out) == (CHANNELS_LIMIT + 1, 3)
