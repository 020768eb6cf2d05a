"""The disk fills: one line says so, what was written stays readable, the scene goes on; deleting works."""

import numpy as np
import pytest
from fault_disk import fill
from fault_processes import Process
from fault_stage import SECOND_NS, Stage, all_count
from processes import SOON_S, labanmesh

from common.capture_file import CaptureFile
from common.teaching_messages import Unwanted
from observer.motion.archive import Recording, TracksCamera
from observer.teaching.takes_file import TakesFile
from observer.tracks import BODY_PARTS


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


@pytest.mark.parametrize("small_disk", [256], indirect=True)
def test_a_person_is_forgotten_on_a_disk_without_space(small_disk):
    def takes_file():
        return TakesFile(small_disk / "sofa.tracks.npz", BODY_PARTS, TracksCamera("sofa"))

    takes = takes_file()
    for trial, person in ((1, "anna"), (2, "ben")):
        takes.add(Recording(np.ones((900, 3, 2), np.float32), 15.0, "wave", person, str(trial)))
    fill(small_disk)
    assert len(takes.forget(Unwanted(person="anna"))) == 1
    assert takes_file().persons == {"ben": {"wave": 1}}, "the smaller file has the place of the old one"
