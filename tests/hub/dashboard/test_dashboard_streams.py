"""The outbox of a browser: the newest state, every verdict, and a snapshot when there are too many."""

from hypothesis import given
from hypothesis import strategies as st

from hub.dashboard.streams import Outbox


def snapshot():
    return b"all"


def test_it_starts_with_a_snapshot_and_then_keeps_all_verdicts_and_the_newest_state():
    box = Outbox()
    assert box.take(snapshot) == [b"all"]
    for payload in (b"1", b"2", b"3"):
        box.put_state(payload)
        box.put_verdict(b"v" + payload)
    assert box.take(snapshot) == [b"v1", b"v2", b"v3", b"3"]
    assert box.take(snapshot) == []


@given(st.lists(st.sampled_from("vst"), max_size=200), st.integers(1, 5))
def test_no_verdict_is_lost_in_any_order(steps, limit):
    """v: a verdict, s: a state, t: the browser takes. At the end it knows everything that was published."""
    box, published, known = Outbox(limit), [], []

    def take():
        for payload in box.take(snapshot):
            if payload == b"all":
                known[:] = published
            elif payload != b"state":
                known.append(payload)

    for step in steps:
        if step == "v":
            published.append(b"%d" % len(published))
            box.put_verdict(published[-1])
            assert len(box._verdicts) <= limit
        elif step == "s":
            box.put_state(b"state")
        else:
            take()
    take()
    assert known == published
