"""A capture played back onto a mesh: its new times, and what others receive."""

import threading
import time

import pytest
from hypothesis import given
from hypothesis import strategies as st
from processes import SOON_S, waited_s

import labanmesh
from common import SECOND_NS as SECOND
from common.arrival import APPEARED, GONE, CaptureRecord
from common.capture_file import CaptureFile, CaptureWriter
from common.config import MeshConfig, ObserverConfig, Scene
from common.errors import LabanmeshError
from common.link import Link
from common.messages import (
    Agreement,
    JudgementMessage,
    OngoingMovement,
    PosteriorMessage,
    StatusMessage,
    VerdictMessage,
    VocabularyReference,
)
from common.vocabulary import Vocabulary
from common.wire import decode, encode, encode_vocabulary
from studies.replay import playback
from studies.replay.playback import PlaybackOptions, TimeShift, play

THEN, NOW = 1_700_000_000 * SECOND, 1_800_000_000 * SECOND
NAMES = Vocabulary(("bowing", "lunging"))
REFERENCE = VocabularyReference(name=NAMES.name, hash=NAMES.digest)
ROOT = "laban/dojo"
POSTERIOR, JUDGEMENT, VERDICT = f"{ROOT}/observer/cam1/posterior", f"{ROOT}/judgement", f"{ROOT}/verdict"
STATUS, ALIVE, VOCABULARY = f"{ROOT}/observer/cam1/status", f"{ROOT}/observer/cam1/alive", f"{ROOT}/vocabulary"


def posterior(seq=1, captured_ns=THEN, sent_ns=THEN, session="s"):
    return PosteriorMessage(
        v=1, scene="dojo", observer="cam1", seq=seq, session=session, captured_ns=captured_ns, sent_ns=sent_ns,
        vocabulary=REFERENCE, p=[0.25, 0.75], rest=0.5, frames=seq, visible={"head": True},
    )  # fmt: skip


def judgement(at_ns=THEN, kind=JudgementMessage, **more):
    return kind(
        scene="dojo", fusion="fusion", seq=1, at_ns=at_ns, vocabulary=REFERENCE, p=[0.5, 0.5], label="bowing",
        certainty_bits=1.0, rule="log", votes={}, agreement=Agreement(k=0, n=0), **more,
    )  # fmt: skip


def verdict(at_ns, ended_ns=None):
    began_ns = THEN + SECOND
    more = {"id": f"dojo-{began_ns // 1_000_000}", "began_ns": began_ns, "decided_ns": THEN + 2 * SECOND}
    return judgement(at_ns, VerdictMessage, **more, ended_ns=ended_ns)


def put(key, message, arrived_ns):
    return CaptureRecord("put", key, message if isinstance(message, bytes) else encode(message), arrived_ns)


def moving(speed=1.0, scene="dojo"):
    return TimeShift(THEN, NOW, speed, scene, "run")


@given(
    arrivals=st.lists(st.tuples(st.integers(0, 10**9), st.integers(0, 10**8), st.integers(0, 10**7)), max_size=20),
    speed=st.sampled_from((0.5, 1.0, 8.0)),
)
def test_posteriors_keep_their_age_and_no_two_are_dated_alike(arrivals, speed):
    times, last, now_ns, at_ns = moving(speed), None, NOW, THEN
    for seq, (later_ns, age_ns, way_ns) in enumerate(arrivals):
        at_ns += later_ns
        message = posterior(seq, at_ns - age_ns - way_ns, at_ns - way_ns)
        now_ns = max(now_ns + 1, times.due_ns(at_ns))
        moved = decode(PosteriorMessage, times.payload(put(POSTERIOR, message, at_ns), now_ns))
        assert moved.captured_ns <= moved.sent_ns
        if last is None or moved.captured_ns > last.captured_ns + 1:
            assert abs((now_ns - moved.captured_ns) * speed - age_ns - way_ns) <= 2 * max(speed, 1)
        if last is not None:
            assert moved.captured_ns > last.captured_ns and moved.sent_ns > last.sent_ns
        assert moved.session == "s-run"
        assert all(getattr(moved, name) == getattr(message, name) for name in ("p", "rest", "seq", "visible"))
        last = moved


@pytest.mark.parametrize(("speed", "shift_ns", "scale"), [(1.0, NOW - THEN, 1), (4.0, NOW - THEN, 4)])
def test_the_messages_of_one_verdict_agree(speed, shift_ns, scale):
    times = moving(speed)
    first = decode(VerdictMessage, times.payload(put(VERDICT, verdict(THEN + 2 * SECOND), THEN), NOW + 5))
    last = verdict(THEN + 4 * SECOND, THEN + 3 * SECOND)
    last = decode(VerdictMessage, times.payload(put(VERDICT, last, THEN), NOW + 9999))
    assert (first.id, first.began_ns, first.decided_ns) == (last.id, last.began_ns, last.decided_ns)
    assert first.began_ns == NOW + SECOND // scale and last.ended_ns == NOW + 3 * SECOND // scale
    assert first.ended_ns is None and last.at_ns == NOW + 4 * SECOND // scale
    assert first.id == f"dojo-{first.began_ns // 1_000_000}"
    going = judgement(THEN, movement=OngoingMovement(id="dojo-1", began_ns=THEN + SECOND))
    going = decode(JudgementMessage, times.payload(put(JUDGEMENT, going, THEN), NOW))
    assert (going.movement.id, going.movement.began_ns, going.movement.decided_ns) == (first.id, first.began_ns, None)


def test_a_status_gets_the_current_time_and_bad_messages_stay_unchanged():
    times = moving(scene="other")
    message = StatusMessage(scene="dojo", id="cam1", state="running", at_ns=THEN, last_frame_ns=THEN - SECOND)
    moved = decode(StatusMessage, times.payload(put(STATUS, message, THEN), NOW))
    assert (moved.scene, moved.at_ns, moved.last_frame_ns) == ("other", NOW, NOW - SECOND)
    for bad in (b"", b"\xc1", encode(message)[:-3]):
        assert times.payload(put(STATUS, bad, THEN), NOW) == bad
    assert times.payload(put(f"{ROOT}/x/y", encode(message), THEN), NOW) == encode(message)


@pytest.fixture
def write(tmp_path):
    scene = Scene(scene="dojo", observers={"cam1": ObserverConfig(source="m.npz")})

    def write_capture(*records):
        path = tmp_path / f"{len(list(tmp_path.iterdir()))}.mcap"
        with CaptureWriter(path, scene, "", THEN) as writer:
            for record in records:
                writer.write(record)
        return CaptureFile(path)

    return write_capture


def taken(inbox, count):
    """All that has come once `count` have."""
    arrivals, deadline_s = [], time.monotonic() + SOON_S
    while len(arrivals) < count:
        arrivals += inbox.take(0.1)
        assert time.monotonic() < deadline_s, arrivals
    return arrivals


def onto(endpoint, scene="dojo", prefix="laban"):
    mesh = MeshConfig(endpoint=endpoint, prefix=prefix)
    return Scene(scene=scene, mesh=mesh, observers={"cam1": ObserverConfig(source="m.npz")})


WHOLE = (
    CaptureRecord("answer", VOCABULARY, encode_vocabulary("dojo", NAMES), THEN),
    CaptureRecord("token", ALIVE, APPEARED, THEN),
    put(POSTERIOR, posterior(1, THEN - 5), THEN + 1_000_000),
    put(JUDGEMENT, judgement(THEN + 2_000_000), THEN + 2_000_000),
    put(STATUS, b"no status", THEN + 2_000_000),
    put(POSTERIOR, posterior(2, THEN + 2_000_000), THEN + 200_000_000),
    CaptureRecord("token", ALIVE, GONE, THEN + 300_000_000),
)


@pytest.fixture
def fusion():
    """The link at which the others connect."""
    with Link.open(MeshConfig(), "fusion", listen=["tcp/127.0.0.1:0"]) as link:
        yield link


def test_fusion_receives_posteriors_liveliness_and_vocabulary(write, fusion):
    inbox = fusion.inbox(f"{ROOT}/**")
    alive = fusion.presence(f"{ROOT}/**/alive")
    queried, progress, held_up_s = [], [], []
    stop = threading.Event()

    def watch(what, done, total):
        if not queried:
            asked_s = time.monotonic()
            assert alive.wait_for(1, SOON_S)
            queried.append(fusion.ask(VOCABULARY, SOON_S))
            held_up_s.append(time.monotonic() - asked_s)
        progress.append((done, total))
        if done == total:
            assert alive.wait_for(0, SOON_S), "its token ends when the process ended"

    began_s, waited_before_s = time.monotonic(), waited_s()
    count = play(write(*WHOLE), onto(fusion.locator), PlaybackOptions(posteriors_only=True), stop, watch)
    assert time.monotonic() - began_s >= 0.3
    # What the process waits for a processor is the time of a busy machine.
    waiting_ns = (waited_s() - waited_before_s) * SECOND
    assert count == 2 and progress[-1] == (7, 7)
    assert queried == [{VOCABULARY: WHOLE[0].payload}]
    arrivals = taken(inbox, 2)
    assert [arrival.key for arrival in arrivals] == [POSTERIOR, POSTERIOR]
    messages = [decode(PosteriorMessage, arrival.payload) for arrival in arrivals]
    assert [message.seq for message in messages] == [1, 2]
    assert all(
        0 <= arrival.arrived_ns - message.sent_ns < 2 * SECOND + waiting_ns
        for arrival, message in zip(arrivals, messages, strict=True)
    )
    # The first one is late by as long as the questions held up the playback.
    apart_ns = arrivals[1].arrived_ns - arrivals[0].arrived_ns
    assert (0.05 - held_up_s[0]) * SECOND < apart_ns < 0.35 * SECOND + waiting_ns


def test_everything_is_played_without_fusion_also_to_late_joiners(write):
    with Link.open(MeshConfig(), "fusion", listen=["tcp/127.0.0.1:0"]) as free:
        endpoint = free.locator
    scene = onto(endpoint, prefix="other")
    answers = {}
    with Link.open(scene.mesh, "hub") as hub:
        inbox = hub.inbox("other/dojo/**")

        def late(what, done, total):
            if done == 6:
                answers.update(hub.ask("other/dojo/**", SOON_S))

        assert play(write(*WHOLE), scene, PlaybackOptions(speed=100), threading.Event(), late) == 4
        received = [arrival.key for arrival in taken(inbox, 4)]
    assert received == ["other" + r.key.removeprefix("laban") for r in WHOLE if r.kind == "put"]
    assert answers.keys() == {f"other{r.key.removeprefix('laban')}" for r in (WHOLE[0], WHOLE[3], WHOLE[4])}


def test_it_ends_when_stopped(write, fusion):
    fusion.inbox(f"{ROOT}/**")
    stop = threading.Event()
    slow = (WHOLE[2], put(POSTERIOR, posterior(3), THEN + 3600 * SECOND))
    count = play(write(*slow), onto(fusion.locator), PlaybackOptions(posteriors_only=True), stop, lambda *_: stop.set())
    assert count == 1


def test_captures_that_cannot_be_played_are_errors(write, fusion, monkeypatch):
    monkeypatch.setattr(playback, "FUSION_TIMEOUT_S", 0.1)
    stop = threading.Event()
    with pytest.raises(LabanmeshError, match="no subscriber to posteriors there; start `labanmesh fuse`"):
        play(write(*WHOLE), onto(fusion.locator), PlaybackOptions(posteriors_only=True), stop)
    with pytest.raises(LabanmeshError, match="already in use"):
        play(write(*WHOLE), onto(fusion.locator), PlaybackOptions(), stop)
    with pytest.raises(LabanmeshError, match="contains no messages"):
        play(write(), onto(fusion.locator), PlaybackOptions(), stop)


def test_the_command_plays_or_judges_never_both(write, tmp_path, capsys):
    path = str(write(*WHOLE).path)
    for words in (["--onto", "s.toml", "--without", "cam1"], ["--onto", "s.toml", "--json"], ["--only", "posteriors"],
                  ["--onto", "s.toml", "--only", "verdicts"], ["--onto", "nowhere.toml"]):  # fmt: skip
        assert labanmesh.main(["replay", path, *words]) == 2
        assert capsys.readouterr().err.count("\n") == 1
