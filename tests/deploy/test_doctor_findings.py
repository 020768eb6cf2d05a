"""What doctor makes of facts: tables of what was seen and what must be said; no machine, file or mesh behind them."""

import json
from dataclasses import replace
from datetime import UTC, datetime, timedelta
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from common.config import MeshConfig, ObserverConfig, Scene
from deploy.doctor import cameras, machine, network, scene_file, security
from deploy.doctor.bounds import Requirement, fits, requirements
from deploy.doctor.cameras import Address, Eye, Looked, Webcam
from deploy.doctor.finding import GROUPS, MARKS, Finding, told, worst
from deploy.doctor.machine import Machine, Needs, Package, needs
from deploy.doctor.network import Network, Reached, meeting
from deploy.doctor.origin import masked, settings
from deploy.doctor.report import as_json, page, printable, summary
from deploy.doctor.scene_file import Examined, SceneFacts
from deploy.doctor.security import Security

NOW = datetime(2026, 6, 1, tzinfo=UTC)
GOOD = Machine(
    system="Linux x86_64",
    python="3.11.7",
    labanmesh="0.1.0",
    packages=(Package("eclipse-zenoh", "1.10.2"),),
    opencv=Package("OpenCV", "4.11.0.86"),
    mediapipe=Package("mediapipe", "0.10.21"),
    face_cascade=True,
    clock="synchronised",
    free_disk=10 << 30,
    free_memory=4 << 30,
    folder=".",
)
EYES = Needs(("a",), ("a",))
POSE = Needs(("a",), (), ("a",), ("a",))


def worst_of(found, words):
    """The mark of the one finding that holds all of `words`."""
    (one,) = [finding for finding in found if all(word in f"{finding.what} {finding.to_do}" for word in words)]
    return one.mark


def test_a_good_machine_is_good():
    assert worst(machine.findings(GOOD, POSE)) == "ok"


@pytest.mark.parametrize(
    ("facts", "who", "mark", "words"),
    [
        ({"packages": (Package("numpy", "", ">=1.26"),)}, EYES, "error", ["numpy is not", "pip install 'numpy>=1.26'"]),
        ({"packages": (Package("numpy", "3.0", "<3", fits=False),)}, EYES, "error", ["numpy 3.0", "'numpy<3'"]),
        ({"opencv": Package("OpenCV", "")}, EYES, "error", ["OpenCV is not", "needed by a", "labanmesh[observer]"]),
        ({"opencv": Package("OpenCV", ""), "face_cascade": False}, Needs(), "ok", ["OpenCV is not", "not needed"]),
        ({"opencv": Package("OpenCV", "5.0", "<5", fits=False)}, Needs(), "warning", ["OpenCV 5.0", "<5"]),
        ({"face_cascade": False}, EYES, "error", ["no face cascade", "of a", "opencv-python-headless"]),
        ({"face_cascade": False}, Needs(("a",)), "ok", ["OpenCV 4.11"]),
        ({"mediapipe": Package("mediapipe", "")}, POSE, "error", ["mediapipe is not", "labanmesh[mediapipe]"]),
        ({"mediapipe": Package("mediapipe", "1.2")}, POSE, "error", ["no pose model", "pose_model"]),
        ({"mediapipe": Package("mediapipe", "9", "<2", fits=False)}, POSE, "warning", ["tried with <2"]),
        ({"clock": "free"}, EYES, "warning", ["clock is not synchronised", "timedatectl set-ntp true"]),
        ({"clock": "unknown"}, EYES, "warning", ["cannot be told", "chronyc"]),
        ({"free_disk": 1 << 20}, EYES, "warning", ["1 MiB free on the disk", "make room"]),
        ({"free_memory": 1 << 20}, EYES, "warning", ["1 MiB free in memory", "fewer observers"]),
    ],
)
def test_machine(facts, who, mark, words):
    assert worst_of(machine.findings(replace(GOOD, **facts), who), words) == mark


def test_what_an_observer_elsewhere_needs_is_no_error_here():
    bare = replace(GOOD, opencv=Package("OpenCV", ""), mediapipe=Package("mediapipe", ""))
    assert worst(machine.findings(bare, POSE)) == "error"
    assert worst(machine.findings(bare, POSE, certain=False)) == "warning"


def test_who_needs_what():
    sections = {
        "motion": ObserverConfig(source="m.npz"),
        "filmed": ObserverConfig(source="m.npz", tracker="camshift"),
        "webcam": ObserverConfig(source="0"),
        "told": ObserverConfig(source="0", face=(0, 0, 9, 9)),
        "pose": ObserverConfig(source="rtsp://x/y", tracker="mediapipe"),
        "own": ObserverConfig(source="clip.mp4", tracker="mediapipe", pose_model="p.task"),
        "tracks": ObserverConfig(source="zenoh:k"),
        "piped": ObserverConfig(source="-"),
    }
    scene = Scene(scene="dojo", observers=sections)
    assert needs(scene, scene.roster) == Needs(
        ("filmed", "webcam", "told", "pose", "own"), ("filmed", "webcam"), ("pose", "own"), ("pose",)
    )
    assert needs(scene, ["tracks"]) == Needs()


@pytest.mark.parametrize(
    ("version", "bounds", "good"),
    [
        ("1.10.2", "<2,>=1.6.2", True),
        ("1.6.1", "<2,>=1.6.2", False),
        ("2.0", "<2,>=1.6.2", False),
        ("2.0.0rc1", "<2", False),
        ("4.11.0.86", ">=4.11.0.86", True),
        ("1.6", "==1.6.0", True),
        ("1.6", "!=1.6.0", False),
        ("1.0", "", True),
    ],
)
def test_bounds(version, bounds, good):
    assert fits(version, bounds) is good


def test_requirements_are_those_of_this_python():
    lines = [
        "numpy<3,>=1.26",
        'opencv-python-headless<5,>=4.11; extra == "observer"',
        'mediapipe<0.10.22; python_version < "3.13" and extra == "mediapipe"',
        'mediapipe<2,>=1.2; python_version >= "3.13" and extra == "mediapipe"',
        'labanmesh[observer]; extra == "all"',
    ]
    plain, opencv = Requirement("numpy", "<3,>=1.26"), Requirement("opencv-python-headless", "<5,>=4.11", "observer")
    assert list(requirements(lines, "3.11")) == [plain, opencv, Requirement("mediapipe", "<0.10.22", "mediapipe")]
    assert list(requirements(lines, "3.13"))[-1] == Requirement("mediapipe", "<2,>=1.2", "mediapipe")


def facts(observers=("a", "b"), certain=True, here=None, trouble="", mode="machine", vocabulary=None, **examined):
    scene = Scene(
        scene="dojo", observers={name: ObserverConfig(source="m.npz") for name in observers},
        mesh=MeshConfig(mode=mode), vocabulary=vocabulary,
    )  # fmt: skip
    good = {name: look(name) for name in observers}
    found = {name: each for name, each in {**good, **examined}.items() if each is not None}
    return SceneFacts("s.toml", scene, (), here or scene.roster, certain, found, trouble)


def look(name, faults=(), doubts=(), labels=("x", "y"), lacks=()):
    return Examined(name, "m.npz", "positions", labels, 15.0, faults, doubts, lacks)


@pytest.mark.parametrize(
    ("seen", "mark", "words"),
    [
        (facts(), "ok", ["a: m.npz, model of 2 movements at 15 Hz"]),
        (facts(), "ok", ["vocabulary of the models: x, y"]),
        (facts(b=look("b", ["b.model: no such model file; make one with labanmesh learn"])), "error", ["b: b.model"]),
        (facts(b=look("b", ["f: gone"]), certain=False), "warning", ["b: f: gone"]),
        (facts(b=look("b", ["f: gone"]), certain=False), "warning", ["other machines", "--observers"]),
        (facts(b=look("b", doubts=["m: learned for door; labanmesh learn"])), "warning", ["b: m: learned for door"]),
        (facts(b=look("b", labels=("x", "z"))), "error", ["learned for [x, z]", "a for [x, y]"]),
        (facts(b=None, trouble="it broke"), "warning", ["b: not examined: it broke", "labanmesh observe s.toml b"]),
        (facts(mode="process"), "error", ["several processes cannot meet so"]),
    ],
)
def test_scene_file(seen, mark, words):
    assert worst_of(scene_file.findings(seen), words) == mark


def test_what_is_told_of_the_machine_is_not_told_again():
    said = [finding.what for finding in scene_file.findings(facts(b=look("b", lacks=["cv2"])))]
    assert not any(what.startswith("b:") for what in said)


def test_models_against_the_scenes_own_vocabulary_are_the_examinations_affair():
    assert worst(scene_file.findings(facts(b=look("b", labels=("x", "z")), vocabulary=("x", "y")))) == "ok"


@pytest.mark.parametrize(
    ("fault", "what", "to_do"),
    [
        ("a.model: no such model file; make one with labanmesh learn", "a.model: no such model file",
         "make one with labanmesh learn"),
        ("m: learned at 10 Hz, the source gives 15: labanmesh learn ... --rate 15",
         "m: learned at 10 Hz, the source gives 15", "labanmesh learn ... --rate 15"),
        ("scene = 'A B': not allowed", "scene = 'A B': not allowed", "WAY"),
        ("two\n lines", "two lines", "WAY"),
    ],
)  # fmt: skip
def test_an_error_in_one_line_becomes_what_and_what_to_do(fault, what, to_do):
    assert told("network", "error", fault, "WAY") == Finding("network", "error", what, to_do)


def test_settings_say_where_they_came_from():
    table = {"scene": "dojo", "observers": {"front-left": {"source": "rtsp://me:secret@cam/x"}}}
    scene = Scene.model_validate({**table, "mesh": {"endpoint": "tcp/10.0.0.1:7447"}})
    environment = {"LABANMESH_MESH_ENDPOINT": "tcp/10.0.0.1:7447", "LABANMESH_OBSERVERS_FRONT_LEFT_VIEW": "door"}
    found = {setting.key: (setting.value, setting.origin) for setting in settings(scene, table, environment)}
    assert found["scene"] == ('"dojo"', "file")
    assert found["mesh.endpoint"] == ('"tcp/10.0.0.1:7447"', "LABANMESH_MESH_ENDPOINT")
    assert found["observers.front-left.view"] == ('"door"', "LABANMESH_OBSERVERS_FRONT_LEFT_VIEW")
    assert found["observers.front-left.source"] == ('"rtsp://cam/..."', "file")
    assert found["fusion.rule"][1] == "default" and "observers.front-left.virtual.seed" not in found
    seen = SceneFacts("s.toml", scene, settings(scene, table, environment), scene.roster, True, {})
    assert (
        worst_of(scene_file.findings(seen), ["mesh.endpoint", "environment variable LABANMESH_MESH_ENDPOINT"]) == "ok"
    )


@given(st.text("abcXYZ019:/@?#%&=;. ", min_size=1), st.text("abc/?&=@#", max_size=9))
def test_no_password_is_ever_shown(secret, behind):
    said = masked(f"rtsp://user:Q{secret}Q@camera.local/{behind}")
    assert "Q" not in said and "user" not in said and said.startswith("rtsp://")


WEBCAM = Webcam("/dev/video0", "Logitech")


@pytest.mark.parametrize(
    ("eyes", "present", "mark", "words"),
    [
        ([Eye("a", WEBCAM)], [WEBCAM], "ok", ["a: /dev/video0 (Logitech) is there"]),
        ([Eye("a", Webcam("/dev/video0", access="forbidden"))], [], "error", ["a:", "usermod -aG video $USER"]),
        ([Eye("a", Webcam("/dev/video7", access="absent"))], [WEBCAM], "error", ["video7 is not", "here: /dev/video0"]),
        ([Eye("a", Webcam("/dev/video0", access="unknown"))], [], "warning", ["labanmesh look /dev/video0"]),
        ([Eye("a", Address("rtsp://cam", "", 0.01))], [], "ok", ["rtsp://cam can be reached, 10 ms"]),
        ([Eye("a", Address("rtsp://cam", "nobody listens there"))], [], "error", ["nobody listens there"]),
        ([Eye("a", WEBCAM, Looked(["nothing to do: fine"]))], [WEBCAM], "ok", ["looked at: nothing to do"]),
        ([Eye("a", WEBCAM, Looked(["too dark: more light"]))], [WEBCAM], "warning", ["too dark", "more light"]),
        ([Eye("a", WEBCAM, Looked(fault="camera 0: busy"))], [WEBCAM], "error", ["camera 0: busy"]),
        ([], [WEBCAM], "ok", ["/dev/video0 (Logitech)", "no observer of this machine uses it"]),
        ([], [replace(WEBCAM, access="forbidden")], "warning", ["may not be read", "usermod"]),
    ],
)
def test_cameras(eyes, present, mark, words):
    assert worst_of(cameras.findings(eyes, present, certain=True), words) == mark


def test_a_camera_that_may_stand_elsewhere_is_no_error():
    absent = [Eye("a", Webcam("/dev/video7", access="absent"))]
    assert worst(cameras.findings(absent, [], certain=False)) == "warning"


REACHED = Reached(("127.0.0.1",), 0.0004)
REFUSED = Reached(("127.0.0.1",), refused=True, fault="nobody listens there")
HERE, THERE = "tcp/127.0.0.1:7447", "tcp/10.0.0.9:7447"


def seen(reached, endpoint=HERE, mode="machine", local=True, **more):
    return Network(MeshConfig(mode=mode, endpoint=endpoint), reached, local, **more)


@pytest.mark.parametrize(
    ("what", "mark", "words"),
    [
        (seen(REACHED, zenoh=0.01), "ok", ["Zenoh answers, 0.4 ms"]),
        (seen(REACHED, mode="router", zenoh=0.01), "ok", ["a Zenoh router answers"]),
        (seen(REACHED), "error", ["taken by something", "another port"]),
        (seen(REACHED, "tls/127.0.0.1:7447", "router"), "ok", ["can be reached", "security"]),
        (seen(REFUSED), "ok", ["free; the fusion process will listen there"]),
        (seen(REFUSED, unusable="permission denied"), "error", ["permission denied", "above 1023"]),
        (seen(REFUSED, THERE, local=False), "error", ["no address of this machine", 'mode = "router"']),
        (seen(REFUSED, mode="router"), "error", ["no router", "on this machine: labanmesh router tcp/0.0.0.0:7447"]),
        (seen(REFUSED, THERE, "router", local=False), "error", ["no router", "on 10.0.0.9: labanmesh router"]),
        (seen(Reached(fault="the name x is not known")), "error", ["not known", "name server"]),
        (seen(REACHED, THERE, "router", zenoh=0.01), "warning", ["open in the network", "labanmesh secure init"]),
        (seen(REFUSED, "tcp/0.0.0.0:7447"), "warning", ["on every interface of this machine"]),
        (seen(REFUSED, "tcp/[::]:7447"), "warning", ["on every interface of this machine"]),
        (seen(None, "unixsock-stream//run/laban"), "ok", ["free"]),
        (seen(None, "unixsock-stream//run/laban", unusable="/run cannot be written"), "error", ["cannot be written"]),
    ],
)
def test_network(what, mark, words):
    assert worst_of(network.findings(what), words) == mark


def test_a_meeting_point_in_pieces():
    assert meeting("tls/[::1]:7447") == network.Meeting("tls", "::1", 7447)
    assert meeting("tcp/router.local:1?x=y") == network.Meeting("tcp", "router.local", 1)
    assert meeting("unixsock-stream//run/x") == network.Meeting("unixsock-stream", "", 0)
    assert not [finding for finding in network.findings(seen(REFUSED)) if finding.mark != "ok"]


def test_free_is_only_where_fusion_will_listen():
    assert network.is_free(seen(REFUSED)) and not network.is_free(seen(REFUSED, mode="router"))
    assert not network.is_free(seen(REACHED)) and not network.is_free(seen(REFUSED, THERE, local=False))


SECURED = MeshConfig(mode="router", endpoint="tls/r:7447", credentials="/c")


@pytest.mark.parametrize(
    ("what", "mark", "words"),
    [
        (Security(MeshConfig()), "ok", ["no encryption"]),
        (
            Security(SECURED, "pi.2", ("observer:a",), NOW + timedelta(days=100)),
            "ok",
            ["pi.2 for observer:a", "100 more"],
        ),
        (
            Security(SECURED, "pi.2", (), NOW + timedelta(days=29)),
            "warning",
            ["29 more days", "secure renew SCENE pi,"],
        ),
        (
            Security(SECURED, "pi.2", (), NOW - timedelta(days=1), "c: expired; renew it"),
            "error",
            ["c: expired", "renew it"],
        ),
        (Security(SECURED), "error", ["no certificate could be read"]),
    ],
)
def test_security(what, mark, words):
    found = security.findings(what, NOW)
    assert worst_of(found, words) == mark and worst(found) == mark


def test_the_page_says_marks_in_words_and_hides_nothing():
    found = [
        Finding("the mesh", "error", "cam1 is \x1b[31mmissing", "start it"),
        Finding("this machine", "ok", "Python 3.11"),
        Finding("this machine", "warning", "the clock", "set it"),
    ]
    lines = [line for line, _ in page(found)]
    assert lines == [
        "this machine",
        "  ok       Python 3.11",
        "  warning  the clock",
        "           -> set it",
        "the mesh",
        "  error    cam1 is ?[31mmissing",
        "           -> start it",
        "1 error, 1 warning",
    ]
    assert summary([]) == "all is well"
    said = json.loads(as_json(found, "0.1.0"))
    assert said["worst"] == "error" and [each["mark"] for each in said["findings"]] == ["error", "ok", "warning"]
    assert set(said["findings"][0]) == {"group", "mark", "what", "to_do"}


@given(st.text())
def test_nothing_that_is_printed_steers_a_terminal(text):
    assert printable(text).isprintable()


def test_who_has_a_complaint_has_a_way_out():
    bare = replace(GOOD, opencv=Package("OpenCV", ""), clock="free", free_disk=0)
    found = (
        machine.findings(bare, POSE) + scene_file.findings(facts(b=look("b", ["x"]))) + network.findings(seen(REFUSED))
    )
    assert {finding.mark for finding in found} == set(MARKS) and {finding.group for finding in found} <= set(GROUPS)
    assert all(bool(finding.to_do) == (finding.mark != "ok") for finding in found)
    assert all("\n" not in finding.what + finding.to_do for finding in found)


def test_the_page_of_the_docs_names_every_group():
    said = (Path(__file__).parents[2] / "docs" / "guide" / "doctor.md").read_text(encoding="utf-8")
    assert all(group in said for group in GROUPS)
