"""Doubtful takes: those that are nearer to a take of another movement than to those of their own. Pure.

Each take is compared with all others by the distance that models use (`observer.model.nearest_take`). This needs no
model, so that a teacher hears of such a take before the observers learn.
"""

from collections import Counter
from collections.abc import Sequence

import numpy as np

from common.teaching_messages import DOUBTS_LIMIT, TakeDoubt
from observer.features import read_trace
from observer.learning.part_selection import parts_to_learn
from observer.model.base import Example
from observer.model.nearest_take import MOST_TAKES, NearestTakes, NearestTakeWatch
from observer.motion.archive import MotionArchive
from observer.recording.own_tracks import in_parts
from observer.tracks import Tracks

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
