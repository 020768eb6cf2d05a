"""Learning Effort from labelled recordings: seen from one view, read as an observer reads, calibrated. Pure."""

import math
import re
from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from common.errors import BadInput
from observer.effort.course import course_of
from observer.effort.features import features
from observer.effort.model import COLUMNS, FACTORS, EffortModel, Trial, log_odds, spread
from observer.geometry.views import View
from observer.motion.archive import MotionArchive
from observer.motion.projected import view_tracks
from observer.motion.transforms import common_rate, movements_in
from observer.tracks import BODY_PARTS, Floats

LEVELS = re.compile(r"(-?[01])_(-?[01])_(-?[01])_(-?[01])(?:\..*)?")
"""A trial's name that says how it was done: levels of Space, Weight, Time, Flow; behind a dot anything."""
TEMPERS = np.geomspace(0.02, 2.0, 60)
"""Temperatures that are tried; none above 2, for few trials that are all right would make it infinite."""


def levels_of(trial: str) -> tuple[int, int, int, int] | None:
    """`-1_0_1_1` or `-1_0_1_1.2` -> (-1, 0, 1, 1): Space, Weight, Time, Flow; None where a trial does not say."""
    found = LEVELS.fullmatch(trial)
    if not found:
        return None
    space, weight, time, flow = (int(level) for level in found.groups())
    return space, weight, time, flow


def trials_in(archive: MotionArchive, view: View, fraction: float = 1.0) -> list[Trial]:
    """The labelled recordings as the view sees them, or this fraction of each; their label is the action.

    Raises BadInput when none is labelled, for recordings at different rates, and when hands or head are missing.
    """
    common_rate(archive)
    labelled = [(r, levels) for r in movements_in(archive) if (levels := levels_of(r.trial)) is not None]
    if not labelled:
        raise BadInput(
            "Effort: no recording's trial says how it was done; -1_0_1_1 (Space, Weight, Time, Flow) is expected"
        )
    trials = []
    for recording, levels in labelled:
        tracks = [t.centres for t in view_tracks(view, recording, archive.body_parts, BODY_PARTS)]
        course = course_of(tracks[: math.ceil(fraction * len(tracks))], BODY_PARTS, recording.rate_hz)
        trials.append(Trial(features(course), levels, recording.label))
    return trials


def learn_effort(archive: MotionArchive, view: View, provenance: Mapping[str, str] | None = None) -> EffortModel:
    """One view's Effort model from all labelled recordings of the archive; raises BadInput as `trials_in`."""
    trials = trials_in(archive, view)
    said = {"examples": str(len(trials)), **(provenance or {})}
    return replace(learn_trials(trials, view.name, common_rate(archive)), provenance=said)


def learn_trials(trials: Sequence[Trial], view: str, rate_hz: float) -> EffortModel:
    """The model of these trials; temperatures are fitted leaving out one action at a time (of one, a trial)."""
    model = _untempered(trials, view, rate_hz)
    return replace(model, temper=np.array([_temper(model, trials, factor) for factor in FACTORS]))


def _untempered(trials: Sequence[Trial], view: str, rate_hz: float) -> EffortModel:
    table = np.array([trial.features for trial in trials])
    seen = np.isfinite(table)
    count = np.maximum(seen.sum(axis=0), 1)
    mean = np.where(seen, table, 0.0).sum(axis=0) / count
    # What an example does not show is taken from the average of the others: it then says little.
    filled = np.where(seen, table, mean)
    deviation = filled.std(axis=0) + 1e-9
    z = (filled - mean) / deviation
    levels = np.array([trial.levels for trial in trials], dtype=np.int64)
    actions = [trial.action for trial in trials]
    spreads = {factor: spread(z[:, COLUMNS[factor]], levels, actions) for factor in FACTORS}
    return EffortModel(view, rate_hz, BODY_PARTS, mean, deviation, z, levels, spreads, np.ones(len(FACTORS)))


def _temper(model: EffortModel, trials: Sequence[Trial], factor: str) -> float:
    """The temperature of least log loss, each action judged by the examples of the others."""
    actions = [trial.action for trial in trials]
    groups = actions if len(set(actions)) > 1 else [str(n) for n in range(len(trials))]
    q = FACTORS.index(factor)
    odds: list[float] = []
    for group in sorted(set(groups)):
        others = [n for n, g in enumerate(groups) if g != group]
        judge = replace(model, examples=model.examples[others], levels=model.levels[others])
        odds += [
            log_odds(judge, model.examples[n], factor) * model.levels[n, q]
            for n, g in enumerate(groups)
            if g == group and model.levels[n, q] != 0
        ]
    losses = [_log_loss(np.array(odds), temper) for temper in TEMPERS]
    return float(TEMPERS[int(np.argmin(losses))]) if odds else 1.0


def _log_loss(signed_odds: Floats, temper: float) -> float:
    return float(np.logaddexp(0.0, -temper * signed_odds).mean())
