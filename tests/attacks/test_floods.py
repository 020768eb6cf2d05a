"""Huge messages and floods: no process grows past 300 MB, none ends, and every scene is judged on."""

import threading
import time
from contextlib import ExitStack
from itertools import pairwise

import pytest
from attack_peers import flood, opened
from attack_stage import JUDGES
from processes import SOON_S, waited_s

from common.config import MeshConfig, ObserverConfig, Scene
from common.link import Link
from common.wire import SIZE_LIMIT
from deploy.security.router_config import router_config

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
    if not long_form:
        pytest.skip("tests/deploy/test_router_limits.py has a small one")
    size, since_ns, unreadable = 900 << 20, time.time_ns(), len(stage.witness.unreadable)
    with Sizes(stage) as sizes:
        for key in keys_of(stage.scenes[0]):
            stage.flood(key, size, congestion="block")
        stage.await_judgements(2.0)
    gaps = stage.gaps(since_ns)
    print("longest gap", round(max(gaps.values()), 3), "s; most MB", max(sizes.most_kb.values(), default=0) // 1000)
    assert max(gaps.values()) <= stage.longest_flooded_s, gaps
    assert max(sizes.most_kb.values(), default=0) < MOST_KB, sizes.most_kb
    assert not stage.witness.unreadable[unreadable:]


@pytest.mark.parametrize("congestion", ["drop", "block"])
@pytest.mark.parametrize("size", [200, SIZE_LIMIT])
def test_a_flood_of_twenty_thousand_messages_a_second(stage, long_form, size, congestion):
    if not long_form and (size, congestion) != (SIZE_LIMIT, "block"):
        pytest.skip("one flood is enough for the short form")
    since_ns, own, other = time.time_ns(), stage.scenes[0].keys, stage.scenes[-1].keys
    with Sizes(stage) as sizes:
        keys = (own.posterior(JUDGES[0]), other.posterior("nobody"), own.observer_status(JUDGES[0]))
        for key in keys if long_form else keys[:1]:
            stage.flood(key, size, 20_000, 5.0 if long_form else 0.1, congestion)
        stage.await_judgements(0.2)
    gaps = stage.gaps(since_ns)
    print("longest gap", round(max(gaps.values()), 3), "s; most MB", max(sizes.most_kb.values(), default=0) // 1000)
    assert max(gaps.values()) <= stage.longest_flooded_s, gaps
    assert max(sizes.most_kb.values(), default=0) < MOST_KB, sizes.most_kb


def test_a_receiver_that_is_stopped_holds_up_nobody_even_if_the_sender_wants_to_wait_for_it(history):
    """Zenoh's own router waits for 5 s for the stopped one, and routes nothing else meanwhile."""
    release, arrived_s = threading.Event(), []
    text = router_config(
        [Scene(scene="dojo", observers={"cam1": ObserverConfig(source="m.npz")})], None, ["tcp/127.0.0.1:0"]
    )
    with Link.router(text, "the test's router") as router, ExitStack() as sessions:
        mesh = MeshConfig(mode="router", endpoint=router.locator)
        stopped, sender, hub = (sessions.enter_context(opened(mesh.endpoint, "client")) for _ in range(3))
        stopped.declare_subscriber("laban/dojo/**", lambda _: release.wait())
        hub.declare_subscriber("laban/dojo/judgement", lambda _: arrived_s.append(time.monotonic()))
        with Link.open(mesh, "fusion") as honest:
            publisher, ended = honest.publisher("laban/dojo/judgement"), threading.Event()
            assert publisher.wait_for_subscriber(SOON_S)
            talking = threading.Thread(target=lambda: [publisher.put(b"judged") for _ in pauses(ended)])
            talking.start()
            before_s = waited_s()
            flood(sender, "laban/dojo/observer/cam1/posterior", SIZE_LIMIT, 20_000, 0.4, "block")
            ended.set()
            talking.join()
            waiting_s = waited_s() - before_s
        release.set()
    gap_s = max(b - a for a, b in pairwise(arrived_s))
    history.note("gap", seconds=gap_s)
    assert gap_s < 2.0 + waiting_s


def pauses(ended):
    """Every hundredth of a second until `ended`."""
    while not ended.wait(0.01):
        yield
