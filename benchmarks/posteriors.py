"""Posteriors of four observers and twenty movements as observers send them: the input of the benchmarks."""

from functools import cache

import numpy as np

from common.config import MeshConfig, ObserverConfig, Scene
from common.facets import SHAPE
from common.messages import PosteriorMessage, VocabularyHash
from common.vocabulary import Vocabulary
from observer.tracks import Floats
from studies.fusion_engine import FusionEngine

NAMES = Vocabulary(tuple(f"movement_{n}" for n in range(20)), "bench")
UNLEARNED = 0.05
"""The default model always says how likely it is that the movement is none of the vocabulary."""
FRAMES_A_SHAPE = 6
"""Shape is read ten times a second; the posteriors here are those of sixty frames."""


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


def message(
    seq: int, captured_ns: int, p: Floats, facets: int = len(SHAPE), unlearned: float | None = UNLEARNED
) -> PosteriorMessage:
    """A posterior over NAMES about a frame captured and sent at `captured_ns`; round-off of p is clamped.

    As from an observer that sees all parts, with as many facets as its view shows: two from the front, three beside it.
    """
    return PosteriorMessage(
        v=2,
        seq=seq,
        session="bench",
        captured_ns=captured_ns,
        sent_ns=captured_ns,
        vocabulary=VocabularyHash(hash=NAMES.digest),
        p=p.tolist(),
        rest=0.1,
        unlearned=unlearned,
        frames=seq + 1,
        facets=_shape(seq // FRAMES_A_SHAPE, facets) if facets else None,
    )


@cache
def _shape(seed: int, facets: int) -> dict[str, list[float]]:
    rows = np.random.default_rng(seed).dirichlet(np.ones(3), facets)
    return dict(zip(SHAPE, rows.tolist(), strict=False))
