"""The benchmarks: rows as in the contract, small runs without a mesh, and which judgement belongs to which put."""

import json
import threading

from benchmarks.__main__ import as_json, measured, table
from benchmarks.fusion import pace_rows
from benchmarks.mesh import first_judged
from benchmarks.posteriors import NAMES, message, random_posteriors, scene_of
from benchmarks.timing import row
from common.inbox import Arrival
from common.wire import encode
from fusion.engine.engine import FusionEngine

QUICK = {"rounds": 1, "batch_s": 0.0}
AT_NS = 1_700_000_000_123_456_789


def test_a_part_that_fails_or_has_no_time_left_is_left_out_in_one_line_and_the_others_are_measured(capsys):
    def fails():
        yield row("first", 2.0, 1.0, "ms", 1, goal=3.0)
        raise OSError("no such\ndevice")

    def hangs():
        threading.Event().wait(30)
        return []

    fast = {"fails": fails, "works": lambda: [row("load", 1.5, 1.0, "times", 1, goal=1.8, at_least=True)]}
    results = measured({**fast, "hangs": hangs, "late": list}, 0.3)
    assert [one.name for one in results] == ["first", "fails", "load", "hangs", "late"]
    assert json.loads(as_json(results))[1] == {"name": "fails", "left_out": "no such device"}
    text = " ".join(table(results).split())
    assert "first 2.000 ms at most 3.000 ms reached" in text and "at least 1.80 times missed" in text
    assert "left out: fails: no such device" in text and text.count("no time was left") == 2


def test_the_fusion_step_takes_every_posterior():
    rows = pace_rows(**QUICK)
    assert len(rows) == 5
    assert all(one.ours > 0 and one.floor > 0 and one.n > 0 for one in rows)


def test_a_posterior_is_judged_by_the_first_judgement_with_it_or_a_newer_one():
    scene = scene_of(2)
    referee = FusionEngine(scene.scene, list(scene.roster), NAMES, scene.fusion)
    p = random_posteriors(1)[0]

    def judged_at(now_ns, *posteriors):
        for observer, seq, captured_ns in posteriors:
            assert referee.receive(observer, message(seq, captured_ns, p), now_ns) is None
        return Arrival("key", encode(referee.step(now_ns).judgement), now_ns + 7)

    first, second, third = AT_NS, AT_NS + 16_666_667, AT_NS + 33_333_334
    arrivals = [
        judged_at(first - 1),
        judged_at(first + 1_000, ("cam1", 0, first)),
        judged_at(first + 2_000, ("cam2", 0, first)),
        judged_at(third + 999, ("cam1", 1, second), ("cam1", 2, third)),
    ]
    put = [("cam1", first), ("cam2", first), ("cam1", second), ("cam2", second), ("cam1", third)]
    assert first_judged(put, arrivals) == {
        ("cam1", first): first + 1_007,
        ("cam2", first): first + 2_007,
        ("cam1", second): third + 1_006,
        ("cam1", third): third + 1_006,
    }
