"""The segmenter: a test for each rule on a scripted movement, then properties for any beliefs at any times."""

from itertools import chain, groupby, pairwise

import pytest
from hypothesis import given
from hypothesis import strategies as st

from common import SECOND_NS
from common.config_sections import FusionConfig
from common.message_types import MovementTimes
from common.vocabulary import ABSTAIN, Vocabulary
from fusion.engine.segment_conditions import REVISIONS_LIMIT
from fusion.engine.segmenter import Segmenter
from fusion.engine.segments import PooledState, SegmentState

NAMES = Vocabulary(("bow", "lunge", "punch"))
STEP_NS = 50_000_000
CONFIG = FusionConfig(threshold=0.8, quorum=2, hold_s=0.15)
"""The hold is three steps."""


def rest(steps, label="bow", p=0.5, agreeing=0):
    return [(label, p, agreeing, 0.9)] * steps


def unsure_rest(steps, label="bow"):
    """Two observers contradict each other: one may have taken a turn of the movement for rest."""
    return [(label, 0.5, 0, 0.6)] * steps


def moving(steps, label="bow", p=0.5, agreeing=2):
    return [(label, p, agreeing, 0.1)] * steps


def sure(steps, label="bow", agreeing=2, p=0.9):
    return moving(steps, label, p, agreeing)


def sure_at_rest(steps, label="bow", agreeing=2):
    return rest(steps, label, 0.9, agreeing)


def else_steps(steps):
    return [("bow", 0.05, 0, 0.1, 0.95)] * steps


def state_of(step, part, **fields):
    label, p, agreeing, rest_p, *unlearned = part
    return PooledState(step * STEP_NS, label, p, agreeing, rest_p, *unlearned, **fields)


def play(parts, segmenter=None, first=0, gap=(0, 0)):
    """The decisions on these parts, from step `first` on. gap: from this step on so many steps later."""
    segmenter = segmenter or Segmenter(CONFIG, NAMES)
    steps = (first + n + (gap[1] if n >= gap[0] else 0) for n in range(len(parts)))
    return [d for step, part in zip(steps, parts, strict=False) for d in segmenter.update(state_of(step, part))]


def in_steps(decisions):
    """Stage, label, begin, end, in steps, of each."""
    return [(d.stage, d.label, d.began_ns // STEP_NS, d.ended_ns and d.ended_ns // STEP_NS) for d in decisions]


def decisions(*parts, config=CONFIG):
    """Step of the decision -> (label, began, decided, ended), in steps; a revision's label is "revised>label"."""
    segmenter, result = Segmenter(config, NAMES), {}
    for step, part in enumerate(chain(*parts)):
        for decision in segmenter.update(state_of(step, part)):
            assert step not in result, "two decisions in one step"
            times = (decision.began_ns, decision.decided_ns, decision.ended_ns)
            name = decision.label if decision.revises is None else f"{decision.revises}>{decision.label}"
            assert (decision.stage == "ended") == (decision.ended_ns is not None)
            assert decision.stage == "ended" or (decision.stage == "revised") == (decision.revises is not None)
            result[step] = (name, *(None if t is None else t // STEP_NS for t in times))
    return result


@pytest.mark.parametrize(("contested", "decided"), [((0, 0), 3), ((0, 20), 9), ((0, 3), 3), ((3, 7), 7)])
def test_2_where_an_observer_votes_for_another_label_it_is_held_for_longer(contested, decided):
    """0.15 s are three steps, 0.3 s six more; what counts is whether it is contested when it would be decided."""
    segmenter = Segmenter(CONFIG, NAMES)
    states = [state_of(n, part, contested=contested[0] <= n < contested[1]) for n, part in enumerate(sure(20))]
    steps = list(map(segmenter.update, states))
    assert [n for n, published in enumerate(steps) if published] == [decided]


def test_2_but_not_beyond_the_movement():
    segmenter = Segmenter(CONFIG, NAMES)
    steps = [segmenter.update(state_of(n, part, contested=True)) for n, part in enumerate(sure(4) + sure_at_rest(4))]
    assert [(n, each.label) for n, published in enumerate(steps) for each in published][:1] == [(4, "bow")]


@pytest.mark.parametrize("after", [("bow", 0.5, 2, 0.1), ("bow", 0.5, 2, 0.9), ("bow", 0.1, 2, 0.1, 0.9)])
def test_2_a_label_that_was_only_contested_is_not_lost_when_it_fades(after):
    """It meets the demand for six steps; then the movement goes on without it, rests, or becomes something else."""
    segmenter, published = Segmenter(CONFIG, NAMES), []
    for n, part in enumerate([*sure(6), *[after] * 10, *rest(14)]):
        published += [(each.label, each.stage) for each in segmenter.update(state_of(n, part, contested=n < 6))]
    assert published[-1] == ("bow", "ended") and {label for label, _ in published} == {"bow"}


TWO_LABELS_IN_TURN = [*rest(1), *[*sure_at_rest(1), *sure_at_rest(1, "lunge")] * 9]
CASES = {
    "published when decided and when ended": (
        (rest(5), moving(2), sure(10), rest(10)),
        {10: ("bow", 5, 10, None), 20: ("bow", 5, 10, 17)},
    ),
    "two movements with a rest between are two": (
        (sure(6), sure_at_rest(3), sure_at_rest(3, "lunge"), sure(6, "lunge"), rest(4)),
        {3: ("bow", 0, 3, None), 9: ("bow", 0, 3, 6), 15: ("lunge", 12, 15, None), 21: ("lunge", 12, 15, 18)},
    ),
    "3: what was named at rest is not decided again while observers change to the next movement": (
        (sure_at_rest(10), sure(6), sure(8, "lunge"), rest(4)),
        {19: ("lunge", 10, 19, None), 27: ("lunge", 10, 19, 24)},
    ),
    "3: but the same movement again is decided, later": (
        (sure_at_rest(10), sure(14), rest(4)),
        {22: ("bow", 10, 22, None), 27: ("bow", 10, 22, 24)},
    ),
    "3: or when the person comes to rest": (
        (sure_at_rest(10), sure(6), rest(4)),
        {16: ("bow", 10, 16, None), 19: ("bow", 10, 16, 16)},
    ),
    "4: rest in which observers contradict each other, and after it the same label: one movement": (
        (rest(2), sure(12), unsure_rest(6), sure(8), rest(9)),
        {5: ("bow", 2, 5, None), 31: ("bow", 2, 5, 28)},
    ),
    "4: also where its label is held only at the end": (
        (rest(2), sure(12), unsure_rest(6), moving(9), sure(1), sure_at_rest(9)),
        {5: ("bow", 2, 5, None), 33: ("bow", 2, 5, 30)},
    ),
    "4: also after 0.4 s of it": (
        (rest(2), sure(12), unsure_rest(8), sure(8), rest(9)),
        {5: ("bow", 2, 5, None), 33: ("bow", 2, 5, 30)},
    ),
    "4: but not after more": (
        (rest(2), sure(12), unsure_rest(9), sure(8), rest(9)),
        {5: ("bow", 2, 5, None), 22: ("bow", 2, 5, 14), 26: ("bow", 23, 26, None), 34: ("bow", 23, 26, 31)},
    ),
    "4: rest beyond doubt ends a movement, however soon the same follows": (
        (rest(2), sure(12), rest(6), sure(8), rest(9)),
        {5: ("bow", 2, 5, None), 17: ("bow", 2, 5, 14), 23: ("bow", 20, 23, None), 31: ("bow", 20, 23, 28)},
    ),
    "4: rest becomes beyond doubt": (
        (rest(2), sure(12), unsure_rest(2), rest(6), sure(8), rest(9)),
        {5: ("bow", 2, 5, None), 19: ("bow", 2, 5, 14), 25: ("bow", 22, 25, None), 33: ("bow", 22, 25, 30)},
    ),
    "3: a label that comes back as the movement begins was not held before": (
        (rest(2), sure(12), rest(12), sure_at_rest(1), sure(8), rest(9)),
        {5: ("bow", 2, 5, None), 17: ("bow", 2, 5, 14), 30: ("bow", 27, 30, None), 38: ("bow", 27, 30, 35)},
    ),
    "1: certainty at rest is no movement": ((sure_at_rest(30),), {}),
    "1: as likely at rest as not is no movement": (([("bow", 0.9, 4, 0.5)] * 30,), {}),
    "1: motion of two steps is no movement": ((rest(5), moving(2), rest(20)), {}),
    "1: nor is motion of less than 0.3 s as the posteriors begin, undecided": ((moving(5), rest(20)), {}),
    "1: which is one once the person has rested": ((rest(1), moving(5), rest(20)), {9: ("abstain", 1, 9, 6)}),
    "1: what follows a decided movement without rest is of that one, unless it has a label of its own": (
        (rest(2), sure(10), moving(30, "lunge"), rest(9)),
        {5: ("bow", 2, 5, None), 18: ("bow", 2, 5, 12)},
    ),
    "1: with a label it is the next movement": (
        (rest(2), sure(10), moving(20, "lunge"), sure(9, "punch"), rest(9)),
        {5: ("bow", 2, 5, None), 18: ("bow", 2, 5, 12), 35: ("punch", 19, 35, None), 44: ("punch", 19, 35, 41)},
    ),
    "1: after something else it is one of its own": (
        (rest(2), sure(10), else_steps(9), moving(20, "lunge"), rest(9)),
        {5: ("bow", 2, 5, None), 20: ("bow", 2, 5, 12), 44: (ABSTAIN, 21, 44, 41)},
    ),
    "1: and so it is after rest": (
        (rest(2), sure(10), rest(4), moving(20, "lunge"), rest(9)),
        {5: ("bow", 2, 5, None), 15: ("bow", 2, 5, 12), 39: (ABSTAIN, 16, 39, 36)},
    ),
    "1: a flicker of rest does not repeat the last movement": (
        (sure(10), sure_at_rest(10), sure(1), sure_at_rest(10), sure(2), sure_at_rest(10)),
        {3: ("bow", 0, 3, None), 13: ("bow", 0, 3, 10)},
    ),
    "2: a break restarts the hold": ((sure(3), moving(1), sure(3), moving(1), sure(4)), {11: ("bow", 0, 11, None)}),
    "2: another label restarts the hold": (
        (sure(3), sure(3, "lunge"), sure(3), sure(4, "lunge")),
        {12: ("lunge", 0, 12, None)},
    ),
    "2: below the quorum nothing is decided": ((sure(20, agreeing=1),), {}),
    "2: the quorum must be met throughout": ((sure(3), sure(1, agreeing=1), sure(4)), {7: ("bow", 0, 7, None)}),
    "2: the threshold is met when it is reached": ((moving(4, p=0.8),), {3: ("bow", 0, 3, None)}),
    "2: just below the threshold": ((moving(20, p=0.7999),), {}),
    "2: decided at once on coming to rest": (
        (moving(4), sure_at_rest(9)),
        {4: ("bow", 0, 4, None), 7: ("bow", 0, 4, 4)},
    ),
    "4: a short rest is part of the movement": (
        (sure(6), rest(2), sure(6), rest(9)),
        {3: ("bow", 0, 3, None), 17: ("bow", 0, 3, 14)},
    ),
    "6: the label held on coming to rest replaces the decision": (
        (sure(5), sure(5, "lunge"), sure_at_rest(5, "lunge")),
        {3: ("bow", 0, 3, None), 10: ("bow>lunge", 0, 10, None), 13: ("bow>lunge", 0, 10, 10)},
    ),
    "6: a change of mind in between is not published": (
        (sure(5), sure(5, "lunge"), sure(5), sure_at_rest(5)),
        {3: ("bow", 0, 3, None), 18: ("bow", 0, 3, 15)},
    ),
    "6: a label held too briefly on coming to rest is not published": (
        (sure(5), sure(2, "lunge"), sure_at_rest(5, "lunge")),
        {3: ("bow", 0, 3, None), 10: ("bow", 0, 3, 7)},
    ),
    "6: a label held only at rest, by an observer that is stuck, does not win": (
        (sure(10), sure_at_rest(9, "lunge")),
        {3: ("bow", 0, 3, None), 13: ("bow", 0, 3, 10)},
    ),
    "6: a revision stays when the rest is interrupted": (
        (sure(5), sure(5, "lunge"), sure_at_rest(1, "lunge"), sure(3, "lunge"), sure_at_rest(5)),
        {3: ("bow", 0, 3, None), 10: ("bow>lunge", 0, 10, None), 17: ("bow>lunge", 0, 10, 14)},
    ),
    "6: a revision may be revised": (
        (sure(5), sure(5, "lunge"), sure_at_rest(1, "lunge"), sure(5), sure_at_rest(5)),
        {
            3: ("bow", 0, 3, None),
            10: ("bow>lunge", 0, 10, None),
            16: ("lunge>bow", 0, 16, None),
            19: ("lunge>bow", 0, 16, 16),
        },
    ),
    "5: undecided is an abstention": ((rest(2), moving(9), rest(9)), {14: (ABSTAIN, 2, 14, 11)}),
    "5: without a quorum is an abstention": ((sure(9, agreeing=1), rest(9)), {12: (ABSTAIN, 0, 12, 9)}),
    "5: a quorum met in time is waited for": (
        (sure(6, agreeing=1), sure_at_rest(2, agreeing=1), sure_at_rest(9)),
        {11: ("bow", 0, 11, 6)},
    ),
    "5: labels in turn are not waited for for ever": ((moving(6), TWO_LABELS_IN_TURN), {12: (ABSTAIN, 0, 12, 6)}),
    "5: a late label is not waited for for ever": ((moving(6), rest(4), sure_at_rest(9)), {9: (ABSTAIN, 0, 9, 6)}),
}


@pytest.mark.parametrize(("parts", "expected"), CASES.values(), ids=CASES)
def test_rules_1_to_6(parts, expected):
    assert decisions(*parts) == expected


def test_2_without_a_hold_it_is_decided_at_once():
    config = CONFIG.model_copy(update={"hold_s": 0.0})
    assert decisions(rest(1), sure(3), rest(3), config=config) == {1: ("bow", 1, 1, None), 4: ("bow", 1, 1, 4)}


def test_6_without_a_hold_a_revision_precedes_the_end_in_one_step():
    config = CONFIG.model_copy(update={"hold_s": 0.0})
    segmenter = Segmenter(config, NAMES)
    states = [PooledState(n, label, 0.9, 2, rest) for n, (label, rest) in enumerate([("bow", 0.1), ("lunge", 0.9)])]
    (first,), (revised, ended) = map(segmenter.update, states)
    assert [(d.stage, d.label, d.revises) for d in (first, revised, ended)] == [
        ("decided", "bow", None), ("revised", "lunge", "bow"), ("ended", "lunge", "bow"),
    ]  # fmt: skip
    assert revised.ended_ns is None and ended.ended_ns == 1 and segmenter.movement is None


def test_6_a_movement_is_revised_a_few_times_at_most():
    config = CONFIG.model_copy(update={"hold_s": 0.1})
    parts = [part for label in ("bow", "lunge") * 5 for part in (sure(3, label), sure_at_rest(1, label))]
    labels = [label for label, *_ in decisions(*parts[:8], config=config).values()]
    assert labels[:4] == ["bow", "bow>lunge", "lunge>bow", "bow>lunge"] and REVISIONS_LIMIT == 3
    # Without rest, too: each of the first three was revised as the person came to rest. Then it is the next movement.
    labels = [label for label, *_ in decisions(*parts[:8], sure(30), config=config).values()]
    assert labels == ["bow", "bow>lunge", "lunge>bow", "bow>lunge", "bow>lunge", "bow"]


@pytest.mark.parametrize(
    ("unlearned", "steps", "words"),
    [
        (0.7, 7, [("decided", "bow"), ("ended", "bow")]),
        (0.9, 7, [("decided", "bow"), ("revised", ABSTAIN), ("ended", ABSTAIN)]),
        (0.9, 5, [("decided", "bow"), ("ended", "bow")]),
        (0.9, 0, [("decided", "bow"), ("ended", "bow")]),
    ],
)
def test_6_something_else_that_is_no_rest_revokes_the_verdict(unlearned, steps, words):
    parts = sure(8) + [("bow", 0.05, 2, 0.1, unlearned)] * steps + [("bow", 0.05, 2, 0.9, 0.95)] * 8
    published = play(parts, Segmenter(CONFIG.model_copy(update={"hold_s": 0.3}), NAMES))
    assert [(d.stage, d.label) for d in published] == words and {d.began_ns for d in published} == {0}
    assert published[-1].ended_ns == (8 + steps) * STEP_NS


RULE_7 = {
    "rest in which observers contradict each other, and then another label: the next": (
        (rest(2), sure(12), unsure_rest(6), sure(8, "lunge"), rest(9)),
        [
            ("decided", "bow", 2, None),
            ("ended", "bow", 2, 20),
            ("decided", "lunge", 20, None),
            ("ended", "lunge", 20, 28),
        ],
    ),
    "something else alone is no movement": ((else_steps(50),), []),
    "a movement between other motion": (
        (else_steps(5), sure(10), else_steps(12)),
        [("decided", "bow", 5, None), ("ended", "bow", 5, 15)],
    ),
    "a flicker of something else ends nothing": (
        (sure(6), else_steps(5), sure(6), rest(5)),
        [("decided", "bow", 0, None), ("ended", "bow", 0, 17)],
    ),
    "one movement follows another directly": (
        (sure(12), sure(12, "lunge"), rest(5)),
        [
            ("decided", "bow", 0, None),
            ("ended", "bow", 0, 12),
            ("decided", "lunge", 12, None),
            ("ended", "lunge", 12, 24),
        ],
    ),
    "a premature word is revised": (
        (sure(5), sure(20, "lunge"), rest(5)),
        [("decided", "bow", 0, None), ("revised", "lunge", 0, None), ("ended", "lunge", 0, 25)],
    ),
    "another label after something else is the next movement": (
        (sure(4), else_steps(1), sure(6, "lunge"), rest(5)),
        [("decided", "bow", 0, None), ("ended", "bow", 0, 5), ("decided", "lunge", 5, None), ("ended", "lunge", 5, 11)],
    ),
    "a label that has faded has ended": (
        (sure(6), moving(20, p=0.2), sure(6), rest(5)),
        [("decided", "bow", 0, None), ("ended", "bow", 0, 6), ("decided", "bow", 13, None), ("ended", "bow", 13, 32)],
    ),
    "a label half as likely as demanded has not faded": (
        (sure(6), moving(20, p=0.4), rest(5)),
        [("decided", "bow", 0, None), ("ended", "bow", 0, 26)],
    ),
    "fewer observers than name a movement end none": (
        (sure(6), sure(12, "lunge", agreeing=1), sure(4), rest(5)),
        [("decided", "bow", 0, None), ("ended", "bow", 0, 22)],
    ),
    "undecided, it was something else": ((moving(6), else_steps(12), rest(5)), []),
}


@pytest.mark.parametrize(("parts", "expected"), RULE_7.values(), ids=RULE_7)
def test_7_movements_without_rest(parts, expected):
    assert in_steps(play([*chain(*parts)])) == expected


TAKES = {"bow": MovementTimes(shortest_s=2.0), "lunge": MovementTimes(shortest_s=0.4)}


@pytest.mark.parametrize(
    ("first", "contested", "is_revised"),
    [(("bow", 19), False, True), (("bow", 19), True, True), (("bow", 22), False, False), (("lunge", 12), False, False)],
    ids=["too soon", "too soon, and contested", "late enough", "a short movement"],
)
def test_7_another_label_before_the_first_can_be_over_revises_it(first, contested, is_revised):
    """Hardly any bow is over before 1.03 s, 21 steps: two thirds of its shortest take, less 0.3 s."""
    segmenter, (label, steps), published = Segmenter(CONFIG, Vocabulary(NAMES.labels, movements=TAKES)), first, []
    second = "lunge" if label == "bow" else "bow"
    course = [(label, 0.1, False)] * steps + [(second, 0.1, contested)] * 20 + [(second, 0.9, False)] * 5
    for n, (name, rest_p, is_contested) in enumerate(course):
        state = PooledState(n * STEP_NS, name, 0.9, 2, rest_p, contested=is_contested)
        published += [(each.stage, each.label, each.began_ns // STEP_NS) for each in segmenter.update(state)]
    revised = [("decided", label, 0), ("revised", second, 0), ("ended", second, 0)]
    two = [("decided", label, 0), ("ended", label, 0), ("decided", second, steps), ("ended", second, steps)]
    assert published == (revised if is_revised else two)


@pytest.mark.parametrize(("steps", "movements"), [(8, 2), (7, 1)])
def test_4_a_movement_that_has_lasted_as_long_as_a_take_needs_half_as_much_rest(steps, movements):
    """The shortest lunge has eight steps, the hold three; rest is seen for two frames more than it began."""
    course = [*sure(steps, "lunge"), *sure_at_rest(3, "lunge"), *sure(8, "lunge"), *rest(5)]
    published = play(course, Segmenter(CONFIG, Vocabulary(NAMES.labels, movements=TAKES)))
    assert [each.stage for each in published] == ["decided", "ended"] * movements


def test_nothing_begins_where_something_else_is_likelier_than_not():
    segmenter = Segmenter(CONFIG, NAMES)
    for n, unlearned in enumerate([0.51] * 20 + [0.5]):
        assert segmenter.movement is None
        segmenter.update(PooledState(n * STEP_NS, "bow", 0.3, 0, 0.1, unlearned))
    assert segmenter.movement is not None


@pytest.mark.parametrize(("unseen", "ends"), [(range(3), 0), (range(3, 6), 0), (range(0), 1)])
def test_1_where_nobody_was_seen_the_person_has_not_been_seen_at_rest(unseen, ends):
    """The motion is too short for a first movement, and long enough for another one."""
    segmenter, published = Segmenter(CONFIG, NAMES), []
    for step, part in enumerate([*rest(3 + unseen.start), *moving(5), *rest(20)]):
        published += segmenter.update(state_of(step, part, observed=step not in unseen))
    assert [each.label for each in published] == ["abstain"] * ends


@pytest.mark.parametrize(("steps", "ends"), [(3, 1), (8, 2)])
def test_1_what_is_short_after_something_else_within_a_movement_is_its_end(steps, ends):
    """The shortest bow takes 1 s: half of it less 0.3 s is 4 steps."""
    names = Vocabulary(NAMES.labels, movements={"bow": MovementTimes(shortest_s=1.0)})
    parts = chain(rest(2), sure(20), else_steps(7), moving(steps, "lunge"), rest(20))
    assert len([d for d in play(list(parts), Segmenter(CONFIG, names)) if d.stage == "ended"]) == ends


def test_3_that_all_observers_go_is_no_rest():
    """The router is killed as a movement begins; what the observers held then is the label of the one before."""
    for observed, stages in ((True, ["decided"]), (False, [])):
        segmenter, published = Segmenter(CONFIG, NAMES), []
        for step, part in enumerate([*sure_at_rest(10), *sure(4), *rest(2)]):
            published += segmenter.update(state_of(step, part, observed=observed or step < 14))
        assert [d.stage for d in published] == stages


def test_without_observers_nothing_ends_or_begins():
    segmenter = Segmenter(CONFIG, NAMES)
    published = play(sure(5), segmenter)
    silent = [PooledState(n * STEP_NS, "lunge", 0.5, 0, 0.1, observed=False) for n in range(5, 30)]
    assert [d.stage for d in published] == ["decided"] and not any(segmenter.update(state) for state in silent)
    assert segmenter.movement.began_ns == 0
    assert not any(Segmenter(CONFIG, NAMES).update(state) for state in silent)


def test_12_after_a_clock_was_set_back_detection_starts_afresh():
    segmenter = Segmenter(CONFIG, NAMES)
    play(sure(4), segmenter, first=100)
    assert segmenter.movement.decision is not None and segmenter.basis_times == {103 * STEP_NS}
    assert play(sure(3), segmenter) == [] and play(sure(1), segmenter, first=3)[0].began_ns == 0


def test_evidence_is_needed_until_the_end_and_no_longer():
    segmenter, needed = Segmenter(CONFIG, NAMES), []
    for step, part in enumerate(sure(5) + sure(7, "lunge") + sure_at_rest(6, "lunge")):
        segmenter.update(state_of(step, part))
        needed.append({t // STEP_NS for t in segmenter.basis_times})
    assert needed == [set()] * 3 + [{3}] * 9 + [{12}] * 3 + [set()] * 3


# Any beliefs at any times

CHOICES = (["bow", "lunge"], [0.3, 0.9, 0.9], [0, 2, 2], [0.0, 0.2, 0.5, 1.0], range(401), range(1, 7))
STEPS = st.lists(st.tuples(*map(st.sampled_from, CHOICES)), max_size=60)
"""Label, p, agreeing, rest, milliseconds between two steps, number of steps."""
CONFIGS = st.builds(
    FusionConfig, threshold=st.just(0.8), quorum=st.integers(1, 3), hold_s=st.sampled_from([0.0, 0.1, 0.3, 1.0])
)


def states(steps, start_ns=0):
    at_ns = start_ns
    for n, (label, p, agreeing, rest_p, wait_ms, times) in enumerate(steps):
        for _ in range(times):
            at_ns += wait_ms * 1_000_000
            yield n, PooledState(at_ns, label, p, agreeing, rest_p)


@given(STEPS, CONFIGS)
def test_a_movement_has_one_first_word_a_few_revisions_and_one_end_and_its_times_are_in_order(steps, config):
    segmenter, history, published = Segmenter(config, NAMES), [], []
    hold_ns = config.hold_s * 1e9
    for _, state in states(steps):
        history.append(state)
        published += [(state.at_ns, decision, tuple(history)) for decision in segmenter.update(state)]
    for at_ns, d, until_then in published:
        assert d.began_ns <= d.decided_ns <= at_ns and d.label in ("bow", "lunge", ABSTAIN)
        if d.ended_ns is None:
            assert d.decided_ns == at_ns and d.label != ABSTAIN
        else:
            assert d.began_ns <= d.ended_ns <= at_ns and d.ended_ns - d.began_ns >= hold_ns
            # As wire.md says; one step is at most 400 ms long.
            assert d.decided_ns - d.ended_ns <= 2 * hold_ns + 4e8
            assert at_ns - d.ended_ns >= hold_ns
            later = [state for state in until_then if d.ended_ns < state.at_ns]
            faded = all(s.rest >= 0.5 or s.label != d.label or 2 * s.p < config.threshold for s in later)
            assert faded if d.label != ABSTAIN else all(s.rest >= 0.5 for s in later)
        if d.label != ABSTAIN:
            at_rest = any(state.at_ns == d.decided_ns and state.rest >= 0.5 for state in until_then)
            # On coming to rest a label is decided at once; it need not have been held for long.
            since_ns = d.decided_ns - (0 if at_rest else hold_ns)
            held = [state for state in until_then if since_ns < state.at_ns < d.decided_ns]
            assert all(s.label == d.label and s.p >= config.threshold and s.agreeing >= config.quorum for s in held)
    spans = []
    for began_ns, words in groupby((d for _, d, _ in published), key=lambda d: d.began_ns):
        check_words(list(words))
        spans.append(began_ns)
    assert len(set(spans)) == len(spans), "all words on a movement precede those on the next"
    ends = [(d.began_ns, d.ended_ns) for _, d, _ in published if d.ended_ns is not None]
    assert set(spans[:-1]) <= {began_ns for began_ns, _ in ends}
    assert all(one[1] <= other[0] for one, other in pairwise(ends))


def check_words(words):
    """What a listener relies on: of one movement a first word, then revisions, then one end with the last label."""
    stages, labels = [d.stage for d in words], [d.label for d in words]
    revised = stages.count("revised")
    assert stages in (["ended"], ["decided", *["revised"] * revised, "ended"][: len(stages)])
    assert revised <= REVISIONS_LIMIT
    for before, after in pairwise(words):
        if after.stage == "revised":
            assert after.revises == before.label != after.label
        else:
            assert (after.label, after.revises) == (before.label, before.revises)
    assert ABSTAIN not in labels[:1] or stages == ["ended"]


@given(STEPS)
def test_times_that_jump_back_and_forth_raise_nothing(steps):
    segmenter, at_ns, last_ns = Segmenter(CONFIG, NAMES), 10**12, 0
    for n, state in states(steps):
        at_ns, last_ns = at_ns + (state.at_ns - last_ns) * (-1 if n % 7 == 6 else 1), state.at_ns
        decided = segmenter.update(PooledState(at_ns, state.label, state.p, state.agreeing, state.rest))
        assert all(decision.began_ns <= (decision.ended_ns or at_ns) for decision in decided)


@given(STEPS, st.integers(0, 10**18))
def test_only_differences_of_time_count(steps, shift_ns):
    def decided(start_ns):
        segmenter = Segmenter(CONFIG, NAMES)
        results = [d for _, state in states(steps, start_ns) for d in segmenter.update(state)]
        return [(d.label, *(t and t - start_ns for t in (d.began_ns, d.decided_ns, d.ended_ns))) for d in results]

    assert decided(10**9) == decided(10**9 + shift_ns)


@pytest.mark.parametrize(
    ("gap_s", "before", "after", "state"),
    [
        (1.0, sure(6), sure(1, p=0.7), SegmentState.DECIDED),
        (1.1, sure(6), sure(1, p=0.7), SegmentState.DECIDED),
        (1.1, sure(6), sure(1, "lunge"), SegmentState.PASSED),
        (1.1, sure(6), rest(1), SegmentState.ENDING),
        (4.0, sure(6), sure(1, "lunge"), SegmentState.PASSED),
        (5.1, sure(6), sure(1), SegmentState.IDLE),
        (1.0, moving(6), moving(1), SegmentState.MOVING),
        (1.0, moving(6), rest(1), SegmentState.PAUSED),
        (2.0, moving(6), rest(1), SegmentState.LOST),
        (2.1, moving(6), rest(1), SegmentState.IDLE),
        (2.0, moving(6), moving(1), SegmentState.MOVING),
        (5.1, moving(6), moving(1), SegmentState.MOVING),
    ],
)
def test_9_the_effect_of_an_outage_depends_on_its_length_and_on_whether_there_was_a_decision(
    gap_s, before, after, state
):
    segmenter = Segmenter(CONFIG, NAMES)
    play(before, segmenter, first=1)
    last_ns, began_ns = len(before) * STEP_NS, segmenter.movement.began_ns
    at_ns = last_ns + round(gap_s * SECOND_NS)
    play(after, segmenter, first=at_ns // STEP_NS)
    assert segmenter.state is state
    if segmenter.movement is not None:
        is_decided, was_outage = segmenter.movement.decision is not None, gap_s > 1.0
        assert segmenter.movement.outage_ns == (last_ns if is_decided and was_outage else None)
        assert segmenter.movement.began_ns == (at_ns if state is SegmentState.MOVING and was_outage else began_ns)


def test_9_an_older_capture_of_a_service_that_is_followed_makes_no_outage():
    segmenter = Segmenter(CONFIG, NAMES)
    play(sure(20), segmenter, first=100)
    segmenter.follow(segmenter.movement, 40 * STEP_NS)
    play(sure(1), segmenter, first=130)
    assert segmenter.movement.outage_ns is None


@pytest.mark.parametrize(("steps", "decided"), [(2, 12), (10, 3)], ids=["just after it", "later"])
def test_9_a_movement_that_begins_just_after_an_outage_is_decided_later(steps, decided):
    published = play([*rest(2), *rest(steps), *sure(20, "lunge")], gap=(2, 30))
    assert [(d.stage, (d.decided_ns - d.began_ns) // STEP_NS) for d in published] == [("decided", decided)]


def test_9_after_an_outage_the_next_movement_is_decided_later_too():
    published = play([*sure(6), *sure(20, "lunge")], gap=(6, 30))
    steps = [(d.stage, d.label, d.began_ns // STEP_NS, d.decided_ns // STEP_NS) for d in published]
    assert steps == [("decided", "bow", 0, 3), ("ended", "bow", 0, 3), ("decided", "lunge", 36, 48)]


def test_9_something_else_after_an_outage_does_not_revoke_the_verdict():
    segmenter, still = Segmenter(CONFIG.model_copy(update={"hold_s": 0.3}), NAMES), [("bow", 0.05, 0, 0.9, 0.95)] * 10
    published = play([*sure(10), *else_steps(8), *still], segmenter, gap=(10, 30))
    assert [(d.stage, d.label) for d in published] == [("decided", "bow"), ("ended", "bow")]
    assert published[-1].ended_ns == 9 * STEP_NS


def words_after_a_gap(before, gap, after, restart=False):
    """Label and stage of the decisions of a story in which no observer is heard for `gap` steps."""
    segmenter, words, newest_capture_ns = Segmenter(CONFIG, NAMES), [], 0
    for step, part in enumerate(chain(before, before[-1:] * gap, after)):
        at_ns, is_heard = step * STEP_NS, not len(before) <= step < len(before) + gap
        newest_capture_ns = at_ns if is_heard else newest_capture_ns
        if restart and not is_heard:
            # The service was killed: another one continues from its checkpoint.
            following, segmenter = segmenter, Segmenter(CONFIG, NAMES)
            segmenter.follow(following.movement, newest_capture_ns)
            continue
        published = segmenter.update(state_of(step, part, newest_capture_ns=newest_capture_ns))
        words += [
            (label, stage, began if ended is None else ended) for stage, label, began, ended in in_steps(published)
        ]
    return words


@pytest.mark.parametrize("restart", [False, True], ids=["router", "service"])
def test_9_after_a_gap_another_label_is_the_next_movement_and_the_same_one_goes_on(restart):
    gone = {"gap": 30, "restart": restart}
    bow = ("bow", "decided", 1)
    assert words_after_a_gap([*rest(1), *sure(5)], after=[*sure(8), *rest(4)], **gone) == [bow, ("bow", "ended", 44)]
    # The bow ended when it was heard last, for all that is known.
    over = ("bow", "ended", 5)
    lunge = [("lunge", "decided", 36), ("lunge", "ended", 44)]
    assert words_after_a_gap([*rest(1), *sure(5)], after=[*sure(8, "lunge"), *rest(4)], **gone) == [bow, over, *lunge]
    # A lunge that nobody saw does not replace the bow that was decided.
    assert words_after_a_gap([*rest(1), *sure(5)], after=sure_at_rest(9, "lunge"), **gone) == [bow, over]


def test_9_nor_is_an_outage_lost_on_a_service_that_follows_the_one_that_noticed_it():
    """Both services were frozen; the owner comes back second, after one judgement of the other."""
    first, second = Segmenter(CONFIG, NAMES), Segmenter(CONFIG, NAMES)
    play([*rest(1), *sure(5)], first)
    second.follow(first.movement, 5 * STEP_NS)
    play(sure(1, "lunge"), second, first=95)
    first.follow(second.movement, 95 * STEP_NS)
    words = in_steps(play(sure(8, "lunge"), first, first=96))
    assert words[0] == ("ended", "bow", 1, 5) and words[1][:2] == ("decided", "lunge")


def test_9_nor_on_one_that_has_just_started_and_takes_over():
    """Seen in a storm: both services were killed twice; one noticed the outage, the other one was given the scene."""
    killed, noticed, started = (Segmenter(CONFIG, NAMES) for _ in range(3))
    play([*rest(1), *sure(5)], killed)
    noticed.follow(killed.movement, 5 * STEP_NS, killed.movement.outage_ns)
    play(sure(1, "lunge"), noticed, first=45)
    started.follow(noticed.movement, 45 * STEP_NS, noticed.movement.outage_ns)
    words = in_steps(play(sure(8, "lunge"), started, first=46))
    assert words[0] == ("ended", "bow", 1, 5) and words[1][:2] == ("decided", "lunge")
    assert killed.movement.outage_ns is None and started.movement.outage_ns is None


def test_9_a_movement_that_was_not_decided_before_the_gap_begins_after_it():
    after = [*sure(8, "lunge"), *rest(4)]
    begins = {gap: words_after_a_gap([*rest(1), *moving(5)], gap, after)[0][2] for gap in (19, 25)}
    assert begins == {19: 1, 25: 31}, "an outage of a second does not split a movement"


@pytest.mark.parametrize("restart", [False, True], ids=["router", "service"])
def test_9_after_a_long_gap_the_same_label_is_another_movement(restart):
    before, after = [*rest(1), *sure(5)], [*sure(16), *rest(4)]
    words = words_after_a_gap(before, 120, after, restart)
    ended = [("bow", "decided", 1), ("bow", "ended", 5)]
    assert words == [*ended, ("bow", "decided", 127), ("bow", "ended", 142)]
    assert words_after_a_gap(before, 60, after, restart) == [("bow", "decided", 1), ("bow", "ended", 82)]


def test_9_what_the_first_heard_again_name_is_the_movement_before():
    """Both services were killed; the one that starts hears an observer that is frozen, and two that hardly see yet."""
    begun = [*sure(6, "punch"), *sure(8, "lunge"), *rest(4)]
    for restart in (False, True):
        words = words_after_a_gap(rest(2), 30, begun, restart)
        assert words == [("lunge", "decided", 32), ("lunge", "ended", 46)]


@pytest.mark.parametrize("restart", [False, True], ids=["router", "service"])
def test_9_nor_does_one_go_on_that_was_over_when_observers_are_heard_again(restart):
    before, gone = [*rest(1), *moving(5)], {"gap": 30, "restart": restart}
    story = [*rest(1), *sure(8, "lunge"), *rest(4)]
    assert words_after_a_gap(before, after=story, **gone)[0] == ("lunge", "decided", 37)
    # What observers still say at rest is about the movement that nobody heard to its end.
    assert words_after_a_gap(before, after=sure_at_rest(9), **gone)[0] == ("bow", "decided", 1)
    # But not after so long that another movement may have come and gone.
    words = words_after_a_gap(before, 60, [*sure_at_rest(9, "lunge"), *sure(8), *rest(4)], restart)
    assert words[0][:2] == (ABSTAIN, "ended") and words[1][:2] == ("bow", "decided")
