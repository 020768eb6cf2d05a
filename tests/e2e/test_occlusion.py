"""An occluder in front of one camera of three: real processes, rendered pictures, and the weights of fusion."""

import numpy as np
import pytest
from e2e_stage import PERFORMED, free_endpoint, labanmesh, played, started, write_scene

from common.config import MeshConfig
from common.link import Link
from common.messages import JudgementMessage, PosteriorMessage
from common.wire import decode
from observer.tracking.head import have_cascade
from studies.performer import perform_continuously


@pytest.mark.skipif(not have_cascade(), reason="this OpenCV has no face cascade")
def test_the_weight_of_an_occluded_camera_falls_at_once_and_recovers(stage):
    """The first observer sees pictures, with a box in front of its camera in the middle third of the movement."""
    recording, endpoint = perform_continuously("1", PERFORMED), free_endpoint()
    span = recording.spans[0]
    begin_s, end_s = ((span.start + share * (span.end - span.start)) / recording.rate_hz for share in (1 / 3, 2 / 3))
    observers = played()
    observers["door"] += 'tracker = "camshift"\nrate_hz = 30\n'
    observers["door.virtual"] = f"occluders = [[0, 0, 1, 1, {begin_s}, {end_s}]]\n"
    file = write_scene(stage / "scene.toml", endpoint, observers)
    judgements, posteriors = [], []
    with Link.open(MeshConfig(endpoint=endpoint), "hub") as hub:
        inbox = hub.inbox("laban/dojo/judgement", "laban/dojo/observer/door/posterior")
        with started(stage, labanmesh("up", file, "--exit-when-done")) as up:
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
