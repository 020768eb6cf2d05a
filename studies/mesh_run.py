"""The same evaluation over real Zenoh sessions: do the judges agree on the same when a network is between them?

Each view has a session and publishes every posterior, the referee has a session and judges, and a listener's session
hears the judgements: what differs from the evaluation in one process is the wire and nothing else.
"""

import threading
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from common.config import FusionConfig, MeshConfig, ObserverConfig, Scene
from common.errors import LabanmeshError
from common.inbox import Inbox
from common.link import Link
from common.messages import JudgementMessage
from common.vocabulary import Vocabulary
from common.wire import decode
from fusion.engine.engine import FusionEngine
from fusion.service import serve
from observer.pipeline import Opinion
from observer.service import Speaker
from studies.evaluate import Answer, Floats, Judged

PATIENCE_S = 10.0
AGAIN_S = 0.5
SAME = 1e-6
"""Beliefs no further apart are the same: they travel in single precision."""


@dataclass(frozen=True, slots=True)
class _Court:
    """Everybody who takes part, each on a session of its own."""

    scene: Scene
    vocabulary: Vocabulary
    observers: Sequence[Link]
    heard: Inbox


def fused_over_mesh(answer: Answer, progress: Callable[[str, int, int], None] = lambda *_: None) -> dict[str, Any]:
    """Judge all trials again over the mesh: accuracy, and how many labels are the same as in one process.

    Raises LabanmeshError when a judgement does not come.
    """
    question = answer.question
    ids = [f"view-{v}" for v in range(len(question.views))]
    conduct = FusionConfig(rule=question.rule, fresh_s=PATIENCE_S, drop_s=2 * PATIENCE_S)
    observers = {name: ObserverConfig(source="evaluated") for name in ids}
    scene = Scene(scene="evaluate", mesh=MeshConfig(mode="process"), observers=observers, fusion=conduct)
    stop = threading.Event()
    with Link.open(scene.mesh, "fusion", listen=["tcp/127.0.0.1:0"]) as meeting:
        mesh = scene.mesh.at(meeting.locator)
        referee = FusionEngine(scene.scene, ids, answer.vocabulary, conduct)
        judging = threading.Thread(target=serve, args=(scene, referee, meeting, stop), name="fusion")
        links = [Link.open(mesh, "observer") for _ in ids]
        try:
            with Link.open(mesh, "hub") as ear:
                court = _Court(scene, answer.vocabulary, links, ear.inbox(scene.keys.judgement))
                judging.start()
                labels = [_label(court, j, n, len(answer.judged), progress) for n, j in enumerate(answer.judged)]
        finally:
            stop.set()
            for link in links:
                link.close()
            if judging.ident is not None:
                judging.join()
    return _compared(answer, labels)


def _label(court: _Court, judged: Judged, number: int, total: int, progress: Callable[[str, int, int], None]) -> str:
    """What the referee holds after this trial."""
    keys, last = court.scene.keys, {}
    for v, (name, link) in enumerate(zip(court.scene.roster, court.observers, strict=True)):
        publisher = link.publisher(keys.posterior(name))
        if number == 0 and not publisher.wait_for_subscriber(PATIENCE_S):
            raise LabanmeshError(f"{name} found no referee on the mesh within {PATIENCE_S:g} s")
        speaker = Speaker(court.vocabulary, publisher)
        said = [_opinion(judged, v, n) for n in range(len(judged.views))]
        for opinion in said:
            _say(speaker, opinion)
        last[name] = speaker, said[-1]
    progress("judging over the mesh", number + 1, total)
    return _awaited(court, last, judged.trial.name)


def _opinion(judged: Judged, view: int, frame: int) -> Opinion:
    """What one observer believed."""
    facing = None if judged.facing is None else judged.facing[frame, view]
    unlearned = np.nan if judged.unlearned is None else float(judged.unlearned[frame, view])
    p = judged.views[frame, view]
    return Opinion(p, 0.0, frame + 1, {}, facing=facing, unlearned=None if np.isnan(unlearned) else unlearned)


def _say(speaker: Speaker, opinion: Opinion) -> None:
    now_ns = time.time_ns()
    speaker.say(opinion, now_ns, now_ns)


def _awaited(court: _Court, last: Mapping[str, tuple[Speaker, Opinion]], trial: str) -> str:
    """The label of the first judgement in which everybody's last posterior counts."""
    begun = said = time.monotonic()
    while (now := time.monotonic()) < begun + PATIENCE_S:
        for arrival in court.heard.take(AGAIN_S):
            judgement = decode(JudgementMessage, arrival.payload)
            if all(_says(judgement, name, opinion.p) for name, (_, opinion) in last.items()):
                return judgement.label
        if now > said + AGAIN_S:
            # Zenoh drops what floods it: what was said last may have been lost, and is said again.
            said = now
            for speaker, opinion in last.values():
                _say(speaker, opinion)
    raise LabanmeshError(f"no judgement of {trial} came over the mesh within {PATIENCE_S:g} s")


def _says(judgement: JudgementMessage, observer: str, p: Floats) -> bool:
    vote = judgement.votes.get(observer)
    return vote is not None and vote.p is not None and bool(np.abs(np.array(vote.p) - p).max() < SAME)


def _compared(answer: Answer, labels: Sequence[str]) -> dict[str, Any]:
    names = answer.vocabulary.labels
    here = [names[int(j.fused[-1].argmax())] for j in answer.judged]
    true = [names[j.truth] for j in answer.judged]
    return {
        "accuracy": sum(a == b for a, b in zip(labels, true, strict=True)) / max(len(labels), 1),
        "same_labels": sum(a == b for a, b in zip(labels, here, strict=True)),
        "n": len(labels),
        "labels": list(labels),
    }
