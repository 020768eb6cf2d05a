"""The messages of one connection, without a socket."""

import json
from datetime import UTC, datetime

import pytest

from hub.phone.phone_messages import BadPhoneMessage
from hub.phone.phone_session import BURST, MOST_HZ, PhoneSession, RateLimit
from hub.phone.register import Phone, RefusedError
from observer.foreign import frame_of_line
from observer.tracks import WHOLE_BODY

MS = 1_000_000
PHONE = Phone(observer="phone1", hash="0" * 64, name="Android", joined=datetime(2026, 1, 1, tzinfo=UTC))


class Door:
    def join(self, code, name):
        if code != "code":
            raise RefusedError("this code is not known")
        return PHONE, "secret"

    def resume(self, secret):
        if secret != "secret":  # noqa: S105
            raise RefusedError("this phone is not known here")
        return PHONE


class Stage:
    def __init__(self):
        self.ns = 1_795_657_600_000 * MS
        self.session = PhoneSession(Door(), "dojo", lambda: self.ns)

    def send(self, **message):
        return self.session.receive(json.dumps(message))

    def tracks(self, at_ms=None, parts=None):
        parts = parts or {part: [10.5, 20, 0.75] for part in WHOLE_BODY}
        return self.send(tracks={"at_ms": self.ns / MS if at_ms is None else at_ms, "parts": parts})


@pytest.fixture
def stage():
    return Stage()


@pytest.fixture
def admitted(stage):
    number = stage.send(join={"code": "code", "name": "Android"}).answers[1]["clock"]
    stage.ns += 10 * MS
    stage.send(clock={"number": number, "now_ms": stage.ns / MS})
    return stage


def test_a_code_is_answered_with_a_secret_and_a_secret_without_one(stage):
    welcome = stage.send(join={"code": "code"}).answers[0]
    assert welcome == {"welcome": {"scene": "dojo", "observer": "phone1", "secret": "secret"}}
    again = Stage().send(resume={"secret": "secret"}).answers[0]
    assert again == {"welcome": {"scene": "dojo", "observer": "phone1", "secret": None}}


@pytest.mark.parametrize("message", [
    {"join": {"code": "forged"}}, {"resume": {"secret": "forged"}}, {"clock": {"number": 1, "now_ms": 1}},
    {"tracks": {"at_ms": 1, "parts": {"head": None}}}, {"camera": {"state": "running"}},
])  # fmt: skip
def test_nothing_counts_from_who_is_not_admitted(stage, message):
    with pytest.raises(RefusedError):
        stage.send(**message)
    assert stage.session.phone is None and stage.session.tracks == 0


def test_nobody_joins_twice_on_one_connection(admitted):
    with pytest.raises(BadPhoneMessage, match="admitted already"):
        admitted.send(resume={"secret": "secret"})


def test_tracks_become_a_line_that_an_observer_reads(admitted):
    admitted.ns += 50 * MS
    outcome = admitted.tracks(at_ms=admitted.ns / MS - 20)
    frame = frame_of_line(outcome.line, WHOLE_BODY, admitted.ns)
    assert frame.content.shape == (15, 3) and frame.content[0].tolist() == [10.5, 20, 0.75]
    assert abs(frame.captured_ns - (admitted.ns - 20 * MS)) <= 6 * MS
    assert outcome.answers == [{"taken": 1}]


def test_late_tracks_are_acknowledged_and_go_no_further(admitted):
    outcome = admitted.tracks(at_ms=admitted.ns / MS - 5000)
    assert outcome.line is None and outcome.answers == [{"taken": 1}] and admitted.session.clock.dropped == 1


def test_the_rate_limit_lets_its_rate_pass_for_ever():
    limit = RateLimit()
    assert all(limit.admits(round(n * 1e9 / MOST_HZ)) for n in range(3000))
    assert sum(limit.admits(round(50e9 + n * 1e5)) for n in range(10_000)) <= MOST_HZ + BURST + 1
    assert not limit.admits(0)


def test_what_is_asked_of_the_lesson_is_passed_on_for_admitted_phones_alone(admitted):
    assert admitted.send(lesson={"ask": "stop", "lesson": "5b1c"}).lesson.lesson == "5b1c"
    with pytest.raises(RefusedError, match="first message"):
        Stage().send(lesson={"ask": "look"})


def test_through_an_hour_of_set_clocks_drift_and_pauses_tracks_stop_for_no_longer_than_what_stops_them(admitted):
    """The page sends two tracks a second and answers a question for its clock each second. Our clock is set, the
    phone's drifts by 150 ppm, the line stops, and the page is hidden for minutes."""
    start_ns, session = admitted.ns, admitted.session
    sets_s = {600: -60.0, 1200: 60.0, 1800: -0.3, 2400: 0.3, 3000: -3600.0}
    pauses_s = {300: 3.0, 900: 30.0, 1500: 200.0}
    true_s, number, gaps, last_s = 0.0, None, [], 0.0
    while true_s < 3600:
        second, half = divmod(round(true_s * 2), 2)
        if half == 0:
            admitted.ns += round(sets_s.get(second, 0.0) * 1e9)
            number = session.question()["clock"]
        paused_s = pauses_s.get(second, 0.0) if half else 0.0
        at_ms = start_ns / MS + 1000 * true_s * (1 + 150e-6)
        admitted.ns += round((0.5 + paused_s) * 1e9)
        true_s, last_s = true_s + 0.5 + paused_s, last_s + paused_s
        if half == 0:
            # The page answers between two looks, after up to half a second.
            admitted.send(clock={"number": number, "now_ms": at_ms + 60})
        if admitted.tracks(at_ms, {"head": None}).line is not None:
            gaps.append((true_s - last_s, second))
            last_s = true_s
    gaps.append((true_s - last_s, 3600))
    assert max(gaps) < (2.5, 0), sorted(gaps)[-5:]
    assert len(gaps) > 0.99 * (3600 - sum(pauses_s.values())) * 2
