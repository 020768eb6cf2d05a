"""The vocabulary in which a scene is fused: that of most observers, without a network."""

import pytest

from common import SECOND_NS
from common.message_types import MovementTimes
from common.vocabulary import Vocabulary
from fusion.vocabulary_change import ObservedVocabularies, agreed_times

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


def known(**fields):
    return Vocabulary(("bow", "clap"), movements={"clap": MovementTimes(**fields)})


@pytest.mark.parametrize(
    ("answers", "agreed"),
    [
        ([known(shortest_s=0.6, rest_s=0.4, period_s=0.5)], MovementTimes(shortest_s=0.6, rest_s=0.4, period_s=0.5)),
        ([known(rest_s=rest_s) for rest_s in (0.2, 9.0, 0.4)], MovementTimes(rest_s=0.4)),
        ([known(rest_s=0.3), known(), known(), known(rest_s=0.5)], MovementTimes(rest_s=0.4)),
        ([known(period_s=0.5), known()], MovementTimes()),
        ([known(period_s=0.5), known(), known(period_s=0.7)], MovementTimes(period_s=0.6)),
        ([known(period_s=0.5), Vocabulary(("bow", "clap"))], MovementTimes(period_s=0.5)),
    ],
    ids=["alone", "one is far off", "some do not know", "a tie", "two of three", "one knows no durations"],
)
def test_the_observers_agree_on_the_durations_of_a_movement(answers, agreed):
    assert agreed_times(answers) == agreed_times(answers[::-1]) == {"clap": agreed}


def test_without_durations_there_is_nothing_to_agree_on():
    assert agreed_times([Vocabulary(("bow", "clap"))]) == agreed_times([]) == {}
