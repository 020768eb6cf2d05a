"""How verdicts are compared with what was performed."""

import pytest
from fault_hearing import is_unheard
from fault_stage import Movement, tally

from common import SECOND_NS

WAVE = Movement("wave", 1000, 2000)


def verdict(stage, label="wave", name="1"):
    """A verdict as a witness receives it."""
    ended_ns = 2000 if stage == "ended" else None
    return {"id": name, "label": label, "stage": stage, "began_ns": 1000, "decided_ns": 1500, "ended_ns": ended_ns}


def faults(*verdicts):
    return [fault for _, fault in tally([WAVE], verdicts).faults]


def test_a_verdict_that_is_sent_again_is_no_second_one():
    words = [verdict("decided"), verdict("decided"), verdict("ended"), verdict("ended")]
    assert faults(*words) == []


def test_two_ids_or_two_decisions_are_faults():
    assert faults(verdict("ended"), verdict("ended", name="2")) == ["has 2 verdicts ['1', '2']"]
    again = verdict("decided"), verdict("ended"), verdict("decided"), verdict("ended")
    assert faults(*again) == ["was published as ['decided', 'ended', 'decided', 'ended']"]
    assert faults(verdict("decided"), verdict("decided", "clap"), verdict("ended")) == [
        "was published as ['decided', 'decided', 'ended']"
    ]


@pytest.mark.parametrize(("away_s", "unheard"), [((), False), ((0.0, 0.9), False), ((1.0, 2.3), True)])
def test_a_movement_is_unheard_when_a_third_of_it_has_no_vote(away_s, unheard):
    movement = Movement("wave", 0, 3 * SECOND_NS)
    votes = {n: 0 if away_s and away_s[0] <= n / 10 < away_s[1] else 3 for n in range(-10, 50)}
    judgements = [{"at_ns": n * SECOND_NS // 10, "agreement": {"n": count}} for n, count in votes.items()]
    assert is_unheard(movement, judgements) is unheard
    assert is_unheard(movement, judgements, least=4)
