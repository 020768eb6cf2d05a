"""Figures over time: belief and entropy, the paper's Fig. 7; streams with true movements, first and last words."""

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

import numpy as np
from matplotlib.patches import Rectangle

from common.vocabulary import ABSTAIN
from studies.figures.accuracy import COLOURS, GREY, INK, Axes, Figure, Floats, plain, save, spread

NAMED = 4
"""Movements with a colour and a name beside the true one."""
WORTH_NAMING = 0.08
"""A line that ends below this probability is not named in this column."""
WORTH_COLOUR = 0.1
"""Least mean probability in some column for a movement to get a colour."""
LABEL_GAP = 0.09
COLUMN_INCHES = 2.7


def belief_figure(
    times_s: Floats,
    beliefs: Mapping[str, Floats],
    entropies: Mapping[str, Floats],
    labels: Sequence[str],
    truth: str,
    path: Path,
) -> Path:
    """Fig. 7: one column for each of `beliefs` ((F, M) by name, fused last), P above, entropy (F,) below.

    times_s is (F,) in seconds, entropies in bits under the same names. The true movement is drawn thick;
    the most probable others have a colour and a name, the rest is grey. Returns `path`.
    """
    figure = Figure(figsize=(COLUMN_INCHES * len(beliefs) + 0.5, 4.2), layout="constrained")
    grid = figure.subplots(
        2, len(beliefs), sharex=True, sharey="row", squeeze=False, gridspec_kw={"height_ratios": (2.2, 1)}
    )
    colours = _colours(beliefs, labels, truth)
    top_bits = max(np.log2(len(labels)), 0.1)
    for column, (name, belief) in enumerate(beliefs.items()):
        upper, lower = grid[0, column], grid[1, column]
        upper.set_title(name, fontsize=10, loc="left", fontweight="bold" if column == len(beliefs) - 1 else None)
        _draw_beliefs(upper, times_s, belief, labels, truth, colours)
        lower.fill_between(times_s, entropies[name], color=GREY, alpha=0.35, linewidth=0)
        lower.plot(times_s, entropies[name], color="#444444", linewidth=1.4)
        lower.set_ylim(0, top_bits * 1.02)
        lower.set_xlabel("time (s)", fontsize=9)
        plain(upper)
        plain(lower)
        lower.spines["bottom"].set_bounds(times_s[0], times_s[-1])
    grid[0, 0].set_ylabel("P(movement)", fontsize=9)
    grid[1, 0].set_ylabel("entropy (bits)", fontsize=9)
    figure.suptitle(f"performing {truth.replace('_', ' ')}", fontsize=10, x=0.01, ha="left")
    return save(figure, path)


def _colours(beliefs: Mapping[str, Floats], labels: Sequence[str], truth: str) -> dict[str, str]:
    """Colours for the true movement and for the movements of the highest mean probability in some column."""
    strength = np.max([belief.mean(axis=0) for belief in beliefs.values()], axis=0)
    order = np.argsort(-strength, kind="stable")
    ranked = [labels[i] for i in order if labels[i] != truth and strength[i] >= WORTH_COLOUR]
    return dict(zip([truth, *ranked[:NAMED]], COLOURS, strict=False))


def _draw_beliefs(
    axes: Axes, times_s: Floats, belief: Floats, labels: Sequence[str], truth: str, colours: Mapping[str, str]
) -> None:
    for label, p in zip(labels, belief.T, strict=True):
        width = 2.6 if label == truth else 1.5 if label in colours else 0.7
        front = 3 if label == truth else 2 if label in colours else 1
        axes.plot(times_s, p, color=colours.get(label, GREY), linewidth=width, zorder=front, solid_capstyle="round")
    axes.set_ylim(-0.02, 1.04)
    span = float(times_s[-1] - times_s[0]) or 1.0
    axes.set_xlim(times_s[0], times_s[-1] + 0.42 * span)
    axes.set_xticks([tick for tick in axes.get_xticks() if times_s[0] <= tick <= times_s[-1]])
    axes.spines["bottom"].set_bounds(times_s[0], times_s[-1])
    _name_lines(axes, times_s, belief, labels, truth, colours)


def _name_lines(
    axes: Axes, times_s: Floats, belief: Floats, labels: Sequence[str], truth: str, colours: Mapping[str, str]
) -> None:
    """Name the true movement, and those that end high enough, at the end of their lines."""
    last = dict(zip(labels, belief[-1].tolist(), strict=True))
    shown = [label for label in colours if label == truth or last[label] >= WORTH_NAMING]
    for label, height in zip(shown, spread([last[label] for label in shown], LABEL_GAP), strict=True):
        axes.annotate(
            label.replace("_", " "),
            (float(times_s[-1]), height),
            xytext=(4, 0),
            textcoords="offset points",
            va="center",
            fontsize=8,
            color=colours[label],
            fontweight="bold" if label == truth else "normal",
        )


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
