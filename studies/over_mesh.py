"""`labanmesh evaluate --through mesh`: the same evaluation over real Zenoh sessions.

Every view publishes in a session of its own, the fusion service runs in another, and a third session subscribes to the
judgements. Only the wire differs from the evaluation in one process.
"""

import threading
import time
from collections.abc import Mapping, Sequence
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
from fusion.server import serve
from observer.runtime.pipeline import Posterior
from observer.runtime.service import PosteriorPublisher
from observer.tracks import Floats
from studies.evaluate import EvaluationResult, Progress, TrialResult

JUDGED_TIMEOUT_S = 10.0
"""Until a session finds the fusion service, and until a judgement arrives."""
POSTERIOR_REPEAT_S = 0.5
"""Posteriors may be lost under load; the last ones are sent again after so long."""
TOLERANCE = 1e-6
"""Posteriors that differ by less are equal: they travel in single precision."""


@dataclass(frozen=True, slots=True)
class _MeshRun:
    """The sessions of the observers, and the judgements that the subscriber receives."""

    scene: Scene
    vocabulary: Vocabulary
    observers: Sequence[Link]
    judgements: Inbox


def fused_over_mesh(result: EvaluationResult, progress: Progress = lambda *_: None) -> dict[str, Any]:
    """Judge all trials again over the mesh: accuracy, and how many labels equal those of one process.

    Raises LabanmeshError when a judgement does not arrive.
    """
    ids = [f"view-{v}" for v in range(len(result.settings.views))]
    config = FusionConfig(rule=result.settings.rule, fresh_s=JUDGED_TIMEOUT_S, drop_s=2 * JUDGED_TIMEOUT_S)
    observers = {name: ObserverConfig(source="evaluated") for name in ids}
    vocabulary = result.vocabulary
    scene = Scene(
        scene="evaluate",
        vocabulary=vocabulary.labels,
        vocabulary_name=vocabulary.name,
        mesh=MeshConfig(mode="process"),
        observers=observers,
        fusion=config,
    )
    stop = threading.Event()
    with Link.open(scene.mesh, "fusion", listen=["tcp/127.0.0.1:0"]) as fusion:
        mesh = scene.mesh.at(fusion.locator)
        thread = threading.Thread(target=serve, args=([scene], config.id, fusion, stop), name="fusion")
        links = [Link.open(mesh, "observer") for _ in ids]
        try:
            with Link.open(mesh, "hub") as hub:
                run = _MeshRun(scene, result.vocabulary, links, hub.inbox(scene.keys.votes))
                thread.start()
                labels = [_label(run, trial, n, len(result.trials), progress) for n, trial in enumerate(result.trials)]
        finally:
            stop.set()
            for link in links:
                link.close()
            if thread.ident is not None:
                thread.join()
    return _compared(result, labels)


def _label(run: _MeshRun, result: TrialResult, number: int, total: int, progress: Progress) -> str:
    """Publish one trial; the label of the judgement after its last frame."""
    last = {}
    for v, (name, link) in enumerate(zip(run.scene.roster, run.observers, strict=True)):
        publisher = link.publisher(run.scene.keys.posterior(name))
        if number == 0 and not publisher.wait_for_subscriber(JUDGED_TIMEOUT_S):
            raise LabanmeshError(f"{name} found no fusion service on the mesh within {JUDGED_TIMEOUT_S:g} s")
        sender = PosteriorPublisher(run.vocabulary, publisher)
        posteriors = [_posterior(result, v, n) for n in range(len(result.views))]
        for posterior in posteriors:
            _publish(sender, posterior)
        last[name] = sender, posteriors[-1]
    progress("judging over the mesh", number + 1, total)
    return _await_label(run, last, result.trial.name)


def _posterior(result: TrialResult, view: int, frame: int) -> Posterior:
    facing = None if result.facing is None else result.facing[frame, view]
    unlearned = np.nan if result.unlearned is None else float(result.unlearned[frame, view])
    p = result.views[frame, view]
    return Posterior(p, 0.0, frame + 1, {}, facing=facing, unlearned=None if np.isnan(unlearned) else unlearned)


def _publish(sender: PosteriorPublisher, posterior: Posterior) -> None:
    now_ns = time.time_ns()
    sender.publish(posterior, now_ns, now_ns)


def _await_label(run: _MeshRun, last: Mapping[str, tuple[PosteriorPublisher, Posterior]], trial: str) -> str:
    """The label of the first judgement in which the last posterior of every observer counts."""
    begun = sent = time.monotonic()
    while (now := time.monotonic()) < begun + JUDGED_TIMEOUT_S:
        for arrival in run.judgements.take(POSTERIOR_REPEAT_S):
            judgement = decode(JudgementMessage, arrival.payload)
            if all(_counts(judgement, name, posterior.p) for name, (_, posterior) in last.items()):
                return judgement.label
        if now > sent + POSTERIOR_REPEAT_S:
            # Zenoh drops messages under load: the last posteriors may have been lost, so they are sent again.
            sent = now
            for sender, posterior in last.values():
                _publish(sender, posterior)
    raise LabanmeshError(f"no judgement of {trial} arrived over the mesh within {JUDGED_TIMEOUT_S:g} s")


def _counts(judgement: JudgementMessage, observer: str, p: Floats) -> bool:
    vote = judgement.votes.get(observer)
    return vote is not None and vote.p is not None and bool(np.abs(np.array(vote.p) - p).max() < TOLERANCE)


def _compared(result: EvaluationResult, labels: Sequence[str]) -> dict[str, Any]:
    names = result.vocabulary.labels
    here = [names[int(r.fused[-1].argmax())] for r in result.trials]
    true = [names[r.truth] for r in result.trials]
    return {
        "accuracy": sum(a == b for a, b in zip(labels, true, strict=True)) / max(len(labels), 1),
        "same_labels": sum(a == b for a, b in zip(labels, here, strict=True)),
        "n": len(labels),
        "labels": list(labels),
    }
