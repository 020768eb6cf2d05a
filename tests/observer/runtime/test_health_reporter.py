"""What an observer says of itself when its camera or its sight fails."""

from observer.runtime.instrumentation import HealthReporter


def heard(*events):
    said = []
    condition = HealthReporter()
    condition.tell_to(lambda state, reason: said.append((state, reason)))
    for event in events:
        if event[0] == "frame":
            condition.frame(event[1])
        else:
            condition.camera(*event)
    return said


LOST = ("degraded", "camera 0: no picture for 0.9 s")
DARK = ("degraded", "the picture is dark")


def test_it_runs_with_the_first_frame_and_says_so_once():
    assert heard(("frame", ""), ("frame", "")) == [("running", "")]


def test_a_camera_that_never_delivers_is_degraded_from_the_start():
    assert heard(LOST, ("running", ""), ("frame", "")) == [LOST, ("running", "")]


def test_a_lost_camera_outweighs_a_complaint_and_the_complaint_comes_back():
    said = heard(("frame", ""), ("frame", DARK[1]), LOST, ("running", ""), ("frame", ""))
    assert said == [("running", ""), DARK, LOST, DARK, ("running", "")]


def test_what_happened_before_somebody_listened_is_told():
    said = []
    condition = HealthReporter()
    condition.camera(*LOST)
    condition.tell_to(lambda *now: said.append(now))
    assert said == [LOST]
