"""An occluder in front of one camera of four: real processes, rendered pictures, and the weights of fusion."""

import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from common.config import MeshConfig
from common.link import Link
from common.messages import JudgementMessage, PosteriorMessage
from common.wire import decode
from observer.motion.archive import MotionArchive
from observer.motion.archive_file import write_archive
from observer.tracking.head import have_cascade
from studies.performer import perform, perform_continuously

ROOT = Path(__file__).parents[2]
MOVEMENTS = ("lunging", "byebye", "nthrow", "stretch")
VIEWS = {"door": "door", "right": "yaw:30", "left": "yaw:-30", "wheel": "yaw:60"}
SOON_S, TIMEOUT_S = 30.0, 60.0


def labanmesh(*words):
    return [sys.executable, "-P", "-m", "labanmesh", *map(str, words)]


@pytest.fixture
def stage(tmp_path):
    """A scene whose first observer sees pictures, with a box in front of its camera in the middle third."""
    learned = perform(people=("2", "3", "4"), movements=MOVEMENTS, trials=2)
    write_archive(tmp_path / "learned.npz", learned)
    seen = perform_continuously("1", ("byebye",))
    write_archive(tmp_path / "seen.npz", MotionArchive(learned.body_parts, (seen,)))
    span = seen.spans[0]
    hidden_s = tuple((span.start + share * (span.end - span.start)) / seen.rate_hz for share in (1 / 3, 2 / 3))
    with Link.open(MeshConfig(), "fusion", listen=["tcp/127.0.0.1:0"]) as free:
        endpoint = free.locator
    text = f'scene = "dojo"\n[mesh]\nendpoint = "{endpoint}"\n'
    for name, view in VIEWS.items():
        learn = labanmesh("learn", tmp_path / "learned.npz", "--view", view, "-o", tmp_path / f"{name}.model")
        subprocess.run(learn, cwd=ROOT, check=True, capture_output=True, timeout=TIMEOUT_S)
        text += f'[observers.{name}]\nsource = "seen.npz"\nview = "{view}"\n'
        if name == "door":
            text += 'tracker = "camshift"\nrate_hz = 30\n'
            text += f"[observers.door.virtual]\noccluders = [[0, 0, 1, 1, {hidden_s[0]}, {hidden_s[1]}]]\n"
    (tmp_path / "scene.toml").write_text(text)
    return tmp_path / "scene.toml", endpoint, hidden_s


@pytest.mark.skipif(not have_cascade(), reason="this OpenCV has no face cascade")
def test_the_weight_of_an_occluded_camera_falls_at_once_and_recovers(stage):
    file, endpoint, (begin_s, end_s) = stage
    judgements, posteriors = [], []
    with Link.open(MeshConfig(endpoint=endpoint), "hub") as hub:
        inbox = hub.inbox("laban/dojo/judgement", "laban/dojo/observer/door/posterior")
        with subprocess.Popen(labanmesh("up", file, "--exit-when-done"), cwd=ROOT, stderr=subprocess.DEVNULL) as up:
            while up.poll() is None:
                for arrival in inbox.take(0.1):
                    if arrival.key.endswith("judgement"):
                        judgements.append(decode(JudgementMessage, arrival.payload))
                    else:
                        posteriors.append(decode(PosteriorMessage, arrival.payload))
            assert up.returncode == 0
    began_ns = posteriors[0].captured_ns

    def weights(first_s, last_s):
        return [
            j.votes["door"].weight
            for j in judgements
            if first_s <= (j.at_ns - began_ns) / 1e9 < last_s and j.votes["door"].weight is not None
        ]

    hidden = [p for p in posteriors if begin_s + 0.1 < (p.captured_ns - began_ns) / 1e9 < end_s]
    assert hidden and not any(any(p.visible.values()) for p in hidden)
    before, after = np.mean(weights(begin_s - 0.2, begin_s)), np.mean(weights(begin_s + 0.3, end_s))
    assert weights(begin_s + 0.3, begin_s + 0.4)[0] < before and after < 0.8 * before
    states = [j.votes["door"].state for j in judgements if (j.at_ns - began_ns) / 1e9 > end_s + 0.5]
    assert states[0] == "counted"
