"""`labanmesh doctor` as a process: a healthy scene; a taken port and a missing model; an old peer; what init writes."""

import json
import socket
import subprocess
import sys
import time
from pathlib import Path

import pytest

from common.config import MeshConfig, read_scene
from common.link import Link
from common.messages import StatusMessage
from common.wire import encode
from observer.motion.archive import MotionArchive
from observer.motion.archive_file import write_archive
from studies.performer import perform, perform_continuously

ROOT = Path(__file__).parents[2]
SOON_S = 60.0
VIEWS = {"door": "door", "wheel": "wheel"}


def labanmesh(*words):
    return [sys.executable, "-P", "-m", "labanmesh", *map(str, words)]


def doctor(*words):
    """Exit status, findings as (mark, what, to do), seconds."""
    began_s = time.monotonic()
    done = subprocess.run(
        labanmesh("doctor", *words, "--json"), cwd=ROOT, capture_output=True, text=True, timeout=SOON_S
    )
    assert done.stdout, done.stderr
    found = [(each["mark"], each["what"], each["to_do"]) for each in json.loads(done.stdout)["findings"]]
    return done.returncode, found, time.monotonic() - began_s


def marks(found, words):
    """The marks of all findings that hold `words`."""
    return {mark for mark, what, to_do in found if words in f"{what} -> {to_do}"}


@pytest.fixture(scope="module")
def stage(tmp_path_factory):
    """A folder with a recording and a model for each view."""
    place = tmp_path_factory.mktemp("stage")
    learned = perform(people=("2",), movements=("lunging", "byebye"), trials=2)
    write_archive(place / "learned.npz", learned)
    seen = perform_continuously("1", ("byebye",))
    write_archive(place / "motion.npz", MotionArchive(learned.body_parts, (seen,)))
    for observer, view in VIEWS.items():
        command = labanmesh("learn", place / "learned.npz", "--view", view, "-o", place / f"{observer}.model")
        subprocess.run(command, cwd=ROOT, check=True, capture_output=True, timeout=SOON_S)
    return place


def write_scene(stage, name, endpoint, mesh="", **extra):
    text = f'scene = "dojo"\n[mesh]\nendpoint = "{endpoint}"\n{mesh}'
    for observer, view in VIEWS.items():
        text += (
            f'[observers.{observer}]\nsource = "motion.npz"\nview = "{view}"\nloop = true\n{extra.get(observer, "")}'
        )
    (stage / name).write_text(text)
    return stage / name


def free_endpoint():
    with socket.create_server(("127.0.0.1", 0)) as server:
        return f"tcp/127.0.0.1:{server.getsockname()[1]}"


def test_a_healthy_scene(stage):
    path = write_scene(stage, "healthy.toml", free_endpoint())
    scene = read_scene(path, {})
    with Link.open(scene.mesh, "hub") as hub:
        judgements = hub.inbox(scene.keys.judgement)
        with subprocess.Popen(labanmesh("up", path), cwd=ROOT, stderr=subprocess.DEVNULL) as up:
            try:
                alive = hub.presence(f"{scene.keys.root}/**/alive")
                assert alive.wait_for(3, SOON_S) and judgements.take(SOON_S)
                status, found, _ = doctor(path)
            finally:
                up.terminate()
    assert status == 0 and "error" not in {mark for mark, *_ in found}, found
    for words in (
        "Zenoh answers",
        "judgements in",
        "door: running",
        "wheel: running",
        "fusion service fusion: running",
    ):
        assert marks(found, words) == {"ok"}, found
    assert marks(found, "vocabulary of the models: lunging, byebye") == {"ok"}


def test_a_port_that_is_taken_and_a_model_that_is_missing(stage):
    with socket.create_server(("127.0.0.1", 0)) as taken:
        endpoint = f"tcp/127.0.0.1:{taken.getsockname()[1]}"
        path = write_scene(stage, "broken.toml", endpoint, wheel='model = "lost.model"\n')
        status, found, took_s = doctor(path)
    assert status == 1
    assert marks(found, "taken by something") == {"error"}
    assert marks(found, "lost.model: no such model file -> make one with labanmesh learn") == {"error"}
    assert marks(found, "door: motion.npz, model of 2 movements") == {"ok"}
    # Its own limit is 6 s; a machine that is busy with other tests gets more.
    assert took_s < 20


def test_a_peer_of_another_version_and_observers_of_other_machines(stage):
    with Link.open(MeshConfig(mode="router"), "router", listen=["tcp/127.0.0.1:0"]) as router:
        path = write_scene(stage, "router.toml", router.locator, 'mode = "router"\n', wheel='model = "lost.model"\n')
        scene = read_scene(path, {})
        with Link.open(scene.mesh, "observer") as link:
            old = encode(StatusMessage(scene="dojo", id="wheel", state="running", version="0.0.1"))
            link.answer(scene.keys.observer_status("wheel"), lambda: old)
            link.announce(scene.keys.observer_alive("wheel"))
            status, found, _ = doctor(path, "--for", "0.6")
            assert marks(found, "wheel: labanmesh 0.0.1, here it is") == {"warning"}
            assert marks(found, "no fusion service is alive") == {"error"} and status == 1
            assert marks(found, "lost.model: no such model file") == {"warning"} == marks(found, "--observers ID,ID")
            status, found, _ = doctor(path, "--observers", "door", "--for", "0.6")
            assert not marks(found, "lost.model") and marks(found, "door: motion.npz") == {"ok"}


def test_for_people_it_is_a_page_and_bad_input_is_status_2(stage, tmp_path):
    done = subprocess.run(labanmesh("doctor"), cwd=ROOT, capture_output=True, text=True, timeout=SOON_S)
    assert done.returncode == 0 and done.stdout.startswith("this machine\n  ok       labanmesh")
    no_such = subprocess.run(
        labanmesh("doctor", tmp_path / "no.toml"), cwd=ROOT, capture_output=True, text=True, timeout=SOON_S
    )
    assert no_such.returncode == 2 and no_such.stderr.count("\n") == 1 and "labanmesh init" in no_such.stderr
    (tmp_path / "bad.toml").write_text('scene = "A B"\n[observers.a]\nsource = "0"\n')
    status, found, _ = doctor(tmp_path / "bad.toml")
    assert status == 1 and marks(found, "A B") == {"error"}


def test_what_init_writes_is_well_but_for_its_model(tmp_path):
    done = subprocess.run(
        labanmesh("init", tmp_path / "dojo.toml"), cwd=ROOT, capture_output=True, text=True, timeout=SOON_S
    )
    assert done.returncode == 0, done.stderr
    _, found, _ = doctor(tmp_path / "dojo.toml", "--for", "0.5")
    of_scene = [(what, to_do) for mark, what, to_do in found if mark == "error" and what.startswith("cam1: ")]
    models = [what for what, to_do in of_scene if "no such model file" in what]
    assert models and all("/dev/video" in what for what, _ in of_scene if what not in models)
