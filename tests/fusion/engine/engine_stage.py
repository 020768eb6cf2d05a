"""What tests of the engine share: messages, aged posteriors, and an engine with scripted observers."""

import numpy as np
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from common import SECOND_NS
from common.config_sections import FusionConfig
from common.messages import PosteriorMessage, VocabularyHash
from common.probability import normalise
from common.vocabulary import Vocabulary
from fusion.engine.engine import FusionEngine
from fusion.engine.roster import AgedPosterior
from fusion.engine.rules import RULES

LABELS = ("bow", "lunge", "punch")
VOCABULARY = Vocabulary(LABELS, "karate")
VIEWS = ("door", "wheel", "table", "back")
UNIFORM = (1 / 3, 1 / 3, 1 / 3)
STEP_NS = SECOND_NS // 10
CONFIG = FusionConfig(quorum=3, threshold=0.8, hold_s=0.3)
MOVING, REST = 0.05, 0.95
"""The probability that the person is at rest."""
ALL_RULES = sorted(RULES)


def message(captured_ns, vocabulary=VOCABULARY, **fields):
    """A posterior over VOCABULARY, sent when it was captured."""
    fields = {
        "v": 1, "scene": "dojo", "observer": "cam1", "seq": 0, "session": "a", "sent_ns": captured_ns,
        "p": [0.7, 0.2, 0.1], "frames": 1, "vocabulary": VocabularyHash(name="karate", hash=vocabulary.digest),
        **fields,
    }  # fmt: skip
    return PosteriorMessage(**{**fields, "captured_ns": captured_ns, "p": list(fields["p"])})


def aged(observer, p, state="counted", **fields):
    """A posterior as the roster gives it to pooling."""
    return AgedPosterior(observer, np.array(p), 0.1, 0.0, state, **fields)


def sure(label, p=0.9):
    """The posterior of an observer that is as sure of a label."""
    return tuple(p if name == label else (1 - p) / 2 for name in LABELS)


def all_views(p, *but):
    """The same posterior for each of VIEWS except these."""
    return {name: p for name in VIEWS if name not in but}


class EngineDriver:
    """Observers that publish to one engine in step, ten times a second."""

    def __init__(self, observers=VIEWS, **config):
        self.engine = FusionEngine("dojo", list(observers), VOCABULARY, CONFIG.model_copy(update=config))
        self.now_ns, self.seq, self.verdicts = 1_000 * SECOND_NS, 0, []

    @property
    def labels(self):
        """The labels of all verdicts."""
        return [verdict.label for verdict in self.verdicts]

    def publish(self, observer, p, rest, captured_ns=None, **fields):
        """One posterior, captured and sent now."""
        fields = {"seq": self.seq, "session": observer, "sent_ns": self.now_ns, "p": p, "rest": rest, **fields}
        posterior = message(self.now_ns if captured_ns is None else captured_ns, observer=observer, **fields)
        return self.engine.receive(observer, posterior, self.now_ns)

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


def posteriors(observers, least=0.0):
    """Any posteriors (observers, M) of two to five movements; least: the smallest mass before they are normalised."""
    masses = st.integers(2, 5).flatmap(lambda m: arrays(np.float64, (observers, m), elements=st.floats(least, 1)))
    return masses.map(lambda a: normalise(a + (a.sum(1, keepdims=True) == 0)))
