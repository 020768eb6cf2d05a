"""Three depth cameras: each taught from its own 2-D tracks, in px as it sees them, against 3-D seen from its place.

The tracks are its positions through its own perspective, where the person's distance changes their size. The models of
3-D learn through the same perspective, and from the parallel view `door`, as the documented figures do. Each person is
left out in turn. Part of a default model is random: with several seeds the same is done anew, and the differences are
paired, because all judge the same performances.
"""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from benchmarks.taught.few_takes import SENSOR
from common.parallel import cores
from observer.geometry.views import View, parse_view, this_camera
from observer.motion.archive import MotionArchive, TracksCamera, labels_of
from observer.motion.archive_file import read_archive
from observer.motion.projected import projected
from observer.tracks import BODY_PARTS, Floats
from studies.evaluate import EvaluationResult, EvaluationSettings, evaluate
from studies.sensors import performances, with_parts

FILES = ("sensor1.npz", "sensor2.npz", "sensor3.npz")
FRACTIONS = (0.4, 0.6, 0.8, 1.0)
DRAWS = 2000
"""Of performances, with replacement, for the interval of a mean difference."""
Progress = Callable[[str, int, int], None]
Answers = NDArray[np.float64]
"""(3 + 1, 4, N) whether each sensor's answer, and the fused one, is right after FRACTIONS of each of N performances;
NaN where a sensor has no recording of it."""


@dataclass(frozen=True, slots=True, eq=False)
class Way:
    """From what models learn: the recordings of each sensor, and the view of all of them."""

    name: str
    archives: Sequence[MotionArchive]
    matrix: Floats


def ways_of(data: Path) -> list[Way]:
    """3-D from the parallel view, 3-D through the sensor's perspective, and the sensor's own tracks."""
    space = [with_parts(read_archive(data / "nw_ucla" / file), BODY_PARTS) for file in FILES]
    tracks = [
        projected(archive, View(name, SENSOR), TracksCamera(name)) for name, archive in zip(names(), space, strict=True)
    ]
    return [
        Way("parallel", space, parse_view("door").matrix),
        Way("3-D", space, SENSOR),
        Way("tracks", tracks, this_camera().matrix),
    ]


def names() -> list[str]:
    """Of the sensors."""
    return [Path(file).stem for file in FILES]


def rows(data: Path, model: str, seeds: int, jobs: int, progress: Progress) -> Iterator[str]:
    """Accuracy after shares of a movement, by sensor and fused, of each way; the paired differences between them."""
    answers = {
        way.name: np.array([judged(way, model, seed, jobs, progress) for seed in range(seeds)]) for way in ways_of(data)
    }
    for name, right in answers.items():
        yield from _table(name, np.nanmean(right, axis=3))
    for before, after in pairwise(answers):
        change = answers[after] - answers[before]
        yield from _table(f"{after} - {before}", np.nanmean(change, axis=3), sign="+")
        for n, fraction in enumerate(FRACTIONS):
            yield f"{after} - {before}, fused after {fraction:.0%}: {paired(change[:, -1, n])}"


def judged(way: Way, model: str, seed: int, jobs: int, progress: Progress) -> Answers:
    """Learn and judge with this seed of the model's random parts."""
    views, whole = tuple(View(name, way.matrix) for name in names()), performances(way.archives)
    settings = EvaluationSettings(
        views, labels_of(whole), leave_one_subject_out=True, model=model, parameters={"seed": seed} if seed else {},
        sensors=tuple(way.archives),
    )  # fmt: skip
    return _answers(evaluate(whole, settings, progress, jobs or cores()))


def paired(change: Floats) -> str:
    """(S, N) differences of right answers: their mean with a 95 % interval over performances, and how many differ."""
    rng = np.random.default_rng(0)
    by_performance = change.mean(axis=0)
    drawn = by_performance[rng.integers(len(by_performance), size=(DRAWS, len(by_performance)))].mean(axis=1)
    low, high = np.quantile(drawn, (0.025, 0.975))
    better, worse = int((change > 0).sum()), int((change < 0).sum())
    return f"{by_performance.mean():+.3f} ({low:+.3f} to {high:+.3f}); {better} better, {worse} worse of {change.size}"


def _table(name: str, shares: Floats, sign: str = "") -> Iterator[str]:
    """(S, 4, 4) of each seed -> a line for each sensor and for all: means, and standard deviations between seeds."""
    for sensor, figures in zip((*names(), "fused"), shares.swapaxes(0, 1), strict=True):
        means = "  ".join(f"{mean:{sign}.3f}" for mean in figures.mean(axis=0))
        between = "  ".join(f"{deviation:.3f}" for deviation in figures.std(axis=0, ddof=1)) if len(figures) > 1 else ""
        yield f"{name:18s} {sensor:8s} {means}{f'   between seeds {between}' if between else ''}"


def _answers(result: EvaluationResult) -> Answers:
    table = []
    for fraction in FRACTIONS:
        by_view, fused = result.at_fraction(fraction)
        right = np.where(np.isfinite(by_view[:, :, 0]), by_view.argmax(axis=2) == result.truth[:, None], np.nan)
        table.append([*right.T, fused.argmax(axis=1) == result.truth])
    return np.array(table, np.float64).swapaxes(0, 1)
