"""Learns an Effort model from labelled recordings, seen from one view, and calibrates it. Pure."""

import math
import re
from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from common.errors import BadInput
from observer.effort.course import course_of
from observer.effort.features import features
from observer.effort.model import COLUMNS, FACTORS, EffortExample, EffortModel, log_odds, spread
from observer.geometry.views import View
from observer.motion.archive import MotionArchive
from observer.motion.projected import view_tracks
from observer.motion.transforms import common_rate, movements_in
from observer.tracks import BODY_PARTS, Floats

LEVELS = re.compile(r"(-?[01])_(-?[01])_(-?[01])_(-?[01])(?:\..*)?")
"""Name of a labelled trial: levels of Space, Weight, Time, Flow; anything after a dot."""
TEMPERS = np.geomspace(0.02, 2.0, 60)
"""Candidate temperatures; a few trials without an error would otherwise make it infinite."""


def levels_of(trial: str) -> tuple[int, int, int, int] | None:
    """`-1_0_1_1` or `-1_0_1_1.2` -> (-1, 0, 1, 1): Space, Weight, Time, Flow; None for other names."""
    match = LEVELS.fullmatch(trial)
    if not match:
        return None
    space, weight, time, flow = (int(level) for level in match.groups())
    return space, weight, time, flow


def effort_examples(archive: MotionArchive, view: View, fraction: float = 1.0) -> list[EffortExample]:
    """The labelled recordings as the view sees them, or the first `fraction` of each; their label is the action.

    Raises BadInput if none is labelled, for recordings at different rates, and if hands or head are missing.
    """
    common_rate(archive)
    labelled = [(r, levels) for r in movements_in(archive) if (levels := levels_of(r.trial)) is not None]
    if not labelled:
        raise BadInput(
            "Effort: no recording's trial names its levels; -1_0_1_1 (Space, Weight, Time, Flow) is expected"
        )
    trials = []
    for recording, levels in labelled:
        tracks = [t.centres for t in view_tracks(view, recording, archive.body_parts, BODY_PARTS)]
        course = course_of(tracks[: math.ceil(fraction * len(tracks))], BODY_PARTS, recording.rate_hz)
        trials.append(EffortExample(features(course), levels, recording.label))
    return trials


def learn_effort(archive: MotionArchive, view: View, provenance: Mapping[str, str] | None = None) -> EffortModel:
    """One view's Effort model from all labelled recordings of the archive; raises BadInput as `effort_examples`."""
    trials = effort_examples(archive, view)
    origin = {"examples": str(len(trials)), **(provenance or {})}
    return replace(learn_trials(trials, view.name, common_rate(archive)), provenance=origin)


def learn_trials(trials: Sequence[EffortExample], view: str, rate_hz: float) -> EffortModel:
    """The model of these trials; temperatures are fitted by leaving out one action at a time (or one trial of one)."""
    model = _untempered(trials, view, rate_hz)
    return replace(model, temper=np.array([_temper(model, trials, factor) for factor in FACTORS]))


def _untempered(trials: Sequence[EffortExample], view: str, rate_hz: float) -> EffortModel:
    table = np.array([trial.features for trial in trials])
    known = np.isfinite(table)
    count = np.maximum(known.sum(axis=0), 1)
    mean = np.where(known, table, 0.0).sum(axis=0) / count
    # A missing feature becomes the mean of the other examples, which is weak evidence.
    filled = np.where(known, table, mean)
    deviation = filled.std(axis=0) + 1e-9
    z = (filled - mean) / deviation
    levels = np.array([trial.levels for trial in trials], dtype=np.int64)
    actions = [trial.action for trial in trials]
    spreads = {factor: spread(z[:, COLUMNS[factor]], levels, actions) for factor in FACTORS}
    return EffortModel(view, rate_hz, BODY_PARTS, mean, deviation, z, levels, spreads, np.ones(len(FACTORS)))


def _temper(model: EffortModel, trials: Sequence[EffortExample], factor: str) -> float:
    """The temperature of least log loss, each action evaluated with the examples of the others."""
    actions = [trial.action for trial in trials]
    groups = actions if len(set(actions)) > 1 else [str(n) for n in range(len(trials))]
    q = FACTORS.index(factor)
    odds: list[float] = []
    for group in sorted(set(groups)):
        others = [n for n, g in enumerate(groups) if g != group]
        unaware = replace(model, examples=model.examples[others], levels=model.levels[others])
        odds += [
            log_odds(unaware, model.examples[n], factor) * model.levels[n, q]
            for n, g in enumerate(groups)
            if g == group and model.levels[n, q] != 0
        ]
    losses = [_log_loss(np.array(odds), temper) for temper in TEMPERS]
    return float(TEMPERS[int(np.argmin(losses))]) if odds else 1.0


def _log_loss(signed_odds: Floats, temper: float) -> float:
    return float(np.logaddexp(0.0, -temper * signed_odds).mean())
