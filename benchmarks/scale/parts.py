"""What each part of a fusion process costs, in microseconds of a processor, and how large its messages are.

1. Rounds of a fleet on a real link, in which a few scenes are due, or as many as are judged together: each has its
   part, and all share one, with what the processor has forgotten since the last round.
   A referee alone hears, a link alone says, inboxes alone are emptied; what is left of a scene's part is the judging.
2. What Zenoh's threads spend is in traffic.py.
3. All of it in ROUNDS rounds, of which the medians count.
"""

import threading
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import closing, contextmanager
from statistics import median

from benchmarks.crowd.crowd import JUDGES, NAMES, scene_name
from benchmarks.crowd.trial import free_port
from benchmarks.scale.traffic import MICRO, hearing, sayings, scene_of
from common.config import MeshConfig, Scene
from common.errors import LabanmeshError
from common.inbox import Arrival
from common.keys import SceneKeys
from common.link import Link, Publisher
from common.messages import PosteriorMessage, StatusMessage, VerdictMessage
from common.notify import Notifier
from common.status import ProcessStatus
from common.wire import decode, encode, encode_vocabulary
from fusion.engine.engine import FusionEngine
from fusion.ingest import PosteriorIngest
from fusion.server import BATCH, FusionServer

ROUNDS = 3
CALLS = 200
ARRIVED_S = 0.005
FLEET_SCENES = 200
STEPS = 30
FEW = 4
PATIENCE_S = 5.0


def measured_parts() -> tuple[dict[str, float], dict[str, int]]:
    """Every cost of benchmarks/scale/measured.py:Costs, and the sizes of messages in bytes."""
    rounds = [one_round() for _ in range(ROUNDS)]
    return {name: round(median(costs[name] for costs, _ in rounds), 2) for name in rounds[0][0]}, rounds[-1][1]


def one_round() -> tuple[dict[str, float], dict[str, int]]:
    """The same, once."""
    bare, sizes = alone()
    with linked() as (link, endpoint, far):
        step = stepping(link, far)
        take = taking(link, far)
        voice = far.publisher(scene_of(0).keys.posterior("cam0"))
        say = spent(lambda: voice.put(bytes(sizes["judgement"])), CALLS) + bare.pop("encode")
        tell = spent(lambda: voice.put(bytes(sizes["fusion_status"])), CALLS) + bare.pop("status")
        costs = {**bare, **hearing(link, endpoint), **step, "hop": hopping(link, voice), "round": passing(link)}
    judge = max(costs.pop("step") - JUDGES * (take + costs["hear"]) - say, 0.0)
    costs |= {"take": take, "judge": judge, "say": say, "tell": tell, "turn": turning()}
    return costs, sizes


def alone() -> tuple[dict[str, float], dict[str, int]]:
    """What hearing and encoding cost without a mesh; how large messages are."""
    scene = scene_of(0)
    keys, now_ns = scene.keys, time.time_ns()
    referee, health = (
        FusionEngine(scene.scene, list(scene.roster), NAMES, scene.fusion),
        ProcessStatus(scene.scene, "fusion"),
    )
    ingest = PosteriorIngest(referee, health, lambda: now_ns)
    took: list[float] = []
    verdict: VerdictMessage | None = None
    for seq in range(CALLS):
        now_ns += 100_000_000
        said = sayings(scene.scene, NAMES.labels[3] if seq % 40 >= 20 else None)
        payloads = [saying.at(seq, now_ns - 20_000_000) for saying in said]
        begun_s = time.thread_time()
        for judge, payload in enumerate(payloads):
            ingest.take(Arrival(keys.posterior(f"cam{judge}"), payload, now_ns))
        took.append((time.thread_time() - begun_s) / JUDGES)
        ruling = referee.step(now_ns)
        verdict = next(iter(ruling.verdicts), verdict)
    health.set_observers(ingest.statistics(scene.roster))
    one = decode(PosteriorMessage, said[0].at(seq, now_ns)).model_copy(
        update={"scene": None, "observer": None, "visible": None, "v": 2}
    )
    watching = StatusMessage(
        scene=scene.scene, id="cam0", state="running", rate_hz=30.0, last_frame_ns=now_ns, at_ns=now_ns
    )
    sizes = {"posterior": one, "judgement": ruling.judgement, "verdict": verdict, "observer_status": watching}
    lengths = {name: len(encode(message)) for name, message in sizes.items() if message is not None}
    lengths |= {
        "fusion_status": len(encode(health.status(now_ns))),
        "vocabulary": len(encode_vocabulary(scene.scene, NAMES)),
    }
    encoding = spent(lambda: encode(ruling.judgement), CALLS)
    status = spent(lambda: encode(health.status(now_ns)), CALLS)
    return {"hear": median(took) * MICRO, "encode": encoding, "status": status}, lengths


@contextmanager
def linked() -> Iterator[tuple[Link, str, Link]]:
    """A link where others meet, its endpoint, and a second link that has met it."""
    endpoint = f"tcp/127.0.0.1:{free_port()}"
    with (
        Link.open(MeshConfig(endpoint=endpoint), "fusion") as link,
        Link.open(MeshConfig(endpoint=endpoint), "observer") as far,
    ):
        yield link, endpoint, far


def stepping(link: Link, far: Link) -> dict[str, float]:
    """What a round costs by how many scenes are due in it: each, and what all share; and what taking a scene costs."""
    (few, _), (many, sit) = (_rounds_of(count, link, far) for count in (FEW, BATCH))
    each = (many - few) / (BATCH - FEW)
    return {"step": each, "cold": max(few - FEW * each, 0.0), "sit": sit}


def _rounds_of(count: int, link: Link, far: Link) -> tuple[float, float]:
    scenes = [scene_of(n) for n in range(count)]
    end_s = time.monotonic() + PATIENCE_S
    with closing(polled_server(scenes, link)) as server:
        begun_s = time.thread_time()
        owned = server.step().owned
        while owned < count:
            if time.monotonic() > end_s:
                raise LabanmeshError(f"a service that is alone did not take its scenes within {PATIENCE_S:g} s")
            owned = server.step().owned
        sit = (time.thread_time() - begun_s) / count
        told, took = [Told(scene, far) for scene in scenes], []
        for _ in range(STEPS):
            for voices in told:
                voices.say()
            time.sleep(1.1 / scenes[0].fusion.step_hz)
            begun_s = time.thread_time()
            server.step()
            took.append(time.thread_time() - begun_s)
    return median(took) * MICRO, sit * MICRO


def taking(link: Link, far: Link) -> float:
    """What it costs to empty an inbox of one posterior, over an empty one."""
    branches = [link.sub_session(polled=True) for _ in range(BATCH)]
    inboxes = [
        branch.inbox(*map(scene_of(n).keys.posterior, scene_of(n).roster), ring=1) for n, branch in enumerate(branches)
    ]
    told = [Told(scene_of(n), far) for n in range(BATCH)]
    took: dict[int, list[float]] = {0: [], len(told) * JUDGES: []}
    for number in range(2 * STEPS):
        for one in told if number % 2 else ():
            one.say()
        time.sleep(ARRIVED_S)
        begun_s = time.thread_time()
        for branch in branches:
            branch.poll()
        came = sum(len(inbox.take(0)) for inbox in inboxes)
        took.setdefault(came, []).append((time.thread_time() - begun_s) * MICRO)
    for branch in branches:
        branch.close()
    none, all_ = (median(times) for times in (took[0], took[len(told) * JUDGES]))
    return max(all_ - none, 0.0) / JUDGES / len(told)


class Told:
    """The four observers of a scene."""

    def __init__(self, scene: Scene, far: Link) -> None:
        self._voices = [far.publisher(scene.keys.posterior(f"cam{judge}")) for judge in range(JUDGES)]
        self._sayings, self._seq = sayings(scene.scene, NAMES.labels[3]), 0
        if not all(voice.wait_for_subscriber(10) for voice in self._voices):
            raise LabanmeshError("the court did not listen to its observers within 10 s")

    def say(self) -> None:
        """Each once."""
        self._seq += 1
        for voice, saying in zip(self._voices, self._sayings, strict=True):
            voice.put(saying.at(self._seq, time.time_ns()))


def passing(link: Link) -> float:
    """What a scene that is not due costs in each round."""
    scenes = [scene_of(n) for n in range(FLEET_SCENES)]
    slow = [scene.model_copy(update={"fusion": scene.fusion.model_copy(update={"step_hz": 0.1})}) for scene in scenes]
    with closing(polled_server(slow, link)) as server:
        return spent(server.step, CALLS) / FLEET_SCENES


def polled_server(scenes: Sequence[Scene], link: Link) -> FusionServer:
    """A service of many scenes that never pauses."""
    silent = Notifier("")
    return FusionServer(scenes, "fusion", link, time.time_ns, shared=True, supervisor=silent, polled=True, pause_s=0.0)


def turning() -> float:
    """What it costs to wait for a moment and come back."""
    return spent(lambda: threading.Event().wait(ARRIVED_S), CALLS)


def hopping(link: Link, voice: Publisher) -> float:
    """From a put until the message is there, in microseconds."""
    inbox, took = link.inbox(SceneKeys(scene_name(0)).posterior()), []
    voice.wait_for_subscriber(10)
    for _ in range(CALLS):
        put_ns = time.time_ns()
        voice.put(b"hop")
        took += [(arrival.arrived_ns - put_ns) / 1e3 for arrival in inbox.take(1.0)]
        time.sleep(ARRIVED_S)
    return median(took)


def spent(work: Callable[[], object], rounds: int) -> float:
    """Processor time of this thread, in microseconds a call: the median."""
    took = []
    for _ in range(rounds):
        begun_s = time.thread_time()
        work()
        took.append(time.thread_time() - begun_s)
    return median(took) * MICRO
