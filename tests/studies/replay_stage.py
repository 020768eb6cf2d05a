"""What the tests of replay share: a mesh of three observers, judged by an engine, as the records of a capture."""

import numpy as np

from common.arrival import CaptureRecord
from common.config import FusionConfig, ObserverConfig, Scene
from common.messages import PosteriorMessage, VocabularyReference
from common.vocabulary import Vocabulary
from common.wire import encode, encode_vocabulary
from studies.fusion_engine import FusionEngine, step

NOON = 1_795_000_000_000_000_000
STEP = 100_000_000
NAMES = Vocabulary(("bowing", "lunging", "stretch"))
REFERENCE = VocabularyReference(name=NAMES.name, hash=NAMES.digest)
OBSERVERS = ("door", "corner", "wheel")
ROOT = "laban/dojo"
# Seconds of rest, then of a movement, and the label of each observer.
PLAY = [
    (0.5, 1.5, {"door": "bowing", "corner": "bowing", "wheel": "bowing"}),
    (1.0, 1.5, {"door": "lunging", "corner": "stretch", "wheel": "lunging"}),
    (1.0, 1.5, {"door": "stretch", "corner": "stretch", "wheel": "stretch"}),
    (1.5, 0.0, {}),
]


def a_scene(**fusion):
    fusion = FusionConfig(**{"quorum": 2, **fusion})
    observers = {name: ObserverConfig(source="m.npz") for name in OBSERVERS}
    return Scene(scene="dojo", observers=observers, fusion=fusion)


def belief(label, certainty):
    p = np.full(NAMES.size, (1 - certainty) / (NAMES.size - 1))
    p[NAMES.index(label)] = certainty
    return [float(x) for x in p]


def posterior(observer, seq, at_ns, label=None, certainty=0.9, **more):
    p = [1 / NAMES.size] * NAMES.size if label is None else belief(label, certainty)
    more = {"captured_ns": at_ns, "sent_ns": at_ns, "rest": 0.98 if label is None else 0.02, "frames": seq, **more}
    more = {"v": 1, "scene": "dojo", "observer": observer, "session": "s", "vocabulary": REFERENCE, **more}
    return PosteriorMessage(seq=seq, p=p, **more)


def key_of(observer, what="posterior"):
    return f"{ROOT}/observer/{observer}/{what}"


def steps(play=PLAY, seed=0):
    """(time, posteriors) of each step."""
    rng, times, at_ns = np.random.default_rng(seed), [], NOON
    for rest_s, move_s, held in play:
        for labels, length_s in (({}, rest_s), (held, move_s)):
            for _ in range(round(length_s * 1e9 / STEP)):
                at_ns += STEP
                times.append((at_ns, labels))
    return [
        (at, [posterior(o, n, at - 7_000_000, held.get(o), rng.uniform(0.9, 0.99)) for o in OBSERVERS])
        for n, (at, held) in enumerate(times, 1)
    ]


def new_engine(scene, observers=OBSERVERS):
    return FusionEngine("dojo", list(observers), NAMES, scene.fusion)


def recorded(scene, played, engine=None, records=None, short=False):
    """The records of a mesh on which an engine judges these posteriors. short: judgements have short votes, and full
    ones under their own key; else full ones, as with `votes = "full"`."""
    engine = engine or new_engine(scene)
    if records is None:
        records = [CaptureRecord("answer", f"{ROOT}/vocabulary", encode_vocabulary("dojo", NAMES), NOON)]
    for at_ns, posteriors in played:
        for message in posteriors:
            records.append(CaptureRecord("put", key_of(message.observer), encode(message), at_ns))
        output = step(engine, {message.observer: message for message in posteriors}, at_ns)
        for verdict in output.verdicts:
            records.append(CaptureRecord("put", f"{ROOT}/verdict", encode(verdict), at_ns))
        full = encode(output.judgement, full=True)
        if short:
            records.append(CaptureRecord("put", f"{ROOT}/votes", full, at_ns + 1))
        payload = encode(output.judgement) if short else full
        records.append(CaptureRecord("put", f"{ROOT}/judgement", payload, at_ns + 1))
    return records


def labels(result, which="last_replayed"):
    return [verdict and verdict.label for verdict in (getattr(row, which) for row in result.rows)]
