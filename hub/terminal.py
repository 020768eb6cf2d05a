"""The scene as a picture in the terminal: observers in the corners, fusion between them, the verdicts below. Pure.

Only the terminal's own named colours are used, without yellow, white and black, so that the picture is readable on a
light and on a dark background; every colour repeats what a word says.
"""

from collections.abc import Iterable, Sequence

from rich.align import Align
from rich.box import HEAVY, ROUNDED
from rich.console import Group, RenderableType
from rich.padding import Padding
from rich.panel import Panel
from rich.text import Text

from common.message_types import printable
from common.messages import VerdictMessage
from common.text import plural
from hub.anticipation import EarlyWord
from hub.same_id import in_words
from hub.scene_state import SOMETHING_ELSE, ObserverState, RankedLabel, SceneState, is_abstention
from hub.terminal_widgets import ShareBar, grid
from hub.wording import (
    WAITING,
    age,
    agreement,
    bits,
    clock_time,
    contributed,
    dissent,
    duration,
    fall_words,
    label_words,
    manner,
    percent,
    person_line,
    score_words,
    undecided,
)

LABELS_PER_OBSERVER = 3
MIN_CORNER_WIDTH = 36
SKEW_SHOWN_S = 0.5
CORNER_FRAME_LINES = 4
FUSION_LINES = 7
COMPACT_CELLS = 48
"""The least width of an observer that is shown in one line."""
HEADER_LINES = 1
SPACED_LETTERS = 12
"""The longest label that is spelled w i d e."""

EVEN = {"ratio": 1}
"""A column as wide as its neighbours."""

Row = tuple[RenderableType, ...]


def render(
    state: SceneState, width: int, height: int | None = None, early: Sequence[EarlyWord] = (), notice: str = ""
) -> RenderableType:
    """The whole picture, `width` cells wide; with `height` it shows fewer labels and verdicts when lines are short.

    When not even the smallest corners fit, each observer is one line, those that do not agree first. early: the open
    early words. notice: what to do when nothing is received.
    """
    observers = state.observers
    columns = 1 if width < 2 * MIN_CORNER_WIDTH or len(observers) < 2 else 2
    rows = -(-len(observers) // columns)
    if height is not None and rows * (CORNER_FRAME_LINES + 1) > height - HEADER_LINES - FUSION_LINES:
        return _compact(state, width, height, early, notice)
    labels, log_lines = _fitting(rows, height)
    corners = [_corners(observers[i : i + columns], columns, labels, state) for i in range(0, len(observers), columns)]
    how = "" if state.judgement is None or state.waiting else manner(state.judgement)
    people = "  ".join(map(person_line, state.people)) if len(state.people) > 1 else ""
    below = [Text(line, no_wrap=True, overflow="ellipsis") for line in (how, people) if line][: max(0, log_lines)]
    log_lines -= len(below)
    log = [] if log_lines < 1 else [_log(state.verdicts[:log_lines])]
    above = -(-rows // 2)
    fusion = _fusion(state, early, notice)
    return Group(_header(state), *corners[:above], fusion, *below, *corners[above:], *log)


def _compact(state: SceneState, width: int, height: int, early: Sequence[EarlyWord], notice: str) -> RenderableType:
    """Fusion, then as many observers as fit, a line each, then the number of the others."""
    columns = max(1, width // COMPACT_CELLS)
    lines = max(0, height - HEADER_LINES - FUSION_LINES - 1)
    # Stable: both groups keep the scene's order.
    observers = sorted(state.observers, key=lambda observer: observer.agrees)
    shown, hidden = observers[: lines * columns], observers[lines * columns :]
    cells: list[RenderableType] = [_one_line(observer, width // columns - 1) for observer in shown]
    rows = [cells[i : i + columns] for i in range(0, len(cells), columns)]
    all_agree = ", all of them agree" if all(observer.agrees for observer in hidden) else ""
    rest = [Text(f"and {len(hidden)} more{all_agree}", "dim")] if hidden else []
    return Group(_header(state), _fusion(state, early, notice), grid(rows, *[EVEN] * columns), *rest)


def _one_line(observer: ObserverState, cells: int) -> RenderableType:
    label = printable(observer.label) if observer.label and observer.is_heard else ""
    line = Text.assemble(printable(observer.name), "  ", (_stance(observer), _colour(observer)), "  ", (label, "bold"),
                         (f"  {percent(observer.weight).strip()}  {age(observer.age_s)}", "dim"),
                         no_wrap=True)  # fmt: skip
    line.truncate(cells, overflow="ellipsis")
    return line


def _fitting(rows: int, height: int | None) -> tuple[int, int]:
    """How many labels per observer, and how many lines of the verdict log, fit into `height` lines."""
    if height is None:
        return LABELS_PER_OBSERVER, 10
    spare = height - HEADER_LINES - FUSION_LINES - rows * CORNER_FRAME_LINES
    labels = max(1, min(LABELS_PER_OBSERVER, (spare - 2) // rows if rows else LABELS_PER_OBSERVER))
    return labels, spare - rows * labels


def _header(state: SceneState) -> RenderableType:
    row = (Text(printable(state.scene), style="bold"), Text("  ".join(_news(state)), style="dim"))
    return grid([row], {"no_wrap": True}, {"no_wrap": True, "ratio": 1, "justify": "right"}, padding=1)


def _news(state: SceneState) -> Iterable[str]:
    if state.fall is not None and state.fall.stage in ("low", "fallen"):
        yield printable(fall_words(state.fall)).upper()
    if state.same_ids:
        yield in_words(state.same_ids)
    if state.rejected:
        yield f"{plural(state.rejected, 'message')} rejected"
    if state.judgement is None:
        yield "waiting for fusion"
        return
    if state.standing_by:
        yield f"{', '.join(map(printable, state.standing_by))} standing by"
    yield f"{state.judgement.fusion}: {printable(state.judgement.rule)}"
    yield f"silent for {age(state.silence_s)}" if state.silent else clock_time(state.now_ns)


def _corners(observers: Sequence[ObserverState], columns: int, labels: int, state: SceneState) -> RenderableType:
    cells: list[RenderableType] = [_corner(observer, labels, _label_cells(state)) for observer in observers]
    return grid([cells], *[EVEN] * columns)


def _corner(observer: ObserverState, labels: int, label_cells: int) -> RenderableType:
    colour = _colour(observer)
    # The label alone, when fusion does not pass on the posterior.
    ranked = observer.ranked[:labels] or ((RankedLabel(observer.label, 0.0),) if observer.label else ())
    rows = [_ranked_row(each, colour if place == 0 else "dim", label_cells) for place, each in enumerate(ranked)]
    rows += [("", "", "")] * (labels - len(rows))
    weight = (Text("weight", style="dim"), ShareBar(observer.weight, "magenta"), percent(observer.weight))
    entropy, age_text = bits(observer.entropy), age(observer.age_s)
    facts = Text.assemble(("entropy ", "dim"), entropy, ("  age ", "dim"), age_text, no_wrap=True)
    title = Text.assemble((f"{printable(observer.name)} ", "bold"), (_stance(observer), colour))
    body = Group(_bars([*rows, weight], label_cells), facts)
    return Panel(body, title=title, title_align="left", subtitle=_health(observer), subtitle_align="right",
                 border_style=colour, box=ROUNDED, padding=(0, 1))  # fmt: skip


def _stance(observer: ObserverState) -> str:
    if not observer.is_heard or observer.sees_nobody:
        return "sees nobody" if observer.sees_nobody else observer.state
    stance = "agrees" if observer.agrees else "differs" if observer.label else "undecided"
    return f"{stance}, stale" if observer.state == "stale" else stance


def _colour(observer: ObserverState) -> str:
    if observer.state != "counted":
        return "red"
    return "green" if observer.agrees else "blue"


def _health(observer: ObserverState) -> Text:
    status, troubles = observer.status, tuple(_troubles(observer))
    if status is None:
        return Text(", ".join(troubles), style="red")
    rate = [] if status.rate_hz is None else [f"{status.rate_hz:.0f} Hz"]
    reason = [printable(status.reason)] if status.reason else []
    style = "dim" if status.state == "running" and not troubles else "red"
    return Text(", ".join([status.state, *rate, *reason, *troubles]), style=style)


def _troubles(observer: ObserverState) -> Iterable[str]:
    """Faults that the observer does not report itself: its clock, lies, and messages that fusion rejected."""
    if observer.skew_s is not None and abs(observer.skew_s) >= SKEW_SHOWN_S:
        yield f"clock {'+' if observer.skew_s > 0 else '-'}{age(abs(observer.skew_s))}"
    if observer.label_reliability is not None:
        yield f"the others contradict it: {observer.label_reliability:.0%} trusted"
    if observer.rest_reliability is not None:
        yield f"its rest contradicts the others: {observer.rest_reliability:.0%} trusted"
    if observer.has_same_id:
        yield "two processes have this id"
    elif observer.rejected:
        yield plural(observer.rejected, "bad message")


def _fusion(state: SceneState, early: Sequence[EarlyWord], notice: str) -> RenderableType:
    count = FUSION_LINES - 3
    rows = [_ranked_row(ranked, "green" if place == 0 else "dim", _label_cells(state)) for place, ranked in
            enumerate(state.fused[:count])]  # fmt: skip
    rows += [("", "", "")] * (count - len(rows))
    fused = Group(_bars(rows, _label_cells(state)), _summary(state))
    style = "red" if state.silent else "bold"
    if notice:
        inside: RenderableType = Align(Text(notice, "red"), vertical="middle", height=FUSION_LINES - 2)
    else:
        flag = Align.center(_flag_now(state, early), vertical="middle")
        inside = grid([(fused, flag)], EVEN, EVEN, padding=2)
    why = "" if state.judgement is None else undecided(state.judgement)
    subtitle = Text(why, style="default") if why else None
    person = None if state.judgement is None else state.judgement.person
    title = f"fusion: {person}" if person else "fusion"
    return Panel(inside, title=title, subtitle=subtitle, subtitle_align="left", box=HEAVY, border_style=style,
                 padding=(0, 1))  # fmt: skip


def _flag_now(state: SceneState, early: Sequence[EarlyWord]) -> RenderableType:
    movement = None if state.judgement is None else state.judgement.movement
    if movement is not None and movement.label is None:
        for word in early:
            if word.id == movement.id:
                return _flag(word.label, "bold blue", f"early, {word.p:.0%} sure, not decided yet")
    return _verdict_flag(state.verdict)


def _summary(state: SceneState) -> Text:
    if state.judgement is None:
        return Text("no judgement yet", style="dim")
    if state.waiting:
        return Text(WAITING, style="bold")
    entropy = bits(state.judgement.certainty_bits)
    return Text.assemble((agreement(state.judgement), "bold"), ("  entropy ", "dim"), entropy, no_wrap=True)


def _verdict_flag(verdict: VerdictMessage | None) -> RenderableType:
    if verdict is None:
        return Text("no verdict yet", style="dim")
    colour = "red" if is_abstention(verdict) else "green"
    style = f"bold {colour}" if verdict.ended_ns is not None else f"bold reverse {colour}"
    when = "now" if verdict.ended_ns is None else f"{duration(verdict)}, at {clock_time(verdict.began_ns)}"
    when = when if verdict.revises is None else f"revised from {printable(verdict.revises)}"
    score = "" if verdict.score is None else f"{verdict.score:.1f} of 10, "
    return _flag(verdict.label, style, f"{score}{when}, {agreement(verdict)}")


def _flag(label: str, style: str, caption: str) -> RenderableType:
    name = printable(label).upper().replace("_", " ")
    spaced = " ".join(name) if len(name) <= SPACED_LETTERS else name
    flag = Padding(Text(spaced, style=style, no_wrap=True), (1, 3), style=style, expand=False)
    return Group(Align.center(flag), Align.center(Text(caption, style="dim", no_wrap=True)))


def _log(verdicts: Sequence[VerdictMessage]) -> RenderableType:
    def row(verdict: VerdictMessage) -> Sequence[RenderableType]:
        label = Text(label_words(verdict), style="red" if is_abstention(verdict) else "bold")
        details = (score_words(verdict), printable(verdict.why or ""), dissent(verdict), contributed(verdict))
        times = (clock_time(verdict.began_ns), label, duration(verdict))
        texts = agreement(verdict), bits(verdict.certainty_bits), Text("  ".join(filter(None, details)), style="dim")
        return (*times, *texts)

    column = {"no_wrap": True, "overflow": "ellipsis"}
    return grid(map(row, verdicts), *[column] * 5, {**column, "ratio": 1}, padding=2)


def _ranked_row(ranked: RankedLabel, style: str, label_cells: int) -> Row:
    name = Text(printable(ranked.label), style="bold" if style != "dim" else "dim")
    name.truncate(label_cells, overflow="ellipsis")
    return name, ShareBar(ranked.p, style), Text(percent(ranked.p), style="" if style != "dim" else "dim")


def _bars(rows: Iterable[Row], label_cells: int) -> RenderableType:
    label, number = {"width": label_cells, "no_wrap": True}, {"width": 4, "no_wrap": True, "justify": "right"}
    return grid(rows, label, {"ratio": 1}, number, padding=1)


def _label_cells(state: SceneState) -> int:
    """Cells for a label, the same at every step so that bars do not jump: the longest label, at most 14."""
    labels = [*(state.labels or [ranked.label for ranked in state.fused])]
    labels += [SOMETHING_ELSE] if state.judgement is not None and state.judgement.unlearned is not None else []
    return min(14, max(6, *map(len, labels)) if labels else 6)
