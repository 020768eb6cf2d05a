"""A fusion service between real Zenoh peers: what an observer publishes, what a hub receives."""

import pytest
from mesh_stage import LOOPBACK, NAMED, NAMES, collect, deliver, posterior
from processes import SOON_S

from common.config import read_scene
from common.messages import JudgementMessage, StatusMessage, VerdictMessage, VocabularyMessage
from common.wire import decode, encode_vocabulary
from fusion.server import serve


@pytest.fixture
def read(tmp_path):
    def written(scene="dojo", vocabulary=NAMED):
        text = f'scene = "{scene}"\n{vocabulary}{LOOPBACK}'
        text += "".join(f'[observers.cam{i}]\nsource = "m.npz"\n' for i in (1, 2))
        (tmp_path / f"{scene}.toml").write_text(f"{text}[fusion]\nstep_hz = 50\nhold_s = 0.1\nquorum = 1\n")
        return read_scene(tmp_path / f"{scene}.toml", {})

    return written


@pytest.fixture
def scene(read):
    return read()


@pytest.fixture
def peer(mesh):
    return mesh.peer


@pytest.fixture
def running(mesh):
    """Run a fusion service of the scenes until the test ends."""

    def run(*scenes):
        def body(stop):
            serve(scenes, "fusion", mesh.meeting, stop, shared=len(scenes) > 1)

        return mesh.run(body)

    return run


def move(publisher, stop):
    """Publish a movement until `stop` is set."""
    for seq in range(100_000):
        if stop.wait(0.01):
            return
        publisher.put(posterior(seq=seq))


def test_posteriors_become_judgements_and_verdicts_and_late_joiners_get_the_last(scene, mesh, peer, running, caplog):
    caplog.set_level("INFO", "labanmesh.fusion")
    keys, hub = scene.keys, peer()
    judgements, verdicts = hub.inbox(keys.judgement), hub.inbox(keys.verdict)
    running(scene)
    # It judges even when no posterior arrives.
    waiting = collect(judgements, JudgementMessage, lambda messages: len(messages) >= 3)[-1]
    assert (waiting.label, waiting.agreement.n, waiting.epoch) == ("", 0, 1)
    assert "dojo: waiting for observers" in caplog.text
    publisher = peer("observer").publisher(keys.posterior("cam1"))
    assert publisher.wait_for_subscriber(SOON_S)
    mesh.run(move, publisher)
    decided = collect(verdicts, VerdictMessage, bool)[0]
    assert (decided.label, decided.ended_ns, decided.votes["cam1"].label) == ("bowing", None, "bowing")
    # Full votes come only where somebody subscribes to them.
    full = collect(hub.inbox(keys.votes), JudgementMessage, lambda messages: len(messages) > 2)[-1].votes["cam1"]
    short = collect(judgements, JudgementMessage, bool)[-1].votes["cam1"]
    assert full.p is not None and full.root_p is None and short.root_p is not None
    answers = peer().ask(f"{keys.root}/**", SOON_S)
    assert set(answers) == {keys.judgement, keys.verdict, keys.vocabulary, keys.fusion_status("fusion")}
    assert decode(VerdictMessage, answers[keys.verdict]).id == decided.id
    assert decode(VocabularyMessage, answers[keys.vocabulary]).labels == ["bowing", "lunging"]
    assert decode(StatusMessage, answers[keys.fusion_status("fusion")]).state == "running"


@pytest.mark.parametrize("count", [2, 9], ids=["few", "many"])
def test_a_query_for_all_last_values_changes_nothing(read, peer, running, count):
    """Nine scenes are polled, two are received by threads; both go on when a hub asks for all last values."""
    scenes = [read(f"dojo{n}") for n in range(count)]
    hub = peer()
    judgements = hub.inbox(scenes[0].keys.judgement)
    running(*scenes)
    for _ in range(5):
        collect(judgements, JudgementMessage, bool)
        answers = peer().ask(f"{scenes[0].keys.root}/**", SOON_S)
        assert scenes[0].keys.judgement in answers
    assert {j.epoch for j in collect(judgements, JudgementMessage, lambda messages: len(messages) > 5)} == {1}


def test_rejected_messages_are_in_the_status_by_observer_and_reason_and_the_loop_goes_on(
    scene, mesh, peer, running, caplog
):
    hub, observer, key = peer(), peer("observer"), scene.keys.posterior("cam1")
    publisher = observer.publisher(key)
    statuses, judgements = hub.inbox(scene.keys.fusion_status()), hub.inbox(scene.keys.judgement)
    running(scene)
    assert publisher.wait_for_subscriber(SOON_S)
    for payload in (b"\xc1", b"", posterior("cam2"), posterior(scene="garden"), posterior()[:-3], b"x" * 70_000):
        deliver(observer, key, payload)
    deliver(observer, scene.keys.posterior("mallory"), b"\xc1")
    wanted = {"not_msgpack": 3, "wrong_key": 2, "too_large": 1}

    def counted(messages):
        return any(s.observers and s.observers["cam1"].rejected == wanted for s in messages)

    status = collect(statuses, StatusMessage, counted)[-1]
    assert set(status.observers) <= {"cam1", "cam2", "mallory"}
    mesh.run(move, publisher)
    collect(judgements, JudgementMessage, lambda messages: any(j.votes["cam1"].state == "counted" for j in messages))
    lines = [record.message for record in caplog.records if "cam1: messages rejected" in record.message]
    assert len(lines) == 1


def test_it_knows_which_observers_are_alive(scene, mesh, peer, running):
    patient = scene.fusion.model_copy(update={"drop_s": 10 * SOON_S})
    scene = scene.model_copy(update={"fusion": patient})
    judgements, one = peer().inbox(scene.keys.judgement), peer("observer")
    one.announce(scene.keys.observer_alive("cam1"))
    publisher = one.publisher(scene.keys.posterior("cam1"))
    running(scene)
    assert publisher.wait_for_subscriber(SOON_S)
    stop, moving = mesh.run(move, publisher)
    collect(judgements, JudgementMessage, lambda messages: any(j.votes["cam1"].state == "counted" for j in messages))
    stop.set()
    moving.join(SOON_S)
    one.close()
    # Its token has disappeared; drop_s would pass after the end of the test.
    collect(judgements, JudgementMessage, lambda messages: messages and messages[-1].votes["cam1"].state == "silent")


def test_it_is_alive_and_its_last_status_is_stopping(scene, peer, running):
    hub = peer()
    presence, statuses = hub.presence(scene.keys.fusion_alive()), hub.inbox(scene.keys.fusion_status())
    stop, thread = running(scene)
    assert presence.wait_for(1, SOON_S)
    collect(statuses, StatusMessage, lambda messages: [s.state for s in messages].count("running") >= 2)
    stop.set()
    thread.join(SOON_S)
    assert collect(statuses, StatusMessage, bool)[-1].state == "stopping"
    assert presence.wait_for(0, SOON_S)


def test_scenes_without_vocabulary_ask_an_observer_as_soon_as_it_appears(read, peer, running, monkeypatch):
    # Without an observer to ask, the next time would be after the end of the test.
    monkeypatch.setattr("fusion.standby.ANSWER_TIMEOUT_S", 10 * SOON_S)
    scenes = [read("dojo", ""), read("garden")]
    hub = peer()
    judgements, statuses = hub.inbox(scenes[0].keys.judgement), hub.inbox(scenes[0].keys.fusion_status())
    running(*scenes)
    collect(statuses, StatusMessage, lambda messages: messages and "vocabulary" in messages[-1].reason)
    payload = encode_vocabulary("dojo", NAMES)
    observer = peer("observer")
    observer.answer(scenes[0].keys.vocabulary, lambda: payload)
    observer.announce(scenes[0].keys.observer_alive("cam1"))
    judgement = collect(judgements, JudgementMessage, bool)[0]
    assert judgement.vocabulary.hash == NAMES.digest and len(judgement.p) == 2
