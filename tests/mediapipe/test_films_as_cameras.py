"""Four films that take the place of cameras, played slowly by real processes: they begin together, and none is late."""

import subprocess
import sys
from collections import Counter

import cv2
import pytest
from mediapipe_stage import pictures

from benchmarks.clips.learning import THE_FOUR, Learning, chosen_labels
from benchmarks.clips.material import recordings
from benchmarks.timing import free_port
from common.config import read_scene
from common.link import Link
from common.messages import JudgementMessage, PosteriorMessage, VerdictMessage
from common.wire import decode
from observer.model.model_file import write_model

pytest.importorskip("mediapipe")
pytestmark = pytest.mark.slow

CAMERAS = ("one", "two", "three", "four")
PICTURES, RATE_HZ, SPEED = 25, 10.0, 0.25


@pytest.fixture
def scene_file(data, pose_model, tmp_path):
    """A person who waves for 2.5 s, seen by four observers."""
    shown = [picture for _, picture in zip(range(PICTURES), pictures(data / "wave_webcam/wave.mp4"), strict=False)]
    size = shown[0].shape[1::-1]
    writer = cv2.VideoWriter(str(tmp_path / "wave.avi"), cv2.VideoWriter.fourcc(*"MJPG"), RATE_HZ, size)
    for picture in shown:
        writer.write(picture)
    writer.release()
    archive = recordings(data)
    write_model(
        tmp_path / "wave.model", Learning(archive, chosen_labels(archive, THE_FOUR), "stacked", {}).model("", "door")
    )
    model = f'pose_model = "{pose_model}"\n' if pose_model else ""
    section = f'source = "wave.avi"\nmodel = "wave.model"\ntracker = "mediapipe"\nspeed = {SPEED}\n{model}'
    text = f'scene = "films"\n[mesh]\nendpoint = "tcp/127.0.0.1:{free_port()}"\n'
    (tmp_path / "scene.toml").write_text(text + "".join(f"[observers.{name}]\n{section}" for name in CAMERAS))
    return tmp_path / "scene.toml"


def test_four_films_begin_together_and_have_a_verdict(scene_file):
    scene = read_scene(scene_file, {})
    begins, states, labels = {}, Counter(), []
    with Link.open(scene.mesh, "hub") as hub:
        inbox = hub.inbox(scene.keys.posterior(), scene.keys.judgement, scene.keys.verdict)
        words = [sys.executable, "-P", "-m", "labanmesh", "up", str(scene_file), "--exit-when-done"]
        up = subprocess.Popen(words, stderr=subprocess.DEVNULL)
        while up.poll() is None:
            for arrival in inbox.take(0.1):
                if arrival.key.endswith("posterior"):
                    begins.setdefault(arrival.key, decode(PosteriorMessage, arrival.payload).captured_ns)
                elif arrival.key.endswith("verdict"):
                    labels.append(decode(VerdictMessage, arrival.payload).label)
                elif len(begins) == len(CAMERAS):
                    votes = decode(JudgementMessage, arrival.payload).votes
                    states.update(vote.state for vote in votes.values())
    assert up.returncode == 0
    assert len(begins) == len(CAMERAS) and max(begins.values()) - min(begins.values()) < 0.5e9
    print(f"\nstates {dict(states)}, verdicts {labels}")
    assert not states["late"] and states["counted"] > 0
    assert labels and set(labels) == {"wave"}
