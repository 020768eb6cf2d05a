"""Live pictures and clips of a real observer loop between real Zenoh peers."""

import time

import cv2
import numpy as np
import pytest
from mesh_stage import LOOPBACK, FakePipeline, believed
from processes import SOON_S

from common.config import read_scene
from common.picture_message import PictureMessage
from common.wire import decode
from observer.preview.shown_pictures import shown_pictures
from observer.runtime.service import serve
from observer.tracks import BODY_PARTS, Frame, Tracks

PICTURE = np.random.default_rng(0).integers(0, 256, (480, 640, 3), np.uint8)


class FakeTracker:
    """What a prepared tracker leaves behind."""

    body_parts = BODY_PARTS

    def __init__(self):
        self.tracker, self.all_tracks = self, Tracks(np.array([[400.0, 300.0], [200.0, 300.0], [320.0, 90.0]]))


class Camera:
    """50 pictures a second."""

    rate_hz, body_parts = 50.0, ()

    def frames(self, stop):
        while not stop.wait(0.02):
            yield Frame(time.time_ns(), PICTURE)


@pytest.fixture
def scene(tmp_path):
    section = '[observers.cam1]\nsource = "0"\npicture_hz = 5\n[observers.cam1.clips]\nfolder = "clips"\n'
    (tmp_path / "s.toml").write_text(f'scene = "dojo"\n{LOOPBACK}{section}')
    return read_scene(tmp_path / "s.toml", {})


def test_pictures_are_sent_only_to_those_who_ask_by_name(scene, mesh):
    pipeline, link = FakePipeline(lambda frame: believed((0.5, 0.5), 0.5)), mesh.peer("observer")
    with shown_pictures(scene, "cam1", pipeline, FakeTracker(), link) as pictured:
        # What `capture`, hubs and whoever listens to everything subscribe to.
        whole = mesh.meeting.inbox(f"{scene.keys.root}/**", "**", "laban/dojo/observer/*/*")
        mesh.run(serve, scene, "cam1", pictured, Camera(), link)
        posteriors = mesh.meeting.inbox(scene.keys.posterior())
        assert posteriors.take(SOON_S)
        inbox = mesh.peer().inbox(scene.keys.picture("cam1"))
        arrivals, began_s = [], time.monotonic()
        while len(arrivals) < 4:
            arrivals += inbox.take(SOON_S)
        took_s = time.monotonic() - began_s
        assert {arrival.key for arrival in arrivals} == {"laban/dojo/observer/cam1/@picture"}
        assert all("picture" not in arrival.key for arrival in whole.take(0.0))
    assert took_s > 0.5, "5 Hz at most"
    assert sum(len(arrival.payload) for arrival in arrivals[:5]) < 50_000, "noise, the largest picture there is"
    message = decode(PictureMessage, arrivals[-1].payload)
    assert cv2.imdecode(np.frombuffer(message.jpeg, np.uint8), cv2.IMREAD_COLOR).shape[:2] == (
        message.height, message.width,
    )  # fmt: skip


def test_without_a_word_in_the_scene_file_the_observer_is_left_as_it_is(scene, mesh):
    plain = scene.model_copy(update={"observers": {"cam1": type(scene.observer("cam1"))(source="0")}})
    pipeline = FakePipeline()
    with shown_pictures(plain, "cam1", pipeline, FakeTracker(), mesh.peer("observer")) as pictured:
        assert pictured is pipeline
