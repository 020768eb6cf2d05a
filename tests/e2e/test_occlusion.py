"""An occluder in front of one camera of three, from rendered pictures to the weights of fusion; by the film's time."""

import heapq
import threading
from dataclasses import replace

import numpy as np
import pytest
from e2e_stage import PERFORMED, played, write_scene

from common import SECOND_NS
from common.config import read_scene
from observer.model.model_file import read_model
from observer.motion.archive import MotionArchive
from observer.motion.archive_file import write_archive
from observer.prepared_tracks import Resampler
from observer.runtime.pipeline import Observer, PosteriorEncoder
from observer.runtime.scene_inputs import open_inputs
from observer.tracking.head import have_cascade
from observer.tracks import BODY_PARTS
from studies.fusion_engine import FusionEngine, step
from studies.performer import perform_continuously

START_NS = 1_700_000_000 * SECOND_NS


@pytest.mark.skipif(not have_cascade(), reason="this OpenCV has no face cascade")
def test_the_weight_of_an_occluded_camera_falls_at_once_and_recovers(stage):
    """The first observer sees pictures, with a box in front of its camera in the middle third of the movement."""
    recording = perform_continuously("1", PERFORMED[:1])
    write_archive(stage / "one.npz", MotionArchive(BODY_PARTS, (recording,)))
    span = recording.spans[0]
    begin_s, end_s = ((span.start + share * (span.end - span.start)) / recording.rate_hz for share in (1 / 3, 2 / 3))
    observers = played(motion="one.npz", more="speed = 0\n")
    observers["door"] += 'tracker = "camshift"\nrate_hz = 30\n'
    scene = read_scene(write_scene(stage / "scene.toml", "tcp/127.0.0.1:0", observers), {})
    votes, seen = votes_of("door", scene, begin_s, end_s)

    def between(first_s, last_s=np.inf):
        """The votes on what the camera saw in that time."""
        return [vote for at_s, vote in votes if first_s <= at_s - vote.age_s < last_s]

    assert seen and not [at_s for at_s in seen if begin_s + 0.1 < at_s < end_s]
    before = np.mean([vote.weight for vote in between(begin_s - 0.4, begin_s)])
    behind = [vote.weight for vote in between(begin_s + 0.3, end_s)]
    assert behind[0] < before and np.mean(behind) < 0.8 * before, f"{before:.3f} before, {behind} behind the box"
    assert between(end_s + 0.5)[0].state == "counted"


def timed(observer, inputs):
    """(ns, observer, frame) of each frame of its film."""
    for frame in inputs.source.frames(threading.Event()):
        yield frame.at_ns, observer, frame


def votes_of(name, scene, begin_s, end_s):
    """(seconds, vote) of that observer in each judgement, and the seconds in which it saw a part of the body. From
    begin_s to end_s its pictures show a box."""
    watching = {}
    for observer in scene.roster:
        model = read_model(scene.model_file(observer))
        inputs = open_inputs(scene, observer, model.header.body_parts)
        encoder = PosteriorEncoder(model.header.vocabulary, observer)
        watching[observer] = Observer(inputs.tracker, model, None, Resampler(model.header.rate_hz)), inputs, encoder
    frames = heapq.merge(*(timed(each, inputs) for each, (_, inputs, _) in watching.items()), key=lambda each: each[:2])
    vocabulary = next(iter(watching.values()))[0].vocabulary
    engine = FusionEngine(scene.scene, list(scene.roster), vocabulary, scene.fusion)
    votes, seen = [], []
    for at_ns, observer, frame in frames:
        watcher, _, encoder = watching[observer]
        if observer == name and begin_s <= at_ns / SECOND_NS < end_s:
            frame = replace(frame, content=np.full_like(frame.content, 70))
        posterior, now_ns = watcher.step(frame), START_NS + at_ns
        output = step(engine, {observer: encoder.encode(posterior, now_ns, now_ns)}, now_ns)
        vote = output.judgement.votes[name]
        if vote.age_s is not None:
            votes.append((at_ns / SECOND_NS, vote))
        if observer == name and any(posterior.visible.values()):
            seen.append(at_ns / SECOND_NS)
    return votes, seen
