"""The referee on the mesh: posteriors in, judgements and verdicts out, and answers to whoever comes late.

1. The mesh only fills an inbox; one loop empties it, and judges once for each lot and `step_hz` times a second.
2. What cannot be read, or does not say what its key says, is counted, logged once a minute and dropped.
3. The last judgement, verdicts, status and the vocabulary answer queries.
4. Of several services the one that leads (leadership.py) speaks; the others hear what it says and go on from there.
"""

import logging
import threading
import time
from collections.abc import Callable

from common.config import Scene
from common.errors import LabanmeshError
from common.keys import observer_of
from common.link import Link, Presence
from common.messages import VocabularyMessage
from common.notify import Notifier
from common.status import StatusPublisher
from common.vocabulary import Vocabulary
from common.wire import decode, encode_vocabulary
from fusion.desk import Desk
from fusion.lot import newest
from fusion.memory_file import Memory
from fusion.referee_like import EngineLike
from fusion.team import Team, Voice
from fusion.telling import Step, telling, waiting

log = logging.getLogger("labanmesh.fusion")
ASK_S = 1.0
ASKING = "asking the observers for their vocabulary"
HEARSAY_S = 0.2
"""How long after opening a link it takes at most to know who is alive."""
NAMESAKE_S = 3.0
"""How long the token of a service that died without closing may outlive it: its lease, and some."""


def serve(
    scene: Scene,
    referee: EngineLike,
    link: Link,
    stop: threading.Event,
    clock: Callable[[], int] = time.time_ns,
    memory: Memory | None = None,
) -> None:
    """Judge the scene until `stop` is set; with `memory`, a movement that went on before a restart is gone on with.

    Raises LabanmeshError when a service of the same id is alive in the scene.
    """
    keys, fusion = scene.keys, scene.fusion.id
    others = link.presence(keys.fusion_alive())
    await_namesake(others, keys.fusion_alive(fusion), stop)
    inbox = link.inbox(keys.posterior())
    desk = Desk(scene, referee, link, clock, inbox.wake)
    voice = Voice(link, keys, encode_vocabulary(scene.scene, referee.vocabulary), referee, memory)
    voice.recall(scene.scene, clock())
    team = Team(scene, referee, voice, link)
    told = telling(scene, referee.vocabulary.labels, lambda: desk.health.status(clock()))
    with told as tell, StatusPublisher(link, keys.fusion_status(fusion), desk.health, clock) as board:
        link.announce(keys.fusion_alive(fusion))
        log.info("judging %s: %s", scene.scene, ", ".join(scene.roster))
        while not stop.is_set():
            arrivals = inbox.take(1 / scene.fusion.step_hz)
            begun_s = time.monotonic()
            counting = newest(arrivals)
            for arrival in counting:
                desk.hear(arrival)
            desk.look()
            leads = team.leads(_ids(others), clock())
            if team.news is not None:
                board.set_state("running", team.news)
            ruling = desk.judge()
            said = team.pass_on(ruling, leads) if ruling is not None else ()
            took_s = time.monotonic() - begun_s
            tell(Step(ruling, leads, said, len(arrivals), len(counting), inbox.dropped, took_s))
            board.alive()
    if inbox.dropped:
        log.warning("%d messages came faster than they could be judged and were left out", inbox.dropped)


def await_namesake(services: Presence, key: str, stop: threading.Event) -> None:
    """Wait for one that was killed to be seen to go; raises LabanmeshError when one of our id is alive for longer."""
    begin_s = time.monotonic()
    # Who is alive comes to be known a moment after the link was opened.
    while (waited_s := time.monotonic() - begin_s) < HEARSAY_S or key in services.alive:
        if stop.wait(0.02):
            return
        if waited_s > NAMESAKE_S:
            raise LabanmeshError(
                f"{key}: a fusion service of this id is alive already; stop it, or give this one an id of its own: "
                '[fusion] standby = ["second"] in the scene file, and labanmesh fuse SCENE --id second'
            )


def known_vocabulary(scene: Scene, link: Link, stop: threading.Event) -> Vocabulary | None:
    """The vocabulary that the scene names, else that of the first observer who answers; None when stopped before."""
    if scene.named_vocabulary is not None:
        return scene.named_vocabulary
    log.info("%s names no vocabulary: asking the observers for theirs", scene.scene)
    supervisor = Notifier.from_environment()
    supervisor.ready(ASKING)
    with waiting(scene, ASKING) as tell:
        while not stop.is_set():
            supervisor.alive()
            tell()
            for payload in link.ask(scene.keys.vocabulary, ASK_S).values():
                try:
                    said = decode(VocabularyMessage, payload)
                    return Vocabulary(tuple(said.labels), said.name)
                except LabanmeshError as error:
                    log.warning("a vocabulary that cannot be used: %s", error)
    return None


def _ids(presence: Presence) -> frozenset[str]:
    return frozenset(observer_of(key) for key in presence.alive)
