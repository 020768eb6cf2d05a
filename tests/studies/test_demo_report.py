"""The demo's result: first and last words, additional verdicts, late votes, and a table also without matplotlib."""

import contextlib
import sys
from types import SimpleNamespace

import numpy as np
import pytest

from common import SECOND_NS
from common.config import read_scene
from common.errors import BadInput, LabanmeshError
from common.inbox import Inbox
from common.messages import Agreement, JudgementMessage, VerdictMessage, VocabularyReference, Vote
from common.wire import encode
from observer.motion.archive import Recording, Span
from studies import demo
from studies.demo import DemoTraffic
from studies.demo_report import draw_figures, movement_rows, result_text
from studies.demo_scene import synthetic_performance, write_demo

T0 = 1_700_000_000 * SECOND_NS
RATE = 10.0
STREAM = Recording(
    np.zeros((100, 3, 3), np.float32), RATE, "", "1", "demo", (Span(10, 30, "ok"), Span(50, 70, "shake"))
)
BASE = {"scene": "demo", "fusion": "fusion", "seq": 1, "certainty_bits": 0.5, "rule": "log", "p": [0.5, 0.5]}
BASE |= {"vocabulary": VocabularyReference(name="", hash="0" * 16), "agreement": Agreement(k=2, n=4)}


def ns(seconds):
    return T0 + round(seconds * SECOND_NS)


def verdict(name, label, began_s, ended_s=None):
    times = {"began_ns": ns(began_s), "decided_ns": ns(began_s + 0.5), "ended_ns": ended_s and ns(ended_s)}
    return VerdictMessage(**BASE, votes={}, at_ns=ns(began_s + 0.5), label=label, id=name, **times)


def judgement(at_s, *states):
    votes = {
        f"cam{n}": Vote(label=None, entropy=1.0, weight=0.5, age_s=0.1, state=state) for n, state in enumerate(states)
    }
    return JudgementMessage(**BASE, votes=votes, at_ns=ns(at_s), label="ok")


def traffic(*words, judgements=(), **more):
    result = DemoTraffic(began_ns=T0, ended_ns=ns(10), judgements=list(judgements), **more)
    for word in words:
        result.first_words.setdefault(word.id, word)
        result.last_words[word.id] = word
    return result


def text_of(shown, pixels=True):
    return result_text(movement_rows(STREAM, shown), shown, pixels)


def test_the_first_word_is_shown_with_its_time_and_the_last_word_where_it_differs():
    text = text_of(traffic(verdict("a", "shake", 1.2), verdict("a", "ok", 1.2, 3.0), verdict("b", "shake", 5.0, 7.0)))
    first, second = text.splitlines()[2:4]
    assert first.split()[:5] == ["ok", "1.0s", "3.0s", "shake", "0.7s"]
    assert first.endswith("WRONG; last word ok: right")
    assert second.endswith("right") and "last word" not in second
    assert "first word: 1 of 2 right, 1 wrong, 0 undecided" in text and "last word:  2 of 2 right, 0 wrong" in text
    unchanged = text_of(traffic(verdict("a", "ok", 1.2, 3.0), verdict("b", "abstain", 5.0, 7.0)))
    assert "1 of 2 right, 0 wrong, 1 undecided" in unchanged
    assert "last word" not in unchanged and "additional" not in unchanged


def test_additional_verdicts_are_listed():
    text = text_of(traffic(verdict("a", "ok", 1.0, 2.0), verdict("b", "shake", 2.2, 3.0), verdict("c", "ok", 8.2, 9.0)))
    assert "2 additional verdicts:\n    2.7s  shake, during ok\n    8.7s  ok, between movements" in text
    assert "no verdict" in text and "1 of 2 right, 0 wrong, 1 undecided" in text


@pytest.mark.parametrize(
    ("states", "more", "slow", "way_out"),
    [
        (["counted"] * 3, {}, "", ""),
        (["counted", "late", "stale"], {}, "TOO SLOW: 67% of the votes", "run labanmesh demo --no-pixels"),
        (["counted", "counted", "late"], {"timed_out": True}, "TOO SLOW: the observers did not reach", "close"),
    ],
)
def test_a_machine_that_is_too_slow_is_named(states, more, slow, way_out):
    # Before the first and after the last frame observers are silent on any machine.
    judgements = [judgement(-1, *["silent"] * 3), judgement(2, *states), judgement(11, *["silent"] * 3)]
    text = text_of(traffic(judgements=judgements, **more))
    late = sum(state != "counted" for state in states) / 3
    assert f"votes in time: {1 - late:.0%}" in text
    assert ("TOO SLOW" in text) == bool(slow) and slow in text and way_out in text
    assert "--no-pixels" not in text_of(traffic(judgements=judgements, **more), pixels=False)


def test_without_matplotlib_a_note_names_the_figures_and_the_way_to_them(monkeypatch, tmp_path):
    for name in [name for name in sys.modules if name.startswith(("matplotlib", "studies.figures"))]:
        monkeypatch.delitem(sys.modules, name)
    monkeypatch.setitem(sys.modules, "matplotlib", None)
    files, note = draw_figures(STREAM, traffic(judgements=[judgement(1, "counted")]), ("ok", "shake"), tmp_path)
    assert files == [] and "verdicts.png" in note and "pip install 'labanmesh[report]'" in note


def test_a_folder_that_cannot_be_written_is_one_line_with_a_way_out(tmp_path):
    (tmp_path / "file").write_text("")
    with pytest.raises(BadInput, match=r"^cannot make the folder .*file: .*\. Choose another one with --output$"):
        write_demo(synthetic_performance(0), tmp_path / "file", lambda *_: None, pixels=False)


def test_without_pixels_observers_get_positions_and_nothing_is_filmed(tmp_path, monkeypatch):
    monkeypatch.setattr("studies.demo_scene.run_parts", lambda *_: [])  # models would be learned
    file, rate = write_demo(synthetic_performance(0), tmp_path / "shown", lambda *_: None, pixels=False)
    observers = read_scene(file).observers.values()
    assert rate is None and {observer.source for observer in observers} == {"performance.npz"} and len(observers) == 4


class SlowToStart:
    """The processes of a demo that publish a judgement only after they have been looked at three times."""

    def __init__(self, inbox, key):
        self._inbox, self._key, self._looks, self.started = inbox, key, 0, []

    @contextlib.contextmanager
    def process(self, command, **_):
        self.started.append((command[4], self._looks))
        yield self

    def poll(self):
        self._looks += 1
        if self._looks == 3:
            self._inbox.put(self._key, encode(judgement(0.0, "counted")))

    def wait(self, timeout_s):
        return 1


def test_the_terminal_view_starts_when_something_is_published(tmp_path, monkeypatch):
    (tmp_path / "scene.toml").write_text('scene = "demo"\n[observers.a]\nsource = "a.npz"\n')
    inbox = Inbox()
    up = SlowToStart(inbox, read_scene(tmp_path / "scene.toml").keys.judgement)
    link = SimpleNamespace(inbox=lambda *_: inbox)
    monkeypatch.setattr(demo.Link, "open", lambda *_: contextlib.nullcontext(link))
    monkeypatch.setattr(demo, "_process", up.process)
    with pytest.raises(LabanmeshError, match=r"log\.txt says why"):
        demo.play(tmp_path / "scene.toml", tmp_path / "log.txt", 1.0)
    assert up.started == [("up", 0), ("watch", 3)]
