"""Another person's films: one uncalibrated camera's tracks of everybody else teach, each film is judged.

The 16 films are cut close, some without begin or end; each shows one of four movements.
"""

from collections.abc import Iterator
from pathlib import Path

import numpy as np

from benchmarks.clips.judging import ClipResult, judge
from benchmarks.clips.material import Clip, centres_in, gesture_clips
from benchmarks.clips.report import line
from benchmarks.taught.judging import TaughtModels
from common import SECOND_NS
from common.config_sections import FusionConfig
from observer.motion.archive import MotionArchive, Recording, TracksCamera
from observer.motion.even_rate import at_even_rate
from observer.motion.importers.florence3d import FLORENCE_HZ
from observer.tracks import BODY_PARTS, Floats

CAMERA = "films"
LEARNED_HZ = 15.0


def rows(data: Path, tracks: Path, teaching: TaughtModels) -> Iterator[str]:
    """A line for each film whose movement occurs for two people, and one for all."""
    films = {clip.name: (clip, centres_in(clip, tracks)) for clip in gesture_clips(data)}
    people: dict[str, set[str]] = {clip.label: set() for clip, _ in films.values()}
    for clip, _ in films.values():
        people[clip.label].add(clip.subject)
    results = []
    for clip, centres in films.values():
        if len(people[clip.label]) > 1:
            results.append(_judged(clip, centres, films, teaching))
            yield line(results[-1])
    right = sum(result.first_is_right for result in results)
    named = sum(bool(result.words) for result in results)
    yield (
        f"films: first verdict right {right} of {len(results)} ({right / len(results):.3f}), "
        f"{named - right} named wrongly, {len(results) - named} not named"
    )


def _judged(clip: Clip, centres: Floats, films: dict[str, tuple[Clip, Floats]], teaching: TaughtModels) -> ClipResult:
    others = tuple(_take(one, seen) for one, seen in films.values() if one.subject != clip.subject)
    archive = MotionArchive(BODY_PARTS, others, TracksCamera(CAMERA, (640, 480)))
    labels = tuple(dict.fromkeys(take.label for take in others))
    model = teaching.models({CAMERA: archive}, labels)[CAMERA]
    return judge(clip.name, clip.label, centres, FLORENCE_HZ, model, FusionConfig())


def _take(clip: Clip, centres: Floats) -> Recording:
    at_ns = np.round(np.arange(len(centres)) * SECOND_NS / FLORENCE_HZ).astype(np.int64)
    return Recording(at_even_rate(at_ns, centres, LEARNED_HZ), LEARNED_HZ, clip.label, clip.subject, clip.name)
