"""Scores of recorded performances: each view is a judge, and the referee drops the highest and the lowest.

The figure of a performance is a small SVG picture: the performance over the band of the references, joint by joint.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from html import escape
from typing import Any

import numpy as np

from common.errors import BadInput
from fusion.score_pool import JudgedScore, pooled_remarks, pooled_score
from observer.features import REFERENCE_HZ, read_trace
from observer.geometry.views import View, parse_view, split_views
from observer.learning.examples import mirrored as mirrored
from observer.motion.archive import Recording
from observer.motion.projected import view_tracks
from observer.score.comparison import Align, Alignment
from observer.score.references import Band, JudgeScore, ReferenceTake, ReferenceTakes, Remark
from observer.tracks import Floats, Floats32, Tracks


@dataclass(frozen=True, slots=True)
class SeenPerformance:
    """A recording as one view sees it, thinned out to about REFERENCE_HZ. seen: (P,) parts seen in half the frames."""

    trace: Floats32
    rate_hz: float
    seen: tuple[bool, ...]

    @classmethod
    def of(cls, view: View, recording: Recording, body_parts: tuple[str, ...]) -> "SeenPerformance":
        """The performance of a whole recording."""
        tracks = view_tracks(view, recording, body_parts, body_parts)
        step = max(int(recording.rate_hz / REFERENCE_HZ), 1)
        trace = read_trace(body_parts, recording.rate_hz, tracks)[::step]
        return cls(trace, recording.rate_hz / step, _seen(tracks))


def _seen(tracks: Sequence[Tracks]) -> tuple[bool, ...]:
    visible = np.mean([each.visible for each in tracks], axis=0) >= 0.5
    return tuple(bool(part) for part in visible)


def shown_takes(view: View, recording: Recording, body_parts: tuple[str, ...]) -> tuple[SeenPerformance, ...]:
    """A reference take as the view sees it, and as done to the other side, if it is in 3-D."""
    sides = [recording, *([mirrored(recording, body_parts)] if recording.positions.shape[-1] == 3 else [])]
    return tuple(SeenPerformance.of(view, each, body_parts) for each in sides)


def references_of(view: View, recordings: Sequence[Recording], body_parts: tuple[str, ...]) -> ReferenceTakes:
    """The references of one movement for one view."""
    shown = [(shown_takes(view, each, body_parts), each.subject) for each in recordings]
    return learned_references(shown, body_parts)


def learned_references(
    shown: Sequence[tuple[Sequence[SeenPerformance], str]], body_parts: Sequence[str], align: Align = Alignment
) -> ReferenceTakes:
    """The references of takes as one view sees them; each the take and the other side, and the person."""
    takes, rate_hz = list[ReferenceTake](), float(REFERENCE_HZ)
    for sides, person in shown:
        rate_hz = sides[0].rate_hz
        takes += [ReferenceTake(each.trace, person, mirrored=n > 0) for n, each in enumerate(sides)]
    return ReferenceTakes(takes, body_parts, rate_hz, align=align)


def pooled(scores: Mapping[str, JudgeScore]) -> float | None:
    """The referee's score, pooled from the judges that have one; None without any."""
    return pooled_score({n: JudgedScore(s.score, s.certainty) for n, s in scores.items() if s.score is not None})


def agreed_remarks(scores: Mapping[str, JudgeScore]) -> list[Remark]:
    """The referee's remarks: those that at least half of the judges with a score make."""
    return pooled_remarks([each.remarks for each in scores.values() if each.score is not None])


@dataclass(frozen=True, slots=True)
class ScoredPerformance:
    """A performance with its scores and remarks. uncertain: why it has no score."""

    scores: Mapping[str, JudgeScore]
    references: int
    uncertain: str = ""

    @property
    def score(self) -> float | None:
        """The referee's, 0 to 10; None if too few judges have one."""
        return pooled(self.scores)

    @property
    def remarks(self) -> list[Remark]:
        """The referee's, at most three."""
        return agreed_remarks(self.scores)

    def as_fields(self) -> dict[str, Any]:
        """The result as `labanmesh score --json` prints it."""
        why = self.uncertain or next((each.uncertain for each in self.scores.values() if each.uncertain), "")
        judged = {view: None if each.score is None else round(each.score, 1) for view, each in self.scores.items()}
        remarks = [
            {"joint": each.joint, "moment": each.moment, "degrees": round(each.degrees, 1), "words": each.words}
            for each in self.remarks
        ]
        score = self.score
        return {
            "score": None if score is None else round(score, 2), "judges": judged, "remarks": remarks,
            "references": self.references, "uncertain": why if score is None else None,
        }  # fmt: skip

    def figure_of(self) -> Band | None:
        """The band of the judge whose remarks are the strongest; None if no judge has one."""
        known = [each for each in self.scores.values() if each.band is not None]
        if not known:
            return None
        return max(known, key=lambda each: max((r.strength for r in each.remarks), default=0.0)).band


class Judges:
    """One judge for each view; what they learn from the same reference takes is kept."""

    def __init__(self, views: str, body_parts: tuple[str, ...]) -> None:
        self._views = {name: parse_view(name) for name in split_views(views)}
        self._parts = body_parts
        self._known: dict[tuple[int, ...], dict[str, ReferenceTakes]] = {}

    def judge(self, performance: Recording, references: Sequence[Recording]) -> ScoredPerformance:
        """Score one performance against reference takes; the result says why it has no score."""
        key = tuple(id(each) for each in references)
        try:
            if key not in self._known:
                learned = {n: references_of(view, references, self._parts) for n, view in self._views.items()}
                self._known = {key: learned}
        except BadInput as error:
            return ScoredPerformance({}, len(references), str(error))
        own = {name: SeenPerformance.of(view, performance, self._parts) for name, view in self._views.items()}
        scores = {name: known.judge(own[name].trace, own[name].seen) for name, known in self._known[key].items()}
        return ScoredPerformance(scores, len(references))


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
