"""Long lines on a terminal, and text from strangers."""

import io

import pytest
from hypothesis import given
from hypothesis import strategies as st

from common.message_types import printable
from common.terminal import WordWrap, wrap_words

GREEN, PLAIN = "\x1b[32m", "\x1b[0m"


@pytest.mark.parametrize(
    ("line", "lines"),
    [
        ("all is well", ["all is well"]),
        ("the clock is not synchronised here", ["the clock is not", "synchronised here"]),
        ("  ok     one two three four", ["  ok     one two three", "         four"]),
        ("         -> one two three", ["         -> one two", "            three"]),
        ("  - one two three four five", ["  - one two three four", "    five"]),
        (f"{GREEN}one two three four five six{PLAIN}", [f"{GREEN}one two three four five", f"six{PLAIN}"]),
        ("  /a/word/that/is/longer/than/a/line ok", ["  /a/word/that/is/longer/than/a/line", "  ok"]),
        ('{"label": "wave", "agreement": 3}', ['{"label": "wave", "agreement": 3}']),
        ("\x1b[2K one two three four five six", ["\x1b[2K one two three four five six"]),
    ],
)
def test_a_long_line_breaks_between_words_below_its_text(line, lines):
    assert wrap_words(line, 24).splitlines() == lines


@given(st.text(st.sampled_from("ab  -\u00e9"), max_size=90), st.integers(20, 100))
def test_no_word_is_lost_and_no_line_too_wide(line, width):
    lines = wrap_words(line, width).split("\n")
    assert " ".join(lines).split() == line.split()
    assert all(len(each) <= width or len(each.split()) == 1 or each == line for each in lines)


def test_a_stream_waits_for_the_end_of_a_line(monkeypatch):
    monkeypatch.setenv("COLUMNS", "24")
    terminal = io.StringIO()
    stream = WordWrap(terminal)
    print("one two three", "four five six", file=stream)
    assert terminal.getvalue() == "one two three four five\nsix\n"
    print("continue?", end="", file=stream, flush=True)
    assert terminal.getvalue().endswith("\ncontinue?") and stream.encoding == terminal.encoding
    monkeypatch.setenv("COLUMNS", "")
    print(" a pipe is no terminal, and has no width", file=stream)
    assert terminal.getvalue().endswith("continue? a pipe is no terminal, and has no width\n")


@given(st.text())
def test_no_text_steers_a_terminal(text):
    assert printable(text).isprintable() and len(printable(text)) == len(text)
