"""Rest is decided by the observers together: no single one of three, nor a stuck or flapping one of two, decides it."""

import math
from dataclasses import replace

import numpy as np
import pytest
from engine_stage import LABELS, UNIFORM, EngineDriver, aged, sure
from hypothesis import example, given
from hypothesis import strategies as st

from common import SECOND_NS
from fusion.engine.rest import GAIN, RestPool, pooled_rest
from fusion.engine.trust import BLUR, HONEST, MEMORY, OBSERVATION_S
from fusion.engine.verdicts import CONTESTED_REST

STEP_NS = 100_000_000


def resting(*votes):
    """Observers with these (rest, freshness)."""
    return [aged_rest(n, rest, freshness) for n, (rest, freshness) in enumerate(votes)]


def aged_rest(n, rest, freshness, state="counted"):
    """An observer's aged posterior with this rest."""
    return replace(aged(f"cam{n}", UNIFORM, state), rest=rest, freshness=freshness)


@given(st.lists(st.tuples(st.floats(0, 1), st.floats(0.01, 1)), min_size=1, max_size=6), st.floats(0.1, 1))
@example([(1.0, 0.578125), (1.0, 0.578125), (0.07463064547557031, 0.578125)], 1.0)
def test_rest_is_a_median_that_needs_no_order_and_no_scale(votes, scale):
    rest = pooled_rest(resting(*votes))
    assert min(r for r, _ in votes) <= rest <= max(r for r, _ in votes)
    assert pooled_rest(resting(*votes[::-1])) == pytest.approx(rest)
    assert pooled_rest(resting(*((r, w * scale) for r, w in votes))) == pytest.approx(rest)
    equal = [(r, 1.0) for r, _ in votes]
    assert pooled_rest(resting(*equal)) == pytest.approx(np.median([r for r, _ in votes]))


@given(st.floats(0, 1), st.floats(0, 1), st.floats(0, 1), st.floats(0.5, 1))
def test_one_of_three_cannot_decide_whether_the_person_rests(one, two, liar, freshness):
    rest = pooled_rest(resting((one, freshness), (two, freshness), (liar, 1.0)))
    if min(one, two) > 0.85:
        assert rest > 0.5
    if max(one, two) < 0.15:
        assert rest < 0.5


def test_an_observer_that_sees_nobody_leaves_rest_to_the_others_and_silence_of_all_is_rest():
    assert pooled_rest(resting((0.1, 1.0), (0.99, 1e-6), (1.0, 1e-9))) == pytest.approx(0.1, abs=1e-3)
    assert pooled_rest(resting((0.3, 5e-324), (0.9, 0.0))) == pytest.approx(0.6)
    gone = [aged_rest(0, 0.1, 0.0, "silent"), aged_rest(1, 1.0, 0.0, "silent")]
    assert pooled_rest(gone) == pytest.approx(0.1) and pooled_rest(gone[1:]) == 1.0


def informed(information):
    """A posterior that knows so much, 0 to 1: of two movements."""
    top = 2.0 ** (information - 1.0)
    return np.array([top, 1.0 - top])


def trusted(*courses, information=()):
    """Each observer's trust after courses of rest, a step each: 0 moving, 1 resting, - sees nobody. information: of the
    first observers in each step, 0 to 9."""
    trust, result = RestPool(), []
    for step, sides in enumerate(zip(*courses, strict=True)):
        known = [int(course[step]) / 9 for course in information] + [0.0] * len(sides)
        posteriors = [
            replace(aged_rest(n, float(s == "1"), float(s != "-")), p=informed(known[n]), sees=s != "-")
            for n, s in enumerate(sides)
        ]
        result = trust.update(posteriors, (step + 1) * STEP_NS)
    return result


PERSON = ("1" * 15 + "0" * 15) * 4
LATE = PERSON[-2:] + PERSON[:-2]
LIARS = {"moving": "0" * 120, "resting": "1" * 120, "flaps": "01" * 60}


@pytest.mark.parametrize("lie", LIARS.values(), ids=LIARS)
@pytest.mark.parametrize("others", [(PERSON,), (PERSON, LATE), (PERSON, "-" * 120, "-" * 120)], ids=len)
def test_who_is_stuck_or_flaps_loses_trust_and_the_others_keep_it(lie, others):
    *honest, liar = trusted(*others, lie)
    assert liar < 0.3 and all(trust > 0.8 for trust in honest)


def test_who_contradicts_two_others_loses_trust_and_one_liar_takes_it_from_nobody():
    inverted = PERSON.translate(str.maketrans("01", "10"))
    one, two, liar = trusted(PERSON, LATE, inverted)
    assert one > 0.9 and two > 0.9 and liar <= 0.05


INVERTED = PERSON.translate(str.maketrans("01", "10"))
LEARNS = ("0" * 16 + "02468" + "9" * 9) * 4
"""Knows nothing while the person rests, and then grows sure."""


@pytest.mark.parametrize("liar_learns", [LEARNS, "0" * 120], ids=["as the others", "nothing"])
def test_of_two_that_contradict_each_other_the_one_whose_posterior_learns_at_rest_is_wrong(liar_learns):
    honest, liar = trusted(PERSON, INVERTED, information=(LEARNS, liar_learns))
    assert honest == 1.0 and liar <= 0.05


def test_the_trust_of_two_that_contradict_each_other_is_the_posterior_of_the_formula():
    """Nobody has changed sides: each second counts. Then both learn, on different sides."""
    steps, gain = 24, 1 / 9
    information = "0" * 20 + "1" * (steps - 20)
    honest, liar = trusted("0" * steps, "1" * steps, information=(information, information))
    believed = HONEST
    for n in range(steps // 3):
        # While nobody changes sides, trust is computed every .3 s here; until then there is nothing to compare.
        for _ in range(1) if n else ():
            right = (1 - BLUR) * believed + (1 - (1 - BLUR) * believed) / 2
            agrees = 2 * (1 - right)
            returned = HONEST + (believed - HONEST) * math.exp(-0.3 / OBSERVATION_S / MEMORY)
            odds = returned / (1 - returned) * ((1 - BLUR) * agrees + BLUR) ** 0.3
            believed = odds / (1 + odds)
    both, one = believed**2, believed * (1 - believed)
    right, wrong = (GAIN * gain * math.log(x) for x in (2 - BLUR, BLUR))
    factor = math.exp((1 - both) * (right - wrong))
    assert honest == 1.0
    assert liar == pytest.approx((both + one / factor) / (both + one * factor), abs=0.02) and 0.05 < liar < 0.6


def least_reliability(course, lag, every, others=PERSON):
    """Of an observer whose frames come `lag` steps late, one in `every`, beside two in time."""
    trust, least = RestPool(), 1.0
    for step in range(len(course)):
        frame = max((step - lag) // every * every, 0)
        age_s = (step - frame) * STEP_NS / SECOND_NS
        late = replace(aged_rest(2, float(course[frame] == "1"), math.exp(-max(age_s - 0.2, 0.0) / 0.5)), age_s=age_s)
        sides = [aged_rest(n, float(others[step % len(others)] == "1"), 1.0) for n in range(2)]
        trust.update([*sides, late], (step + 1) * STEP_NS)
        least = min(least, trust.reliability.get(late.observer, 1.0))
    return least


@pytest.mark.parametrize(("lag", "every"), [(7, 1), (5, 5), (0, 10)], ids=["late", "late and seldom", "seldom"])
def test_an_observer_whose_frames_come_late_or_seldom_is_not_named_and_a_liar_is(lag, every):
    assert least_reliability(PERSON * 2, lag, every) > 0.8
    assert least_reliability(INVERTED * 2, lag, every) < 0.6


@pytest.mark.parametrize("every", [1, 5, 10, 20], ids=["10 Hz", "2 Hz", "1 Hz", "0.5 Hz"])
def test_one_that_does_not_blink_when_the_others_do_is_not_named(every):
    moving = 10 * 14
    blinks = "1" * 15 + ("0" * 12 + "11") * 10 + "1" * 15
    assert least_reliability("1" * 15 + "0" * moving + "1" * 15, 0, every, blinks) > 0.8
    assert least_reliability("1" * 2 * len(blinks), 0, every) < 0.6


def test_who_moves_in_fits_and_starts_makes_nobody_look_wrong():
    """All observers change sides three times a second, some oftener: it is the person."""
    fits = "0001" * 60
    assert min(trusted(fits, fits, "000100010111" * 20)) == 1.0
    *honest, liar = trusted(fits, fits, "01" * 120)
    assert min(honest) == 1.0 and liar < 0.5


def test_one_that_flaps_makes_nobody_look_stuck():
    still = PERSON + "0" * 120
    honest, liar = trusted(still, "01" * (len(still) // 2))
    assert honest == 1.0 and liar <= 0.05


@pytest.mark.parametrize("word", [0.0, 0.98], ids=["says nothing", "sees another person"])
def test_where_two_contradict_each_other_and_nothing_tells_which_is_wrong_no_movement_is_cut_into_pieces(word):
    scene = EngineDriver(["door", "liar"], quorum=1)
    movements, reasons = LABELS[:2] * 3, []
    for step in range(-15, 30 * len(movements)):
        label, moves = movements[max(step, 0) // 30], 0 <= step % 30 < 15 and step >= 0
        scene.tick()
        scene.publish("door", sure(label, word) if moves and word else UNIFORM, 1.0 - moves)
        scene.publish("liar", UNIFORM if moves or not word else sure(LABELS[2], word), float(moves))
        reasons.append(scene.fuse().why or "")
    decided = [verdict.label for verdict in scene.verdicts if verdict.stage == "decided"]
    assert [label for label in decided if label != LABELS[2]] == (list(movements) if word else [])
    assert word or reasons[-1].startswith(CONTESTED_REST)


def test_contested_rest_stays_until_the_two_agree_again():
    pool, states = RestPool(), []
    for n in range(120):
        other = 0.05 if n < 100 else 0.95
        rest = pool.pool([aged_rest(0, 0.95, 1.0), aged_rest(1, other, 1.0)], (n + 1) * STEP_NS)
        states.append((pool.contested, rest))
    # Never stuck: both sides are as they were from the start, so that each loses trust alike.
    assert states[99] == (True, states[60][1])
    assert states[-1] == (True, pytest.approx(0.95)), "long contested, and they agree now"


@pytest.mark.parametrize(
    ("reliability", "rest"), [(0.001, 0.6), (0.6, 0.7), (1.0, 0.7)], ids=["named", "hardly", "full"]
)
def test_one_whose_labels_the_others_contradict_does_not_decide_on_a_pause(reliability, rest):
    honest = [aged_rest(n, own, 1.0) for n, own in enumerate((0.4, 0.6, 0.8))]
    hostile = replace(aged_rest(3, 0.97, 1.0), reliability=reliability)
    assert RestPool().pool([*honest, hostile], STEP_NS) == pytest.approx(rest)


def test_a_clock_that_was_set_back_begins_anew():
    trust = RestPool()
    for n in range(60):
        trust.update([aged_rest(0, n % 2, 1.0), aged_rest(1, 0.1, 1.0)], n * STEP_NS)
    assert trust.update([aged_rest(0, 0.1, 1.0), aged_rest(1, 0.1, 1.0)], 0) == [1.0, 1.0]


@pytest.mark.parametrize("lie", [(0.0,), (1.0,), (0.0, 1.0)], ids=["moving", "resting", "flips"])
@pytest.mark.parametrize("every", [1, 3], ids=["10 Hz", "3 Hz"])
def test_with_two_of_three_honest_observers_blind_the_fourth_that_lies_about_rest_blocks_no_verdict(lie, every):
    scene = EngineDriver(["door", "wheel", "table", "liar"], quorum=1)
    movements = LABELS * 2
    for step in range(-15, 30 * len(movements)):
        label, moves = movements[max(step, 0) // 30], 0 <= step % 30 < 15 and step >= 0
        scene.tick()
        if every == 1 or step % every == 0:
            scene.publish("door", sure(label, 0.98) if moves else UNIFORM, 0.05 if moves else 0.95)
            for name in ("wheel", "table"):
                scene.publish(name, UNIFORM, 0.1, visible={"left_hand": False})
        scene.publish("liar", UNIFORM, lie[step % len(lie)])
        scene.fuse()
    ended = [(verdict.label, verdict.stage) for verdict in scene.verdicts]
    assert ended == [(label, stage) for label in movements for stage in ("decided", "ended")]
