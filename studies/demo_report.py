"""What the demo shows at its end: verdicts against truth, and where the figures are."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from common.messages import JudgementMessage, VerdictMessage
from common.probability import entropy_bits
from common.vocabulary import ABSTAIN
from observer.motion.archive import Recording, Span
from observer.tracks import Floats
from studies.demo import Heard
from studies.report import figures

LATE_S = 1.0
"""A verdict may come so long after the movement's end and still be about it."""


@dataclass(frozen=True, slots=True)
class Row:
    """A movement performed, and the verdict on it, if any; times in seconds from the performance's begin."""

    label: str
    begin_s: float
    end_s: float
    verdict: VerdictMessage | None
    decided_s: float | None

    @property
    def right(self) -> bool:
        """Whether the last word of the verdict is what was done."""
        return self.verdict is not None and self.verdict.label == self.label


def rows_of(stream: Recording, heard: Heard) -> list[Row]:
    """Each movement with the verdict whose time overlaps it most."""
    return [_row(span, stream.rate_hz, heard) for span in stream.spans]


def _row(span: Span, rate_hz: float, heard: Heard) -> Row:
    begin_s, end_s = span.start / rate_hz, span.end / rate_hz

    def overlap(verdict: VerdictMessage) -> float:
        ended = verdict.ended_ns or verdict.decided_ns
        return min(end_s + LATE_S, heard.seconds(ended)) - max(begin_s, heard.seconds(verdict.began_ns))

    verdict = max(heard.verdicts.values(), key=overlap, default=None)
    if verdict is None or overlap(verdict) <= 0:
        return Row(span.label, begin_s, end_s, None, None)
    return Row(span.label, begin_s, end_s, verdict, heard.seconds(verdict.decided_ns))


def table(rows: Sequence[Row]) -> str:
    """Verdicts against truth, a line a movement, and how many were right."""
    width = max(len(row.label) for row in rows) + 2
    head = f"{'done':<{width}}{'from':>6}{'to':>7}  {'verdict':<{width}}{'after':>7}{'agreed':>8}{'entropy':>9}"
    right = sum(row.right for row in rows)
    return "\n".join([head, "-" * len(head), *(_line(row, width) for row in rows), "", _sum(rows, right)])


def _line(row: Row, width: int) -> str:
    start = f"{row.label:<{width}}{row.begin_s:>5.1f}s{row.end_s:>6.1f}s  "
    if row.verdict is None or row.decided_s is None:
        return f"{start}{'none':<{width}}"
    after = f"{row.decided_s - row.begin_s:>6.1f}s"
    agreed = f"{row.verdict.agreement.k} of {row.verdict.agreement.n}"
    mark = "right" if row.right else "undecided" if row.verdict.label == ABSTAIN else "WRONG"
    bits = f"{row.verdict.certainty_bits:.2f} bit"
    return f"{start}{row.verdict.label:<{width}}{after}{agreed:>8}{bits:>9}  {mark}"


def _sum(rows: Sequence[Row], right: int) -> str:
    wrong = sum(not row.right and row.verdict is not None and row.verdict.label != ABSTAIN for row in rows)
    open_ = len(rows) - right - wrong
    return f"{right} of {len(rows)} right, {wrong} wrong, {open_} undecided (the judges abstain rather than guess)"


def draw(stream: Recording, heard: Heard, labels: Sequence[str], folder: Path) -> list[Path]:
    """The verdicts over time, and the paper's Fig. 7 of the movement on which the judges differed most."""
    drawing = figures()
    Interval = drawing.Span
    rate = stream.rate_hz
    judgements = _one_a_frame(heard, rate)
    times_s = np.array([heard.seconds(j.at_ns) for j in judgements])
    fused = np.array([j.p for j in judgements])
    truth = [Interval(s.start / rate, s.end / rate, s.label) for s in stream.spans]
    verdicts = [
        Interval(heard.seconds(v.began_ns), heard.seconds(v.ended_ns or v.decided_ns), v.label)
        for v in heard.verdicts.values()
    ]
    playing = (times_s >= 0) & (times_s <= len(stream.positions) / rate)
    timeline = drawing.verdict_timeline_figure(
        times_s[playing], fused[playing], labels, truth, verdicts, folder / "verdicts.png"
    )
    span = _most_disputed(stream, judgements, times_s)
    inside = np.flatnonzero((times_s >= span.start / rate) & (times_s <= span.end / rate + LATE_S / 2))
    told = [judgements[n] for n in inside]
    beliefs = {name: _belief_of(name, told, len(labels)) for name in judgements[0].votes}
    beliefs["fused"] = fused[inside]
    entropies = {name: entropy_bits(p) for name, p in beliefs.items()}
    path = folder / f"belief-{span.label}.png"
    return [timeline, drawing.belief_figure(times_s[inside], beliefs, entropies, labels, span.label, path)]


def _one_a_frame(heard: Heard, rate_hz: float) -> list[JudgementMessage]:
    """The last judgement of each frame, when all judges have spoken: each of them causes a judgement of its own."""
    last = {int(heard.seconds(j.at_ns) * rate_hz): j for j in heard.judgements}
    return [last[frame] for frame in sorted(last)]


def _belief_of(observer: str, judgements: Sequence[JudgementMessage], size: int) -> Floats:
    """(F, M) what one observer believed; the prior while it was silent."""
    said = [judgement.votes[observer].p for judgement in judgements]
    return np.array([[1 / size] * size if p is None else p for p in said])


def _most_disputed(stream: Recording, judgements: Sequence[JudgementMessage], times_s: Floats) -> Span:
    """The movement during which the judges' entropies lay farthest apart, on average."""
    entropies = [[v.entropy for v in j.votes.values() if v.entropy is not None] for j in judgements]
    spread = np.array([max(bits) - min(bits) if bits else 0.0 for bits in entropies])

    def dispute(span: Span) -> float:
        inside = (times_s >= span.start / stream.rate_hz) & (times_s <= span.end / stream.rate_hz)
        return float(spread[inside].mean()) if inside.any() else 0.0

    return max(stream.spans, key=dispute)
