"""An occluder in front of one camera of three: real processes, rendered pictures, and the weights of fusion."""

import numpy as np
import pytest
from e2e_stage import PERFORMED, free_endpoint, played, started, write_scene
from processes import labanmesh

from common import SECOND_NS
from common.config import MeshConfig
from common.link import Link
from common.messages import JudgementMessage, PosteriorMessage
from common.wire import decode
from observer.motion.archive import MotionArchive
from observer.motion.archive_file import write_archive
from observer.tracking.head import have_cascade
from observer.tracks import BODY_PARTS
from studies.performer import perform_continuously


@pytest.mark.skipif(not have_cascade(), reason="this OpenCV has no face cascade")
def test_the_weight_of_an_occluded_camera_falls_at_once_and_recovers(stage):
    """The first observer sees pictures, with a box in front of its camera in the middle third of the movement."""
    recording, endpoint = perform_continuously("1", PERFORMED[:1]), free_endpoint()
    write_archive(stage / "one.npz", MotionArchive(BODY_PARTS, (recording,)))
    span = recording.spans[0]
    begin_s, end_s = ((span.start + share * (span.end - span.start)) / recording.rate_hz for share in (1 / 3, 2 / 3))
    observers = played(motion="one.npz")
    observers["door"] += 'tracker = "camshift"\nrate_hz = 30\n'
    observers["door.virtual"] = f"occluders = [[0, 0, 1, 1, {begin_s}, {end_s}]]\n"
    # On a busy machine pictures are judged late: their age must not count, only what they show.
    file = write_scene(stage / "scene.toml", endpoint, observers, "[fusion]\nfresh_s = 1.5\n")
    # It is played in real time, which a busy machine may not keep once.
    for _ in range(3):
        before, behind, back = weighed(*played_once(stage, file, endpoint), begin_s, end_s)
        if behind and behind[0] < before and np.mean(behind) < 0.8 * before and back == "counted":
            return
    raise AssertionError(f"{before:.3f} before, {behind} behind the box, then {back}")


def played_once(stage, file, endpoint):
    """The judgements, and the posteriors of the observer whose camera is occluded."""
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
    return judgements, posteriors


def weighed(judgements, posteriors, begin_s, end_s):
    """Its mean weight before the occlusion, its weights behind it, and its state half a second after."""
    began_ns = posteriors[0].captured_ns

    def votes(first_s, last_s=np.inf):
        """The votes on what the camera saw in that time."""
        voted = [(j.at_ns - began_ns, j.votes["door"]) for j in judgements if j.votes["door"].age_s is not None]
        return [vote for at_ns, vote in voted if first_s <= at_ns / SECOND_NS - vote.age_s < last_s]

    hidden = [p for p in posteriors if begin_s + 0.1 < (p.captured_ns - began_ns) / SECOND_NS < end_s]
    assert not any(any(p.visible.values()) for p in hidden)
    before = np.mean([vote.weight for vote in votes(begin_s - 0.4, begin_s)] or [0.0])
    after = [vote.state for vote in votes(end_s + 0.5)] or ["not judged"]
    return before, [vote.weight for vote in votes(begin_s + 0.3, end_s)], after[0]
