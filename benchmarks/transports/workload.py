"""What is said in a run: real posteriors over twenty movements, and a judgement as the referee makes it of them."""

from functools import cache

from benchmarks.posteriors import NAMES, beliefs, message, scene_of
from common.wire import encode
from fusion.engine.engine import FusionEngine

START_NS = 1_700_000_000_000_000_000
FRAME_NS = 16_666_667


def names(publishers: int) -> list[str]:
    """cam1, cam2, ..."""
    return list(scene_of(publishers).roster)


def posteriors(name: str, count: int) -> tuple[bytes, ...]:
    """`count` + 1 of them: sequence number 0 is the murmur."""
    p = beliefs(count + 1, seed=int(name.removeprefix("cam")))
    return tuple(encode(message(name, seq, START_NS + seq * FRAME_NS, belief)) for seq, belief in enumerate(p))


@cache
def judgement(publishers: int) -> bytes:
    """What the referee says when it has heard one posterior of each."""
    scene = scene_of(publishers)
    referee = FusionEngine(scene.scene, list(scene.roster), NAMES, scene.fusion)
    for name, belief in zip(scene.roster, beliefs(publishers), strict=True):
        referee.hear(name, message(name, 0, START_NS, belief), START_NS)
    return encode(referee.judge(START_NS).judgement)
