"""Huge messages and floods: no process grows past 300 MB, none ends, and every scene is judged on."""

import threading
import time

import pytest
from attack_stage import JUDGES

from common.wire import SIZE_LIMIT

MOST_KB = 300_000


def keys_of(scene):
    keys = scene.keys
    return (keys.posterior("door"), keys.observer_status("door"), keys.judgement, keys.verdict, keys.vocabulary)


class Sizes:
    """Watches the memory of all processes; `most_kb` by name."""

    def __init__(self, stage):
        self.most_kb, self._stage, self._stop = {}, stage, threading.Event()
        self._thread = threading.Thread(target=self._watch, daemon=True)

    def _watch(self):
        while not self._stop.wait(0.05):
            for name, kb in self._stage.memory_kb().items():
                self.most_kb[name] = max(kb, self.most_kb.get(name, 0))

    def __enter__(self):
        self._thread.start()
        return self

    def __exit__(self, *_):
        self._stop.set()
        self._thread.join()
        self._stage.history.note("most", kb=self.most_kb)


def test_a_huge_put_with_blocking_congestion_control(stage, long_form):
    size, since_ns = (900 if long_form else 12) << 20, time.time_ns()
    with Sizes(stage) as sizes:
        for key in keys_of(stage.scenes[0])[: None if long_form else 1]:
            stage.flood(key, size, congestion="block")
        stage.await_judgements(2.0 if long_form else 0.2)
    gaps = stage.gaps(since_ns)
    assert max(gaps.values()) <= stage.longest_gap_s, gaps
    assert max(sizes.most_kb.values(), default=0) < MOST_KB, sizes.most_kb
    assert not stage.witness.unreadable


@pytest.mark.parametrize("congestion", ["drop", "block"])
@pytest.mark.parametrize("size", [200, SIZE_LIMIT])
def test_a_flood_of_twenty_thousand_messages_a_second(stage, long_form, size, congestion):
    if not long_form and (size, congestion) != (SIZE_LIMIT, "block"):
        pytest.skip("one flood is enough for the short form")
    since_ns, own, other = time.time_ns(), stage.scenes[0].keys, stage.scenes[-1].keys
    with Sizes(stage) as sizes:
        for key in (own.posterior(JUDGES[0]), other.posterior("nobody"), own.observer_status(JUDGES[0])):
            stage.flood(key, size, 20_000, 5.0 if long_form else 0.1, congestion)
        stage.await_judgements(0.2)
    gaps = stage.gaps(since_ns)
    assert max(gaps.values()) <= stage.longest_gap_s, gaps
    assert max(sizes.most_kb.values(), default=0) < MOST_KB, sizes.most_kb
