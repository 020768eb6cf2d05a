"""Who is named as contradicted: whoever leaves what was decided, again and again, or jumps about."""

import pytest
from engine_stage import LABELS, MOVING, REST, UNIFORM, VIEWS, EngineDriver, sure

from common.message_types import CONTRADICTED

HONEST, LIAR = VIEWS[:3], VIEWS[3]


class Scene:
    """Three honest observers and one more; each movement has the next label."""

    def __init__(self):
        self.driver, self.movements, self.named = EngineDriver(quorum=2, hold_s=0.1), 0, []

    def step(self, posteriors, rest, times):
        for _ in range(times):
            judgement = self.driver.step(posteriors, rest)
            votes = judgement.votes.items()
            self.named.append({name for name, vote in votes if (vote.label_reliability or 1.0) < CONTRADICTED})

    def movement(self, own, others=(0, 0, 0), leaves_after=0):
        """own, others: how far each label lies from the movement's; None: no label. leaves_after: so many steps."""
        n = self.movements
        self.movements += 1

        def label(ahead):
            return UNIFORM if ahead is None else sure(LABELS[(n + ahead) % 3], 0.96)

        honest = dict(zip(HONEST, map(label, others), strict=True))
        self.step(
            {**dict.fromkeys(HONEST, label(0)), LIAR: label(0 if leaves_after else own)}, MOVING, leaves_after or 6
        )
        self.step({**honest, LIAR: label(own)}, MOVING, 9)
        self.step(dict.fromkeys(VIEWS, UNIFORM), REST, 20)


def test_one_that_leaves_what_was_decided_is_named_within_three_movements():
    scene = Scene()
    for _ in range(3):
        scene.movement(1, leaves_after=6)
    assert scene.named[-1] == {LIAR} and set().union(*scene.named) == {LIAR}


def test_one_that_is_wrong_from_the_first_frame_is_named_after_the_first_movement():
    scene = Scene()
    scene.movement(1)
    assert scene.named[-1] == {LIAR}


def test_one_that_agrees_again_is_not_named_for_good():
    scene = Scene()
    for own in [1] * 3 + [0] * 12:
        scene.movement(own, leaves_after=6)
    assert scene.named[-1] == set()


@pytest.mark.parametrize(
    "how",
    [{"own": None}, {"own": 1, "others": (0, 1, 1)}, {"own": 1, "others": (0, 0, 1)}],
    ids=["says nothing", "of two pairs", "not alone"],
)
def test_nobody_is_named_for_what_honest_observers_do(how):
    scene = Scene()
    for n in range(6):
        scene.movement(**(how if n % 3 == 2 else {"own": 0}), leaves_after=6)
    assert LIAR not in set().union(*scene.named) or how["own"] is not None
    assert scene.named[-1] == set()


def test_two_wrong_ones_of_a_dozen_name_nobody():
    scene = Scene()
    for n in range(12):
        scene.movement(1 if n in (5, 6) else 0, leaves_after=6)
    assert set().union(*scene.named) == set()


def test_jumping_about_names_an_observer_and_nobody_else():
    scene = Scene()
    for n in range(60):
        scene.step({**dict.fromkeys(HONEST, UNIFORM), LIAR: sure(LABELS[n % 3], 0.95)}, REST, 1)
    assert scene.named[-1] == {LIAR} and set().union(*scene.named) == {LIAR}
