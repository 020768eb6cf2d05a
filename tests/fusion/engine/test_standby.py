"""Two engines in step: wherever the leading one stops, the other publishes the rest under the same ids."""

import pytest
from engine_stage import LABELS, MOVING, UNIFORM, EngineDriver, all_views, sure
from hypothesis import given, settings
from hypothesis import strategies as st

from common import SECOND_NS
from common.message_types import LAST_INTEGER
from common.messages import JudgementMessage
from common.wire import decode, encode

BOW, LUNGE, PUNCH = (sure(label, 0.94) for label in LABELS)
STORY = [
    *[(UNIFORM, 0.95)] * 5,
    *[(UNIFORM, 0.1)] * 2, *[(BOW, 0.05)] * 8, *[(BOW, 0.9)] * 6,
    *[(UNIFORM, 0.95)] * 3,
    *[(PUNCH, 0.05)] * 2, *[(LUNGE, 0.05)] * 6, *[(LUNGE, 0.9)] * 6,
    *[(UNIFORM, 0.05)] * 8, *[(UNIFORM, 0.9)] * 8,
]  # fmt: skip
"""A single observer's p and rest, step by step: a bow, a punch that becomes a lunge, and an unknown movement."""
VERDICTS = [
    ("decided", "bow", None), ("ended", "bow", None),
    ("decided", "punch", None), ("revised", "lunge", "punch"), ("ended", "lunge", "punch"),
    ("ended", "abstain", None),
]  # fmt: skip
"""Its verdicts: the stage, the label, and the label that it replaces."""


class Service:
    """One of two services that receive the same posteriors."""

    def __init__(self, name, delay_ns=0):
        self.scene = EngineDriver(["cam"], id=name, quorum=1, hold_s=0.1)
        self.scene.now_ns += delay_ns

    def step(self, n):
        """Step `n` of the story: the verdicts, and the judgement."""
        p, rest = STORY[n]
        before = len(self.scene.verdicts)
        judgement = self.scene.step({"cam": p}, rest)
        return self.scene.verdicts[before:], judgement

    def follow(self, verdicts, judgement=None):
        for message in (*verdicts, *([] if judgement is None else [judgement])):
            self.scene.engine.continue_from(message)


def words(verdicts):
    return [(verdict.stage, verdict.label, verdict.revises) for verdict in verdicts]


@pytest.fixture(scope="module")
def alone():
    """The verdicts of a service that leads all the time."""
    service = Service("a")
    return [verdict for n in range(len(STORY)) for verdict in service.step(n)[0]]


@pytest.mark.parametrize("verdict_arrived", [True, False])
@pytest.mark.parametrize("last_step", range(len(STORY) + 1))
def test_wherever_the_owner_stops_each_verdict_is_published_once_and_under_its_id(alone, last_step, verdict_arrived):
    """The leader's last message is a verdict without the judgement after it, or it sends nothing in that step."""
    leader, standby, published = Service("a"), Service("b", 3_000_000), []
    for n in range(len(STORY)):
        # The standby steps a moment later, as two machines never step together.
        sent = leader.step(n) if n <= last_step else None
        own, _ = standby.step(n)
        if sent is None or (n == last_step and not verdict_arrived):
            published += own
        else:
            published += sent[0]
            standby.follow(sent[0], None if n == last_step else sent[1])
    assert words(published) == words(alone) == VERDICTS
    ids = dict.fromkeys(verdict.id for verdict in published)
    new_ids = ids.keys() - {verdict.id for verdict in alone}
    assert len(ids) == 3
    assert all(int(verdict_id.split("-")[1]) >= 1000_000 + last_step * 100 for verdict_id in new_ids), "an id changed"


def test_a_number_near_the_end_of_its_range_is_not_continued():
    service = Service("b")
    _, judgement = service.step(0)
    service.follow([], judgement.model_copy(update={"seq": LAST_INTEGER}))
    assert service.step(1)[1].seq == 1
    service.follow([], judgement.model_copy(update={"seq": 1000}))
    assert service.step(2)[1].seq == 1001


def test_the_end_is_published_on_the_basis_of_the_owner():
    leader, standby, published = Service("a"), Service("b"), []
    for n in range(21):
        verdicts, judgement = leader.step(n)
        own, _ = standby.step(n)
        if published:
            published += own
        else:
            standby.follow(verdicts, judgement)
            published += verdicts
    decided, ended = published
    assert (decided.fusion, ended.fusion, decided.ended_ns) == ("a", "b", None) and ended.ended_ns is not None
    for name in ("p", "votes", "agreement", "label", "decided_ns", "began_ns", "id"):
        assert getattr(ended, name) == getattr(decided, name), name
    assert ended.seq > decided.seq


def test_a_revision_that_the_owner_made_no_more_is_published_by_the_standby_service():
    """The leader's last judgement is older than the standby's own revision, and arrives after it."""
    leader, standby = Service("a"), Service("b")
    for n in range(STORY.index((LUNGE, 0.9))):
        last = leader.step(n)
        standby.step(n)
        standby.follow(*last)
    own, _ = standby.step(n + 1)
    assert words(own) == [("revised", "lunge", "punch")]
    standby.follow([], last[1])
    published = [verdict for later in range(n + 2, n + 6) for verdict in standby.step(later)[0]]
    assert words(published) == [("revised", "lunge", "punch"), ("ended", "lunge", "punch")]
    assert {verdict.id for verdict in published} == {last[1].movement.id}


@settings(deadline=None)  # a whole story each time
@given(st.lists(st.sampled_from(range(len(STORY))), max_size=6, unique=True))
def test_the_owner_may_change_at_any_time(alone, changes):
    services, leading, published = [Service("a"), Service("b")], 0, []
    for n in range(len(STORY)):
        leading ^= n in changes
        outputs = [service.step(n) for service in services]
        published += outputs[leading][0]
        services[1 - leading].follow(*outputs[leading])
    assert [(v.id, v.ended_ns) for v in published] == [(v.id, v.ended_ns) for v in alone]
    assert words(published) == VERDICTS


def test_an_outage_is_known_to_a_service_that_is_given_the_scene_just_after_it():
    scene, started = EngineDriver(), EngineDriver()
    scene.step(all_views(sure("bow", 0.96)), MOVING, 10)
    seen_ns = scene.now_ns
    scene.now_ns += 3 * SECOND_NS
    judgement = scene.step(all_views(sure("lunge", 0.96)), MOVING)
    assert judgement.movement.label == "bow" and judgement.movement.outage_ns == seen_ns
    started.engine.continue_from(decode(JudgementMessage, encode(judgement)))
    started.now_ns, started.seq = scene.now_ns, scene.seq
    started.step(all_views(sure("lunge", 0.96)), MOVING, 5)
    assert [(v.label, v.stage) for v in started.verdicts] == [("bow", "ended"), ("lunge", "decided")]
    assert started.verdicts[0].ended_ns == seen_ns


def test_a_decision_from_the_wait_for_observers_is_not_published_beside_the_followed_one():
    """Another one of the roster is awaited; the answer of the service that judges the movement comes after that."""
    owner, late = EngineDriver(["cam"], quorum=1, hold_s=0.1), EngineDriver(["cam", "other"], quorum=1, hold_s=0.1)
    late.engine.wait_for_roster(60.0)
    for p, rest in STORY[:12]:
        last = owner.step({"cam": p}, rest)
        late.step({"cam": p}, rest)
    assert words(owner.verdicts) == [("decided", "bow", None)] and late.verdicts == []
    for message in (*owner.verdicts, last):
        late.engine.continue_from(message)
    late.step({"cam": BOW}, 0.95, 12)
    assert [(v.stage, v.id) for v in late.verdicts] == [("ended", owner.verdicts[0].id)]
