"""A fusion service that receives more posteriors than it can read says so."""

import pytest

from common import SECOND_NS
from common.config import FusionConfig, MeshConfig, ObserverConfig, Scene
from common.inbox import Arrival
from common.link import Link
from common.notify import Notifier
from fusion.membership import SceneMember
from fusion.publisher import put_now
from fusion.service import Service

MESH = MeshConfig(mode="process", endpoint="tcp/127.0.0.1:0")

DUE_HZ = 10


@pytest.mark.parametrize(
    "scenes, steps_hz, posteriors, reason",
    [
        ("few", 10, 100, "uses 20 of 1000 posteriors a second: too slow for all of them; find out who sends"),
        ("many", 2, 1, "uses 2 of 10 posteriors a second: too slow for all of them; share the scenes"),
    ],
)
def test_it_is_degraded_while_most_posteriors_are_left_out(scenes, steps_hz, posteriors, reason):
    """steps_hz, posteriors: steps a second, and posteriors at each, while it is behind; of many scenes only the newest
    posterior waits for a step, so that steps that come late are all there is to see."""
    scene = Scene(
        scene="dojo", vocabulary=["bow", "lunge"], observers={"cam1": ObserverConfig(source="-")},
        fusion=FusionConfig(step_hz=DUE_HZ),
    )  # fmt: skip
    now_s = 1000.0
    key = scene.keys.posterior("cam1")
    with Link.open(MESH, "fusion", listen=["tcp/127.0.0.1:0"]) as link:
        member = SceneMember(
            scene,
            Service(
                own="fusion", session="s", link=link, clock=lambda: round(now_s * SECOND_NS), ticks=lambda: now_s,
                shared=False, polled=scenes == "many", wake=lambda: None, ask_clocks_s=60.0, put=put_now,
                supervisor=Notifier(""),
            ),
        )  # fmt: skip
        member.join()
        states = []
        for hz, arrivals in [(steps_hz, posteriors)] * 6 * steps_hz + [(DUE_HZ, 1)] * 6 * DUE_HZ:
            now_s += 1 / hz
            member.update()
            worker = member.worker
            if worker is not None:
                worker.collect([Arrival(key, b"", n) for n in range(arrivals)])
            status = member.status.status(round(now_s * SECOND_NS))
            if (status.state, status.reason) not in states:
                states.append((status.state, status.reason))
        member.close()
    assert next(text for state, text in states if state == "degraded").startswith(reason)
    assert ("running", "") in states and (status.state, status.reason) == ("running", "")
