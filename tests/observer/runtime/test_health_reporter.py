"""The state that an observer reports when its camera or its tracker fails."""

import pytest

from observer.runtime.service import HealthReporter

RUNNING = ("running", "")
LOST = ("degraded", "camera 0: no picture for 0.9 s")
DARK = ("degraded", "the picture is dark")
FRAME = ""


def reported(*events):
    """The reports after frames (a complaint, or "") and the camera's states (pairs)."""
    reports, health = [], HealthReporter()
    health.report_to(lambda *state: reports.append(state))
    for event in events:
        if isinstance(event, str):
            health.record_frame(event)
        else:
            health.record_camera(*event)
    return reports


@pytest.mark.parametrize(
    ("events", "reports"),
    [
        pytest.param((FRAME, FRAME), [RUNNING], id="running once"),
        pytest.param((LOST, RUNNING, FRAME), [LOST, RUNNING], id="degraded before the first frame"),
        pytest.param(
            (FRAME, DARK[1], LOST, RUNNING, FRAME), [RUNNING, DARK, LOST, DARK, RUNNING], id="camera before complaint"
        ),
    ],
)
def test_each_change_is_reported_once(events, reports):
    assert reported(*events) == reports


def test_a_state_from_before_is_reported_to_a_new_listener():
    reports, health = [], HealthReporter()
    health.record_camera(*LOST)
    health.report_to(lambda *state: reports.append(state))
    assert reports == [LOST]
