"""Who is named as contradicted: whoever leaves what was decided, again and again, or jumps about."""

import pytest

from common import SECOND_NS
from common.messages import OngoingMovement, Vote
from fusion.engine.label_trust import LabelTrust
from fusion.engine.roster import ObserverRecord

BEGAN_NS, STEP_S = 1_800_000_000 * SECOND_NS, 0.1
CONTRADICTED = 0.6
HONEST = ("a", "b", "c")


class Scene:
    """Steps of a scene of three honest observers and `x`."""

    def __init__(self, learned=1.0):
        self.trust, self.at_s, self.movements = LabelTrust(), 0.0, 0
        self.records = {name: ObserverRecord(reliability=learned if name == "x" else 1.0) for name in (*HONEST, "x")}

    def step(self, labels, decided=None, steadiness=1.0):
        now_ns = BEGAN_NS + round(self.at_s * SECOND_NS)
        trusts = {
            name: record.reliability * (steadiness if name == "x" else 1.0) for name, record in self.records.items()
        }
        votes = {
            name: Vote(
                label=label, entropy=0.1, weight=0.2, age_s=0.1, state="counted", p=[1.0], reliability=trusts[name]
            )
            for name, label in labels.items()
        }
        movement = OngoingMovement(id=f"m{self.movements}", began_ns=now_ns, label=decided) if decided else None
        self.trust.update(votes, movement, self.records, now_ns)
        self.at_s += STEP_S

    def movement(self, own, others=("bow", "bow", "bow"), lasts_s=1.5, left_s=0.9):
        """x votes for `own` in the last `left_s`."""
        self.movements += 1
        for n in range(round(lasts_s / STEP_S)):
            late = n * STEP_S >= lasts_s - left_s
            labels = dict(zip(HONEST, others, strict=True)) if late else dict.fromkeys(HONEST, "bow")
            self.step({**labels, "x": own if late else "bow"}, decided="bow")
        for _ in range(5):
            self.step(dict.fromkeys((*HONEST, "x")))

    @property
    def named(self):
        return {name for name, trust in self.trust.reliability.items() if trust < CONTRADICTED}


def test_one_that_leaves_what_was_decided_is_named_after_three_movements():
    scene, named = Scene(), []
    for _ in range(4):
        scene.movement("wave")
        named.append(scene.named)
    assert named == [set(), set(), {"x"}, {"x"}]


def test_one_that_agrees_again_is_not_named_for_good():
    scene = Scene()
    for own in ["wave"] * 3 + ["bow"] * 4:
        scene.movement(own)
    assert scene.named == set()


@pytest.mark.parametrize(
    "how",
    [
        {"own": None},
        {"own": "wave", "left_s": 0.4},
        {"own": "wave", "lasts_s": 0.2},
        {"own": "wave", "others": ("bow", "bow", "wave")},
        {"own": "wave", "others": ("bow", None, None)},
    ],
    ids=["says nothing", "for a moment", "short", "not alone", "against one"],
)
def test_nobody_is_named_for_what_honest_observers_do(how):
    scene = Scene()
    for _ in range(6):
        scene.movement(**how)
    assert scene.named == set()


def test_two_wrong_ones_of_a_dozen_name_nobody():
    scene = Scene()
    for n in range(12):
        scene.movement("wave" if n in (5, 6) else "bow")
        assert scene.named == set()


def test_a_moment_without_steadiness_names_nobody_and_a_minute_does():
    scene = Scene()
    for n in range(600):
        scene.step(dict.fromkeys((*HONEST, "x")), steadiness=0.1 if n % 40 < 4 else 1.0)
        assert scene.named == set()
    for _ in range(100):
        scene.step(dict.fromkeys((*HONEST, "x")), steadiness=0.1)
    assert scene.named == {"x"}


def test_what_verdicts_taught_names_at_once():
    scene = Scene(learned=0.5)
    scene.step(dict.fromkeys((*HONEST, "x")))
    assert scene.named == {"x"}
