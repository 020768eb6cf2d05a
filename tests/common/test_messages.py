"""Messages: what is taken in, what is refused, and what is never changed."""

import pytest
from hypothesis import given
from hypothesis import strategies as st
from pydantic import ValidationError

from common.messages import PosteriorMessage, StatusMessage, VerdictMessage
from common.vocabulary import ABSTAIN

SAID = {
    "scene": "dojo", "observer": "cam1", "seq": 0, "session": "a", "captured_ns": 1, "sent_ns": 2,
    "vocabulary": {"name": "karate", "hash": "0123456789abcdef"}, "p": [0.25, 0.75], "frames": 1,
}  # fmt: skip
JUDGED = {
    "scene": "dojo", "fusion": "f", "seq": 0, "at_ns": 5, "vocabulary": SAID["vocabulary"], "p": [0.5, 0.5],
    "label": ABSTAIN, "certainty_bits": 1.0, "rule": "log", "agreement": {"k": 1, "n": 2},
    "votes": {"cam1": {"label": None, "entropy": None, "weight": 0.0, "age_s": None, "state": "silent"}},
    "id": "dojo-1", "began_ns": 3, "decided_ns": 5,
}  # fmt: skip


def posterior(**changed):
    return PosteriorMessage.model_validate({**SAID, **changed})


def test_the_contracts_fields_are_enough():
    message = posterior()
    assert (message.v, message.rest, message.prior, message.visible) == (1, None, None, {})


def test_who_says_more_is_understood():
    assert posterior(mood=0.3, vocabulary={**SAID["vocabulary"], "lang": "de"}).p == [0.25, 0.75]


@pytest.mark.parametrize(
    "changed",
    [
        {"v": 3}, {"scene": "Dojo"}, {"scene": "dojo\n"}, {"observer": "a/b"}, {"observer": ""}, {"seq": -1},
        {"captured_ns": -1}, {"frames": -1}, {"p": [1.0]}, {"p": []}, {"p": [0.5, float("nan")]}, {"p": [1.5, -0.5]},
        {"p": [0.5, 0.6]}, {"prior": [0.5, 0.2]}, {"prior": [1.0]}, {"prior": [0.2, 0.3, 0.5]}, {"rest": 1.01},
        {"rest": float("nan")}, {"vocabulary": "karate"}, {"visible": {"head": "perhaps"}}, {"session": None},
    ],
)  # fmt: skip
def test_what_is_no_posterior_is_refused(changed):
    with pytest.raises(ValidationError):
        posterior(**changed)


@pytest.mark.parametrize("missing", SAID)
def test_nothing_of_the_contract_may_be_missing(missing):
    with pytest.raises(ValidationError, match=missing):
        PosteriorMessage.model_validate({k: x for k, x in SAID.items() if k != missing})


@given(st.floats(-0.002, 0.002))
def test_the_sum_may_miss_a_thousandth(error):
    if abs(error) < 0.000999:
        assert posterior(p=[0.25, 0.75 + error])
    elif abs(error) > 0.001001:
        with pytest.raises(ValidationError, match="sums to"):
            posterior(p=[0.25, 0.75 + error])


def test_a_message_is_never_changed():
    message = posterior()
    with pytest.raises(ValidationError, match="frozen"):
        message.seq = 1


def test_a_verdict_is_a_judgement_and_its_end_may_be_open():
    verdict = VerdictMessage.model_validate(JUDGED)
    assert verdict.ended_ns is None and verdict.label == "abstain"
    assert VerdictMessage.model_validate(verdict.model_dump()) == verdict


@pytest.mark.parametrize("changed", [{"votes": {"cam1": {"state": "asleep"}}}, {"agreement": {"k": -1, "n": 0}}])
def test_what_is_no_verdict_is_refused(changed):
    with pytest.raises(ValidationError):
        VerdictMessage.model_validate({**JUDGED, **changed})


def test_a_process_is_in_one_of_five_states():
    for state in ("starting", "running", "degraded", "stopping", "failed"):
        assert StatusMessage(scene="dojo", id="cam1", state=state).reason == ""
    with pytest.raises(ValidationError):
        StatusMessage(scene="dojo", id="cam1", state="happy")
