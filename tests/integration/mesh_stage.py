"""What tests with real Zenoh peers share beside labanmesh_testing: messages, observers without a camera, waiting."""

import time

import numpy as np
import zenoh
from processes import SOON_S

from common.messages import PosteriorMessage, VocabularyReference
from common.vocabulary import Vocabulary
from common.wire import decode, encode
from observer.runtime.pipeline import Posterior

NAMES = Vocabulary(("bowing", "lunging"), "karate")
NAMED = 'vocabulary = ["bowing", "lunging"]\nvocabulary_name = "karate"\n'
REFERENCE = VocabularyReference(name=NAMES.name, hash=NAMES.digest)
LOOPBACK = '[mesh]\nmode = "process"\nendpoint = "tcp/127.0.0.1:0"\n'


def believed(p=(0.5, 0.5), rest=0.5, visible=None):
    """What a pipeline returns after a frame."""
    return Posterior(np.array(p, dtype=float), rest, 1, {} if visible is None else visible)


class FakePipeline:
    """Returns `answer(frame)` after each frame; by default what the frame holds."""

    vocabulary, complaint, leans_on = NAMES, "", None

    def __init__(self, answer=lambda frame: frame.content, at_end=None):
        self.step, self.end = answer, lambda: at_end


def lay_out(folder, pair, authority):
    """A folder of credentials: a certificate, its key, and the authority's certificate."""
    folder.mkdir(exist_ok=True)
    for name, content in (("ca.pem", authority), ("certificate.pem", pair.certificate), ("key.pem", pair.key)):
        (folder / name).write_bytes(content)
        (folder / name).chmod(0o600)
    return str(folder)


def posterior(observer="cam1", seq=0, scene="dojo", **fields):
    """A posterior of a movement in progress as bytes."""
    now_ns = time.time_ns()
    values = {
        "v": 1, "scene": scene, "observer": observer, "seq": seq, "session": "s", "captured_ns": now_ns,
        "sent_ns": now_ns, "vocabulary": REFERENCE, "p": [0.98, 0.02], "rest": 0.05, "frames": 1,
    }  # fmt: skip
    return encode(PosteriorMessage(**{**values, **fields}))


def deliver(link, key, payload):
    """Publish once, and wait while Zenoh's queues are full: on a busy machine a publisher of ours drops what is due."""
    link._session.put(key, payload, congestion_control=zenoh.CongestionControl.BLOCK)


def collect(inbox, kind, enough=bool):
    """Messages of `kind` until `enough(messages)` holds."""
    messages, end_s = [], time.monotonic() + SOON_S
    while not enough(messages):
        assert time.monotonic() < end_s, f"not among {len(messages)} messages: {messages[-3:]}"
        messages += [decode(kind, arrival.payload) for arrival in inbox.take(0.1)]
    return messages


def up_to(inbox, kind, fits=lambda message: True):
    """The messages of `kind` up to and including the first that `fits`."""
    messages, end_s = [], time.monotonic() + SOON_S
    while time.monotonic() < end_s:
        for arrival in inbox.take(0.1):
            messages.append(decode(kind, arrival.payload))
            if fits(messages[-1]):
                return messages
    raise AssertionError(f"no such {kind.__name__} among {len(messages)}: {messages[-1:]}")


def first(inbox, kind, fits=lambda message: True):
    """The first message of `kind` that `fits`."""
    return up_to(inbox, kind, fits)[-1]
