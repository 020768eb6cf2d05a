"""Three depth cameras: each taught from its own 2-D tracks, in px as it sees them, against 3-D seen from its place.

The tracks are its positions through its own perspective, where the person's distance changes their size; the models of
3-D learn from the parallel view `door`, as the documented figures do. Each person is left out in turn.
"""

from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np

from benchmarks.taught.few_takes import SENSOR
from common.parallel import cores
from observer.geometry.views import View, parse_view, this_camera
from observer.motion.archive import TracksCamera, labels_of
from observer.motion.archive_file import read_archive
from observer.motion.projected import projected
from observer.tracks import BODY_PARTS, Floats
from studies.evaluate import EvaluationResult, EvaluationSettings, evaluate
from studies.sensors import performances, with_parts

FILES = ("sensor1.npz", "sensor2.npz", "sensor3.npz")
FRACTIONS = (0.4, 0.6, 0.8, 1.0)
Progress = Callable[[str, int, int], None]


def rows(data: Path, model: str, jobs: int, progress: Progress) -> Iterator[str]:
    """Accuracy after shares of a movement, by sensor and fused, from 3-D, from tracks, and the difference."""
    names = [Path(file).stem for file in FILES]
    space = [with_parts(read_archive(data / "nw_ucla" / file), BODY_PARTS) for file in FILES]
    tracks = [
        projected(archive, View(name, SENSOR), TracksCamera(name)) for name, archive in zip(names, space, strict=True)
    ]
    tables = []
    for what, archives, matrix in (
        ("3-D", space, parse_view("door").matrix),
        ("tracks", tracks, this_camera().matrix),
    ):
        views = tuple(View(name, matrix) for name in names)
        whole = performances(archives)
        settings = EvaluationSettings(views, labels_of(whole), leave_one_subject_out=True, model=model)
        settings = replace(settings, sensors=tuple(archives))
        tables.append(_accuracies(evaluate(whole, settings, progress, jobs or cores())))
        for name, figures in zip((*names, "fused"), tables[-1], strict=True):
            yield f"{what:7s} {name:8s} {'  '.join(f'{share:.3f}' for share in figures)}"
    for name, figures in zip((*names, "fused"), tables[1] - tables[0], strict=True):
        yield f"change  {name:8s} {'  '.join(f'{share:+.3f}' for share in figures)}"


def _accuracies(result: EvaluationResult) -> Floats:
    """(V + 1, 4) the share of right answers after FRACTIONS, of the trials that each sensor recorded; fused last."""
    table = []
    for fraction in FRACTIONS:
        by_view, fused = result.at_fraction(fraction)
        known = np.isfinite(by_view[:, :, 0])
        right = by_view.argmax(axis=2) == result.truth[:, None]
        per_view = [float(right[known[:, v], v].mean()) for v in range(by_view.shape[1])]
        table.append([*per_view, float((fused.argmax(axis=1) == result.truth).mean())])
    return np.array(table).T
