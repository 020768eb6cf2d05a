"""The vocabulary in which a scene is fused: that of most observers, without a network."""

import pytest

from common import SECOND_NS
from common.config_sections import FusionConfig
from common.message_types import MovementTimes
from common.messages import PosteriorMessage, VocabularyHash
from common.vocabulary import Vocabulary, agreed_times
from fusion.engine.roster import Roster

NOW_NS = 1_000 * SECOND_NS


class Published:
    """A roster that takes posteriors in the vocabularies "a", "b", ..., of which it knows none."""

    def __init__(self, observers):
        self.roster, self.seq = (
            Roster([f"cam{n}" for n in range(1, observers + 1)], Vocabulary(("x", "y")), FusionConfig()),
            0,
        )

    def __call__(self, observer, digest, at_ns=NOW_NS):
        self.seq += 1
        message = PosteriorMessage(
            v=2, seq=self.seq, session="s", captured_ns=at_ns, sent_ns=at_ns, vocabulary=VocabularyHash(hash=digest),
            p=[0.5, 0.5], frames=1,
        )  # fmt: skip
        self.roster.receive(observer, message, at_ns)

    def majority(self, at_ns=NOW_NS):
        return self.roster.majority(at_ns)


@pytest.mark.parametrize(
    ("published", "majority"),
    [("", None), ("a", "a"), ("ab", None), ("aab", "a"), ("abb", "b"), ("abc", None), ("aabb", None), ("abbb", "b")],
)
def test_more_than_half_of_the_observers_decide(published, majority):
    publish = Published(4)
    for n, digest in enumerate(published, 1):
        publish(f"cam{n}", digest)
    publish("stranger", "z")
    assert publish.majority() == majority
    publish.roster.change_vocabulary(Vocabulary(("x", "z")))
    assert publish.majority() == majority


def test_an_observer_that_is_gone_or_silent_has_no_say():
    publish = Published(3)
    publish.roster.set_present(frozenset({"cam1", "cam2"}))
    publish("cam1", "a")
    publish("cam2", "b")
    assert publish.majority() is None
    publish.roster.set_present(frozenset({"cam2"}))
    assert publish.majority() == "b"
    # One that never announced itself has one.
    publish("cam3", "a", NOW_NS + SECOND_NS)
    assert publish.majority(NOW_NS + SECOND_NS) is None
    assert publish.majority(NOW_NS + 3 * SECOND_NS) == "a"


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
