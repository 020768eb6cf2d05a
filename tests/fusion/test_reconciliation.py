"""After a split network has healed: the movement of the service that stands down ends once, for each listener."""

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from common import SECOND_NS
from common.config_sections import FusionConfig
from common.messages import JudgementMessage, OngoingMovement, VerdictMessage
from common.vocabulary import Vocabulary
from fusion.engine.engine import FusionEngine
from fusion.reconciliation import DETECTION_S, RECONNECTION_S, Reachability, SharedMovements, UnreconciledMovement

AT_NS = 1_000 * SECOND_NS
NAMES = Vocabulary(("bow", "lunge"))


def judged(movement_id="", label=None):
    """A judgement with this movement in progress."""
    engine = FusionEngine("dojo", ["cam1"], NAMES, FusionConfig(id="b"))
    decided_ns = None if label is None else AT_NS
    movement = OngoingMovement(id=movement_id, began_ns=AT_NS, label=label, decided_ns=decided_ns)
    return engine.step(AT_NS).judgement.model_copy(update={"movement": movement if movement_id else None})


class Verdict:
    id = "dojo-1"


@pytest.mark.parametrize(
    ("messages", "early", "late"),
    [
        ([judged("dojo-1", "bow")], None, None),
        ([judged("dojo-2", "bow")], "dojo-2", None),
        ([judged("dojo-2")], None, ""),
        ([judged()], None, ""),
        ([judged("dojo-2"), judged("dojo-1", "bow")], None, None),
    ],
    ids=["adopted", "decided otherwise", "undecided", "at rest", "adopted later"],
)
def test_the_movement_ends_unless_the_owner_goes_on_with_it(messages, early, late):
    movement = UnreconciledMovement(Verdict, AT_NS)
    for message in messages:
        movement.record_message(message)
    assert movement.same_as(AT_NS) == early
    assert movement.same_as(AT_NS + SECOND_NS) == late
    assert movement.is_reconciled and movement.same_as(AT_NS + 2 * SECOND_NS) is None


def test_the_last_judgement_is_sent_again_at_intervals_until_the_owner_has_decided():
    movement = UnreconciledMovement(Verdict, AT_NS)
    at = [AT_NS + round(seconds * SECOND_NS) for seconds in (0.0, 0.1, 0.15, 0.2, 0.3)]
    assert [movement.should_repeat(now_ns) for now_ns in at] == [True, False, True, False, True]
    movement.record_message(judged("dojo-2", "bow"))
    assert not movement.should_repeat(AT_NS + SECOND_NS)


@given(st.lists(st.booleans(), max_size=40))
def test_verdicts_wait_until_others_have_found_the_router_too(connected):
    reachable, down_s = Reachability(), float("-inf")
    for step, up in enumerate(connected):
        now_s = step / 4
        down_s = down_s if up else now_s
        assert reachable.update(up, now_s, now_s) == (now_s - down_s >= RECONNECTION_S)


def test_a_verdict_sent_just_before_the_router_died_is_sent_again_and_once():
    steps = [(True, 0.0), (False, 1.0), (False, 2.0), (True, 2.1), (True, 2.5)]
    reachable, since = Reachability(), []
    for up, now_s in steps:
        reachable.update(up, 0.0, now_s)
        since.append(reachable.lost_from(now_s))
        assert reachable.doubtful_from_s == (1.0 - DETECTION_S if 1.0 <= now_s < 2.5 else math.inf)
    assert since == [math.inf] * 4 + [1.0 - DETECTION_S] and reachable.lost_from(3.0) == math.inf


@pytest.mark.parametrize(("frozen_s", "is_sent_again"), [(0.1, False), (0.7, True), (1.9, True)])
def test_a_verdict_sent_while_the_router_was_frozen_is_sent_again(frozen_s, is_sent_again):
    """The link may be lost and opened again between two steps: nothing but the silence of the observers shows it."""
    reachable, since = Reachability(), []
    for step in range(40):
        now_s = step / 10
        heard_s = 1.0 if 1.0 < now_s < 1.0 + frozen_s else now_s
        assert reachable.update(True, heard_s, now_s), "judgements go on"
        since.append(reachable.lost_from(now_s))
    assert [at_s for at_s in since if at_s < math.inf] == ([1.0 - DETECTION_S] if is_sent_again else [])


def test_the_owner_says_once_of_each_movement_that_has_ended_under_which_id_it_has_judged_it():
    fields = {name: getattr(judged(), name) for name in JudgementMessage.model_fields}
    span = {"began_ns": AT_NS, "decided_ns": AT_NS + 3, "ended_ns": AT_NS + 10, "stage": "ended"}
    own = VerdictMessage(**{**fields, **span, "id": "dojo-1", "label": "bow"})
    other = own.model_copy(update={"id": "dojo-2", "fusion": "a", "began_ns": AT_NS + 4})
    shared = SharedMovements()
    assert shared.same_as(other) is None
    shared.record(own)
    later = other.model_copy(update={"id": "dojo-3", "began_ns": AT_NS + 20, "ended_ns": AT_NS + 30})
    unended = other.model_copy(update={"ended_ns": None, "stage": "decided", "at_ns": AT_NS + 8})
    assert [shared.same_as(v) for v in (unended, other, other, own, later)] == [None, "dojo-1", None, None, None]
