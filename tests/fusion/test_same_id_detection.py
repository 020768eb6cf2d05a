"""Two fusion processes with the same id: what each does, by the rules alone."""

import pytest

from fusion.same_id import (
    ANSWERS,
    ASK_EVERY_S,
    LAPSE_S,
    SUSPECTS_LIMIT,
    YOUNG_S,
    SameIdDetector,
    Stance,
)

STEP_S, TAKEOVER_S = 0.05, 1.0
LONG_S = YOUNG_S + 1.0


class Pair:
    """Processes `a` and `b` of one id, `a` with the lower session; each hears what the other publishes."""

    def __init__(self, ages_s=(0.0, 0.0), epochs=(1, 1)):
        self.now_s, self.epochs = 100.0, list(epochs)
        self.detectors = [
            SameIdDetector(name, self.now_s - age_s, TAKEOVER_S) for name, age_s in zip("ab", ages_s, strict=True)
        ]
        self.stances, self.published = [Stance.GO_ON] * 2, []

    def run(self, seconds, lives=(True, True)):
        """One step after the other; `published`: by time the processes that did."""
        for _ in range(round(seconds / STEP_S)):
            self.now_s += STEP_S
            who = [n for n in (0, 1) if lives[n] and self.stances[n] is Stance.GO_ON and self.epochs[n] is not None]
            self.published.append(who)
            for n, other in ((0, 1), (1, 0)):
                self._step(n, other, who, lives)
        return self.stances

    def _step(self, n, other, who, lives):
        detector, now_s = self.detectors[n], self.now_s
        if not lives[n] or self.stances[n] is Stance.END:
            return
        if lives[other] and self.stances[other] is not Stance.END:
            detector.record_message("ab"[other], now_s, self.epochs[other] if other in who else None)
            if (question := detector.next_question(now_s)) is not None:
                detector.record_answer("ab"[other], question, now_s + STEP_S / 2)
        self.stances[n] = detector.stance(self.epochs[n], now_s)


@pytest.mark.parametrize(("epochs", "ends"), [((1, 1), 0), ((2, 1), 1), ((1, None), 1), ((None, None), 0)])
def test_of_two_that_start_together_one_ends_and_publishes_nothing_meanwhile(epochs, ends):
    pair = Pair(epochs=epochs)
    stances = pair.run(1.5)
    assert stances[ends] is Stance.END and stances[1 - ends] is Stance.GO_ON
    assert all(ends not in who for who in pair.published[1:])
    assert pair.run(10.0)[1 - ends] is Stance.GO_ON


@pytest.mark.parametrize(("epochs", "below"), [((1, 1), 0), ((3, 2), 1)])
def test_of_two_that_meet_after_a_partition_one_stands_by_and_goes_on_when_the_other_is_gone(epochs, below):
    pair = Pair((60.0, 70.0), epochs)
    assert pair.run(1.5)[below] is Stance.STAND_BY
    assert pair.stances[1 - below] is Stance.GO_ON
    assert pair.run(30.0)[below] is Stance.STAND_BY
    pair.run(TAKEOVER_S + 2 * STEP_S, lives=(below == 0, below == 1))
    assert pair.stances[below] is Stance.GO_ON


def test_messages_that_nobody_answers_for_change_nothing_for_one_that_is_not_young():
    detector = SameIdDetector("m", 0.0, TAKEOVER_S)
    for n in range(200):
        now_s = LONG_S + n * STEP_S
        detector.record_message(f"z{n}", now_s, 10**6)
        detector.record_message("zz", now_s, 10**6)
        detector.next_question(now_s)
        assert detector.stance(1, now_s) is Stance.GO_ON


def test_they_hold_a_young_one_back_for_a_few_seconds_at_most():
    detector, held_s = SameIdDetector("m", 0.0, TAKEOVER_S), []
    for n in range(1, round(5 * LONG_S / STEP_S)):
        now_s = n * STEP_S
        detector.record_message(f"z{n // 20}", now_s, 10**6)
        if detector.stance(1, now_s) is not Stance.GO_ON:
            held_s.append(now_s)
    assert max(held_s) < YOUNG_S + LAPSE_S


def confirmed(began_s=0.0, now_s=LONG_S):
    """A detector with the confirmed session z, and the time of its last answer."""
    detector = SameIdDetector("m", began_s, TAKEOVER_S)
    for _ in range(ANSWERS):
        detector.record_message("z", now_s, 9)
        detector.record_answer("z", detector.next_question(now_s), now_s)
        now_s += 0.5
    return detector, now_s - 0.5


def test_a_confirmation_lapses_when_there_are_no_more_answers():
    detector, now_s = confirmed()
    assert detector.is_confirmed("z", now_s) and detector.stance(1, now_s) is Stance.STAND_BY
    for _ in range(round(LAPSE_S / STEP_S) + 1):
        now_s += STEP_S
        detector.record_message("z", now_s, 9)
    assert not detector.is_confirmed("z", now_s) and detector.stance(1, now_s) is Stance.GO_ON


def test_a_young_one_does_not_wait_for_answers_for_ever():
    detector = SameIdDetector("m", 0.0, TAKEOVER_S)
    stances = []
    for n in range(1, round(2 * LAPSE_S / STEP_S)):
        detector.record_message("z", n * STEP_S, 9)
        stances.append(detector.stance(1, n * STEP_S))
    assert stances[0] is Stance.WAIT and stances[-1] is Stance.GO_ON


def test_questions_are_not_asked_all_the_time_and_few_sessions_are_followed():
    detector = SameIdDetector("m", 0.0, TAKEOVER_S)
    for n in range(SUSPECTS_LIMIT + 1):
        detector.record_message(str(n), LONG_S)
    for n in range(ANSWERS):
        now_s = LONG_S + n * 0.5
        question = detector.next_question(now_s)
        assert detector.next_question(now_s + ASK_EVERY_S / 2) is None
        for session in range(SUSPECTS_LIMIT + 1):
            detector.record_answer(str(session), question, now_s)
    assert [detector.is_confirmed(str(n), now_s) for n in (0, SUSPECTS_LIMIT)] == [True, False]


def test_answers_to_one_question_prove_nothing():
    detector = SameIdDetector("m", 0.0, TAKEOVER_S)
    detector.record_message("z", LONG_S, 9)
    question = detector.next_question(LONG_S)
    for _ in range(100):
        detector.record_answer("z", question, LONG_S + STEP_S)
    assert detector.stance(1, LONG_S + STEP_S) is Stance.GO_ON
