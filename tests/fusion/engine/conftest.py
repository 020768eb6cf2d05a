"""A fusion engine with scripted observers."""

import pytest

from common import SECOND_NS
from common.config_sections import FusionConfig
from common.messages import PosteriorMessage, VocabularyReference
from common.vocabulary import Vocabulary
from fusion.engine.engine import FusionEngine

VOCABULARY = Vocabulary(("bow", "lunge", "punch"), "karate")
VIEWS = ("door", "wheel", "table", "back")
STEP_NS = SECOND_NS // 10
CONFIG = FusionConfig(quorum=3, threshold=0.8, hold_s=0.3)


class EngineDriver:
    """Observers that publish to one engine in step, ten times a second."""

    def __init__(self, observers=VIEWS, **config):
        self.engine = FusionEngine("dojo", list(observers), VOCABULARY, CONFIG.model_copy(update=config))
        self.now_ns, self.seq, self.verdicts = 1_000 * SECOND_NS, 0, []

    def publish(self, observer, p, rest, **fields):
        """One posterior, captured and sent now."""
        message = {
            "scene": "dojo", "observer": observer, "seq": self.seq, "session": observer, "captured_ns": self.now_ns,
            "sent_ns": self.now_ns, "vocabulary": VocabularyReference(name="karate", hash=VOCABULARY.digest),
            "p": list(p), "rest": rest, "frames": self.seq, **fields,
        }  # fmt: skip
        return self.engine.receive(observer, PosteriorMessage(**message), self.now_ns)

    def step(self, posteriors, rest, times=1, **fields):
        """Each observer publishes its posterior; returns the last judgement."""
        for _ in range(times):
            self.tick()
            for observer, p in posteriors.items():
                assert self.publish(observer, p, rest, **fields) is None
            judgement = self.fuse()
        return judgement

    def tick(self):
        """A tenth of a second passes."""
        self.now_ns, self.seq = self.now_ns + STEP_NS, self.seq + 1

    def fuse(self):
        """One step of the engine, without new posteriors."""
        output = self.engine.step(self.now_ns)
        self.verdicts += output.verdicts
        return output.judgement


@pytest.fixture(scope="session")
def driver():
    """Makes an EngineDriver; keywords change its configuration."""
    return EngineDriver
