"""Figures of reports: each function takes arrays and a path, draws, and returns the path."""

from studies.figures.accuracy import (
    confusion_figure,
    earliness_figure,
    reliability_figure,
)
from studies.figures.over_time import (
    LabelledInterval,
    StreamTimeline,
    VerdictBar,
    belief_figure,
    stream_timeline_figure,
)

__all__ = [
    "LabelledInterval",
    "StreamTimeline",
    "VerdictBar",
    "belief_figure",
    "confusion_figure",
    "earliness_figure",
    "reliability_figure",
    "stream_timeline_figure",
]
