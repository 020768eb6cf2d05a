"""A performance over the band of the references, joint by joint, as a small SVG picture. Pure."""

from collections.abc import Sequence
from html import escape

import numpy as np

from observer.score.references import Band, Remark
from observer.tracks import Floats

WIDTH, HEIGHT, EDGE, TITLE = 320, 120, 44, 28
STRAIGHT_DEG = 180.0
SHOWN = 3
INK, BAND_FILL, MEAN_LINE, OWN_LINE = "#222", "#bcd4e6", "#5b8db8", "#c0392b"


def score_figure(title: str, band: Band, remarks: Sequence[Remark]) -> str:
    """The joints that are remarked, else those that are farthest off: degrees over the course of the movement."""
    names = [joint.name for joint in band.joints]
    off = np.argsort(-(band.spreads**2).mean(axis=0))
    chosen = [names.index(each.joint) for each in remarks if each.joint in names]
    chosen = (chosen + [int(n) for n in off if int(n) not in chosen])[:SHOWN]
    height = TITLE + (HEIGHT + EDGE) * len(chosen)
    words_of = {each.joint: each.words for each in remarks}
    panels = [
        _panel(band, n, TITLE + place * (HEIGHT + EDGE), words_of.get(names[n], names[n]))
        for place, n in enumerate(chosen)
    ]
    size = f'width="{WIDTH + 2 * EDGE}" height="{height}"'
    name = escape(title)
    head = f'<title>{name}</title><text x="{EDGE}" y="18" font-weight="bold">{name}</text>'
    style = f'font-family="sans-serif" font-size="12" fill="{INK}"'
    return f'<svg xmlns="http://www.w3.org/2000/svg" {size} {style}>{head}{"".join(panels)}</svg>\n'


def _panel(band: Band, n: int, top: int, words: str) -> str:
    mean, own, deviation = band.mean[:, n], band.own[:, n], band.deviation[:, n]
    edges = np.concatenate([mean + deviation, (mean - deviation)[::-1]])
    moments = np.linspace(0, 1, len(mean))
    area = _points(np.concatenate([moments, moments[::-1]]), edges, top)
    return (
        f'<text x="{EDGE}" y="{top + 12}">{escape(words)}</text>'
        f'<polygon points="{area}" fill="{BAND_FILL}"/>'
        f'<polyline points="{_points(moments, mean, top)}" fill="none" stroke="{MEAN_LINE}"/>'
        f'<polyline points="{_points(moments, own, top)}" fill="none" stroke="{OWN_LINE}" stroke-width="2"/>'
        f'<text x="4" y="{top + 28}">180°</text><text x="4" y="{top + HEIGHT + 16}">0°</text>'
        f'<text x="{EDGE}" y="{top + HEIGHT + 30}">begin</text>'
        f'<text x="{EDGE + WIDTH}" y="{top + HEIGHT + 30}" text-anchor="end">end</text>'
    )


def _points(moments: Floats, degrees: Floats, top: int) -> str:
    x = EDGE + WIDTH * moments
    y = top + 18 + HEIGHT * (1 - np.clip(degrees, 0, STRAIGHT_DEG) / STRAIGHT_DEG)
    return " ".join(f"{a:.1f},{b:.1f}" for a, b in zip(x, y, strict=True))
