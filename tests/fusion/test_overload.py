"""A fusion service that receives more posteriors than it can read says so."""

from common import SECOND_NS
from common.config import FusionConfig, MeshConfig, ObserverConfig, Scene
from common.inbox import Arrival
from common.link import Link
from common.notify import Notifier
from fusion.membership import SceneMember
from fusion.publisher import put_now
from fusion.service import Service

MESH = MeshConfig(mode="process", endpoint="tcp/127.0.0.1:0")
STEPS_HZ = 5


def test_it_is_degraded_while_most_posteriors_are_left_out():
    scene = Scene(
        scene="dojo", vocabulary=["bow", "lunge"], observers={"cam1": ObserverConfig(source="-")}, fusion=FusionConfig()
    )
    now_s = 1000.0
    key = scene.keys.posterior("cam1")
    with Link.open(MESH, "fusion", listen=["tcp/127.0.0.1:0"]) as link:
        member = SceneMember(
            scene,
            Service(
                own="fusion", session="s", link=link, clock=lambda: round(now_s * SECOND_NS), ticks=lambda: now_s,
                shared=False, polled=True, wake=lambda: None, ask_clocks_s=60.0, put=put_now, supervisor=Notifier(""),
            ),
        )  # fmt: skip
        member.join()
        states = []
        for arrivals in [200] * 6 * STEPS_HZ + [1] * 6 * STEPS_HZ:
            now_s += 1 / STEPS_HZ
            member.update()
            worker = member.worker
            if worker is not None:
                worker.collect([Arrival(key, b"", n) for n in range(arrivals)])
            status = member.status.status(round(now_s * SECOND_NS))
            if (status.state, status.reason) not in states:
                states.append((status.state, status.reason))
        member.close()
    names = [state for state, _ in states]
    assert names[-2:] == ["running", "degraded"] and (status.state, status.reason) == ("running", "")
    assert states[-1][1].startswith("uses 10 of 1000 posteriors a second: ")
