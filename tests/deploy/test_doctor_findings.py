"""The doctor's checks: tables of facts and the findings on them; no machine, file or mesh behind them."""

import json
from dataclasses import replace
from datetime import UTC, datetime, timedelta
from pathlib import Path

import pytest

from common.config import MeshConfig, ObserverConfig, Scene, read_scene
from common.config_sections import ClipsConfig
from common.credentials import Certificate
from deploy.doctor.broker import BrokerFacts, broker_facts, check_broker
from deploy.doctor.cameras import CameraTest, NetworkCamera, ObserverCamera, Webcam, check_cameras
from deploy.doctor.findings import GROUPS, Finding, as_json, from_fault, page, settings_in_force, summary, worst
from deploy.doctor.machine import MachineFacts, MachineNeeds, check_machine, machine_needs
from deploy.doctor.network import Connection, NetworkFacts, check_network, is_free
from deploy.doctor.scene_file import FolderFacts, PreflightReport, SceneFacts, check_scene
from deploy.doctor.security import SecurityFacts, check_security

NOW = datetime(2026, 6, 1, tzinfo=UTC)
GOOD = MachineFacts(
    system="Linux x86_64",
    python="3.11.7",
    labanmesh="0.1.0",
    packages={"eclipse-zenoh": "1.10.2"},
    opencv="4.11.0.86",
    mediapipe="0.10.21",
    face_cascade=True,
    clock="synchronised",
    free_disk=10 << 30,
    free_memory=4 << 30,
    folder=".",
)
NOTHING, PICTURES, FACE = MachineNeeds(), MachineNeeds(("a",)), MachineNeeds(("a",), ("a",))
ALONE, SPREAD = MachineNeeds(other_clocks=False), MachineNeeds(other_clocks=True)
POSE = MachineNeeds(("a",), (), ("a",), ("a",))


def mark_of(findings, words):
    """The mark of the one finding that holds all of `words`; every complaint has a way out, in one line."""
    assert all(bool(each.to_do) == (each.mark != "ok") for each in findings)
    assert all("\n" not in each.what + each.to_do for each in findings)
    (one,) = [each for each in findings if all(word in f"{each.what} {each.to_do}" for word in words)]
    return one.mark


@pytest.mark.parametrize(
    ("facts", "needs", "mark", "words"),
    [
        ({"packages": {"numpy": ""}}, FACE, "error", ["numpy is not", "pip install labanmesh"]),
        ({"opencv": ""}, FACE, "error", ["OpenCV is not", "needed by a", "labanmesh[observer]"]),
        ({"opencv": "", "face_cascade": False}, NOTHING, "ok", ["OpenCV is not", "not needed"]),
        ({"face_cascade": False}, FACE, "error", ["no face cascade", "of a", "opencv-python-headless"]),
        ({"face_cascade": False}, PICTURES, "ok", ["OpenCV 4.11"]),
        ({"mediapipe": ""}, POSE, "error", ["mediapipe is not", "labanmesh[mediapipe]"]),
        ({"mediapipe": "1.2"}, POSE, "error", ["no pose model", "pose_model"]),
        ({"clock": "free"}, NOTHING, "hint", ["clock is not synchronised", "on several machines"]),
        ({"clock": "free"}, SPREAD, "warning", ["clock is not synchronised", "timedatectl set-ntp true"]),
        ({"clock": "free"}, ALONE, "ok", ["clock may be wrong"]),
        ({"clock": "unknown"}, SPREAD, "warning", ["cannot tell", "chronyc"]),
        ({"free_disk": 1 << 20}, FACE, "warning", ["1 MiB free on the disk", "make room"]),
        ({"free_memory": 1 << 20}, FACE, "warning", ["1 MiB free in memory", "fewer observers"]),
    ],
)
def test_machine(facts, needs, mark, words):
    assert mark_of(check_machine(replace(GOOD, **facts), needs), words) == mark
    assert worst(check_machine(GOOD, needs)) == "ok"


def test_the_needs_of_observers():
    sections = {
        "motion": ObserverConfig(source="m.npz"),
        "filmed": ObserverConfig(source="m.npz", tracker="camshift"),
        "webcam": ObserverConfig(source="0"),
        "taught": ObserverConfig(source="0", face=(0, 0, 9, 9)),
        "pose": ObserverConfig(source="rtsp://x/y", tracker="mediapipe"),
        "own": ObserverConfig(source="clip.mp4", tracker="mediapipe", pose_model="p.task"),
        "tracks": ObserverConfig(source="zenoh:k"),
        "piped": ObserverConfig(source="-"),
    }
    scene = Scene(scene="dojo", observers=sections)
    assert machine_needs(scene, scene.roster) == MachineNeeds(
        ("filmed", "webcam", "taught", "pose", "own"), ("filmed", "webcam"), ("pose", "own"), ("pose",), False
    )
    assert machine_needs(scene, ["tracks"]) == ALONE


def scene_facts(observers=("a", "b"), certain=True, trouble="", mode="machine", vocabulary=None, hubs=(), **reports):
    scene = Scene(
        scene="dojo", observers={name: ObserverConfig(source="m.npz") for name in observers},
        mesh=MeshConfig(mode=mode), vocabulary=vocabulary, hub={"start": hubs},
    )  # fmt: skip
    chosen = {name: reports.get(name, report(name)) for name in observers}
    present = {name: each for name, each in chosen.items() if each is not None}
    return SceneFacts("s.toml", scene, (), scene.roster, certain, present, trouble)


def report(name, faults=(), doubts=(), labels=("x", "y"), lacks=()):
    return PreflightReport(name, "m.npz", "positions", labels, 15.0, faults, doubts, lacks)


def test_models_without_other_motion_are_one_hint():
    reports = {name: replace(report(name), blends_only=True) for name in ("a", "b")}
    findings = check_scene(scene_facts(**reports))
    assert [each.what.partition(":")[0] for each in findings if each.mark != "ok"] == ["a, b"]
    assert worst(findings) == "hint" and summary(findings) == "all is well"


CROWD = tuple(f"cam{number}" for number in range(900))
LONG = tuple(f"{'m' * 60}{number:03}" for number in range(1100))


@pytest.mark.parametrize(
    ("facts", "mark", "words"),
    [
        (scene_facts(), "ok", ["scene dojo, 2 observers (a, b), mesh machine"]),
        (scene_facts(("a",)), "ok", ["scene dojo, 1 observer (a)"]),
        (scene_facts(), "ok", ["a: m.npz, model of 2 movements at 15 Hz"]),
        (scene_facts(), "ok", ["vocabulary of the models: x, y"]),
        (scene_facts(b=report("b", ["b.model: no such model file; make one with labanmesh learn"])), "error",
         ["b: b.model"]),
        (scene_facts(b=report("b", ["f: gone"]), certain=False), "warning", ["b: f: gone"]),
        (scene_facts(b=report("b", ["f: gone"]), certain=False), "warning", ["other machines", "--observers"]),
        (scene_facts(b=report("b", doubts=["m: learned for door; labanmesh learn"])), "warning",
         ["b: m: learned for door"]),
        (scene_facts(b=report("b", labels=("x", "z"))), "error", ["learned for [x, z]", "a for [x, y]"]),
        (scene_facts(b=None, trouble="it broke"), "warning", ["b: not examined: it broke", "labanmesh observe s.toml"]),
        (scene_facts(hubs=["mqttt"]), "error", ["hub.start = 'mqttt': unknown hub", "did you mean mqtt?"]),
        (scene_facts(mode="process"), "error", ["several processes cannot meet in this mode"]),
        (scene_facts(), "ok", ["judgements take up to", "a message holds 64"]),
        (scene_facts(CROWD[:340]), "warning", ["judgements take up to", "before you add"]),
        (scene_facts(CROWD), "error", ["900 observers", "a message holds 65536"]),
        (scene_facts(vocabulary=LONG), "error", ["1100 movements", "fewer"]),
    ],
)  # fmt: skip
def test_scene_file(facts, mark, words):
    assert mark_of(check_scene(facts), words) == mark


@pytest.mark.parametrize("writable", [True, False])
def test_pictures_and_clips_that_are_on_are_named(writable):
    plain = scene_facts(("a", "b"))
    section = ObserverConfig(source="0", picture_hz=2.0, clips=ClipsConfig(folder="clips"))
    scene = plain.scene.model_copy(update={"observers": {"a": section, "b": plain.scene.observer("b")}})
    findings = check_scene(replace(plain, scene=scene, clip_folders={"a": FolderFacts(Path("/x/clips"), writable)}))
    assert mark_of(findings, ["a: live pictures are on: any process of the mesh may ask for 2 a second"]) == "ok"
    assert mark_of(findings, ["a: clips are on", "/x/clips, for 7 days, at most 500 MB"]) == "ok"
    assert not any(finding.what.startswith("b: ") and "are on" in finding.what for finding in findings)
    assert any("cannot write to /x/clips" in finding.what for finding in findings) != writable


def test_findings_of_the_machine_and_the_preflight_are_not_repeated():
    findings = check_scene(scene_facts(b=report("b", lacks=["cv2"])))
    assert not any(finding.what.startswith("b:") for finding in findings)
    # The preflight compares each model with the scene's own vocabulary.
    assert worst(check_scene(scene_facts(b=report("b", labels=("x", "z")), vocabulary=("x", "y")))) == "ok"


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
    assert from_fault("error", fault, "WAY") == Finding("error", what, to_do)


def test_settings_name_their_origin():
    table = {"scene": "dojo", "observers": {"front-left": {"source": "rtsp://me:secret@cam/x"}}}
    scene = Scene.model_validate({**table, "mesh": {"endpoint": "tcp/10.0.0.1:7447"}})
    environment = {"LABANMESH_MESH_ENDPOINT": "tcp/10.0.0.1:7447", "LABANMESH_OBSERVERS_FRONT_LEFT_VIEW": "door"}
    settings = settings_in_force(scene, table, environment)
    values = {setting.key: (setting.value, setting.origin) for setting in settings}
    assert values["scene"] == ('"dojo"', "file")
    assert values["mesh.endpoint"] == ('"tcp/10.0.0.1:7447"', "LABANMESH_MESH_ENDPOINT")
    assert values["observers.front-left.view"] == ('"door"', "LABANMESH_OBSERVERS_FRONT_LEFT_VIEW")
    assert values["observers.front-left.source"] == ('"rtsp://cam/..."', "file")
    assert values["fusion.rule"][1] == "default"
    findings = check_scene(SceneFacts("s.toml", scene, settings, scene.roster, True, {}))
    assert mark_of(findings, ["mesh.endpoint", "environment variable LABANMESH_MESH_ENDPOINT"]) == "ok"


WEBCAM = Webcam("/dev/video0", "Logitech")


def camera(*arguments, test=None, **more):
    return [ObserverCamera("a", Webcam(*arguments, **more), test)]


@pytest.mark.parametrize(
    ("cameras", "present", "mark", "words"),
    [
        ([ObserverCamera("a", WEBCAM)], [WEBCAM], "ok", ["a: /dev/video0 (Logitech) is there"]),
        (camera("/dev/video0", access="forbidden"), [], "error", ["a:", "usermod -aG video $USER"]),
        (camera("/dev/video7", access="absent"), [WEBCAM], "error", ["video7 is not", "here: /dev/video0"]),
        (camera("/dev/video0", access="unknown"), [], "warning", ["labanmesh camera look /dev/video0"]),
        ([ObserverCamera("a", NetworkCamera("rtsp://cam", "", 0.01))], [], "ok", ["rtsp://cam can be reached, 10 ms"]),
        ([ObserverCamera("a", NetworkCamera("rtsp://cam", "nothing listens"))], [], "error", ["nothing listens"]),
        (camera("/dev/video0", test=CameraTest(["nothing to do: fine"])), [], "ok", ["test picture: nothing to do"]),
        (camera("/dev/video0", test=CameraTest(["too dark: more light"])), [], "warning", ["too dark", "more light"]),
        (camera("/dev/video0", test=CameraTest(fault="camera 0: busy")), [], "error", ["camera 0: busy"]),
        ([], [WEBCAM], "ok", ["/dev/video0 (Logitech)", "no observer of this machine uses it"]),
        ([], [replace(WEBCAM, access="forbidden")], "warning", ["may not be read", "usermod"]),
    ],
)
def test_cameras(cameras, present, mark, words):
    assert mark_of(check_cameras(cameras, present, certain=True), words) == mark


def test_faults_of_observers_that_may_run_elsewhere_are_warnings():
    bare, absent = replace(GOOD, opencv=""), camera("/dev/video7", access="absent")
    for certain, mark in ((True, "error"), (False, "warning")):
        assert worst(check_machine(bare, FACE, certain=certain)) == mark
        assert worst(check_cameras(absent, [], certain=certain)) == mark


REACHED = Connection(0.0004)
REFUSED = Connection(refused=True, fault="nothing listens there")
HERE, THERE = "tcp/127.0.0.1:7447", "tcp/10.0.0.9:7447"


def net(connection, endpoint=HERE, mode="machine", local=True, **more):
    return NetworkFacts(MeshConfig(mode=mode, endpoint=endpoint), connection, local, **more)


@pytest.mark.parametrize(
    ("facts", "mark", "words"),
    [
        (net(REACHED, zenoh_s=0.01), "ok", ["Zenoh answers, 0.4 ms"]),
        (net(REACHED, mode="router", zenoh_s=0.01), "ok", ["a Zenoh router answers"]),
        (net(REACHED), "error", ["taken by a program", "another port"]),
        (net(REACHED, listener="PID 7 (nc)"), "error", ["taken by PID 7 (nc)", "another port"]),
        (net(REACHED, "tls/127.0.0.1:7447", "router"), "ok", ["can be reached", "security"]),
        (net(REFUSED), "ok", ["free; the fusion process will listen there"]),
        (net(REFUSED, unusable="permission denied"), "error", ["permission denied", "above 1023"]),
        (net(REFUSED, THERE, local=False), "error", ["not an address of this machine", 'mode = "router"']),
        (net(REFUSED, mode="router"), "error", ["no router", "on this machine: labanmesh router --scene SCENE"]),
        (net(REFUSED, THERE, "router", local=False), "error", ["no router", "on 10.0.0.9: labanmesh router"]),
        (net(Connection(fault="the name x is not known")), "error", ["not known", "name server"]),
        (net(REACHED, THERE, "router", zenoh_s=0.01), "warning", ["open in the network", "labanmesh secure init"]),
        (net(REFUSED, "tcp/0.0.0.0:7447"), "warning", ["on every interface of this machine"]),
        (net(REFUSED, "tcp/[::]:7447"), "warning", ["on every interface of this machine"]),
        (net(None, "unixsock-stream//run/laban"), "ok", ["free"]),
        (net(None, "unixsock-stream//run/laban", unusable="/run is not writable"), "error", ["not writable"]),
    ],
)
def test_network(facts, mark, words):
    assert mark_of(check_network(facts), words) == mark


def test_free_is_only_where_fusion_will_listen():
    assert is_free(net(REFUSED)) and not is_free(net(REFUSED, mode="router"))
    assert not is_free(net(REACHED)) and not is_free(net(REFUSED, THERE, local=False))


SECURED = MeshConfig(mode="router", endpoint="tls/r:7447", credentials="/c")


def pi(days, *roles):
    return Certificate("pi.2", NOW, NOW + timedelta(days=days), roles)


@pytest.mark.parametrize(
    ("facts", "mark", "words"),
    [
        (SecurityFacts(MeshConfig()), "ok", ["no encryption"]),
        (SecurityFacts(SECURED, pi(100, "observer:a")), "ok", ["pi.2 for observer:a", "100 more"]),
        (SecurityFacts(SECURED, pi(29)), "warning", ["29 more days", "secure renew SCENE pi,"]),
        (SecurityFacts(SECURED, pi(-1), "c: expired; renew it"), "error", ["c: expired", "renew it"]),
        (SecurityFacts(SECURED), "error", ["no certificate could be read"]),
    ],
)
def test_security(facts, mark, words):
    findings = check_security(facts, NOW)
    assert mark_of(findings, words) == mark and worst(findings) == mark


def test_the_page_has_marks_in_words_and_hides_nothing():
    findings = [
        Finding("error", "cam1 is \x1b[31mmissing", "start it", group="the mesh"),
        Finding("ok", "Python 3.11", group="this machine"),
        Finding("warning", "the clock", "set it", group="this machine"),
    ]
    assert [line for line, _ in page(findings)] == [
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
    read = json.loads(as_json(findings, "0.1.0"))
    assert read["worst"] == "error" and [each["mark"] for each in read["findings"]] == ["error", "ok", "warning"]
    assert set(read["findings"][0]) == {"group", "mark", "what", "to_do"}


def test_the_page_of_the_docs_names_every_group():
    text = (Path(__file__).parents[2] / "docs" / "guide" / "doctor.md").read_text(encoding="utf-8")
    assert all(group in text for group in GROUPS)


BROKER = BrokerFacts("homeassistant.local:1883", Connection(0.004), starts=True, installed=True)


@pytest.mark.parametrize(
    ("facts", "mark", "text"),
    [
        (BROKER, "ok", "homeassistant.local:1883: answers, 4.0 ms"),
        (replace(BROKER, connection=Connection(fault="nothing listens there")), "error", "app Mosquitto broker"),
        (replace(BROKER, connection=Connection(fault="x"), starts=False), "warning", "correct hub.mqtt.host"),
        (replace(BROKER, password_file="a/word", password="no such file"), "error", "> word, beside"),  # noqa: S106
        (replace(BROKER, installed=False), "error", "pip install 'labanmesh[mqtt]'"),
    ],
)
def test_the_broker_of_home_assistant(facts, mark, text):
    first = next(iter(check_broker(facts)))
    assert first.mark == mark and text in f"{first.what} {first.to_do}"


def test_a_scene_without_a_broker_has_no_word_on_home_assistant(tmp_path):
    (tmp_path / "s.toml").write_text('scene = "home"\n[observers.sofa]\nsource = "0"\n')
    assert list(check_broker(broker_facts(read_scene(tmp_path / "s.toml", {})))) == []
    with (tmp_path / "s.toml").open("a") as file:
        file.write('[hub.mqtt]\nhost = "127.0.0.1"\nport = 9\nusername = "anna"\npassword_file = "word"\n')
    (word, broker) = check_broker(broker_facts(read_scene(tmp_path / "s.toml", {})))
    assert "no such file" in word.what and "127.0.0.1:9: nothing listens there" in broker.what
