"""Scores on the wire: what one observer says in its posterior, and what a verdict carries."""

import math

import msgpack
import pytest
from message_stage import posterior, reason_of, verdict

from common.message_types import LAST_INTEGER
from common.messages import PosteriorMessage, VerdictMessage
from common.posterior import ObservedRemark, ObservedScore, Unscored
from common.wire import decode, encode

REMARK = {"joint": "left knee", "moment": 0.5, "degrees": 12.0, "strength": 2.0}
SCORE = {"label": "wave", "ended_ns": 5, "score": 7.5, "certainty": 0.75, "remarks": [REMARK]}


def with_score(**fields):
    """The bytes of a posterior with a score."""
    return msgpack.packb({**msgpack.unpackb(encode(posterior())), "score": {**SCORE, **fields}})


def test_a_posterior_carries_a_score_and_its_remarks():
    own = ObservedScore(label="wave", ended_ns=5, score=7.5, certainty=0.75, remarks=[ObservedRemark(**REMARK)])
    message = decode(PosteriorMessage, encode(posterior(score=own)))
    assert message.score == own == decode(PosteriorMessage, with_score()).score
    assert own.remarks[0].words == "left knee: 12 degrees too straight at 50 %"
    assert "score" not in msgpack.unpackb(encode(posterior()))
    assert own.shifted(-2).ended_ns == 3


@pytest.mark.parametrize(
    "fields",
    [
        {"score": 10.5}, {"score": -0.1}, {"score": math.nan}, {"certainty": 2.0}, {"certainty": math.inf},
        {"label": "x" * 65}, {"ended_ns": -1}, {"ended_ns": LAST_INTEGER + 1}, {"remarks": [REMARK] * 4},
        *({"remarks": [{**REMARK, **wrong}]} for wrong in (
            {"joint": "x" * 65}, {"moment": 1.5}, {"degrees": math.nan}, {"strength": -1.0},
        )),
    ],
)  # fmt: skip
def test_a_score_out_of_range_is_rejected(fields):
    assert reason_of(PosteriorMessage, with_score(**fields)) == "malformed"


def test_names_hold_no_control_characters():
    message = decode(PosteriorMessage, with_score(label="wa\x1bve", remarks=[{**REMARK, "joint": "knee\n"}]))
    assert message.score.label.isprintable() and message.score.remarks[0].joint.isprintable()


def test_a_posterior_says_why_it_has_no_score():
    own = Unscored(label="wave", ended_ns=5, reason="its begin was not seen")
    message = decode(PosteriorMessage, encode(posterior(unscored=own)))
    assert message.unscored == own and own.shifted(-2).ended_ns == 3 and message.score is None
    assert "unscored" not in msgpack.unpackb(encode(posterior()))
    fields = {
        **msgpack.unpackb(encode(posterior())),
        "unscored": {"label": "wave", "ended_ns": 5, "reason": "x\x1b" * 99},
    }
    reason = decode(PosteriorMessage, msgpack.packb(fields)).unscored.reason
    assert len(reason) == 120 and reason.isprintable()
    fields["unscored"]["ended_ns"] = -1
    assert reason_of(PosteriorMessage, msgpack.packb(fields)) == "malformed"


def test_a_verdict_carries_score_scores_and_remarks():
    own = verdict(ended_ns=9, stage="ended", score=7.5, scores={"cam1": 7.0, "cam2": 8.0}, remarks=["left knee: ..."])
    assert decode(VerdictMessage, encode(own)) == own
    assert not {"score", "scores", "remarks"} & msgpack.unpackb(encode(verdict())).keys()
    fields = msgpack.unpackb(encode(own))
    for bad in ({"score": 11.0}, {"scores": {"cam1": -1.0}}, {"remarks": ["x"] * 4}, {"remarks": ["x" * 121]}):
        assert reason_of(VerdictMessage, msgpack.packb({**fields, **bad})) == "malformed"
