"""The score of a verdict: pooled at the end of the movement from the observers that scored it as its label."""

import pytest
from engine_stage import MOVING, REST, VIEWS, EngineDriver, all_views, sure

from common import SECOND_NS
from common.clock_skew import ClockReading
from common.posterior import ObservedRemark, ObservedScore, Unscored

KNEE = ObservedRemark(joint="left knee", moment=0.6, degrees=12.0, strength=2.0)
ELBOW = ObservedRemark(joint="right elbow", moment=0.2, degrees=-9.0, strength=1.5)


def scored(driver, score, label="bow", ago_s=0.0, **fields):
    return ObservedScore(label=label, score=score, ended_ns=driver.now_ns - round(ago_s * SECOND_NS), **fields)


def unscored(driver, reason, label="bow", ago_s=0.0):
    return Unscored(label=label, reason=reason, ended_ns=driver.now_ns - round(ago_s * SECOND_NS))


def ended(driver, make_scores, label="bow"):
    """A movement to its end: the last verdict. make_scores: the score of each observer that has one, or why it has
    none, at its rest."""
    driver.step(all_views(sure(label)), MOVING, times=15)
    scores = make_scores(driver)
    for _ in range(15):
        driver.tick()
        for name in VIEWS:
            own = scores.get(name)
            field = "unscored" if isinstance(own, Unscored) else "score"
            assert driver.publish(name, sure(label), REST, **{field: own}) is None
        driver.fuse()
    *before, last = driver.verdicts
    assert last.stage == "ended" and all(each.score is None for each in before if each.id == last.id)
    return last


def test_the_ended_verdict_has_the_pooled_score_and_what_half_of_the_judges_remark():
    points = dict(zip(VIEWS, (9.0, 8.0, 0.0, 7.0), strict=True))
    remarks = dict(zip(VIEWS, ([KNEE], [KNEE, ELBOW], [], []), strict=True))
    driver = EngineDriver()
    verdict = ended(driver, lambda d: {n: scored(d, p, remarks=remarks[n]) for n, p in points.items()})
    assert verdict.score == pytest.approx(7.5) and verdict.scores == points
    assert verdict.remarks == ["left knee: 12 degrees too straight at 60 %"]


def test_a_score_of_another_label_or_of_an_earlier_movement_or_of_a_part_is_not_used():
    def scores(driver):
        return {
            "door": scored(driver, 1.0, label="lunge"),
            "wheel": scored(driver, 2.0, ago_s=30.0),
            "back": scored(driver, 3.0, ago_s=0.9),
            "table": scored(driver, 6.0, certainty=0.8),
        }

    verdict = ended(EngineDriver(), scores)
    assert verdict.score == 6.0 and verdict.scores == {"table": 6.0} and verdict.remarks is None


def test_nobody_scores_nothing_is_said():
    verdict = ended(EngineDriver(), lambda driver: {})
    assert verdict.score is verdict.scores is verdict.remarks is None
    driver = EngineDriver()
    ended(driver, lambda d: {"door": scored(d, 5.0)})
    # The next movement begins after that score.
    assert ended(driver, lambda d: {"door": scored(d, 5.0, ago_s=20.0)}).score is None


def test_a_verdict_without_a_score_has_the_reason_that_most_observers_give():
    def reasons(driver):
        return {
            "door": unscored(driver, "its begin was not seen"),
            "wheel": unscored(driver, "too little is seen: not the left leg"),
            "back": unscored(driver, "too little is seen: not the left leg"),
            "table": unscored(driver, "of another movement", label="lunge"),
        }

    verdict = ended(EngineDriver(), reasons)
    assert verdict.score is verdict.scores is None and verdict.unscored == "too little is seen: not the left leg"


def test_one_score_is_enough_and_the_reason_of_an_earlier_movement_is_none():
    verdict = ended(EngineDriver(), lambda d: {"door": unscored(d, "far away"), "wheel": scored(d, 6.0)})
    assert (verdict.score, verdict.scores, verdict.unscored) == (6.0, {"wheel": 6.0}, None)
    assert ended(EngineDriver(), lambda d: {"door": unscored(d, "far away", ago_s=30.0)}).unscored is None


def test_the_time_of_a_score_is_by_the_clock_of_fusion():
    driver = EngineDriver()
    hour_ns = 3600 * SECOND_NS
    asked_ns = driver.now_ns
    driver.engine.roster.record_clock("door", ClockReading(asked_ns, asked_ns + hour_ns, asked_ns))
    driver.step(all_views(sure("bow")), MOVING, times=15)
    began_ns = driver.now_ns
    for _ in range(15):
        driver.tick()
        ahead_ns = driver.now_ns + hour_ns
        own = ObservedScore(label="bow", score=4.0, ended_ns=began_ns + hour_ns)
        late = ObservedScore(label="bow", score=9.0, ended_ns=began_ns - 60 * SECOND_NS)
        fields = {"door": {"captured_ns": ahead_ns, "sent_ns": ahead_ns, "score": own}, "wheel": {"score": late}}
        for name in VIEWS:
            driver.publish(name, sure("bow"), REST, **fields.get(name, {}))
        driver.fuse()
    assert driver.verdicts[-1].stage == "ended" and driver.verdicts[-1].scores == {"door": 4.0}
