"""`labanmesh teach` with real processes: on two hosts, secured, four observers learn and change together, and one is
killed meanwhile; on one machine a wrong verdict is corrected, and a person is forgotten."""

import re
import shutil
import socket
import subprocess

import numpy as np
import pytest
from fault_film import RATE_HZ, REST, film, pointing, seen, waving, waving_left, write
from fault_hosts import RIGHT
from fault_processes import Process
from fault_stage import LONG_FORM
from processes import labanmesh, until

from common import SECOND_NS
from common.capture_file import CaptureFile
from common.message_checks import check_vocabulary
from common.messages import JudgementMessage, PosteriorMessage, VerdictMessage, VocabularyMessage
from common.wire import decode
from observer.motion.archive_file import read_archive

CAMERAS = ("sofa", "shelf", "door", "window")
FAR = ("sofa", "shelf")
SCENE = """scene = "home"
[mesh]
mode = "router"
endpoint = "tls/{address}:7447"
"""


@pytest.fixture
def home(tmp_path, hosts):
    """A scene file, films, certificates, and the processes by name; all are killed at the end."""
    text = SCENE.format(address=RIGHT)
    for n, camera in enumerate(CAMERAS):
        film(tmp_path / f"{camera}.npz", n, 1 + n / 2)
        text += f'[observers.{camera}]\nsource = "{camera}.npz"\nview = "camera"\nloop = true\n'
    file = tmp_path / "home.toml"
    file.write_text(text)
    run("secure", "init", file)
    run("secure", "add", file, "router", "--host", RIGHT)
    for name in (*CAMERAS, "fusion", "hub"):
        run("secure", "add", file, name)
    run("secure", "add", file, "phone", "--hub", "--teach")

    def process(certificate, *words):
        inside = hosts.left.inside if certificate in (*FAR, "phone") else hosts.right.inside
        credentials = {"LABANMESH_MESH_CREDENTIALS": str(tmp_path / f"secure/{certificate}.1")}
        return Process(labanmesh(*words), inside, credentials)

    quick = ("--takes", "3", "--background-minutes", "0.1", "--countdown", "0", "--no-test")
    processes = {
        "router": process("router", "router", "--scene", file),
        "fusion": process("fusion", "fuse", file),
        **{camera: process(camera, "observe", file, camera) for camera in CAMERAS},
        "capture": process("hub", "capture", file, "-o", tmp_path / "day.mcap"),
        "hub": process("hub", "teach", file, "wave", "point"),
        "teach": process("phone", "teach", file, "wave", "point", *quick),
        "again": process("phone", "teach", file, "nod", "bow", *quick),
    }
    yield processes, tmp_path
    for each in processes.values():
        each.kill()


def run(*words):
    done = subprocess.run(labanmesh(*words), capture_output=True, text=True)
    assert done.returncode == 0, done.stderr


@LONG_FORM
def test_four_observers_on_two_hosts_are_taught_and_change_within_a_second(home):
    processes, folder = home
    processes["router"].start()
    processes["router"].wait_for("listening")
    for name in (*CAMERAS, "fusion", "capture"):
        processes[name].start()
    for camera in CAMERAS:
        processes[camera].wait_for("no model yet")
    processes["hub"].start().wait_for("lacks the right to teach")
    teach = processes["teach"].start()
    teach.wait_for("wave 2 of 3: kept")
    processes["sofa"].kill()
    processes["sofa"].start()
    teach.wait_for("4 observers and the fusion service recognise wave, point")
    print(teach.log)
    again = processes["again"].start()
    again.wait_for("4 observers and the fusion service recognise nod, bow")
    print(again.log)
    until(lambda: len(took := changes(folder / "day.mcap")) == 1 and took)
    took_s = changes(folder / "day.mcap")
    print("seconds from the first posterior in a new vocabulary to the first judgement in it:", took_s)
    assert len(took_s) == 1 and max(took_s) < 1.0


def changes(path):
    """Seconds that each change took. Each judgement and verdict is in one vocabulary; a movement ends in its own."""
    records = [(record.key.rpartition("/")[2], record) for record in CaptureFile(path).records()]
    named = [decode(VocabularyMessage, record.payload) for kind, record in records if kind == "vocabulary"]
    known, newest, begun, took_s, ids = {each.hash: each.vocabulary for each in named}, None, {}, [], {}
    for kind, record in records:
        if kind == "posterior":
            begun.setdefault(decode(PosteriorMessage, record.payload).vocabulary.hash, record.arrived_ns)
        elif kind in ("judgement", "verdict") and record.kind == "put":
            message = decode(JudgementMessage if kind == "judgement" else VerdictMessage, record.payload)
            check_vocabulary(message, known[message.vocabulary.hash])
            if kind == "verdict":
                assert ids.setdefault(message.id, message.vocabulary.hash) == message.vocabulary.hash
            if newest not in (None, message.vocabulary.hash):
                took_s.append((record.arrived_ns - begun[message.vocabulary.hash]) / SECOND_NS)
            newest = message.vocabulary.hash
    return took_s


@pytest.fixture
def sofa(tmp_path):
    """A scene with one observer that was taught wrongly, once: waving with the left hand is pointing."""
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        port = free.getsockname()[1]
    rest = [REST] * (RATE_HZ // 2)
    film_frames = 30 * ([REST] * (3 * RATE_HZ) + waving_left() + [REST] * (2 * RATE_HZ))
    write(tmp_path / "film.npz", [seen(np.array(film_frames), 1)], "film")
    shown = 3 * [("wave", waving), ("point", pointing)] + [("point", waving_left)]
    takes = [seen(np.array(rest + movement() + rest), n, label, str(n)) for n, (label, movement) in enumerate(shown)]
    write(tmp_path / "sofa.tracks.npz", takes, "sofa")
    file = tmp_path / "home.toml"
    text = f'scene = "home"\n[mesh]\nendpoint = "tcp/127.0.0.1:{port}"\n[observers.sofa]\nsource = "film.npz"\n'
    file.write_text(f'{text}view = "camera"\n')
    run("learn", tmp_path / "sofa.tracks.npz", "-o", tmp_path / "sofa.model")
    processes = [Process(labanmesh("fuse", file)), Process(labanmesh("observe", file, "sofa"))]
    for process in processes:
        process.start()
    yield file, *processes
    for process in processes:
        process.kill()


@LONG_FORM
def test_a_wrong_verdict_is_corrected_and_a_person_is_forgotten(sofa):
    file, fusion, observer = sofa
    fusion.wait_for("point, 1 of 1 agree, ended", times=2)
    wrong = re.findall(r"verdict (home-\d+): point, 1 of 1 agree, ended", fusion.log)
    corrected = subprocess.run(
        labanmesh("teach", file, "--was", wrong[0], "wave", "--was", wrong[1], "wave", "--person", "ben"),
        capture_output=True, text=True,
    )  # fmt: skip
    print(corrected.stdout)
    assert corrected.returncode == 0, corrected.stderr
    assert corrected.stdout.count("was wave by ben: kept by sofa") == 2
    assert "1 observer and the fusion service recognise wave, point from now on" in corrected.stdout
    fusion.wait_for("wave, 1 of 1 agree, ended")
    # Of what is left nothing can be learned: ben has only waved.
    forgotten = subprocess.run(labanmesh("forget", file, "--person", "anna", "--yes"), capture_output=True, text=True)
    print(forgotten.stdout)
    assert forgotten.returncode == 0, forgotten.stderr
    assert "sofa: removed 7 takes" in forgotten.stdout and "its model goes too" in forgotten.stdout
    observer.wait_for("no model yet")
    left = read_archive(file.with_name("sofa.tracks.npz")).recordings
    assert {(r.label, r.subject) for r in left} == {("wave", "ben")}
    assert not [path for path in file.parent.glob("*.model") if path.exists()]


@LONG_FORM
def test_nothing_that_was_taught_counts_again_when_the_observer_starts_anew(sofa):
    file, fusion, observer = sofa
    observer.kill()
    # Taught beside the scene file at first, and later in a folder for what is taught.
    (own := file.with_name("own")).mkdir()
    taught = ("sofa.model", "sofa.tracks.npz")
    for name in taught:
        shutil.copy(file.with_name(name), own)
    anew = Process(labanmesh("observe", file, "sofa"), environment={"LABANMESH_MODELS": str(own)}).start()
    try:
        fusion.wait_for("point, 1 of 1 agree, ended")
        forgotten = subprocess.run(labanmesh("forget", file, "--all", "--yes"), capture_output=True, text=True)
        print(forgotten.stdout)
        assert forgotten.returncode == 0, forgotten.stderr
        assert "sofa: removed 14 takes, 2 models" in forgotten.stdout
        assert "not touched: files made by labanmesh capture" in forgotten.stdout
        anew.wait_for("no model yet")
        anew.kill()
        assert not [path for folder in (own, file.parent) for name in taught if (path := folder / name).exists()]
        times = anew.log.count("no model yet") + 1
        anew.start().wait_for("no model yet", times=times)
    finally:
        anew.kill()
