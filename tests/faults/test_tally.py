"""How verdicts are compared with what was performed."""

from fault_stage import Movement, tally

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
