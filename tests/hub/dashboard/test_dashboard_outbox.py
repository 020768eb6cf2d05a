"""What waits for a browser: the newest state, every verdict, and a snapshot when it is too much."""

from hypothesis import given
from hypothesis import strategies as st

from hub.dashboard.streams import Outbox


def snapshot():
    return b"all"


def test_it_begins_with_a_snapshot():
    assert Outbox().take(snapshot) == [b"all"]


def test_of_states_the_newest_waits_and_verdicts_come_first():
    box = Outbox()
    box.take(snapshot)
    for said in (b"1", b"2", b"3"):
        box.put_state(said)
        box.put_verdict(b"v" + said)
    assert box.take(snapshot) == [b"v1", b"v2", b"v3", b"3"]
    assert box.take(snapshot) == []


@given(st.lists(st.sampled_from("vst"), max_size=200), st.integers(1, 5))
def test_no_verdict_is_lost_whatever_the_order(steps, limit):
    """v: a verdict, s: a state, t: the browser takes. What it knows at the end is all that was said."""
    box, said, known = Outbox(limit), [], []

    def take():
        for payload in box.take(lambda: b"all"):
            if payload == b"all":
                known[:] = said
            elif payload != b"state":
                known.append(payload)

    for step in steps:
        if step == "v":
            payload = b"%d" % len(said)
            said.append(payload)
            box.put_verdict(payload)
            assert len(box._verdicts) <= limit
        elif step == "s":
            box.put_state(b"state")
        else:
            take()
    take()
    assert known == said
