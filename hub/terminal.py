"""The scene as a picture in the terminal: judges in their corners, the referee between them, the verdicts below. Pure.

Only the terminal's own named colours are used, no yellow, white or black, so that it reads on light and on
dark; every colour repeats what a word says.
"""

from collections.abc import Iterable, Sequence

from rich.align import Align
from rich.box import HEAVY, ROUNDED
from rich.console import Group, RenderableType
from rich.padding import Padding
from rich.panel import Panel
from rich.table import Table
from rich.text import Text

from common.messages import VerdictMessage
from hub.anticipation import Word
from hub.bars import Bar
from hub.manner import LINES, manner_lines
from hub.scene_state import SOMETHING_ELSE, Belief, Judge, SceneState, is_abstention
from hub.wording import age, agreement, bits, clock_time, contributed, dissent, duration, percent, printable

BELIEFS = 3
LEAST_CORNER_WIDTH = 36
SKEW_WORTH_TELLING_S = 0.5
JUDGE_FRAME = 4
REFEREE_LINES = 7
CROWD_CELLS = 48
"""The least width of a judge that is told in one line."""
HEADER_LINES = 1
SPACED_LETTERS = 12
"""The longest label that is spelled w i d e."""

Rows = Sequence[RenderableType]


def render(state: SceneState, width: int, height: int | None = None, early: Sequence[Word] = ()) -> RenderableType:
    """The whole view, `width` cells wide; with `height` it shows fewer beliefs and verdicts where lines are short.

    Where not even the smallest corners fit, each judge is one line, and those that do not agree come first. early: what
    was said of movements that are not decided.
    """
    judges = state.judges
    columns = 1 if width < 2 * LEAST_CORNER_WIDTH or len(judges) < 2 else 2
    rows = -(-len(judges) // columns)
    beliefs, log_lines = _fitting(rows, height)
    if height is not None and rows * (JUDGE_FRAME + 1) > height - HEADER_LINES - REFEREE_LINES:
        return _crowded(state, width, height, early)
    corners = [_row(judges[i : i + columns], columns, beliefs, state) for i in range(0, len(judges), columns)]
    above = -(-rows // 2)
    manner = manner_lines(state.judgement, width) if log_lines >= LINES else None
    log_lines -= LINES if manner is not None else 0
    log = [] if log_lines < 1 else [_log(state.verdicts[:log_lines])]
    below = [] if manner is None else [manner]
    return Group(_header(state), *corners[:above], _referee(state, early), *below, *corners[above:], *log)


def _crowded(state: SceneState, width: int, height: int, early: Sequence[Word]) -> RenderableType:
    """The referee, then as many judges as fit, a line each; how many more there are stands below them."""
    columns = max(1, width // CROWD_CELLS)
    lines = max(0, height - HEADER_LINES - REFEREE_LINES - 1)
    # Stable: within those that agree, and within those that do not, the scene's order.
    judges = sorted(state.judges, key=lambda judge: judge.agrees)
    shown, hidden = judges[: lines * columns], judges[lines * columns :]
    cells: list[RenderableType] = [_in_one_line(judge, width // columns - 1) for judge in shown]
    cells += [""] * (-len(cells) % columns)
    rows = [tuple(cells[i : i + columns]) for i in range(0, len(cells), columns)]
    steady = ", all of them agree" if all(judge.agrees for judge in hidden) else ""
    rest = [Text(f"and {len(hidden)} more{steady}", "dim")] if hidden else []
    return Group(_header(state), _referee(state, early), _grid(rows, (1,) * columns), *rest)


def _in_one_line(judge: Judge, cells: int) -> RenderableType:
    label = printable(judge.label) if judge.label and judge.state == "counted" else ""
    words = Text.assemble(printable(judge.name), "  ", (_stance(judge), _colour(judge)), "  ", (label, "bold"),
                          (f"  {percent(judge.weight).strip()}  {age(judge.age_s)}", "dim"), no_wrap=True)  # fmt: skip
    words.truncate(cells, overflow="ellipsis")
    return words


def _fitting(rows: int, height: int | None) -> tuple[int, int]:
    """How many beliefs a judge and how many verdicts the log may show in `height` lines."""
    if height is None:
        return BELIEFS, 10
    spare = height - HEADER_LINES - REFEREE_LINES - rows * JUDGE_FRAME
    beliefs = max(1, min(BELIEFS, (spare - 2) // rows if rows else BELIEFS))
    return beliefs, spare - rows * beliefs


def _header(state: SceneState) -> RenderableType:
    table = Table.grid(expand=True, padding=(0, 1))
    table.add_column(no_wrap=True)
    table.add_column(no_wrap=True, ratio=1, justify="right")
    table.add_row(Text(printable(state.scene), style="bold"), Text("  ".join(_news(state)), style="dim"))
    return table


def _news(state: SceneState) -> Iterable[str]:
    if state.rejected:
        yield f"{state.rejected} messages not understood"
    if state.judgement is None:
        yield "waiting for a referee"
        return
    if state.standing_by:
        yield f"{', '.join(map(printable, state.standing_by))} standing by"
    yield f"{state.judgement.fusion}: {printable(state.judgement.rule)}"
    yield f"silent for {age(state.silence_s)}" if state.silent else clock_time(state.now_ns)


def _row(judges: Sequence[Judge], columns: int, beliefs: int, state: SceneState) -> RenderableType:
    cells: list[RenderableType] = [_corner(judge, beliefs, _label_cells(state)) for judge in judges]
    return _grid([tuple(cells + [""] * (columns - len(cells)))], ratios=(1,) * columns)


def _corner(judge: Judge, beliefs: int, label_cells: int) -> RenderableType:
    """One judge's panel: what it believes, how sure it is, what its word weighs, and how it is."""
    colour = _colour(judge)
    shown = judge.beliefs[:beliefs] or _label_only(judge)
    lines = [_belief(belief, colour if place == 0 else "dim", label_cells) for place, belief in enumerate(shown)]
    lines += [("", "", "")] * (beliefs - len(lines))
    weight = (Text("weight", style="dim"), Bar(judge.weight, "magenta"), percent(judge.weight))
    facts = Text.assemble(("entropy ", "dim"), bits(judge.entropy), ("  age ", "dim"), age(judge.age_s), no_wrap=True)
    title = Text.assemble((f"{printable(judge.name)} ", "bold"), (_stance(judge), colour))
    body = Group(_bars([*lines, weight], label_cells), facts)
    return Panel(body, title=title, title_align="left", subtitle=_health(judge), subtitle_align="right",
                 border_style=colour, box=ROUNDED, padding=(0, 1))  # fmt: skip


def _troubles(judge: Judge) -> Iterable[str]:
    """What is wrong with a judge beside its camera: its clock, and what it sends."""
    if judge.skew_s is not None and abs(judge.skew_s) >= SKEW_WORTH_TELLING_S:
        yield f"clock {'+' if judge.skew_s > 0 else '-'}{age(abs(judge.skew_s))}"
    if judge.rejected:
        yield f"{judge.rejected} bad messages"


def _label_only(judge: Judge) -> tuple[Belief, ...]:
    """A judge whose distribution the referee does not pass on still has its label."""
    return (Belief(judge.label, 0.0),) if judge.label else ()


def _stance(judge: Judge) -> str:
    if judge.state != "counted":
        return judge.state
    return "agrees" if judge.agrees else "differs"


def _colour(judge: Judge) -> str:
    if judge.state != "counted":
        return "red"
    return "green" if judge.agrees else "blue"


def _health(judge: Judge) -> Text:
    status, troubles = judge.status, tuple(_troubles(judge))
    if status is None:
        return Text(", ".join(troubles), style="red")
    rate = [] if status.rate_hz is None else [f"{status.rate_hz:.0f} Hz"]
    reason = [printable(status.reason)] if status.reason else []
    style = "dim" if status.state == "running" and not troubles else "red"
    return Text(", ".join([status.state, *rate, *reason, *troubles]), style=style)


def _referee(state: SceneState, early: Sequence[Word]) -> RenderableType:
    """The fused belief and the verdict, big."""
    beliefs = [_belief(belief, "green" if i == 0 else "dim", _label_cells(state)) for i, belief in
               enumerate(state.fused[:REFEREE_LINES - 3])]  # fmt: skip
    beliefs += [("", "", "")] * (REFEREE_LINES - 3 - len(beliefs))
    fused = Group(_bars(beliefs, _label_cells(state)), _agreement(state))
    now = None if state.judgement is None or state.judgement.movement is None else state.judgement.movement
    words = [word for word in early if now is not None and now.label is None and word.id == now.id]
    flag = _early(words[0]) if words else _verdict(state.verdict)
    inside = _grid([(fused, Align.center(flag, vertical="middle"))], ratios=(1, 1), padding=2)
    style = "red" if state.silent else "bold"
    return Panel(inside, title="referee", box=HEAVY, border_style=style, padding=(0, 1))


def _agreement(state: SceneState) -> Text:
    if state.judgement is None:
        return Text("nothing judged yet", style="dim")
    entropy = bits(state.judgement.certainty_bits)
    return Text.assemble((agreement(state.judgement), "bold"), ("  entropy ", "dim"), entropy, no_wrap=True)


def _verdict(verdict: VerdictMessage | None) -> RenderableType:
    if verdict is None:
        return Text("no verdict yet", style="dim")
    colour = "red" if is_abstention(verdict) else "green"
    style = f"bold {colour}" if verdict.ended_ns is not None else f"bold reverse {colour}"
    when = "now" if verdict.ended_ns is None else f"{duration(verdict)}, at {clock_time(verdict.began_ns)}"
    return _flag(verdict.label, style, f"{when}, {agreement(verdict)}")


def _early(word: Word) -> RenderableType:
    return _flag(word.label, "bold blue", f"early, {word.p:.0%} sure, not decided yet")


def _flag(label: str, style: str, caption: str) -> RenderableType:
    name = printable(label).upper().replace("_", " ")
    spaced = " ".join(name) if len(name) <= SPACED_LETTERS else name
    flag = Padding(Text(spaced, style=style, no_wrap=True), (1, 3), style=style, expand=False)
    return Group(Align.center(flag), Align.center(Text(caption, style="dim", no_wrap=True)))


def _log(verdicts: Sequence[VerdictMessage]) -> RenderableType:
    table = Table.grid(padding=(0, 2), expand=True)
    for ratio in (None, None, None, None, None, 1):
        table.add_column(no_wrap=True, overflow="ellipsis", ratio=ratio)
    for verdict in verdicts:
        style = "red" if is_abstention(verdict) else "bold"
        label = Text(printable(verdict.label), style=style)
        reasons = "  ".join(filter(None, (dissent(verdict), contributed(verdict))))
        table.add_row(clock_time(verdict.began_ns), label, duration(verdict), agreement(verdict),
                      bits(verdict.certainty_bits), Text(reasons, style="dim"))  # fmt: skip
    return table


def _belief(belief: Belief, style: str, label_cells: int) -> tuple[RenderableType, ...]:
    name = Text(printable(belief.label), style="bold" if style != "dim" else "dim")
    name.truncate(label_cells, overflow="ellipsis")
    return name, Bar(belief.p, style), Text(percent(belief.p), style="" if style != "dim" else "dim")


def _bars(rows: Iterable[tuple[RenderableType, ...]], label_cells: int) -> Table:
    table = Table.grid(padding=(0, 1), expand=True)
    table.add_column(width=label_cells, no_wrap=True)
    table.add_column(ratio=1)
    table.add_column(width=4, no_wrap=True, justify="right")
    for row in rows:
        table.add_row(*row)
    return table


def _label_cells(state: SceneState) -> int:
    """Cells for a label, the same at every step so that bars do not jump: the longest known, within reason."""
    known = [*(state.labels or [belief.label for belief in state.fused])]
    known += [SOMETHING_ELSE] if state.judgement is not None and state.judgement.unlearned is not None else []
    return min(14, max(6, *map(len, known)) if known else 6)


def _grid(rows: Sequence[tuple[RenderableType, ...]], ratios: Sequence[int], padding: int = 0) -> Table:
    table = Table.grid(expand=True, padding=(0, padding), pad_edge=False)
    for ratio in ratios:
        table.add_column(ratio=ratio)
    for row in rows:
        table.add_row(*row)
    return table
