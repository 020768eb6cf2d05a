"""Listening: late joiners know at once, strangers' nonsense is counted, what is missing is asked for again."""

from itertools import count
from pathlib import Path

import pytest

from common.config import read_scene
from common.inbox import Inbox
from common.wire import encode
from hub.session import listen

ROOT = "laban/room"


class FakeLink:
    """A link whose inbox the test fills, and whose last values it sets."""

    def __init__(self, last=None):
        self.box, self.last, self.asked = Inbox(), last or {}, []

    def inbox(self, *keys):
        self.keys = keys
        return self.box

    def ask(self, key, timeout_s):
        self.asked.append(key)
        return self.last

    def ask_each(self, key, timeout_s):
        return list(self.ask(key, timeout_s).items())


def looks(number):
    """Go on for so many looks into the inbox."""
    left = iter(range(number))
    return lambda: next(left, None) is not None


@pytest.fixture
def scene(tmp_path: Path):
    file = tmp_path / "scene.toml"
    file.write_text('scene = "room"\n[observers.cam1]\nsource = "a.npz"\n[observers.cam2]\nsource = "a.npz"\n')
    return read_scene(file)


def test_a_late_joiner_knows_at_once(scene, said):
    last = {f"{ROOT}/judgement": said.judgement(), f"{ROOT}/vocabulary": said.vocabulary()}
    link = FakeLink({key: encode(message) for key, message in last.items()})
    late_ns = said.NOON + 60 * said.SECOND
    *_, end = listen(scene, link, looks(0), lambda: late_ns)
    assert end.state.labels == tuple(said.vocabulary().labels)
    assert end.state.silence_s == 60, "a last value is as old as it says, not as fresh as the answer"


def test_what_is_said_is_heard_in_order_and_once(scene, said):
    link = FakeLink()
    messages = [said.judgement(1), said.verdict(1), said.judgement(1), said.judgement(2, said.NOON + 1)]
    for message in messages:
        kind = "verdict" if hasattr(message, "id") else "judgement"
        link.box.put(f"{ROOT}/{kind}", encode(message))
    heard = [each.message for each in listen(scene, link, looks(1)) if each.message]
    assert heard == [messages[0], messages[1], messages[3]]
    assert f"{ROOT}/judgement" in link.keys and f"{ROOT}/observer/*/status" in link.keys


def test_nonsense_is_counted_and_dropped(scene, said):
    link = FakeLink()
    link.box.put(f"{ROOT}/judgement", b"nonsense")
    link.box.put(f"{ROOT}/new_kind", b"whatever")
    link.box.put(f"{ROOT}/judgement", encode(said.judgement()))
    *_, end = listen(scene, link, looks(1))
    assert end.state.rejected == 1 and end.state.judgement == said.judgement()


def test_whose_status_it_is_stands_in_the_key(scene, said):
    link = FakeLink()
    link.box.put(f"{ROOT}/observer/cam1/status", encode(said.status("cam1")))
    link.box.put(f"{ROOT}/fusion/main/status", encode(said.status("main")))
    *_, end = listen(scene, link, looks(1))
    assert [judge.name for judge in end.state.observers] == ["cam1", "cam2"] and "main" in end.state.fusion_status


def test_a_missing_vocabulary_is_asked_for_until_it_is_told(scene, said):
    link, seconds = FakeLink(), count(said.NOON, said.SECOND)
    link.box.put(f"{ROOT}/judgement", encode(said.judgement()))
    states = listen(scene, link, looks(8), lambda: next(seconds))
    while f"{ROOT}/vocabulary" not in link.asked:
        link.box.wake()
        next(states)
    link.last = {f"{ROOT}/vocabulary": encode(said.vocabulary())}
    link.box.wake()
    end = None
    for end in states:  # noqa: B007 - what the last one says is looked at
        link.box.wake()
    assert end.state.labels and link.asked.count(f"{ROOT}/vocabulary") <= 3
