"""Sending on change costs no verdict: the same people judged with and without it."""

import numpy as np

from common.config_sections import FusionConfig
from observer.geometry.views import parse_view
from observer.motion.archive import labels_of
from observer.runtime.pipeline import Posterior
from observer.runtime.send_on_change import SendOnChange
from studies.fusion_engine import FusionEngine, step
from studies.observing import observe_folds
from studies.performer import perform
from studies.settings import EvaluationSettings
from studies.stream import observed_stream

CONFIG = FusionConfig(quorum=1)
STEP_NS = 1e9 / CONFIG.step_hz


def judged(stream, filters):
    """The messages of each verdict; how many posteriors were sent; the states of all votes."""
    engine = FusionEngine("stream", list(stream.messages[0]), stream.vocabulary, CONFIG)
    verdicts, count, states = {}, 0, set()
    for messages in stream.messages:
        sent = {
            name: m
            for name, m in messages.items()
            if filters is None
            or filters[name].should_send(
                Posterior(np.array(m.p), m.rest, m.frames, m.visible, unlearned=m.unlearned), m.captured_ns
            )
        }
        count += len(sent)
        output = step(engine, sent, max(m.captured_ns for m in messages.values()))
        states |= {vote.state for vote in output.judgement.votes.values()}
        for verdict in output.verdicts:
            verdicts.setdefault(verdict.id, []).append(verdict)
    return list(verdicts.values()), count, states


def test_verdicts_are_the_same_within_a_step_with_less_sent():
    archive, views = perform(trials=1), (parse_view("door"), parse_view("wheel"))
    first, *others = sorted({r.subject for r in archive.recordings})
    people = {"train_subjects": tuple(others), "test_subjects": (first,)}
    settings = EvaluationSettings(views, labels_of(archive)[:6], **people, onset_known=False, calibrated=False)
    (fold,) = observe_folds(archive, settings, trials=False, streams=True)
    assert fold.vocabulary.labels == settings.labels
    assert set(fold.vocabulary.movements) == set(settings.labels), "durations, as a service has them"
    for stream in [observed_stream(*part, fold.vocabulary) for part in fold.stream_courses]:
        whole, all_count, _ = judged(stream, None)
        reduced, count, states = judged(stream, {name: SendOnChange(CONFIG.fresh_s / 2) for name in stream.messages[0]})
        assert count < 7 / 8 * all_count and states == {"counted"}
        assert len(reduced) == len(whole) >= 5
        for one, other in zip(whole, reduced, strict=True):
            assert [v.label for v in one] == [v.label for v in other]
            for v, w in zip(one, other, strict=True):
                assert abs(v.began_ns - w.began_ns) <= STEP_NS and abs(v.decided_ns - w.decided_ns) <= STEP_NS
                assert v.ended_ns is w.ended_ns is None or abs(v.ended_ns - w.ended_ns) <= STEP_NS
