"""Many scenes shared by several fusion processes: one is killed, and another one is handed its share."""

from benchmarks.crowd.trial import CrowdPlan, run_trial
from fusion.ownership import rendezvous_rank

KEPT_WAITING_S = 0.1
"""Two frames and a half of the crowd: a longer gap of all observers at once is none of its plan."""


def test_real_processes_one_is_killed_and_another_started(tmp_path):
    plan = CrowdPlan(scenes=4, rate_hz=25.0, seconds=6.0, processes=2, kill=True, warm_up_s=3.0)
    # The crowd goes by the clock. Where the machine kept it waiting its own gaps cut movements in two: such a trial
    # says nothing about the services, and is made again.
    for number in range(3):
        log, folder = [], tmp_path / str(number)
        folder.mkdir()
        outcome = run_trial(plan, folder, log.append)
        assert ["killed fusion1" in log, "started fusion2" in log] == [True, True]
        if outcome.counts.late_s <= KEPT_WAITING_S:
            break
    counts = outcome.counts
    assert counts.doubled == 0
    left = ("fusion0", "fusion2")
    assert counts.judges == {scene: rendezvous_rank(scene, left)[0] for scene in counts.done}
    assert set(counts.judges.values()) == set(left), "the new one is handed its share"
    assert outcome.whole or counts.late_s > KEPT_WAITING_S, (outcome.table(), counts.done, counts.ended)
    assert counts.right >= 0.9 * counts.movements
