"""The messages of the fusion engine beside the label: contributions, something else, facets, epoch, vocabulary."""

import json
import math

import numpy as np
import pytest
from engine_stage import ALL_RULES, LABELS, MOVING, REST, STEP_NS, UNIFORM, VIEWS, EngineDriver, all_views, sure
from hypothesis import example, given, settings
from hypothesis import strategies as st

from common.message_types import CONTRADICTED
from common.messages import Facing, JudgementMessage, VerdictMessage
from common.probability import softmax
from common.vocabulary import ABSTAIN, Vocabulary


def test_every_verdict_says_what_each_observer_contributed():
    scene = EngineDriver(quorum=2)
    views = {"door": sure("bow", 0.97), "wheel": sure("bow", 0.95), "table": (0.4, 0.35, 0.25)}
    scene.step({**views, "back": sure("punch", 0.6)}, MOVING, 8)
    scene.step(all_views(UNIFORM), 0.9, 8)
    decided, ended = scene.verdicts
    assert decided.contributions == ended.contributions and set(decided.contributions) == set(VIEWS)
    assert decided.contributions["door"].nats > 0 > decided.contributions["back"].nats
    assert all(contribution.stands for contribution in decided.contributions.values())


def test_something_else_is_no_movement_and_the_silence_says_why():
    scene = EngineDriver()
    judgement = scene.step(all_views(sure("bow", 0.98)), MOVING, 8, unlearned=0.9)
    assert judgement.unlearned > 0.8 and judgement.movement is None
    assert sum(judgement.p) == pytest.approx(1) and {v.label for v in judgement.votes.values()} == {None}
    assert " % something else; bow " in judgement.why
    judgement = scene.step(all_views(UNIFORM), REST, 8)
    assert scene.verdicts == [] and judgement.why is None


def test_after_something_else_a_movement_needs_no_rest():
    scene = EngineDriver()
    scene.step(all_views(sure("bow", 0.98)), MOVING, 8, unlearned=0.95)
    for unlearned in (0.02, 0.95):
        scene.step(all_views(sure("bow", 0.98)), MOVING, 12, unlearned=unlearned)
    assert [(v.stage, v.label) for v in scene.verdicts] == [("decided", "bow"), ("ended", "bow")]
    assert scene.verdicts[0].began_ns > 0 and scene.verdicts[1].ended_ns > scene.verdicts[0].decided_ns


def test_one_of_four_that_is_always_sure_of_something_else_blocks_no_movement_not_even_the_first():
    scene, bow = EngineDriver(), {"door": (0.6, 0.3), "wheel": (0.9, 0.25), "table": (0.97, 0.2)}
    for n in range(60):
        scene.tick()
        for view, (p, unlearned) in bow.items():
            moves = n % 30 < 15
            scene.publish(view, sure("bow", p) if moves else UNIFORM, float(not moves), unlearned=unlearned)
        scene.publish("back", UNIFORM, 0.0, unlearned=1.0)
        scene.fuse()
    assert scene.labels == ["bow"] * 4


@pytest.mark.parametrize(("unlearned", "decided"), [(0.0, ["bow"]), (0.3, [])])
def test_the_threshold_is_among_all_answers(unlearned, decided):
    scene = EngineDriver(rule="linear")
    scene.step(all_views(sure("bow")), MOVING, 8, unlearned=unlearned)
    assert scene.labels == decided


def test_a_verdict_is_revoked_when_at_rest_it_was_something_else():
    scene = EngineDriver()
    for unlearned, rest, times in ((0.0, MOVING, 6), (0.97, MOVING, 4), (0.97, REST, 6)):
        scene.step(all_views(sure("bow", 0.98)), rest, times, unlearned=unlearned)
    assert [(v.stage, v.label) for v in scene.verdicts] == [
        ("decided", "bow"),
        ("revised", ABSTAIN),
        ("ended", ABSTAIN),
    ]
    for verdict in scene.verdicts[1:]:
        assert verdict.unlearned > 0.9 and " % something else; bow " in verdict.why and verdict.revises == "bow"
    assert len({v.id for v in scene.verdicts}) == 1


def test_facing_and_facets_are_pooled_and_published():
    scene, table = EngineDriver(), [[0, 20, 40, 20]] * 3
    for name in VIEWS[:2]:
        scene.publish(name, sure("bow"), MOVING, facing=Facing(surprise=table), facets={"effort_time": [0.1, 0.9]})
    scene.publish("table", sure("bow"), MOVING, facets={"effort_time": [0.3, 0.7], "own": [1.0]})
    judgement = scene.fuse()
    assert set(judgement.facets) == {"facing", "effort_time"} and np.argmax(judgement.facets["facing"]) == 0
    assert (judgement.facing_deg + 1) % 360 == pytest.approx(1, abs=0.5)
    assert judgement.facets["effort_time"][1] > 0.6
    assert judgement.votes["door"].facing.surprise == table and judgement.votes["table"].facing is None


def test_facets_change_five_times_a_second_and_those_of_a_verdict_are_of_its_own_step():
    """Ten steps a second; the movement is decided in the fourth, in which all have just changed their minds."""
    scene, sudden = EngineDriver(), []
    for share in (0.9, 0.9, 0.9, 0.1, 0.1):
        judgement = scene.step(all_views(sure("bow", 0.98)), MOVING, facets={"effort_time": [1 - share, share]})
        sudden.append(judgement.facets["effort_time"][1] > 0.5)
    assert sudden == [True, True, True, True, False]
    assert [verdict.decided_ns for verdict in scene.verdicts] == [scene.now_ns - STEP_NS]
    assert scene.verdicts[0].facets["effort_time"][1] < 0.2


@pytest.mark.parametrize(
    ("other", "unlearned", "steps"),
    [("bow", 0.1, 4), ("punch", 0.1, 7), ("bow", 0.5, 4), (None, 0.1, 4)],
    ids=["agrees", "another label", "something else", "no opinion"],
)
def test_a_label_that_one_of_four_contests_is_decided_later(other, unlearned, steps):
    scene, count = EngineDriver(), 0
    while not scene.verdicts and (count := count + 1) < 20:
        scene.tick()
        for name in VIEWS:
            is_last = name == VIEWS[-1]
            p = sure("bow", 0.96) if not is_last else sure(other, 0.6) if other else UNIFORM
            scene.publish(name, p, MOVING, unlearned=unlearned if is_last else 0.05)
        scene.fuse()
    assert scene.labels == ["bow"] and count == steps


def test_one_that_the_others_contradict_contests_nothing():
    scene = EngineDriver(quorum=2)
    for label in ("bow", "lunge") * 2:
        scene.step({**all_views(sure(label, 0.97)), "back": sure("punch", 0.97)}, MOVING, 9)
        judgement = scene.step(all_views(UNIFORM), REST, 6)
    assert judgement.votes["back"].reliability < CONTRADICTED
    delays_s = [
        (verdict.decided_ns - verdict.began_ns) / 1e9 for verdict in scene.verdicts if verdict.stage == "decided"
    ]
    assert delays_s[0] == pytest.approx(0.6) and delays_s[-1] == pytest.approx(0.3)


def test_reliability_falls_with_each_wrong_verdict_and_a_standby_learns_it_too():
    scene, standby = EngineDriver(quorum=2), EngineDriver(quorum=2)
    for label in ("bow", "punch") * 4:
        views = {**all_views(sure(label, 0.97)), "back": sure("lunge", 0.97), "wheel": sure(label)}
        scene.step(views, MOVING, 9)
        judgement = scene.step(all_views(UNIFORM), REST, 6)
    assert judgement.votes["back"].reliability < 0.5 and judgement.votes["door"].reliability == 1.0
    for verdict in scene.verdicts:
        standby.engine.continue_from(verdict)
    assert standby.engine.reliability == scene.engine.reliability


def test_epoch_and_session_of_the_service_are_in_every_message():
    scene = EngineDriver(quorum=1)
    judgement = scene.step(all_views(UNIFORM), 0.9)
    assert (judgement.epoch, judgement.session) == (None, None)
    scene.engine.epoch, scene.engine.session = 3, "s1"
    scene.step(all_views(sure("bow")), MOVING, 6)
    scene.engine.epoch, scene.engine.session = 4, "s2"
    judgement = scene.step(all_views(sure("bow")), REST, 6)
    assert (judgement.epoch, judgement.session) == (4, "s2")
    assert [(v.epoch, v.session) for v in scene.verdicts] == [(3, "s1"), (4, "s2")]


POSTERIORS = st.one_of(
    st.lists(st.floats(-800, 800), min_size=3, max_size=3).map(lambda logits: softmax(np.array(logits)).tolist()),
    st.sampled_from([UNIFORM, sure("bow"), sure("punch"), (1.0, 0.0, 0.0), (0.0, 1.0, 0.0)]),
)
FACINGS = st.lists(st.lists(st.integers(0, 255), min_size=4, max_size=4), min_size=3, max_size=3)
FIELDS = st.fixed_dictionaries(
    {},
    optional={
        "unlearned": st.floats(0, 1),
        "facing": FACINGS.map(lambda table: Facing(surprise=table)),
        "facets": st.floats(0, 1).map(lambda p: {"effort_time": [p, 1 - p]}),
        "prior": POSTERIORS,
    },
)
STEPS = st.lists(
    st.tuples(st.dictionaries(st.sampled_from(VIEWS), POSTERIORS), st.floats(0, 1) | st.none(), FIELDS), max_size=12
)


def numbers(value):
    """Every float in a message."""
    if isinstance(value, float):
        yield value
    elif isinstance(value, dict | list):
        for part in value.values() if isinstance(value, dict) else value:
            yield from numbers(part)


@settings(deadline=None)  # up to twelve steps each time
@given(STEPS, st.sampled_from(ALL_RULES), st.sampled_from([1e-3, 0.5, 1.0, 1.7, 1e3]))
@example([({"door": (1.0, 0.0, 0.0), "wheel": (0.0, 1.0, 0.0)}, 0.0, {"unlearned": 1.0})] * 3, "product", 1e-3)
def test_any_posteriors_give_messages_that_their_classes_accept(steps, rule, temperature):
    scene = EngineDriver(rule=rule, temperature=temperature, quorum=1, hold_s=0.1)
    for n, (views, rest, fields) in enumerate(steps, 1):
        judgement = scene.step(views, rest, **fields)
        assert judgement.seq == n and sum(judgement.p) == pytest.approx(1)
        used = [v for v in judgement.votes.values() if v.p is not None]
        assert len(used) == judgement.agreement.n <= 4
        assert sum(v.label == judgement.label for v in used) == judgement.agreement.k
        assert judgement.label == (LABELS[int(np.argmax(judgement.p))] if used else "")
        content = judgement.model_dump()
        assert JudgementMessage.model_validate(json.loads(json.dumps(content, allow_nan=False))) == judgement
        facing_deg = content.pop("facing_deg")
        assert facing_deg is None or 0 <= facing_deg < 360
        for vote in content["votes"].values():
            assert vote["age_s"] is None or vote.pop("age_s") >= 0
        bits = [content.pop("certainty_bits"), *(v.pop("entropy") or 0.0 for v in content["votes"].values())]
        assert all(0 <= value <= math.log2(3) for value in bits)
        assert all(0 <= value <= 1 for value in numbers(content))
    for verdict in scene.verdicts:
        assert isinstance(verdict, VerdictMessage) and verdict.label in (*LABELS, ABSTAIN)
        assert verdict.id == f"dojo-{verdict.began_ns // 1_000_000}"
        json.dumps(verdict.model_dump(), allow_nan=False)


def test_a_new_vocabulary_ends_a_decided_movement_in_the_old_one_and_forgets_the_rest():
    scene, taught = EngineDriver(), Vocabulary(("clap", "wave"))
    scene.step(all_views(sure("bow", 0.96)), MOVING, 5)
    (decided,), seq = scene.verdicts, scene.fuse().seq
    (ended,) = scene.engine.change_vocabulary(taught, scene.now_ns)
    assert (ended.id, ended.stage, ended.label, ended.ended_ns) == (decided.id, "ended", "bow", scene.now_ns)
    assert ended.vocabulary == decided.vocabulary and len(ended.p) == 3 and ended.contributions is not None
    scene.tick()
    judgement = scene.fuse()
    assert judgement.vocabulary.hash == taught.digest and judgement.p == [0.5, 0.5]
    assert ended.seq == judgement.seq == seq + 1 and judgement.movement is None
    assert scene.publish("door", sure("bow"), MOVING) == "foreign_vocabulary"
    assert scene.fuse().votes["door"].state == "foreign"
    # A message of the owner from before gives its number alone.
    scene.engine.continue_from(decided)
    assert scene.fuse().movement is None and scene.fuse().seq == decided.seq + 2
    assert not scene.engine.change_vocabulary(Vocabulary(("bow", "clap")), scene.now_ns)


def test_an_undecided_movement_gets_no_verdict_in_a_new_vocabulary():
    scene = EngineDriver()
    scene.step(all_views(sure("bow", 0.96)), MOVING, 2)
    assert scene.fuse().movement is not None and not scene.verdicts
    assert not scene.engine.change_vocabulary(Vocabulary(("clap", "wave")), scene.now_ns)
    scene.tick()
    assert scene.fuse().movement is None and not scene.verdicts
