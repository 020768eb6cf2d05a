"""Posteriors of four observers and twenty movements: the input of the fusion and mesh benchmarks."""

import numpy as np

from common.config import MeshConfig, ObserverConfig, Scene
from common.messages import PosteriorMessage, VocabularyReference
from common.vocabulary import Vocabulary
from observer.tracks import BODY_PARTS, Floats
from studies.fusion_engine import FusionEngine

NAMES = Vocabulary(tuple(f"movement_{n}" for n in range(20)), "bench")
VISIBLE = dict.fromkeys(BODY_PARTS, True)


def scene_of(observers: int, endpoint: str = MeshConfig().endpoint) -> Scene:
    """A scene with the observers cam1, cam2, ..., the vocabulary NAMES and default fusion."""
    sources = {f"cam{n}": ObserverConfig(source="bench") for n in range(1, observers + 1)}
    mesh = MeshConfig(endpoint=endpoint)
    return Scene(scene="bench", vocabulary=NAMES.labels, vocabulary_name=NAMES.name, mesh=mesh, observers=sources)


def engine_of(scene: Scene) -> FusionEngine:
    """A new fusion engine of the scene."""
    return FusionEngine(scene.scene, list(scene.roster), NAMES, scene.fusion)


def random_posteriors(count: int, seed: int = 0) -> Floats:
    """(count, 20) posteriors from nearly certain to undecided; the same in every run."""
    rng = np.random.default_rng(seed)
    return np.array([rng.dirichlet(np.full(NAMES.size, sharpness)) for sharpness in rng.choice([0.02, 0.2, 2], count)])


def message(observer: str, seq: int, captured_ns: int, p: Floats) -> PosteriorMessage:
    """A posterior over NAMES about a frame captured and sent at `captured_ns`; round-off of p is clamped."""
    return PosteriorMessage(
        scene="bench",
        observer=observer,
        seq=seq,
        session="bench",
        captured_ns=captured_ns,
        sent_ns=captured_ns,
        vocabulary=VocabularyReference(name=NAMES.name, hash=NAMES.digest),
        p=p.tolist(),
        rest=0.1,
        frames=seq + 1,
        visible=VISIBLE,
    )
