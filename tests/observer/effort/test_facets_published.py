"""Facets from tracks through the observer into the posterior message."""

import numpy as np

from common.facets import SHAPE
from common.messages import PosteriorMessage
from common.vocabulary import Vocabulary
from common.wire import decode
from observer.effort.reader import FacetReader
from observer.model.base import Example, Header
from observer.model.phase import Phase
from observer.runtime.pipeline import Observer
from observer.runtime.service import PosteriorPublisher
from observer.tracks import BODY_PARTS, Frame, Tracks

RATE = 30.0


class PassThrough:
    """A tracker whose frames are tracks."""

    body_parts = BODY_PARTS

    def update(self, frame):
        return Tracks(frame.content)


class Payloads:
    def __init__(self):
        self.payloads = []

    def put(self, payload):
        self.payloads.append(payload)


def rising(frames=30, way=1.0):
    tracks = np.tile(np.array([[-40.0, 100.0], [40.0, 100.0], [0.0, 0.0]]), (frames, 1, 1))
    tracks[:, :2, 1] -= 90 * way * np.linspace(0, 1, frames)[:, None]
    return tracks


def model():
    vocabulary = Vocabulary(("up", "down"))
    header = Header("phase", vocabulary, "door", np.eye(3, 4), RATE, BODY_PARTS)
    return Phase.learn(header, [Example([Tracks(t) for t in rising(way=w)], m) for m, w in enumerate((1.0, -0.5))])


def test_shape_is_published_with_the_posterior():
    learned, publisher = model(), Payloads()
    observer = Observer(PassThrough(), learned, facets=FacetReader(BODY_PARTS, RATE))
    posteriors = PosteriorPublisher(learned.header.vocabulary, publisher)
    for n, centres in enumerate(rising()):
        posteriors.publish(observer.step(Frame(n * 33_000_000, centres)), n, n)
    messages = [decode(PosteriorMessage, payload) for payload in publisher.payloads]
    assert messages[0].facets is None
    assert set(messages[-1].facets) == {"shape_horizontal", "shape_vertical"}
    assert SHAPE["shape_vertical"][int(np.argmax(messages[-1].facets["shape_vertical"]))] == "rising"


def test_an_observer_without_a_facet_reader_publishes_no_facets():
    learned, publisher = model(), Payloads()
    posteriors = PosteriorPublisher(learned.header.vocabulary, publisher)
    posteriors.publish(Observer(PassThrough(), learned).step(Frame(0, rising()[0])), 0, 0)
    assert decode(PosteriorMessage, publisher.payloads[0]).facets is None
