"""What the crowd counts of the verdicts that it receives."""

from benchmarks.crowd.crowd import CrowdCounts


def counts(*ends):
    """Counts of a scene with these movements, one after the other, and these ends of verdicts: ids and labels."""
    counted = CrowdCounts(done={"home": ["a", "b", "c"]})
    for verdict_id, label in ends:
        counted.record_end("home", verdict_id, label)
    return counted.right, counted.doubled


def test_an_end_that_is_sent_again_counts_once():
    assert counts(("1", "a"), ("2", "b"), ("1", "a"), ("2", "b"), ("3", "c")) == (3, 0)


def test_a_movement_that_ends_under_two_ids_or_two_labels_is_doubled():
    assert counts(("1", "a"), ("2", "a"), ("3", "b"), ("4", "c")) == (3, 1)
    assert counts(("1", "a"), ("1", "b"), ("3", "c")) == (3, 1)


def test_a_movement_without_its_verdict_is_not_right():
    assert counts(("1", "a"), ("2", "abstain"), ("3", "c")) == (2, 0)
