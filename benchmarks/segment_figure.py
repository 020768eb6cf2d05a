"""`python -m benchmarks.segment_figure`: draws the segmenter's table of transitions into docs/design/fusion.md."""

import sys
from collections.abc import Iterator
from pathlib import Path

from benchmarks.command_line import run_command
from fusion.engine.segmenter import TABLE, TRANSITIONS, Effect
from fusion.engine.segments import SegmentState

PAGE = Path(__file__).parents[1] / "docs" / "design" / "fusion.md"
BEGIN, END = "<!-- from the table: python -m benchmarks.segment_figure -->", "<!-- end of the table -->"
PUBLISHED = {Effect.DECIDE: "decided", Effect.REVISE: "revised", Effect.END: "ended", Effect.NEXT: "ended"}


def segment_figure() -> None:
    """Write the states and transitions into the page.

    Example: python -m benchmarks.segment_figure
    """
    text = PAGE.read_text(encoding="utf-8")
    PAGE.write_text(with_table(text), encoding="utf-8")


def with_table(page: str) -> str:
    """The page with the table between its marks."""
    before, _, rest = page.partition(BEGIN)
    after = rest.partition(END)[2]
    return "\n".join([f"{before}{BEGIN}", "", *_lines(), "", f"{END}{after}"])


def _lines() -> Iterator[str]:
    """A diagram of the states with what is published on the way, the states, and all transitions."""
    yield from ("```mermaid", "stateDiagram-v2")
    yield "    [*] --> IDLE"
    for state, rows in TABLE.items():
        for target in dict.fromkeys(row.state for row in rows if row.state is not state):
            words = dict.fromkeys(PUBLISHED.get(row.effect, "") for row in rows if row.state is target)
            published = " or ".join(filter(None, words))
            yield f"    {state.name} --> {target.name}{f': {published}' if published else ''}"
    yield from ("```", "", "| state | meaning |", "|---|---|")
    yield from (f"| {state.name} | {state.value} |" for state in SegmentState)
    yield from ("", "| in | on | to | what follows | rule |", "|---|---|---|---|---|")
    for row in TRANSITIONS:
        states = ", ".join(state.name for state in row.states)
        event = row.event.name.lower().replace("_", " ")
        yield f"| {states} | *{event}*: {row.event.meaning} | {row.state.name} | {row.effect.meaning} | {row.rule} |"


if __name__ == "__main__":
    sys.exit(run_command(segment_figure, "segment_figure"))
