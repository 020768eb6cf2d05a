"""How much code a reader has to know: the files that run from a picture to the bytes of its posterior."""

import sys
import threading
from pathlib import Path

from performances import DOOR

import common
import observer
from common.config import read_scene
from common.load import LoadMeter
from common.vocabulary import Vocabulary
from observer.commands import pipeline_of
from observer.learning.learn import learn_view
from observer.motion.archive_file import read_archive
from observer.runtime.pacing import PacedObserver, TrackingPace
from observer.runtime.scene_inputs import open_inputs
from observer.runtime.service import PosteriorPublisher

MOST_FILES = 29
"""Of observer/ and common/ together, with camshift and the default model, which is in twelve of them: as many as there
are now. The goal is 25."""
ROOMS = tuple(f"{Path(room.__file__).parent}/" for room in (common, observer))
SECTION = 'source = "motion.npz"\ntracker = "camshift"\nspeed = 0\nface = [300, 96, 40, 40]\n'


class Wire:
    """Where posteriors go."""

    def __init__(self):
        self.sent = []

    def put(self, payload):
        self.sent.append(payload)


def test_few_files_run_from_a_picture_to_the_bytes_of_its_posterior(place):
    (place / "path.toml").write_text(f'scene = "path"\n[observers.cam1]\n{SECTION}')
    scene = read_scene(place / "path.toml", {})
    model = learn_view(read_archive(place / "motion.npz"), DOOR, Vocabulary(("lunging", "byebye")), calibrate=False)
    files, wire = set(), Wire()
    inputs = open_inputs(scene, "cam1", model.header.body_parts, environment={})
    watching = pipeline_of(scene, "cam1", inputs, model)
    paced = PacedObserver(watching, inputs.tracker, TrackingPace(), scene.fusion, LoadMeter("pictures", ""))
    publisher = PosteriorPublisher(watching.vocabulary, wire)
    for frame in inputs.source.frames(threading.Event()):
        before = sys.getprofile()
        sys.setprofile(lambda frame, *_: files.add(frame.f_code.co_filename))
        try:
            posterior = paced.step(frame)
            if posterior is not None:
                publisher.publish(posterior, frame.captured_ns, frame.captured_ns)
        finally:
            sys.setprofile(before)
    ours = sorted(file for file in files if file.startswith(ROOMS))
    assert wire.sent and len(ours) <= MOST_FILES, "\n".join(ours)
