"""Takes of a camera's own tracks: which body parts a model learns from, and which takes are doubtful. Pure.

A take is doubtful that is nearer to one of another movement than to those of its own. Each is compared with all others
by the distance that models use (`observer.model.nearest_take`): this needs no model, so that a teacher hears of such a
take before the observers learn.
"""

from collections import Counter
from collections.abc import Sequence

import numpy as np

from common.teaching_messages import DOUBTS_LIMIT, TakeDoubt
from observer.features import read_trace
from observer.model.base import Example
from observer.model.nearest_take import MOST_TAKES, NearestTakes, NearestTakeWatch
from observer.motion.archive import MotionArchive, movements_in
from observer.recording.own_tracks import in_parts
from observer.tracks import Floats, Tracks

SEEN_SHARE = 0.5
"""A part is learned if it is seen in this share of the frames of each movement's takes."""


AUTO = "auto"
"""In place of names of parts: `parts_to_learn`."""


def parts_to_learn(archive: MotionArchive) -> tuple[str, ...]:
    """The parts that a model of these tracks reads, in their order; all parts if fewer than two remain.

    A part that the camera does not see in SEEN_SHARE of every movement, such as a foot behind a sofa, is no evidence,
    and a tracker's guesses of it mislead.
    """
    seen: dict[str, list[Floats]] = {}
    for take in movements_in(archive):
        if take.label:
            seen.setdefault(take.label, []).append(np.isfinite(take.positions).all(axis=2).mean(axis=0))
    shares = [np.mean(own, axis=0) for own in seen.values()]
    least = np.min(shares, axis=0) if shares else np.ones(len(archive.body_parts))
    parts = tuple(part for part, share in zip(archive.body_parts, least, strict=True) if share >= SEEN_SHARE)
    return parts if len(parts) > 1 else archive.body_parts


CLEARLY = 0.9
"""Another movement's take is nearer if its distance is less than this share of the own movement's nearest."""


def doubtful_takes(archive: MotionArchive, labels: Sequence[str]) -> list[TakeDoubt]:
    """The doubtful takes of these movements, at most DOUBTS_LIMIT.

    None of a movement with a single take, and none among more than MOST_TAKES takes, with which models do not compare.
    """
    takes = [take for take in archive.recordings if take.label in labels and not take.spans]
    counts = Counter(take.label for take in takes)
    if len(counts) < 2 or len(takes) > MOST_TAKES:
        return []
    parts = parts_to_learn(archive)
    traces = [
        read_trace(parts, take.rate_hz, map(Tracks, in_parts(take, archive.body_parts, parts).positions.astype(float)))
        for take in takes
    ]
    numbers = [labels.index(take.label) for take in takes]
    examples = [Example((), n, features=t.astype(np.float64)) for n, t in zip(numbers, traces, strict=True)]
    compared = NearestTakes.of(examples, len(labels), np.ones(len(labels)))
    doubts = []
    for number, (take, trace) in enumerate(zip(takes, traces, strict=True)):
        if compared is not None and counts[take.label] > 1:
            distances = NearestTakeWatch(compared, trace).distances
            distances[number] = np.inf
            own = min(d for d, each in zip(distances, takes, strict=True) if each.label == take.label)
            nearest = int(distances.argmin())
            if distances[nearest] < CLEARLY * own and take.trial.isdecimal():
                doubts.append(TakeDoubt(label=take.label, take=int(take.trial), like=takes[nearest].label))
    return doubts[:DOUBTS_LIMIT]
