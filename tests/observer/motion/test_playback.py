"""Playback of recorded motion: each frame when it is due."""

import threading
from itertools import islice

import numpy as np
import pytest
from observer_stage import WaitingClock
from processes import SOON_S

from common import SECOND_NS
from observer.motion.archive import Recording
from observer.motion.playback import RecordedMotion

PARTS = ("left_hand", "right_hand", "head")


def recording(frames, rate_hz=10.0, first=0):
    positions = np.arange(first, first + frames, dtype=np.float32)[:, None, None] * np.ones((1, 3, 3), np.float32)
    return Recording(positions, rate_hz, "bowing", "1", "1")


def played(watch, *recordings, **arguments):
    return RecordedMotion(PARTS, recordings, clock=watch, **arguments).frames(watch)


@pytest.mark.parametrize(
    ("lengths_and_rates", "options", "due_s"),
    [
        pytest.param([(4, 10.0)], {}, [0, 0.1, 0.2, 0.3], id="one recording"),
        pytest.param([(3, 10.0)], {"speed": 2.0}, [0, 0.05, 0.1], id="twice the speed"),
        pytest.param([(2, 10.0), (2, 20.0)], {}, [0, 0.1, 0.2, 0.25], id="each at its own rate"),
        pytest.param([(2, 10.0)], {"loop": True}, [0, 0.1, 0.2, 0.3, 0.4], id="in a loop"),
    ],
)
def test_frames_are_played_at_their_rate(lengths_and_rates, options, due_s):
    watch = WaitingClock()
    frames = list(islice(played(watch, *(recording(*each) for each in lengths_and_rates), **options), len(due_s)))
    assert [(frame.captured_ns - watch.began_ns) / SECOND_NS for frame in frames] == pytest.approx(due_s)
    assert watch.waits == pytest.approx(np.diff(due_s).tolist())
    first = lengths_and_rates[0][0]
    assert [frame.content[0, 0] for frame in frames[:first]] == list(range(first))
    assert frames[0].content.shape == (3, 3) and frames[0].content.dtype == np.float64


@pytest.mark.parametrize("loop", [False, True])
def test_the_last_frame_of_each_recording_is_marked(loop):
    frames = islice(played(WaitingClock(), recording(2), recording(3), loop=loop), 9)
    assert [frame.last for frame in frames] == [False, True, False, False, True, False, True, False, False][
        : 9 if loop else 5
    ]


def test_speed_0_does_not_wait_and_stamps_the_time_of_playback():
    watch = WaitingClock()
    for i, frame in enumerate(played(watch, recording(3), recording(2), speed=0.0)):
        assert frame.captured_ns == watch.began_ns + 7 * i
        watch.now_ns += 7
    assert i == 4 and watch.waits == []


def test_a_common_start_is_waited_for():
    watch = WaitingClock()
    first = next(played(watch, recording(2), start_ns=watch.began_ns + 2 * SECOND_NS))
    assert watch.waits == [2.0] and first.captured_ns == watch.began_ns + 2 * SECOND_NS


def slow(watch, frames, seconds):
    """The numbers of the frames that an observer gets which takes so many seconds for each, and their delays."""
    for frame in frames:
        yield int(frame.content[0, 0]), (watch() - frame.captured_ns) / SECOND_NS
        watch.now_ns += round(seconds * SECOND_NS)


def test_after_a_short_stall_no_frame_is_lost():
    watch = WaitingClock()
    frames = played(watch, recording(30, rate_hz=100.0))
    numbers = [next(frames).content[0, 0]]
    watch.now_ns += round(0.09 * SECOND_NS)
    numbers += [number for number, _ in slow(watch, frames, 0.001)]
    assert numbers == list(range(30))


def test_a_slow_observer_gets_the_newest_frame_until_it_keeps_up_again():
    watch = WaitingClock()
    frames = played(watch, recording(60, rate_hz=100.0))
    numbers, delays_s = zip(*islice(slow(watch, frames, 0.05), 6), strict=True)
    assert numbers == (0, 1, 2, 15, 20, 25) and max(delays_s[3:]) < 0.01
    watch.now_ns = watch.began_ns + round(0.255 * SECOND_NS)
    assert next(frames).content[0, 0] == 26  # has to be waited for: it keeps up
    watch.now_ns += round(0.05 * SECOND_NS)
    assert [next(frames).content[0, 0] for _ in range(3)] == [27, 28, 29]


def test_the_end_of_a_recording_is_played_unless_the_next_one_is_over_too():
    watch = WaitingClock()
    frames = played(watch, *(recording(5, first=10 * n) for n in range(4)))
    next(frames)
    watch.now_ns += round(1.7 * SECOND_NS)  # in the last recording
    assert [(frame.content[0, 0], frame.last) for frame in frames] == [(24, True), (32, False), (33, False), (34, True)]


def test_stop_ends_a_wait():
    stop, playing_began = threading.Event(), threading.Event()
    source = RecordedMotion(PARTS, [recording(2, 0.001)])

    def play():
        for _ in source.frames(stop):
            playing_began.set()

    playing = threading.Thread(target=play)
    playing.start()
    assert playing_began.wait(SOON_S)
    stop.set()
    playing.join(SOON_S)
    assert not playing.is_alive()


def test_in_slow_motion_frames_are_repeated_until_the_next_is_due():
    watch = WaitingClock()
    frames = list(played(watch, recording(3), speed=0.25))
    since_s = [(frame.captured_ns - watch.began_ns) / SECOND_NS for frame in frames]
    assert max(np.diff(since_s)) < 0.15 and min(np.diff(since_s)) > 0.04
    assert [s for s, frame in zip(since_s, frames, strict=True) if not frame.repeated] == pytest.approx([0, 0.4, 0.8])
    assert [frame.motion_ns for frame in frames if frame.repeated] == [0] * 3 + [SECOND_NS // 10] * 3
    assert frames[-1].last and not frames[-1].repeated


def test_at_full_speed_nothing_is_repeated():
    assert not any(frame.repeated for frame in played(WaitingClock(), recording(3, rate_hz=2.0)))
