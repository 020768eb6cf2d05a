"""The disk fills while a scene is captured: one line says so, what was written stays readable, the scene goes on."""

from fault_processes import Process
from fault_stage import SECOND_NS, Stage, all_count
from processes import SOON_S, labanmesh

from common.capture_file import CaptureFile


def test_a_full_disk_ends_the_capture_in_one_line_and_nothing_else(replay, tmp_path, small_disk):
    with Stage(replay, tmp_path) as stage:
        capture = stage.processes["capture"] = Process(labanmesh("capture", stage.file, "-o", small_disk / "a.mcap"))
        stage.play()
        witness = stage.witness()
        witness.wait_for(all_count, why="all count")
        status = capture.wait()
        assert (status, capture.log.count("\n")) == (1, 1), capture.log
        assert "a.mcap" in capture.log and "space" in capture.log
        ended_ns = witness.last["at_ns"]
        witness.wait_for(lambda w: w.last["at_ns"] > ended_ns + SECOND_NS and all_count(w), SOON_S, "the scene goes on")
        records = list(CaptureFile(small_disk / "a.mcap").records())
        assert len(records) > 20 and any(record.key.endswith("judgement") for record in records)
