"""Two referees in step: wherever the leading one dies, the other says what was left to say, under the same ids."""

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from common.config_sections import FusionConfig
from common.messages import PosteriorMessage, VocabularyReference
from common.vocabulary import Vocabulary
from fusion.engine.engine import FusionEngine

NAMES = Vocabulary(("bow", "lunge", "punch"), "karate")
REFERENCE = VocabularyReference(name=NAMES.name, hash=NAMES.digest)
S = 1_000_000_000
STEP = S // 10
UNSURE = (1 / 3, 1 / 3, 1 / 3)
CONDUCT = {"rule": "robust_inverse_entropy", "temperature": 1.0, "quorum": 1, "threshold": 0.8, "hold_s": 0.3,
           "fresh_s": 0.2, "fade_s": 0.5, "blind_s": 0.15, "drop_s": 2.0}  # fmt: skip


def sure(label):
    return tuple(0.94 if name == label else 0.03 for name in NAMES.labels)


STORY = [
    *[(UNSURE, 0.95)] * 5,
    *[(UNSURE, 0.1)] * 2, *[(sure("bow"), 0.05)] * 8, *[(sure("bow"), 0.9)] * 6,
    *[(UNSURE, 0.95)] * 3,
    *[(sure("punch"), 0.05)] * 6, *[(sure("lunge"), 0.05)] * 6, *[(sure("lunge"), 0.9)] * 6,
    *[(UNSURE, 0.05)] * 8, *[(UNSURE, 0.9)] * 8,
]  # fmt: skip
"""What one judge believes, step by step: a bow, a punch that becomes a lunge, and something that nobody knows."""


def referee(name):
    return FusionEngine("dojo", ["cam"], NAMES, FusionConfig(id=name, **CONDUCT))


def hear(one, seq, now_ns):
    p, rest = STORY[seq]
    fields = {"captured_ns": now_ns, "sent_ns": now_ns, "vocabulary": REFERENCE, "p": list(p), "rest": rest}
    said = PosteriorMessage(scene="dojo", observer="cam", seq=seq, session="a", frames=1, **fields)
    one.receive("cam", said, now_ns)


def told(verdict):
    return verdict.id, verdict.label, verdict.ended_ns is not None


def whole_story():
    alone, said = referee("a"), []
    for seq in range(len(STORY)):
        now_ns = 1000 * S + seq * STEP
        hear(alone, seq, now_ns)
        said += alone.step(now_ns).verdicts
    return said


def test_the_story_has_three_movements():
    assert [(v.label, v.ended_ns is not None) for v in whole_story()] == [
        ("bow", False), ("bow", True), ("punch", False), ("lunge", True), ("abstain", True),
    ]  # fmt: skip


@pytest.mark.parametrize("verdict_came_through", [True, False])
@pytest.mark.parametrize("dies_at", range(len(STORY) + 1))
def test_wherever_the_leader_dies_all_is_said_once_and_under_its_id(dies_at, verdict_came_through):
    """Its last words may be a verdict without the judgement after it, or nothing of that step at all."""
    leading, standing_by, said = referee("a"), referee("b"), []
    for seq in range(len(STORY)):
        now_ns = 1000 * S + seq * STEP
        if seq <= dies_at:
            hear(leading, seq, now_ns)
            ruling = leading.step(now_ns)
            last = seq == dies_at
            if not last or verdict_came_through:
                said += ruling.verdicts
        # A moment later, as two machines never step together.
        hear(standing_by, seq, now_ns + 3_000_000)
        own = standing_by.step(now_ns + 3_000_000)
        if seq > dies_at:
            said += own.verdicts
        elif not last or verdict_came_through:
            for verdict in ruling.verdicts:
                standing_by.continue_from(verdict)
            if not last:
                standing_by.continue_from(ruling.judgement)
        else:
            said += own.verdicts  # it took over within this very step
    wanted = [told(v) for v in whole_story()]
    found = [told(v) for v in said]
    assert [(label, ended) for _, label, ended in found] == [(label, ended) for _, label, ended in wanted]
    ids = dict.fromkeys(v_id for v_id, _, _ in found)
    assert len(ids) == 3
    before = {v_id for v_id, _, _ in wanted}
    late = [v_id for v_id in ids if v_id not in before]
    assert all(int(v_id.split("-")[1]) >= 1000_000 + (dies_at - 1) * 100 for v_id in late), "an id was changed"


def test_the_end_is_said_on_the_leaders_grounds():
    leading, standing_by, said = referee("a"), referee("b"), []
    for seq in range(21):
        now_ns = 1000 * S + seq * STEP
        hear(leading, seq, now_ns)
        hear(standing_by, seq, now_ns)
        if not said:
            ruling = leading.step(now_ns)
            standing_by.step(now_ns)
            for verdict in ruling.verdicts:
                standing_by.continue_from(verdict)
                said.append(verdict)
            standing_by.continue_from(ruling.judgement)
        else:
            said += standing_by.step(now_ns).verdicts
    decided, ended = said
    assert (decided.fusion, ended.fusion, decided.ended_ns) == ("a", "b", None) and ended.ended_ns is not None
    for name in ("p", "votes", "agreement", "label", "decided_ns", "began_ns", "id"):
        assert getattr(ended, name) == getattr(decided, name), name
    assert ended.seq > decided.seq


@settings(deadline=None)  # a whole story each time
@given(st.lists(st.sampled_from(range(len(STORY))), max_size=6, unique=True))
def test_the_lead_may_change_as_often_as_it_likes(changes):
    both, leads, said = [referee("a"), referee("b")], 0, []
    for seq in range(len(STORY)):
        now_ns = 1000 * S + seq * STEP
        leads ^= seq in changes
        rulings = []
        for one in both:
            hear(one, seq, now_ns)
            rulings.append(one.step(now_ns))
        said += rulings[leads].verdicts
        for verdict in rulings[leads].verdicts:
            both[1 - leads].continue_from(verdict)
        both[1 - leads].continue_from(rulings[leads].judgement)
    assert [told(v) for v in said] == [told(v) for v in whole_story()]
