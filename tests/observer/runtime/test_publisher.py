"""What an observer says of facing and of the unlearned, and what it keeps to itself."""

import threading

import numpy as np
import pytest

from common.config import MeshConfig, read_scene
from common.link import Link
from common.messages import PosteriorMessage
from common.probability import decode_facing
from common.vocabulary import Vocabulary
from common.wire import decode
from observer.runtime.pipeline import Posterior
from observer.runtime.service import PosteriorPublisher, serve
from observer.tracks import Frame

SOON_S = 10.0
NAMES = Vocabulary(("bowing", "lunging"))
FACING = np.array([[0.7, 0.1, 0.1, 0.1], [0.25, 0.25, 0.25, 0.25]])


class Kept:
    def __init__(self):
        self.payloads = []

    def put(self, payload):
        self.payloads.append(payload)


def opinion(**given):
    return Posterior(np.array([0.75, 0.25]), 0.1, 3, {"head": True}, **given)


def said(opinion, **given):
    kept = Kept()
    PosteriorPublisher(NAMES, kept, **given).publish(opinion, 1, 2)
    return decode(PosteriorMessage, kept.payloads[0])


def test_facing_and_the_unlearned_go_into_the_message():
    message = said(opinion(facing=FACING, unlearned=0.125))
    assert message.unlearned == 0.125
    assert decode_facing(np.array(message.facing.surprise)) == pytest.approx(FACING, abs=0.03)


def test_who_knows_neither_leaves_them_out():
    message = said(opinion())
    assert message.unlearned is None and message.facing is None


def test_who_does_not_know_where_he_looks_keeps_the_facing_to_himself():
    message = said(opinion(facing=FACING, unlearned=0.125), directed=False)
    assert message.facing is None and message.unlearned == 0.125
    assert message.p == [0.75, 0.25]


class Sure:
    vocabulary, complaint = NAMES, ""

    def step(self, frame):
        return opinion(facing=FACING)


class Once:
    rate_hz, body_parts = 10.0, ("head",)

    def frames(self, stop):
        yield Frame(1, np.zeros((1, 3)))


@pytest.mark.parametrize(("direction", "told"), [("known", True), ("unknown", False)])
def test_the_scene_says_whether_the_direction_is_known(direction, told, tmp_path):
    text = 'scene = "dojo"\n[mesh]\nmode = "process"\nendpoint = "tcp/127.0.0.1:0"\n'
    text += f'[observers.cam1]\nsource = "m.npz"\ndirection = "{direction}"\n'
    (tmp_path / "s.toml").write_text(text)
    scene = read_scene(tmp_path / "s.toml", {})
    with Link.open(scene.mesh, "fusion") as fusion:
        heard = fusion.inbox(scene.keys.posterior())
        with Link.open(MeshConfig(mode="process", endpoint=fusion.locator), "observer") as link:
            assert link.publisher(scene.keys.posterior("cam1")).wait_for_subscriber(SOON_S)
            serve(scene, "cam1", Sure(), Once(), link, threading.Event())
        (arrival,) = heard.take(SOON_S)
    assert (decode(PosteriorMessage, arrival.payload).facing is not None) == told
