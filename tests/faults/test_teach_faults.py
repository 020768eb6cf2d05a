"""A camera, an observer or a disk fails within a lesson: it is said at once, and nothing taken is lost."""

import sys

import pytest
from fault_disk import fill
from fault_film import film
from fault_processes import Process
from fault_stage import HERE, LONG_FORM
from processes import labanmesh

from benchmarks.timing import free_port
from observer.model.model_file import read_model
from observer.motion.archive import labels_of
from observer.motion.archive_file import read_archive

SCENE = """scene = "home"
[mesh]
mode = "router"
endpoint = "tcp/127.0.0.1:{port}"
[observers.sofa]
source = "film.npz"
view = "camera"
loop = true
[observers.shelf]
source = "film.npz"
view = "camera"
loop = true
[observers.lamp]
source = "zenoh:tracks/lamp"
view = "camera"
"""
LESSON = ("wave", "point", "--takes", "3", "--background-minutes", "0.1", "--countdown", "0", "--no-test")


@pytest.fixture
def home(tmp_path, small_disk):
    """The processes of a scene whose one observer has a small disk, and whose one camera is a process of its own."""
    film(tmp_path / "film.npz", 0, 1.0)
    file, port = tmp_path / "home.toml", free_port()
    file.write_text(SCENE.format(port=port))
    peers = [sys.executable, str(HERE / "fault_peers.py"), "film", str(file), "tracks/lamp", str(tmp_path / "film.npz")]
    processes = {
        "router": Process(labanmesh("router", f"tcp/127.0.0.1:{port}")),
        "camera": Process(peers),
        "fusion": Process(labanmesh("fuse", file)),
        "sofa": Process(labanmesh("observe", file, "sofa"), environment={"LABANMESH_MODELS": str(small_disk)}),
        **{name: Process(labanmesh("observe", file, name)) for name in ("shelf", "lamp")},
        "teach": Process(labanmesh("teach", file, *LESSON)),
    }
    yield processes, tmp_path
    for each in processes.values():
        each.kill()


@pytest.mark.parametrize("small_disk", [4096], indirect=True)
@LONG_FORM
def test_a_camera_an_observer_and_a_disk_fail_within_a_lesson_and_it_goes_on(home):
    processes, folder = home
    processes["router"].start().wait_for("listening")
    for name in ("camera", "fusion", "sofa", "shelf", "lamp"):
        processes[name].start()
    for name in ("sofa", "shelf", "lamp"):
        processes[name].wait_for("no model yet")
    teach = processes["teach"].start()
    teach.wait_for("wave 1 of 3: kept")
    processes["camera"].kill()
    teach.wait_for("lamp: no pictures")
    processes["camera"].start()
    teach.wait_for("lamp: has pictures again")
    processes["shelf"].kill()
    teach.wait_for("shelf: no answer any more")
    processes["shelf"].start()
    teach.wait_for("shelf: is back")
    filler = fill(folder / "disk")
    teach.wait_for("sofa: ")
    teach.wait_for("no space left on device")
    filler.unlink()
    teach.wait_for("observers and the fusion service recognise wave, point", timeout_s=180)
    print(teach.log)
    taken = {}
    for name, place in (("sofa", "disk"), ("shelf", "."), ("lamp", ".")):
        archive = read_archive(folder / place / f"{name}.tracks.npz")
        assert set(labels_of(archive)) == {"wave", "point"}
        taken[name] = [(r.label, r.trial) for r in archive.recordings if r.label]
        assert read_model(folder / place / f"{name}.model").header.vocabulary.labels == ("wave", "point")
    assert len(taken["sofa"]) >= 6 and ("wave", "1") in taken["shelf"] and ("wave", "1") in taken["lamp"]


@LONG_FORM
def test_a_teacher_that_is_killed_goes_on_where_it_stopped(home):
    processes, folder = home
    processes["router"].start().wait_for("listening")
    for name in ("camera", "fusion", "shelf"):
        processes[name].start()
    processes["shelf"].wait_for("no model yet")
    teach = processes["teach"].start()
    teach.wait_for("wave 2 of 3: kept")
    teach.kill()
    teach.start()
    teach.wait_for("wave: goes on after 2 takes")
    teach.wait_for("1 observer and the fusion service recognise wave, point", timeout_s=180)
    takes = [(r.label, r.trial) for r in read_archive(folder / "shelf.tracks.npz").recordings if r.label]
    assert takes[:2] == [("wave", "1"), ("wave", "2")] and len(takes) == len(set(takes)) == 6
