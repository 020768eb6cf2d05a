"""Foreign tracks through real processes: lines on the standard input and on a Zenoh key."""

import json
import re
import subprocess
import sys
import threading
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import pytest

from common.config import MeshConfig
from common.link import Link
from common.messages import PosteriorMessage
from common.wire import decode
from observer.geometry.projection import project
from observer.geometry.views import parse_view
from observer.motion.archive_file import write_archive
from observer.tracks import BODY_PARTS
from studies.performer import perform

ROOT = Path(__file__).parents[2]
MOVEMENTS = ("lunging", "byebye", "nthrow", "stretch")
SOON_S = 30.0
SIZE_PX, MIDDLE_PX = 180.0, (320.0, 260.0)


def lines_of(recording):
    """The lines of a foreign tracker for that recording, in pixels."""
    centres = project(parse_view("door").matrix, recording.positions) * SIZE_PX + MIDDLE_PX
    for n, row in enumerate(centres):
        places = [place.tolist() if np.isfinite(place).all() else None for place in row]
        parts = dict(zip(BODY_PARTS, places, strict=True))
        yield json.dumps({"captured_ns": 1_000_000_000 + round(n * 1e9 / recording.rate_hz), "parts": parts}) + "\n"


@pytest.fixture(scope="module")
def stage(tmp_path_factory):
    folder = tmp_path_factory.mktemp("tracks")
    write_archive(folder / "learned.npz", perform(people=("2", "3", "4"), movements=MOVEMENTS, trials=2))
    learn = ["learn", folder / "learned.npz", "--view", "door", "-o", folder / "cam1.model"]
    subprocess.run(
        [sys.executable, "-P", "-m", "labanmesh", *learn], cwd=ROOT, check=True, capture_output=True, timeout=60
    )
    return folder


@contextmanager
def started(*words):
    process = subprocess.Popen(
        [sys.executable, *map(str, words)], cwd=ROOT, stdin=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    )
    watchdog = threading.Timer(SOON_S, process.kill)
    watchdog.start()
    try:
        yield process
    finally:
        watchdog.cancel()
        process.kill()
        process.wait(SOON_S)
        for pipe in (process.stdin, process.stderr):
            pipe.close()


def scene_file(stage, endpoint, source):
    (stage / "scene.toml").write_text(
        f'scene = "dojo"\n[mesh]\nendpoint = "{endpoint}"\n'
        f'[observers.cam1]\nsource = "{source}"\nonset = "known"\nmodel = "cam1.model"\n'
    )
    return stage / "scene.toml"


def posteriors(inbox, count):
    messages = []
    while len(messages) < count:
        arrived = inbox.take(SOON_S)
        assert arrived, f"only {len(messages)} of {count} posteriors came"
        messages += [decode(PosteriorMessage, a.payload) for a in arrived]
    return messages


@pytest.mark.parametrize("source", ["-", "zenoh:tracks/cam1"])
def test_a_movement_tracked_by_another_program_is_recognised(stage, source):
    (recording,) = perform(people=("1",), movements=("byebye",), trials=1).recordings
    lines = list(lines_of(recording))
    with Link.open(MeshConfig(), "fusion", listen=["tcp/127.0.0.1:0"]) as meeting:
        inbox = meeting.inbox("laban/dojo/observer/cam1/posterior")
        presence = meeting.presence("laban/dojo/observer/*/alive")
        file = scene_file(stage, meeting.locator, source)
        with started("-P", "-m", "labanmesh", "observe", file, "cam1") as observer:
            assert presence.wait_for(1, SOON_S)
            if source == "-":
                observer.stdin.writelines(["junk\n", *lines])
                observer.stdin.close()
                assert observer.wait(SOON_S) == 0
                messages = posteriors(inbox, len(lines))
            else:
                (bridge,) = re.findall(
                    r"```python\n(.*?)```", (ROOT / "docs/reference/tracks.md").read_text(), re.DOTALL
                )
                (stage / "bridge.py").write_text(bridge)
                assert meeting.publisher("tracks/cam1").wait_for_subscriber(SOON_S)
                with started(stage / "bridge.py", meeting.locator) as passing:
                    # Messages before discovery are lost: repeat the first line until the observer has received it.
                    while not inbox.take(0.05):
                        passing.stdin.write(lines[0])
                        passing.stdin.flush()
                    passing.stdin.writelines(lines[1:])
                    passing.stdin.close()
                    messages = posteriors(inbox, len(lines) - 1)
    assert max(zip(messages[-1].p, MOVEMENTS, strict=True))[1] == "byebye"
    assert all(messages[-1].visible.values())
