"""The doctor's findings on a mesh: from made-up messages, and from real Zenoh peers that publish them."""

import threading
import time
from concurrent.futures import ThreadPoolExecutor

import pytest
from hypothesis import given
from hypothesis import strategies as st
from processes import SOON_S

from common.config import FusionConfig, MeshConfig, ObserverConfig, Scene
from common.link import Link
from common.messages import (
    Agreement,
    JudgementMessage,
    ObserverStatistics,
    PosteriorMessage,
    StatusMessage,
    VocabularyReference,
    Vote,
)
from common.vocabulary import Vocabulary
from common.wire import SIZE_LIMIT, encode
from deploy.doctor.findings import worst
from deploy.doctor.mesh import ExpectedMesh, check_mesh, listen
from deploy.doctor.network import network_facts
from deploy.doctor.traffic import PROCESSES_LIMIT, MeshTraffic

NAMES, OTHERS = Vocabulary(("bowing", "lunging")), Vocabulary(("bowing", "jumping"))
SECOND, NOON = 1_000_000_000, 1_700_000_000_000_000_000
HERE = "0.1.0"
SCENE = Scene(
    scene="dojo",
    vocabulary=NAMES.labels,
    observers={name: ObserverConfig(source="m.npz") for name in ("cam1", "cam2", "cam3")},
    fusion=FusionConfig(quorum=2, standby=("spare",)),
)
KEYS = SCENE.keys
EXPECTED = ExpectedMesh(SCENE, HERE, "s.toml")


def reference(vocabulary=NAMES):
    return VocabularyReference(name="karate", hash=vocabulary.digest)


def posterior(observer, seq=0, session="s", vocabulary=NAMES):
    message = PosteriorMessage(v=1, scene="dojo", observer=observer, seq=seq, session=session, captured_ns=1, sent_ns=2,
                               vocabulary=reference(vocabulary), p=[0.5, 0.5], frames=1)  # fmt: skip
    return KEYS.posterior(observer), encode(message)


def judgement(fusion="fusion", seq=0, **more):
    message = JudgementMessage(
        scene="dojo", fusion=fusion, seq=seq, at_ns=NOON, vocabulary=reference(), p=[0.5, 0.5], label="bowing",
        certainty_bits=1.0, rule="log", agreement=Agreement(k=0, n=0), **{"votes": {}, **more},
    )  # fmt: skip
    return KEYS.judgement, encode(message)


def status(name, state="running", at_ns=NOON, frame_ns=NOON, version=HERE, **more):
    key = KEYS.fusion_status(name) if name in ("fusion", "spare", "wild") else KEYS.observer_status(name)
    message = StatusMessage(
        scene="dojo", id=name, state=state, rate_hz=15.0, last_frame_ns=frame_ns, version=version, at_ns=at_ns, **more
    )
    return key, encode(message)


def doubted(name, **reliability):
    """A judgement on a vote that is hardly relied on."""
    return judgement(votes={name: Vote(label=None, entropy=None, weight=0, age_s=0, state="counted", **reliability)})


def statistics(**observers):
    return {"observers": {name: ObserverStatistics(**fields) for name, fields in observers.items()}}


def good():
    """Three observers, a fusion service that judges and one that stands by."""
    messages = {key: [(key, payload)] for key, payload in map(status, ("cam1", "cam2", "cam3", "fusion"))}
    messages["spare"] = [status("spare", reason="standing by for fusion", frame_ns=NOON - 60 * SECOND)]
    messages["judgements"] = [judgement(seq=seq) for seq in range(3)]
    messages["posteriors"] = [posterior(name, seq) for name in SCENE.roster for seq in range(3)]
    return messages


def traffic_of(messages, observers=("cam1", "cam2", "cam3"), fusions=("fusion", "spare"), now_ns=NOON):
    result = MeshTraffic(KEYS, listened_s=2.0)
    for key, payload in [each for group in messages.values() for each in group]:
        result.record(key, payload, now_ns)
    result.alive_observers, result.alive_fusions = frozenset(observers), frozenset(fusions)
    return result


def mark_of(findings, words):
    """The mark of the one finding that holds all of `words`; every complaint has a way out."""
    assert all(bool(each.to_do) == (each.mark != "ok") for each in findings)
    (one,) = [each for each in findings if all(word in f"{each.what} -> {each.to_do}" for word in words)]
    return one.mark


def test_a_good_mesh_is_good():
    findings = check_mesh(EXPECTED, traffic_of(good()))
    assert worst(findings) == "ok", findings
    assert mark_of(findings, ["3 judgements in 2.0 s by fusion"]) == "ok"
    assert mark_of(findings, ["cam1: running, 15 Hz, newest frame 0.0 s old"]) == "ok"
    assert mark_of(findings, ["spare: running: standing by for fusion"]) == "ok"


def test_a_movement_without_a_verdict_is_no_fault_and_says_why():
    why = "bowing 79 % of the 80 % needed"
    undecided, decided = judgement(seq=3, why=why), judgement(seq=4)
    findings = check_mesh(EXPECTED, traffic_of({**good(), "x": [undecided]}))
    assert worst(findings) == "ok" and mark_of(findings, [f"a movement goes on without a verdict yet: {why}"]) == "ok"
    findings = check_mesh(EXPECTED, traffic_of({**good(), "x": [undecided, decided]}))
    assert not any("without a verdict" in each.what for each in findings)


CAM2, FUSION = KEYS.observer_status("cam2"), KEYS.fusion_status("fusion")


@pytest.mark.parametrize(
    ("instead", "who", "mark", "words"),
    [
        ({CAM2: []}, {"observers": ("cam1", "cam3")}, "ok", ["cam1: running"]),
        ({CAM2: [status("cam2", "degraded", reason="no frame for 9 s")]}, {}, "warning",
         ["cam2: degraded: no frame", "what its camera delivers"]),
        ({FUSION: [status("fusion", "degraded", reason="no frame for 9 s")]}, {}, "warning",
         ["fusion: degraded: no frame", "it hears no observer"]),
        ({CAM2: [status("cam2", "failed", reason="BadInput: x")]}, {}, "error", ["cam2: failed: BadInput: x"]),
        ({CAM2: [status("cam2", "starting")]}, {}, "warning", ["cam2: starting", "in a moment"]),
        ({CAM2: [status("cam2", frame_ns=NOON - 7 * SECOND)]}, {}, "warning", ["cam2: running", "frame is 7 s old"]),
        ({CAM2: [status("cam2", version="0.0.9")]}, {}, "warning", ["cam2: labanmesh 0.0.9, here it is 0.1.0"]),
        ({CAM2: [(CAM2, b"\x81\xa1v\x09")]}, {}, "error",
         ["cam2: 1 message rejected: wrong version", "same labanmesh"]),
        ({CAM2: []}, {}, "warning", ["cam2: alive, and publishes no status"]),
        ({}, {"observers": ("cam1", "cam3")}, "warning", ["cam2: running; this is its last status, it is not alive"]),
        ({"x": [posterior("cam2", vocabulary=OTHERS)]}, {}, "error",
         ["cam2 has another vocabulary", "labanmesh learn"]),
        ({"x": [posterior("cam2", 9, "t"), posterior("cam2", 10, "s"), posterior("cam2", 11, "t")]}, {}, "error",
         ["two processes publish as cam2"]),
        ({"x": [status("cam9")]}, {"observers": ("cam1", "cam2", "cam3", "cam9")}, "warning",
         ["not in the scene: cam9"]),
        ({FUSION: [status("fusion", **statistics(cam2={"skew_s": 3600.0}))]}, {}, "warning",
         ["cam2: its clock is 3600 s ahead of that of fusion", "NTP"]),
        ({FUSION: [status("fusion", **statistics(cam2={"skew_s": -0.7}))]}, {}, "warning",
         ["cam2: its clock is 0.7 s behind"]),
        ({FUSION: [status("fusion", **statistics(cam2={"rejected": {"repeated": 4}}))]}, {}, "warning",
         ["cam2: 4 messages rejected: repeated"]),
        ({FUSION: [status("fusion", **statistics(cam2={"rejected": {"same_id": 4}}))]}, {}, "warning",
         ["two processes published as cam2: 4 messages rejected", "stop one of them"]),
        ({FUSION: [status("fusion", **statistics(cam2={}))], "x": [doubted("cam2", label_reliability=0.1)]}, {},
         "warning", ["cam2: the others contradict it in most verdicts", "labanmesh camera look"]),
        ({FUSION: [status("fusion", **statistics(cam2={}))], "x": [doubted("cam2", rest_reliability=0.1)]}, {},
         "warning", ["cam2: its rest contradicts the others (10% trusted)", "stand still or tremble"]),
        ({FUSION: [status("fusion", reason="another process has this id")]}, {}, "error",
         ["fusion: another process has this id", "fuse --id"]),
        ({FUSION: [status("fusion", **statistics(cam2={"rejected": {"never_heard_of": 1}}))]}, {}, "warning",
         ["cam2: 1 message rejected: never heard of"]),
        ({FUSION: [status("fusion", at_ns=NOON + 9 * SECOND)]}, {}, "warning",
         ["this machine's clock is 9.0 s behind that of fusion service fusion"]),
        ({"wild": [status("wild")]}, {"fusions": ("fusion", "spare", "wild")}, "error",
         ["wild", "not in this scene file"]),
        ({"x": [judgement("spare")]}, {}, "error", ["2 fusion services judge at once: fusion, spare"]),
        ({"x": [judgement(seq=seq) for seq in (9, 3, 10, 4)]}, {}, "error",
         ["two processes judge as fusion service fusion"]),
        ({"judgements": []}, {}, "error", ["no judgement within 2.0 s, though observers publish"]),
        ({"judgements": [], "posteriors": []}, {}, "warning", ["no judgement within 2.0 s: no observer publishes"]),
        ({"x": [(KEYS.judgement, b"\xc1")]}, {}, "error", ["judgements: 1 message rejected: not msgpack"]),
        ({"spare": []}, {"fusions": ("fusion",)}, "warning", ["spare is missing", "labanmesh fuse s.toml --id spare"]),
    ],
)  # fmt: skip
def test_a_fault_is_reported(instead, who, mark, words):
    assert mark_of(check_mesh(EXPECTED, traffic_of({**good(), **instead}, **who)), words) == mark


@pytest.mark.parametrize(("missing", "mark"), [(("cam2",), "warning"), (("cam2", "cam3"), "error")])
def test_a_missing_observer_matters_when_too_few_are_left_to_agree(missing, mark):
    left = tuple(name for name in SCENE.roster if name not in missing)
    messages = {"judgements": [judgement()], FUSION: [status("fusion")], **{name: [status(name)] for name in left}}
    findings = check_mesh(EXPECTED, traffic_of(messages, left, ("fusion", "spare")))
    assert mark_of(findings, ["cam2 is missing", "labanmesh observe s.toml cam2"]) == mark


def test_an_empty_mesh_and_one_without_fusion():
    (nobody,) = check_mesh(EXPECTED, traffic_of({}, (), ()))
    assert nobody.mark == "hint" and "labanmesh up s.toml" in nobody.to_do
    findings = check_mesh(EXPECTED, traffic_of({name: [status(name)] for name in SCENE.roster}, fusions=()))
    assert mark_of(findings, ["no fusion service is alive", "labanmesh fuse s.toml"]) == "error"


def test_with_an_observers_certificate_the_doctor_reports_fusion_alone():
    findings = check_mesh(
        ExpectedMesh(SCENE, HERE, "s.toml", partly=True), traffic_of({FUSION: [status("fusion")]}, (), ())
    )
    assert mark_of(findings, ["certificate is an observer's", "--hub"]) == "warning"
    assert not any("cam1" in each.what for each in findings) and mark_of(findings, ["fusion: running"]) == "ok"


def test_services_that_share_scenes_stand_in_no_scene_file():
    shared = SCENE.model_copy(update={"fusion": FusionConfig(quorum=2)})
    messages = {**good(), FUSION: [], "spare": [], "wild": [status("wild")], "judgements": [judgement("wild")]}
    findings = check_mesh(ExpectedMesh(shared, HERE, "s.toml"), traffic_of(messages, fusions=("wild",)))
    assert worst(findings) == "ok" and mark_of(findings, ["wild is not in this scene file", "shares"]) == "ok", findings


def test_the_age_of_a_frame_is_by_the_senders_clock_and_the_clock_by_its_quickest_message():
    an_hour_ahead = status("cam2", at_ns=NOON + 3600 * SECOND, frame_ns=NOON + 3599 * SECOND)
    assert traffic_of({"x": [an_hour_ahead]}).observers["cam2"].frame_age_s == 1.0
    messages = [status("cam2", at_ns=NOON - late * SECOND) for late in (3, 1, 2)]
    assert traffic_of({"x": messages}).observers["cam2"].skew_s == -1.0


def test_a_judgement_that_answers_a_query_may_be_old_and_does_not_count():
    result = MeshTraffic(KEYS)
    result.record(*judgement(), NOON, queried=True)
    assert not result.fusions
    result.record(*judgement(), NOON)
    assert result.fusions["fusion"].judgements == 1


@given(st.lists(st.tuples(st.text("ab/*é", max_size=9), st.binary(max_size=40)), max_size=20), st.booleans())
def test_any_bytes_under_any_key_are_recorded(messages, asked):
    result = MeshTraffic(KEYS)
    for end, payload in messages:
        for key in (
            end,
            f"{KEYS.root}/observer/{end}/status",
            KEYS.posterior("x"),
            KEYS.judgement,
            KEYS.fusion_status("f"),
        ):
            result.record(key, payload, NOON, queried=asked)
    check_mesh(EXPECTED, result)


def test_invented_names_do_not_fill_the_page():
    result = traffic_of({"x": [status(f"x{number}") for number in range(PROCESSES_LIMIT + 10)]})
    assert len(result.observers) == PROCESSES_LIMIT
    (stranger,) = [each for each in check_mesh(EXPECTED, result) if "not in the scene" in each.what]
    assert "58 more" in stranger.what


def publish(link, messages, stop, alive):
    """Be such a mesh until `stop`: publish all messages every 50 ms."""
    for key in alive:
        link.announce(key)
    publishers = {key: link.publisher(key) for key, _ in messages}
    while not stop.wait(0.05):
        for key, payload in messages:
            publishers[key].put(payload)


def test_the_findings_on_a_real_mesh():
    """An observer of another version and an odd one, over Zenoh; nobody else."""
    now_ns = time.time_ns()
    messages = [
        status("cam1", at_ns=now_ns, frame_ns=now_ns, version="0.0.9"), status("cam2", at_ns=now_ns, frame_ns=now_ns),
        status("fusion", at_ns=now_ns, frame_ns=now_ns), judgement(), posterior("cam2", vocabulary=OTHERS),
        (KEYS.judgement, bytes(SIZE_LIMIT + 1)),
    ]  # fmt: skip
    alive = [KEYS.observer_alive("cam1"), KEYS.observer_alive("cam2"), KEYS.fusion_alive("fusion")]
    stop = threading.Event()
    with Link.open(MeshConfig(), "fusion", listen=["tcp/127.0.0.1:0"]) as link, ThreadPoolExecutor(1) as pool:
        scene = SCENE.model_copy(update={"mesh": MeshConfig(endpoint=link.locator)})
        pool.submit(publish, link, messages, stop, alive)
        try:
            facts = listen(scene, network_facts(scene.mesh), 0.6)
        finally:
            stop.set()
    assert facts.network.zenoh_s is not None and facts.traffic is not None
    findings = check_mesh(ExpectedMesh(scene, HERE, "s.toml"), facts.traffic)
    assert mark_of(findings, ["cam1: labanmesh 0.0.9"]) == "warning"
    assert mark_of(findings, ["cam2 has another vocabulary"]) == "error"
    assert mark_of(findings, ["cam3 is missing"]) == "warning"
    assert mark_of(findings, ["judgements in 0.6 s by fusion"]) == "ok"
    assert mark_of(findings, ["judgements: ", "rejected: too large", "fewer observers"]) == "error"
    assert mark_of(findings, ["fusion service fusion: running"]) == "ok"


@pytest.mark.parametrize(("mode", "role"), [("machine", "fusion"), ("router", "router")])
def test_an_empty_mesh_is_not_listened_to_for_long(mode, role):
    with Link.open(MeshConfig(mode=mode), role, listen=["tcp/127.0.0.1:0"]) as link:
        scene = SCENE.model_copy(update={"mesh": MeshConfig(mode=mode, endpoint=link.locator)})
        began_s = time.monotonic()
        facts = listen(scene, network_facts(scene.mesh), 3 * SOON_S)
    assert facts.network.zenoh_s is not None and facts.traffic is not None and facts.traffic.silent
    assert time.monotonic() - began_s < SOON_S
