"""Recordings begin together when the last observer is ready; nobody waits for ever, and late ones join."""

import threading
from concurrent.futures import ThreadPoolExecutor

from common import SECOND_NS
from observer.motion.playback import StartBarrier

NOW_NS = 1_700_000_000 * SECOND_NS


def barrier(folder, observer, timeout_s=60.0, **options):
    return StartBarrier(folder, observer, timeout_s=timeout_s, **options)


def awaited(folder, *observers):
    for observer in observers:
        (folder / f"{observer}.awaited").touch()


def test_all_begin_at_the_same_time_after_the_last_is_ready(tmp_path):
    awaited(tmp_path, "a", "b", "c")
    with ThreadPoolExecutor() as pool:
        early = [pool.submit(barrier(tmp_path, name), threading.Event()) for name in "ab"]
        while len(list(tmp_path.glob("*.ready"))) < 2:
            pass
        assert not any(one.done() for one in early)
        begins = {barrier(tmp_path, "c")(threading.Event()), *(one.result(10) for one in early)}
    assert len(begins) == 1
    ready_ns = int((tmp_path / "c.ready").read_text())
    assert 0 < begins.pop() - ready_ns < 5 * SECOND_NS


def test_an_observer_that_starts_again_joins_where_the_others_are(tmp_path):
    awaited(tmp_path, "a")
    begin_ns = barrier(tmp_path, "a", clock=lambda: NOW_NS)(threading.Event())
    assert barrier(tmp_path, "a", clock=lambda: NOW_NS + 60 * SECOND_NS)(threading.Event()) == begin_ns


def test_nobody_waits_for_one_that_never_comes(tmp_path, caplog):
    awaited(tmp_path, "a", "broken")
    times = iter(range(NOW_NS, NOW_NS + 1000 * SECOND_NS, SECOND_NS // 2))
    with caplog.at_level("WARNING"):
        barrier(tmp_path, "a", timeout_s=1.0, clock=lambda: next(times))(threading.Event())
    assert "begins without 1 observer: broken: not ready after 1 s" in caplog.text


def test_not_before_the_earliest_time_and_not_without_the_folder(tmp_path):
    later_ns = NOW_NS + 9 * SECOND_NS
    assert barrier(tmp_path, "a", earliest_ns=later_ns, clock=lambda: NOW_NS)(threading.Event()) == later_ns
    gone = barrier(tmp_path / "gone", "a", clock=lambda: NOW_NS)
    assert gone(threading.Event()) == NOW_NS


def test_stopping_ends_the_wait(tmp_path):
    awaited(tmp_path, "a", "b")
    stop = threading.Event()
    stop.set()
    assert barrier(tmp_path, "a", clock=lambda: NOW_NS)(stop) == NOW_NS
