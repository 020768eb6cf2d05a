"""`labanmesh watch` on a terminal that changes its size, and one that is too small for everybody."""

import io
import re

import pytest
from rich.console import Console

from hub.scene_state import SceneState
from hub.session import SceneUpdate
from hub.terminal import render
from hub.watch import BEGIN_FRAME, END_FRAME, show_live

SIZES = ((80, 24), (120, 40), (50, 12), (200, 60), (30, 8), (80, 24))


def crowd(said, count):
    votes = {f"cam{i:03}": said.vote("ok" if i % 50 == 49 else "nthrow", weight=1 / count) for i in range(count)}
    state = SceneState("room", tuple(votes)).fold(said.vocabulary(), said.NOON)
    return state.fold(said.judgement(votes=votes), said.NOON).fold(said.verdict(1), said.NOON).at(said.NOON)


def lines_of(state, width, height):
    console = Console(file=io.StringIO(), force_terminal=True, width=width, height=height, color_system=None)
    console.print(render(state, width, height))
    return console.file.getvalue().splitlines()


def test_every_picture_has_the_size_of_its_moment_and_appears_as_a_whole(said):
    console = Console(file=io.StringIO(), force_terminal=True, legacy_windows=False, color_system=None)
    state = crowd(said, 4)

    def resized():
        for step, size in enumerate(SIZES):
            console.size = size
            yield SceneUpdate(state.at(said.NOON + step * said.SECOND))

    show_live(resized(), console)
    written = console.file.getvalue()
    frames = re.findall(re.escape(BEGIN_FRAME) + "(.*?)" + re.escape(END_FRAME), written, re.DOTALL)
    assert len(frames) == len(SIZES) and "cam0" not in re.sub(r"(?s)\x1b\[\?2026h.*?\x1b\[\?2026l", "", written)
    for (width, height), frame in zip(SIZES, frames, strict=True):
        lines = re.sub(r"\x1b\[[\d;?]*[A-Za-z]", "", frame).split("\n")
        assert "\x1b[2J" not in frame, "a cleared screen flickers"
        assert len(lines) == height and {len(line) for line in lines} == {width}, (width, height)


@pytest.mark.parametrize(("count", "width", "height"), [(200, 100, 30), (4, 60, 20), (9, 80, 24), (200, 40, 12)])
def test_the_referee_is_seen_however_many_judges_there_are(said, count, width, height):
    lines = lines_of(crowd(said, count), width, height)
    text = "\n".join(lines)
    assert len(lines) <= height and max(map(len, lines)) <= width
    assert ("fusion" in text and "N T H R O W" in text and "cam049" in text) or count < 50


def test_who_does_not_agree_comes_first_where_not_all_fit(said):
    text = "\n".join(lines_of(crowd(said, 200), 100, 30))
    assert all(f"cam{i:03}  differs" in text for i in (49, 99, 149, 199))
    assert re.search(r"and \d+ more, all of them agree", text)


def test_none_is_left_out_where_all_fit(said):
    text = "\n".join(lines_of(crowd(said, 9), 80, 24))
    assert all(f"cam{i:03}" in text for i in range(9)) and "more" not in text
