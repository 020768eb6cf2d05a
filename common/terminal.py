"""Long lines on a terminal: they are broken between words, below where their text begins."""

import os
import re
import sys
from collections.abc import Iterator
from typing import Any, TextIO, cast

SGR = re.compile(r"\x1b\[[0-9;]*m")
"""A colour or a style, which takes no cells."""
OTHER_CONTROL = re.compile(r"[\x00-\x08\x0b-\x1f]")
VERBATIM = re.compile(r'\s*(["{}\[\]#]|//)')
"""How lines of JSON and of configuration begin, which people copy."""
COLUMN = re.compile(r"(\s*)(\S+\s{2,}|-> |- )?")
"""The margin of a line, and the first word where it stands in a column of its own."""
NARROW = 20
"""Cells: a terminal with fewer is not known, or so narrow that no break helps."""


def wrap_words(line: str, width: int) -> str:
    """`line` with line breaks between words, so that none is wider than `width` cells, unless one word is.

    JSON, configuration, and what moves the cursor, stay as they are.
    """
    if _cells(line) <= width or width < NARROW or VERBATIM.match(line) or OTHER_CONTROL.search(SGR.sub("", line)):
        return line
    column = COLUMN.match(SGR.sub("", line))
    margin, text_begin = (len(column[1]), column.end()) if column else (0, 0)
    indent = " " * (text_begin if text_begin <= width // 2 else min(margin, width // 2))
    return "\n".join(_lines(line, width, indent))


def _lines(line: str, width: int, indent: str) -> Iterator[str]:
    current, gap = "", ""
    for piece in re.findall(r"\s+|\S+", line):
        if piece.isspace():
            gap = piece
        elif not current.strip() or _cells(current + gap + piece) <= width:
            current, gap = current + gap + piece, ""
        else:
            yield current
            current, gap = indent + piece, ""
    yield current


def _cells(text: str) -> int:
    return len(SGR.sub("", text))


class WordWrap:
    """A text stream of a terminal, with `wrap_words` for each line that is written to it."""

    def __init__(self, stream: TextIO) -> None:
        self._stream, self._line = stream, ""

    def write(self, text: str) -> int:
        """Write the complete lines of `text`; the rest waits for its end, or for `flush`."""
        *lines, self._line = (self._line + text).split("\n")
        if lines:
            width = terminal_width(self._stream)
            self._stream.write("".join(f"{wrap_words(line, width)}\n" for line in lines))
        return len(text)

    def flush(self) -> None:
        """Write the unfinished line too, as it is."""
        rest, self._line = self._line, ""
        self._stream.write(rest)
        self._stream.flush()

    def __getattr__(self, name: str) -> Any:  # noqa: ANN401 - all else is the stream's
        return getattr(self._stream, name)


def terminal_width(stream: TextIO) -> int:
    """Cells of a line: COLUMNS, or what the terminal says; 0 if it says nothing."""
    columns = os.environ.get("COLUMNS", "")
    if columns.isdecimal():
        return int(columns)
    try:
        return os.get_terminal_size(stream.fileno()).columns
    except (OSError, ValueError):
        return 0


def wrap_on_terminals() -> None:
    """Break lines to stdout and stderr between words from now on, where these are terminals."""
    if sys.stdout.isatty():
        sys.stdout = cast(TextIO, WordWrap(sys.stdout))
    if sys.stderr.isatty():
        sys.stderr = cast(TextIO, WordWrap(sys.stderr))
