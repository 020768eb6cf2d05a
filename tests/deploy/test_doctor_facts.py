"""The doctor's facts from real things: ports, names, files, device nodes, this machine; checks that hang or break."""

import json
import os
import socket
import subprocess
import sys
import threading
import time

import pytest
from processes import SOON_S

from common.config import MODELS_VARIABLE, MeshConfig, read_scene
from deploy.doctor import cameras
from deploy.doctor.cameras import Webcam, observer_cameras, webcams
from deploy.doctor.commands import Check, run_checks
from deploy.doctor.findings import ok
from deploy.doctor.mesh import listen
from deploy.doctor.network import check_network, connect_to, listener_on, network_facts
from deploy.doctor.scene_file import FolderFacts, check_scene, scene_facts, scenes_in
from labanmesh import main


@pytest.fixture
def listener():
    """A program that listens and never answers."""
    with socket.create_server(("127.0.0.1", 0)) as server:
        yield server.getsockname()[1]


@pytest.fixture
def free_port():
    with socket.create_server(("127.0.0.1", 0)) as server:
        return server.getsockname()[1]


def test_a_port_is_reached_refused_or_unknown(listener, free_port):
    reached = connect_to("127.0.0.1", listener)
    assert reached.took_s is not None and reached.took_s < SOON_S and reached.fault == ""
    assert listener_on(free_port) == ""
    refused = connect_to("127.0.0.1", free_port)
    assert refused.refused and refused.took_s is None
    assert "not known" in connect_to("no-such-host.invalid", 1, 5.0).fault


def test_a_name_server_that_never_answers_is_not_waited_for(monkeypatch):
    forever = threading.Event()
    monkeypatch.setattr(socket, "getaddrinfo", lambda *_, **__: forever.wait(3 * SOON_S) and [])
    began_s = time.monotonic()
    assert "did not answer for slow within 0.05 s" in connect_to("slow", 1, 0.05).fault
    assert time.monotonic() - began_s < SOON_S
    forever.set()


def test_a_free_port_here_and_an_address_of_nobody(free_port):
    ours = network_facts(MeshConfig(endpoint=f"tcp/127.0.0.1:{free_port}"))
    assert ours.local and not ours.unusable and ours.connection.refused
    every = network_facts(MeshConfig(endpoint=f"tcp/0.0.0.0:{free_port}"))
    assert every.local and every.connection.refused
    # TEST-NET-1 belongs to nobody: we cannot listen there, wherever we are.
    assert not network_facts(MeshConfig(endpoint="udp/192.0.2.1:7447")).local


def test_a_socket_file_needs_a_folder_that_may_be_written(tmp_path):
    assert not network_facts(MeshConfig(endpoint=f"unixsock-stream/{tmp_path}/mesh")).unusable
    assert "not writable" in network_facts(MeshConfig(endpoint=f"unixsock-stream/{tmp_path}/no/mesh")).unusable


@pytest.mark.parametrize("mode", ["machine", "router"])
def test_a_port_taken_by_another_program_is_reported(listener, mode, tmp_path, monkeypatch):
    for limit in ("OPEN_S", "STATUS_ANSWER_S"):
        monkeypatch.setattr(f"deploy.doctor.mesh.{limit}", 0.2)  # the program never answers
    (tmp_path / "s.toml").write_text(
        f'scene = "dojo"\nmesh = {{mode = "{mode}", endpoint = "tcp/127.0.0.1:{listener}"}}\n'
        '[observers.a]\nsource = "m.npz"\n'
    )
    scene = read_scene(tmp_path / "s.toml", {})
    began_s = time.monotonic()
    facts = listen(scene, network_facts(scene.mesh), 3 * SOON_S)
    assert facts.traffic is None and time.monotonic() - began_s < SOON_S
    (error,) = [finding for finding in check_network(facts.network) if finding.mark == "error"]
    # The listener is this very process.
    assert f"taken by PID {os.getpid()} (" in error.what or not os.path.exists("/proc/net/tcp")  # noqa: PTH110


@pytest.mark.skipif(not os.path.exists("/proc/net/tcp"), reason="Linux tells who listens")  # noqa: PTH110
def test_the_command_of_a_process_that_holds_a_port_is_one_short_line():
    listens = "import socket, time\nheld = socket.create_server(('127.0.0.1', 0))\n"
    code = listens + "print(held.getsockname()[1], flush=True)"
    code += "\ntime.sleep(60)\n#" + 60 * " long"
    with subprocess.Popen([sys.executable, "-c", code], stdout=subprocess.PIPE, text=True) as process:
        port = int(process.stdout.readline())
        line = listener_on(port)
        process.kill()
    assert line.startswith(f"PID {process.pid} (") and "\n" not in line and len(line) < 200


def test_webcams_are_found_by_their_first_node(tmp_path):
    devices, names = tmp_path / "dev", tmp_path / "names"
    for number, index in ((0, 0), (1, 1), (10, 0), (2, 0)):
        (names / f"video{number}").mkdir(parents=True)
        (names / f"video{number}" / "name").write_text(f"Camera {number}\n")
        (names / f"video{number}" / "index").write_text(f"{index}\n")
        devices.mkdir(exist_ok=True)
        (devices / f"video{number}").touch()
    cameras = webcams(devices, names)
    assert [webcam.place.rpartition("/")[2] for webcam in cameras] == ["video0", "video2", "video10"]
    assert [webcam.name for webcam in cameras] == ["Camera 0", "Camera 2", "Camera 10"]
    assert {webcam.access for webcam in cameras} == {"readable"}


@pytest.mark.skipif(os.geteuid() == 0, reason="root may read everything")
def test_a_webcam_that_may_not_be_read(tmp_path):
    (tmp_path / "video0").touch(mode=0)
    (webcam,) = webcams(tmp_path, tmp_path)
    assert webcam.access == "forbidden"


def test_cameras_of_a_scene(tmp_path, listener):
    scene = tmp_path / "s.toml"
    scene.write_text(
        'scene = "dojo"\n[observers.gone]\nsource = "/dev/video97"\n[observers.numbered]\nsource = "98"\n'
        '[observers.motion]\nsource = "m.npz"\n'
        f'[observers.net]\nsource = "http://me:secret@127.0.0.1:{listener}/stream"\n'
    )
    read = read_scene(scene, {})
    gone, numbered, net = observer_cameras(read, read.roster, test=False)
    assert gone.camera == Webcam("/dev/video97", "", "absent")
    assert (numbered.observer, numbered.camera.place, numbered.camera.access) == ("numbered", "/dev/video98", "absent")
    assert net.camera.fault == "" and net.camera.url == f"http://127.0.0.1:{listener}/..."


def test_a_camera_that_is_there_is_looked_at_if_asked(tmp_path, monkeypatch):
    """A stand-in for `labanmesh camera look`: which cameras are tested, with what, and how its output is read."""
    ran = []

    def run(command, **_):
        ran.append(command)
        status = int("1" in command)
        output = (
            ("clip: 9x9\n-> too dark: more light\n", "", "") if not status else ("", "x\nlabanmesh: camera 1: busy\n")
        )
        return subprocess.CompletedProcess(command, status, *output[:2])

    (tmp_path / "video0").touch()
    (tmp_path / "video1").touch()
    monkeypatch.setattr(cameras, "DEVICES", tmp_path)
    monkeypatch.setattr(subprocess, "run", run)
    (tmp_path / "s.toml").write_text(
        'scene = "dojo"\n[observers.a]\nsource = "0"\nskin = "s.npz"\n[observers.b]\nsource = "1"\n'
        '[observers.away]\nsource = "2"\n'
    )
    scene = read_scene(tmp_path / "s.toml", {})
    a, b, away = observer_cameras(scene, scene.roster, test=True)
    assert a.test.advice == ["too dark: more light"] and a.test.fault == ""
    assert b.test.fault == "camera 1: busy" and away.test is None
    assert any(str(tmp_path / "s.npz") in command for command in ran) and len(ran) == 2
    assert not [each for each in observer_cameras(scene, scene.roster, test=False) if each.test]


def test_a_folder_that_cannot_be_taught_in_is_named_before_teaching(tmp_path, monkeypatch):
    monkeypatch.setattr("deploy.doctor.scene_file._preflight", lambda *_: ({}, ""))
    (tmp_path / "s.toml").write_text('scene = "dojo"\n[observers.a]\nsource = "0"\n[observers.b]\nsource = "1"\n')
    nowhere = {MODELS_VARIABLE: str(tmp_path / "nowhere")}
    facts = scene_facts(tmp_path / "s.toml", read_scene(tmp_path / "s.toml", nowhere), None)
    (finding,) = [each for each in check_scene(facts) if "teaching would fail" in each.what]
    assert finding.what.startswith(f"a, b: this user cannot write to {tmp_path / 'nowhere'}")
    assert MODELS_VARIABLE in finding.to_do


def test_a_scene_that_is_not_there_is_bad_input_and_no_finding(tmp_path, capsys):
    assert main(["doctor", str(tmp_path / "no.toml")]) == 2
    assert "no such file; name a scene file, or make one: labanmesh init" in capsys.readouterr().err


def test_all_faults_of_a_scene_file_are_findings(tmp_path, capsys):
    sound = '[observers.b]\nsource = "0"\nview = "dor"\nspede = 1\n[fusion]\nrule = "lgo"\nquorum = 9\n'
    (tmp_path / "bad.toml").write_text('scene = "d"\n[observers.a]\nsorce = "0"\nspeed = -1\n' + sound)
    assert main(["doctor", str(tmp_path / "bad.toml"), "--json"]) == 1
    findings = [each for each in json.loads(capsys.readouterr().out)["findings"] if each["mark"] == "error"]
    wanted = ("observers.a.sorce", "observers.b.spede", "observers.a.source", "observers.a.speed", "fusion.quorum")
    assert len(findings) == 7
    for finding, key in zip(findings, (*wanted, "fusion.rule = 'lgo'", "b: view 'dor'"), strict=True):
        assert key in finding["what"]
    assert findings[0]["to_do"] == "did you mean source?"


def test_scene_files_in_the_folder_are_named(tmp_path):
    (tmp_path / "s.toml").write_text('scene = "dojo"\n[observers.a]\nsource = 0\n')
    (tmp_path / "other.toml").write_text("[tool.ruff]")
    (hint,) = scenes_in(tmp_path)
    assert "s.toml is in this folder" in hint.what and hint.to_do == "labanmesh doctor s.toml"


def test_observers_are_examined_in_a_process_of_their_own(tmp_path, monkeypatch):
    monkeypatch.setattr("deploy.doctor.scene_file.PREFLIGHT_S", SOON_S)
    path = tmp_path / "s.toml"
    clips = '[observers.a.clips]\nfolder = "s.toml/x"\n'
    first = '[observers.a]\nsource = "m.npz"\nview = "dor"\n'
    path.write_text(f'scene = "dojo"\n{first}{clips}[observers.b]\nsource = "-"\n[fusion]\nrule = "lgo"\n')
    facts = scene_facts(path, read_scene(path, {}), ["a"])
    assert facts.clip_folders == {"a": FolderFacts(path / "x", writable=False)}
    assert facts.taught_folders == {"a": FolderFacts(tmp_path, writable=True)}
    assert facts.certain and set(facts.reports) == {"a"} and facts.trouble == ""
    faults = " ".join(facts.reports["a"].faults)
    assert "did you mean log?" in facts.fusion
    assert "did you mean door?" in faults and "m.npz: cannot be read" in faults
    assert "a.model: no such model file; teach it" in facts.reports["a"].doubts[0]
    assert f"labanmesh teach {path} LABEL" in facts.reports["a"].doubts[0]


def test_a_check_that_hangs_or_breaks_is_a_finding_and_the_others_are_reported():
    forever = threading.Event()

    def breaks():
        raise RuntimeError("no such luck")

    def hangs():
        forever.wait(SOON_S)
        return []

    checks = [
        Check("cameras", 5.0, breaks),
        Check("network", 0.05, hangs),
        Check("security", 5.0, lambda: [ok("fine")]),
    ]
    broken, hung, fine = run_checks(checks)
    forever.set()
    assert broken.mark == "warning" and "RuntimeError: no such luck" in broken.what
    assert hung.mark == "warning" and "longer than 0.05 s" in hung.what and fine.mark == "ok"
