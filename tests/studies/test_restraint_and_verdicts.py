"""What an observer on a slow line holds back costs no verdict: the same people judged with and without."""

from dataclasses import dataclass

import numpy as np

from common.config_sections import FusionConfig
from fusion.engine.engine import FusionEngine
from observer.geometry.views import parse_view
from observer.motion.transforms import labels_of
from observer.runtime.posterior_encoder import SendOnChange
from studies.evaluate import EvaluationSettings
from studies.performer import perform
from studies.stream import observed_streams

CONDUCT = FusionConfig(quorum=1)
STEP_NS = 1e9 / CONDUCT.step_hz


@dataclass
class Said:
    """A message as the opinion that it came from."""

    p: np.ndarray
    rest: float
    unlearned: float | None
    visible: dict
    facing: None = None
    facets: tuple = ()

    @classmethod
    def by(cls, message):
        return cls(np.array(message.p), message.rest, message.unlearned, message.visible, facets={})


def judged(heard, restraints):
    """Verdicts by their id, first and last word of each; how many posteriors it took; how judges were heard."""
    referee, verdicts, said, states = (
        FusionEngine("stream", list(heard.messages[0]), heard.vocabulary, CONDUCT),
        {},
        0,
        set(),
    )
    for messages in heard.messages:
        for name, message in messages.items():
            if restraints is None or restraints[name].should_send(Said.by(message), message.captured_ns):
                referee.receive(name, message, message.captured_ns)
                said += 1
        ruling = referee.step(message.captured_ns)
        states |= {vote.state for vote in ruling.judgement.votes.values()}
        for verdict in ruling.verdicts:
            verdicts.setdefault(verdict.id, []).append(verdict)
    return list(verdicts.values()), said, states


def test_verdicts_are_the_same_and_begin_and_end_within_a_step_with_a_fifth_less_said():
    archive, views = perform(), (parse_view("door"), parse_view("wheel"))
    people = sorted({r.subject for r in archive.recordings})
    question = EvaluationSettings(
        views,
        labels_of(archive)[:5],
        train_subjects=tuple(people[1:]),
        test_subjects=(people[0],),
        onset_known=False,
        calibrated=False,
    )
    for heard in observed_streams(archive, question):
        whole, all_said, _ = judged(heard, None)
        held, said, states = judged(heard, {name: SendOnChange(CONDUCT.fresh_s / 2) for name in heard.messages[0]})
        assert said < 0.8 * all_said and states == {"counted"}
        assert len(held) == len(whole) >= 5
        for one, other in zip(whole, held, strict=True):
            assert [v.label for v in one] == [v.label for v in other]
            for v, w in zip(one, other, strict=True):
                assert abs(v.began_ns - w.began_ns) <= STEP_NS and abs(v.decided_ns - w.decided_ns) <= STEP_NS
                assert v.ended_ns is w.ended_ns is None or abs(v.ended_ns - w.ended_ns) <= STEP_NS
