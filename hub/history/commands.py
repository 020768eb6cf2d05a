"""The verb `labanmesh history`: what happened in a scene, as lines, CSV or JSON."""

import csv
import json
import sys
from collections.abc import Iterable
from datetime import datetime, timedelta
from pathlib import Path
from typing import Annotated

import typer

from common import SECOND_NS
from common.config import read_scene
from common.errors import BadInput
from common.text import nearest
from hub.history.history_file import HistoryFile, HistoryQuery
from hub.history.records import ROW_KINDS, HistoryRow, row_line

CSV_COLUMNS = (
    "kind", "began", "ended", "seconds", "label", "stage", "p", "agree", "of", "revises", "corrected", "repetitions",
    "score", "why", "id",
)  # fmt: skip
NO_HISTORY = 'keeps no history; in the scene file: [history] with file = "history.db", and labanmesh hub events SCENE'


def history(
    scene: Annotated[Path, typer.Argument(help="The scene file; its [history] names the file.")],
    day: Annotated[str, typer.Option(metavar="YYYY-MM-DD", help="Of this day; also `today`, `yesterday`.")] = "",
    since: Annotated[str, typer.Option("--from", metavar="TIME", help="From YYYY-MM-DD[THH:MM[:SS]] on.")] = "",
    until: Annotated[str, typer.Option("--to", metavar="TIME", help="Before YYYY-MM-DD[THH:MM[:SS]].")] = "",
    kind: Annotated[str, typer.Option(help="Only verdict, or only fall.")] = "",
    label: Annotated[str, typer.Option(help="Only this movement.")] = "",
    last: Annotated[int, typer.Option(min=1, max=100_000, help="So many at most, the newest.")] = 1000,
    as_csv: Annotated[bool, typer.Option("--csv", help="As a table with commas.")] = False,
    as_json: Annotated[bool, typer.Option("--json", help="Each as a line of JSON.")] = False,
) -> None:
    """List what happened in a scene, from the file on this machine: movements and falls, the oldest first; local time.

    Example: labanmesh history scene.toml --day today

    Example: labanmesh history scene.toml --from 2026-11-01 --label squat --csv > squats.csv
    """
    if kind and kind not in ROW_KINDS:
        raise BadInput(f"--kind {kind[:40]!r}: {' or '.join(ROW_KINDS)} is expected")
    config = read_scene(scene)
    if not config.history.file:
        raise BadInput(f"scene {config.scene}: {NO_HISTORY}")
    from_ns, until_ns = _span(day, since, until)
    with HistoryFile.to_read(config.place(config.history.file)) as file:
        rows = file.select(HistoryQuery(kind, label, from_ns, until_ns, last))
        if label and not rows and label not in (known := file.labels()):
            print(f"nothing of {label[:64]}: {nearest(label, known)}", file=sys.stderr)
        elif not rows and not (as_csv or as_json):
            print("nothing was kept that fits", file=sys.stderr)
    ordered = list(reversed(rows))
    if as_csv:
        writer = csv.DictWriter(sys.stdout, CSV_COLUMNS, extrasaction="ignore", lineterminator="\n")
        writer.writeheader()
        writer.writerows(row.as_json() for row in ordered)
    elif as_json:
        for row in ordered:
            print(json.dumps(row.as_json()))
    else:
        _print_lines(ordered)


def _print_lines(rows: Iterable[HistoryRow]) -> None:
    day = ""
    for row in rows:
        line_day, line = row_line(row)
        if line_day != day:
            day = line_day
            print(day)
        print(f"  {line}")


def _span(day: str, since: str, until: str) -> tuple[int | None, int | None]:
    if day:
        if since or until:
            raise BadInput("--day stands alone; --from and --to say the same more exactly")
        begin = _day(day)
        return _ns(begin), _ns(begin + timedelta(days=1))
    return _ns(_time(since, "--from")) if since else None, _ns(_time(until, "--to")) if until else None


def _day(text: str) -> datetime:
    today = datetime.now().astimezone().replace(hour=0, minute=0, second=0, microsecond=0, tzinfo=None)
    named = {"today": today, "yesterday": today - timedelta(days=1)}
    return named[text] if text in named else _time(text, "--day").replace(hour=0, minute=0, second=0)


def _time(text: str, option: str) -> datetime:
    try:
        return datetime.fromisoformat(text)
    except ValueError:
        raise BadInput(f"{option} {text[:40]!r}: YYYY-MM-DD, or YYYY-MM-DDTHH:MM, is expected") from None


def _ns(moment: datetime) -> int:
    try:
        return round(moment.timestamp()) * SECOND_NS
    except (ValueError, OverflowError):
        raise BadInput(f"{moment}: not a time that this machine knows") from None
