"""Figures of a report: each function takes plain arrays and a path, draws, and returns the path."""

from studies.figures.belief import belief_figure
from studies.figures.confusion import confusion_figure
from studies.figures.earliness import earliness_figure
from studies.figures.learning import learning_figure
from studies.figures.poles import poles_figure
from studies.figures.reliability import reliability_figure
from studies.figures.timeline import Span, verdict_timeline_figure

__all__ = [
    "Span",
    "belief_figure",
    "confusion_figure",
    "earliness_figure",
    "learning_figure",
    "poles_figure",
    "reliability_figure",
    "verdict_timeline_figure",
]
