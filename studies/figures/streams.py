"""Figures of streams: true movements, first words and last words over time, for one person."""

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

from matplotlib.patches import Rectangle

from common.vocabulary import ABSTAIN
from studies.figures.accuracy import COLOURS, GREY, INK, Axes, Figure, save

LINE_S = 30.0
"""Longer streams are broken into lines of this length at most."""
RIGHT, WRONG, UNDECIDED = COLOURS[2], COLOURS[1], "#999999"
TRUE_ROW, FIRST_ROW, LAST_ROW = 2.1, 1.0, 0.0
HEIGHT = 0.8


class LabelledInterval(NamedTuple):
    """A true movement, in seconds."""

    start_s: float
    end_s: float
    label: str


@dataclass(frozen=True, slots=True)
class VerdictBar:
    """A verdict in seconds: its first word when it was decided, its last word from the movement's begin to its end."""

    first: str
    at_s: float
    last: str
    begin_s: float
    end_s: float
    first_right: bool
    last_right: bool


@dataclass(frozen=True, slots=True)
class StreamTimeline:
    """One stream: its name and length, the true movements, and the verdicts."""

    name: str
    length_s: float
    truth: Sequence[LabelledInterval]
    verdicts: Sequence[VerdictBar]


def stream_timeline_figure(streams: Sequence[StreamTimeline], title: str, path: Path) -> Path:
    """Lines of up to 30 s, one below the other, with three rows each: done, first words, last words. Returns `path`.

    Right words are green, false ones orange and hatched, abstentions grey. A revised verdict has a thick frame and an
    arrow before its last word.
    """
    line_s = min(LINE_S, max(stream.length_s for stream in streams))
    lines = [line for stream in streams for line in _lines(stream, line_s)]
    figure = Figure(figsize=(15, 0.5 + 1.15 * len(lines)), layout="constrained")
    grid = figure.subplots(len(lines), 1, squeeze=False)[:, 0]
    figure.suptitle(title, fontsize=10, x=0.01, ha="left")
    for axes, (stream, begin_s) in zip(grid, lines, strict=True):
        _draw_line(axes, stream, begin_s, line_s)
    grid[-1].set_xlabel("time (s)", fontsize=9)
    return save(figure, path)


def _lines(stream: StreamTimeline, line_s: float) -> Iterator[tuple[StreamTimeline, float]]:
    for n in range(math.ceil(stream.length_s / line_s)):
        yield stream, n * line_s


def _draw_line(axes: Axes, stream: StreamTimeline, begin_s: float, line_s: float) -> None:
    axes.axvspan(begin_s, min(begin_s + line_s, stream.length_s), color=GREY, alpha=0.12, linewidth=0)
    for span in stream.truth:
        _bar(axes, (span.start_s, span.end_s), TRUE_ROW, INK, span.label)
    for verdict in stream.verdicts:
        first, last = _colour(verdict.first, verdict.first_right), _colour(verdict.last, verdict.last_right)
        axes.plot([verdict.at_s] * 2, [FIRST_ROW, TRUE_ROW + HEIGHT], color=first, linewidth=0.8, linestyle=":")
        axes.plot(verdict.at_s, FIRST_ROW + HEIGHT / 2, ">", color=first, markersize=5)
        _write(axes, verdict.at_s, FIRST_ROW, " " + verdict.first, "left", first)
        revised = verdict.last != verdict.first
        name = f"→ {verdict.last}" if revised else verdict.last
        _bar(axes, (verdict.begin_s, verdict.end_s), LAST_ROW, last, name, 2.2 if revised else 0.9)
    axes.set_xlim(begin_s, begin_s + line_s)
    axes.set_ylim(-0.1, TRUE_ROW + HEIGHT + 0.1)
    rows = (LAST_ROW, FIRST_ROW, TRUE_ROW)
    axes.set_yticks([row + HEIGHT / 2 for row in rows], ["last word", "first word", "done"], fontsize=7)
    axes.set_title(stream.name, fontsize=8, loc="left", pad=2)
    axes.tick_params(left=False, labelsize=7)
    axes.spines[:].set_visible(False)


def _colour(label: str, right: bool) -> str:
    return UNDECIDED if label == ABSTAIN else RIGHT if right else WRONG


def _bar(axes: Axes, times_s: tuple[float, float], row: float, colour: str, label: str, frame: float = 0.9) -> None:
    begin_s, end_s = times_s
    corner, width = (begin_s, row), max(end_s - begin_s, 0.05)
    axes.add_patch(Rectangle(corner, width, HEIGHT, facecolor=colour, alpha=0.18, linewidth=0))
    hatch = "////" if colour == WRONG else None
    axes.add_patch(Rectangle(corner, width, HEIGHT, fill=False, edgecolor=colour, linewidth=frame, hatch=hatch))
    _write(axes, begin_s + width / 2, row, label, "center", INK)


def _write(axes: Axes, at_s: float, row: float, label: str, place: str, colour: str) -> None:
    ground = {"facecolor": "white", "alpha": 0.7, "linewidth": 0, "pad": 0.5}
    name, middle = label.replace("_", " "), row + HEIGHT / 2
    axes.text(at_s, middle, name, ha=place, va="center", fontsize=6.5, color=colour, bbox=ground, clip_on=True)
