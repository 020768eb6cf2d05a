"""Foreign tracks through real processes: lines on the standard input and on a Zenoh key."""

import json
import re
import sys
from pathlib import Path

import numpy as np
import pytest
from e2e_stage import MOVEMENTS, SOON_S, messages, started, write_scene
from processes import labanmesh

from common.messages import PosteriorMessage
from observer.geometry.projection import project
from observer.geometry.views import parse_view
from observer.tracks import BODY_PARTS
from studies.performer import perform

PAGE = Path(__file__).parents[2] / "docs" / "guide" / "cameras.md"
SIZE_PX, MIDDLE_PX = 180.0, (320.0, 260.0)


def lines_of(recording):
    """The lines of a foreign tracker for that recording, in pixels."""
    centres = project(parse_view("door").matrix, recording.positions) * SIZE_PX + MIDDLE_PX
    for n, row in enumerate(centres):
        places = [place.tolist() if np.isfinite(place).all() else None for place in row]
        parts = dict(zip(BODY_PARTS, places, strict=True))
        yield json.dumps({"captured_ns": 1_000_000_000 + round(n * 1e9 / recording.rate_hz), "parts": parts}) + "\n"


@pytest.mark.parametrize("source", ["-", "zenoh:tracks/cam1"])
def test_a_movement_tracked_by_another_program_is_recognised(stage, meeting, source):
    (recording,) = perform(people=("1",), movements=("byebye",), trials=1).recordings
    lines = list(lines_of(recording))
    inbox = meeting.inbox("laban/dojo/observer/cam1/posterior")
    presence = meeting.presence("laban/dojo/observer/*/alive")
    observers = {"cam1": f'source = "{source}"\nonset = "known"\nmodel = "door.model"\n'}
    file = write_scene(stage / "scene.toml", meeting.locator, observers)
    with started(stage, labanmesh("observe", file, "cam1")) as observer:
        assert presence.wait_for(1, SOON_S)
        if source == "-":
            observer.stdin.writelines(["junk\n", *lines])
            observer.stdin.close()
            assert observer.wait(SOON_S) == 0
            posteriors = messages(inbox, PosteriorMessage, len(lines))
        else:
            (bridge,) = re.findall(r"```python\n(.*?)```", PAGE.read_text(), re.DOTALL)
            (stage / "bridge.py").write_text(bridge)
            assert meeting.publisher("tracks/cam1").wait_for_subscriber(SOON_S)
            with started(stage, [sys.executable, "-P", "bridge.py", meeting.locator]) as passing:
                # Messages before discovery are lost: repeat the first line until the observer has received it.
                while not inbox.take(0.05):
                    passing.stdin.write(lines[0])
                    passing.stdin.flush()
                passing.stdin.writelines(lines[1:])
                passing.stdin.close()
                posteriors = messages(inbox, PosteriorMessage, len(lines) - 1)
    last = posteriors[-1]
    assert max(zip(last.p, MOVEMENTS, strict=True))[1] == "byebye" and all(last.visible.values())
