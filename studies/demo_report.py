"""The result of a demo: verdicts against truth, whether the machine kept up, and the figures."""

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from common.errors import LabanmeshError
from common.messages import JudgementMessage, VerdictMessage
from common.probability import entropy_bits
from common.text import plural
from common.vocabulary import ABSTAIN
from observer.motion.archive import Recording, Span
from observer.tracks import Floats
from studies.demo import DemoTraffic
from studies.report import figures

LATE_VOTE_S = 1.0
"""A verdict may begin this long after a movement has ended and still belong to it."""
SLOW_SHARE = 0.1
"""With more votes than this share late, stale or silent, the machine was too slow for the demo."""


@dataclass(frozen=True, slots=True)
class DemoRow:
    """A movement with the verdicts on it, earliest first; begin_s, end_s from the begin of the performance."""

    label: str
    begin_s: float
    end_s: float
    verdict_ids: tuple[str, ...] = ()


@dataclass(frozen=True, slots=True)
class DemoResult:
    """All movements, and the verdicts that belong to none of them (`unmatched`, by id)."""

    rows: tuple[DemoRow, ...]
    unmatched: tuple[str, ...]


def movement_rows(stream: Recording, traffic: DemoTraffic) -> DemoResult:
    """Assign each verdict to the movement that it overlaps longest."""
    spans = [(span, span.start / stream.rate_hz, span.end / stream.rate_hz) for span in stream.spans]
    ids: list[list[str]] = [[] for _ in spans]
    unmatched: list[str] = []
    for name, verdict in sorted(traffic.last_words.items(), key=lambda item: item[1].began_ns):
        began_s = traffic.seconds(verdict.began_ns)
        ended_s = traffic.seconds(verdict.ended_ns or verdict.decided_ns)
        overlaps = [min(end_s + LATE_VOTE_S, ended_s) - max(begin_s, began_s) for _, begin_s, end_s in spans]
        best = int(np.argmax(overlaps)) if overlaps else 0
        (ids[best] if overlaps and overlaps[best] > 0 else unmatched).append(name)
    rows = [DemoRow(s.label, begin_s, end_s, tuple(own)) for (s, begin_s, end_s), own in zip(spans, ids, strict=True)]
    return DemoResult(tuple(rows), tuple(unmatched))


def result_text(result: DemoResult, traffic: DemoTraffic, pixels: bool = True) -> str:
    """The table of movements, the counts, additional verdicts, and whether the machine was fast enough."""
    rows = result.rows
    width = max(len(label) for label in ("first word", *(row.label for row in rows))) + 1
    head = f"{'done':<{width}}{'from':>6}{'to':>7}  {'first word':<{width}}{'after':>6}{'agreed':>8}{'entropy':>10}"
    table = [head, "-" * len(head), *(_line(row, traffic, width) for row in rows)]
    first = _counts(rows, traffic.first_words)
    last = _counts(rows, traffic.last_words)
    counts = [f"{first} (observers abstain rather than guess)"]
    if last != first:
        counts = [f"first word: {counts[0]}", f"last word:  {last}"]
    return "\n".join([*table, "", *counts, *_additional(result, traffic), *_timeliness(traffic, pixels)])


def _line(row: DemoRow, traffic: DemoTraffic, width: int) -> str:
    start = f"{row.label:<{width}}{row.begin_s:>5.1f}s{row.end_s:>6.1f}s  "
    if not row.verdict_ids:
        return f"{start}no verdict"
    first, last = traffic.first_words[row.verdict_ids[0]], traffic.last_words[row.verdict_ids[0]]
    after = f"{traffic.seconds(first.decided_ns) - row.begin_s:>5.1f}s"
    agreed = f"{first.agreement.k} of {first.agreement.n}"
    grade = _grade(row, first)
    if last.label != first.label:
        grade += f"; last word {last.label}: {_grade(row, last)}"
    return f"{start}{first.label:<{width}}{after}{agreed:>8}{first.certainty_bits:>6.2f} bit  {grade}"


def _grade(row: DemoRow, verdict: VerdictMessage) -> str:
    return "right" if verdict.label == row.label else "undecided" if verdict.label == ABSTAIN else "WRONG"


def _counts(rows: Sequence[DemoRow], words: dict[str, VerdictMessage]) -> str:
    grades = Counter(_grade(row, words[row.verdict_ids[0]]) if row.verdict_ids else "undecided" for row in rows)
    return f"{grades['right']} of {len(rows)} right, {grades['WRONG']} wrong, {grades['undecided']} undecided"


def _additional(result: DemoResult, traffic: DemoTraffic) -> list[str]:
    """Verdicts beyond the first one of each movement."""
    extra = [(name, f"during {row.label}") for row in result.rows for name in row.verdict_ids[1:]]
    extra += [(name, "between movements") for name in result.unmatched]
    if not extra:
        return []
    lines = [f"{plural(len(extra), 'additional verdict')}:"]
    for name, place in sorted(extra, key=lambda item: traffic.first_words[item[0]].decided_ns):
        first, last = traffic.first_words[name], traffic.last_words[name]
        label = first.label if first.label == last.label else f"{first.label}, then {last.label}"
        lines.append(f"  {traffic.seconds(first.decided_ns):>5.1f}s  {label}, {place}")
    return lines


def _timeliness(traffic: DemoTraffic, pixels: bool) -> list[str]:
    """How many votes were late, stale or silent while the observers were watching; a plain word when too many."""
    states = Counter(
        vote.state
        for judgement in traffic.judgements
        if (traffic.began_ns or 0) <= judgement.at_ns <= traffic.ended_ns
        for vote in judgement.votes.values()
    )
    total = max(states.total(), 1)
    shares = {state: states[state] / total for state in ("late", "stale", "silent")}
    late = sum(shares.values())
    slow = f"{late:.0%} of the votes came too late to count in full" if late > SLOW_SHARE else ""
    if traffic.timed_out:
        slow = f"the observers did not reach the end of the performance in time ({late:.0%} of their votes were late)"
    lines = [f"votes in time: {1 - late:.0%}; " + ", ".join(f"{state} {share:.0%}" for state, share in shares.items())]
    if slow:
        way_out = "close other programs" + (", or run labanmesh demo --no-pixels" if pixels else "")
        lines.append(f"THIS MACHINE WAS TOO SLOW: {slow}; {way_out}")
    return lines


def draw_figures(
    stream: Recording, traffic: DemoTraffic, labels: Sequence[str], folder: Path
) -> tuple[list[Path], str]:
    """The figures' files, and a note (or "") that says which figures are missing and how to get them."""
    try:
        return _draw(stream, traffic, labels, folder), ""
    except (LabanmeshError, OSError) as error:
        names = f"{folder / 'verdicts.png'} and {folder / 'belief-*.png'}"
        return [], f"\nfigures left out: {names}: {error}\n"


def _draw(stream: Recording, traffic: DemoTraffic, labels: Sequence[str], folder: Path) -> list[Path]:
    """The verdicts over time, and the paper's Fig. 7 of the movement on which the observers differed most."""
    drawing, rate = figures(), stream.rate_hz
    truth = [drawing.LabelledInterval(s.start / rate, s.end / rate, s.label) for s in stream.spans]
    shown = drawing.StreamTimeline("", len(stream.positions) / rate, truth, _bars(stream, traffic))
    timeline = drawing.stream_timeline_figure([shown], "verdicts", folder / "verdicts.png")
    judgements = _last_per_frame(traffic, rate)
    times_s = np.array([traffic.seconds(j.at_ns) for j in judgements])
    span = _most_disputed(stream, judgements, times_s)
    inside = np.flatnonzero((times_s >= span.start / rate) & (times_s <= span.end / rate + LATE_VOTE_S / 2))
    chosen = [judgements[n] for n in inside]
    beliefs = {name: _posteriors_of(name, chosen, len(labels)) for name in judgements[0].votes}
    beliefs["fused"] = np.array([j.p for j in chosen])
    entropies = {name: entropy_bits(p) for name, p in beliefs.items()}
    path = folder / f"belief-{span.label}.png"
    return [timeline, drawing.belief_figure(times_s[inside], beliefs, entropies, labels, span.label, path)]


def _bars(stream: Recording, traffic: DemoTraffic) -> list[Any]:
    """Each verdict; it is right if the movement to which it belongs has its label."""
    labels = {name: row.label for row in movement_rows(stream, traffic).rows for name in row.verdict_ids}
    return [
        figures().VerdictBar(
            first.label,
            traffic.seconds(first.decided_ns),
            last.label,
            traffic.seconds(last.began_ns),
            traffic.seconds(last.ended_ns or last.decided_ns),
            *(labels.get(name) == word.label for word in (first, last)),
        )
        for (name, first), last in zip(traffic.first_words.items(), traffic.last_words.values(), strict=True)
    ]


def _last_per_frame(traffic: DemoTraffic, rate_hz: float) -> list[JudgementMessage]:
    """The last judgement of each frame, in which all observers count: each posterior causes a judgement."""
    last = {int(traffic.seconds(j.at_ns) * rate_hz): j for j in traffic.judgements}
    return [last[frame] for frame in sorted(last)]


def _posteriors_of(observer: str, judgements: Sequence[JudgementMessage], size: int) -> Floats:
    """(F, M) posterior of one observer; the uniform prior while it is silent."""
    votes = [judgement.votes[observer].p for judgement in judgements]
    return np.array([[1 / size] * size if p is None else p for p in votes])


def _most_disputed(stream: Recording, judgements: Sequence[JudgementMessage], times_s: Floats) -> Span:
    """The movement during which the entropies of the observers differ most, on average."""
    entropies = [[v.entropy for v in j.votes.values() if v.entropy is not None] for j in judgements]
    spread = np.array([max(bits) - min(bits) if bits else 0.0 for bits in entropies])

    def dispute(span: Span) -> float:
        inside = (times_s >= span.start / stream.rate_hz) & (times_s <= span.end / stream.rate_hz)
        return float(spread[inside].mean()) if inside.any() else 0.0

    return max(stream.spans, key=dispute)
