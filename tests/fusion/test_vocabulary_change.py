"""The vocabulary in which a scene is fused: that of most observers, without a network."""

import pytest

from common import SECOND_NS
from fusion.vocabulary_change import ObservedVocabularies

NOW_NS = 1_000 * SECOND_NS


@pytest.mark.parametrize(
    ("published", "majority"),
    [("", None), ("a", "a"), ("ab", None), ("aab", "a"), ("abb", "b"), ("abc", None), ("aabb", None), ("abbb", "b")],
)
def test_more_than_half_of_the_observers_decide(published, majority):
    observed = ObservedVocabularies([f"cam{n}" for n in range(4)])
    for n, digest in enumerate(published):
        observed.note(f"cam{n}", digest, NOW_NS)
    observed.note("stranger", "z", NOW_NS)
    assert observed.majority(NOW_NS) == majority


def test_an_observer_that_is_gone_or_silent_has_no_say():
    observed = ObservedVocabularies(["cam1", "cam2", "cam3"])
    observed.set_present(frozenset({"cam1", "cam2"}))
    observed.note("cam1", "a", NOW_NS)
    observed.note("cam2", "b", NOW_NS)
    assert observed.majority(NOW_NS) is None
    observed.set_present(frozenset({"cam2"}))
    assert observed.majority(NOW_NS) == "b"
    # One that never announced itself has one.
    observed.note("cam3", "a", NOW_NS + SECOND_NS)
    assert observed.majority(NOW_NS + SECOND_NS) is None
    assert observed.majority(NOW_NS + 3 * SECOND_NS) == "a"
