"""The ear of the hub: what is news and what is history, and of many judgements the newest."""

import pytest
from mqtt_stage import until

from common.config import read_scene
from common.inbox import Inbox, Presence
from common.wire import encode
from hub.mqtt.listener import SceneListener


class FakeLink:
    """A link whose inboxes the test fills, and which tells on asking what the test wants."""

    def __init__(self, told, meanwhile):
        self.told, self.meanwhile, self.boxes = told, meanwhile, {}

    def inbox(self, *keys, limit=4096):
        box = Inbox(limit)
        self.boxes |= dict.fromkeys(keys, box)
        return box

    def presence(self, key):
        return Presence()

    def ask(self, key, timeout_s):
        return {}

    def ask_each(self, key, timeout_s):
        for spoken, payload in self.meanwhile:
            self.boxes[spoken].put(spoken, payload)
        return self.told


@pytest.fixture
def scene(tmp_path):
    file = tmp_path / "scene.toml"
    file.write_text('scene = "room"\n[observers.cam1]\nsource = "a.npz"\n')
    return read_scene(file, {})


def test_a_verdict_that_is_said_while_we_ask_is_news(scene, said):
    old, new = ((scene.keys.verdict, encode(said.verdict(number))) for number in (1, 2))
    words = [(scene.keys.judgement, encode(said.judgement(seq, said.NOON + seq))) for seq in range(1, 9)]
    heard = []
    with SceneListener(scene, FakeLink([old, new], [new, *words]), heard.append) as ear:
        until(lambda: len(ear.verdicts) == 2 and ear.state.judgement, lambda: heard)
    assert [(each.verdict.id, each.answered) for each in ear.verdicts] == [("v1", True), ("v2", False)]
    assert ear.state.judgement.seq == 8
    assert sum(each.message is not None for each in heard) == 3, "of the judgements the newest alone is read"


def test_what_ends_the_listening_before_its_time_is_raised(scene):
    def fail(heard):
        raise ValueError("no")

    with SceneListener(scene, FakeLink([], []), fail) as ear, pytest.raises(ValueError, match="no"):
        until(ear.check, "the fault")
