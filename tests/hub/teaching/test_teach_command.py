"""`labanmesh teach` before the lesson: who runs, who has pictures, what can be taught; one line says what to do."""

import math
import threading
from pathlib import Path
from types import SimpleNamespace

import pytest

from common.errors import BadInput, LabanmeshError
from common.inbox import Presence
from common.teaching_messages import TeachReply
from hub.teaching import commands, teaching_client, terminal_lesson
from hub.teaching.commands import TeachOptions
from hub.teaching.interface import Answers

FILE = Path("scene.toml")


@pytest.fixture(autouse=True)
def no_waiting(monkeypatch):
    monkeypatch.setattr(terminal_lesson, "PICTURES_S", 0.0)
    monkeypatch.setattr(terminal_lesson, "CAMERAS_S", 0.0)


def client(**pictures):
    """Answers for these observers, which have pictures or not."""
    replies = {name: TeachReply(state="idle", pictures=has) for name, has in pictures.items()}
    return SimpleNamespace(ask=lambda request, observers: Answers(replies))


def test_where_nobody_runs_one_line_says_so(scene, capsys):
    with pytest.raises(LabanmeshError, match=r"no observer of room runs; start them: labanmesh up scene\.toml"):
        terminal_lesson.present_observers(scene, FILE, Presence())
    assert capsys.readouterr().out == "", "nobody is taught without them"


def test_the_search_for_observers_ends_with_ctrl_c(scene, fake_link, monkeypatch):
    monkeypatch.setattr(teaching_client, "FIND_S", math.inf)
    stop = threading.Event()
    stop.set()
    with pytest.raises(KeyboardInterrupt):
        teaching_client.find_observers(scene, fake_link(), stop)


def test_a_lesson_does_not_wait_for_cameras_that_are_all_unplugged(capsys):
    interface = SimpleNamespace(now_s=lambda: 0.0, say=print)
    assert terminal_lesson.teachable_observers(
        client(sofa=True, shelf=False), "t", ["sofa", "shelf"], interface, FILE
    ) == ["sofa", "shelf"]
    with pytest.raises(LabanmeshError, match=r"no pictures from sofa, shelf: .* labanmesh doctor scene\.toml says why"):
        terminal_lesson.teachable_observers(client(sofa=False, shelf=False), "t", ["sofa", "shelf"], interface, FILE)


def test_a_single_movement_is_refused_with_the_way_out(scene):
    with pytest.raises(BadInput, match=r"wave: one movement alone .* name at least two, or add it with --add"):
        commands._require_teachable(scene, TeachOptions(FILE, ["wave"]), ["wave"])
    commands._require_teachable(scene, TeachOptions(FILE, ["wave"], add=True), ["wave"])
