"""What silence, sameness and failures mean: the rules of sight.py, and addresses without their secrets."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from observer.camera.base import kind_of, shown
from observer.camera.live import (
    SECOND_NS,
    Backoff,
    CameraHealth,
    CameraHistory,
    CameraTimeouts,
    digest,
    judge,
    silent_in_s,
)

MS = 1_000_000
times = st.integers(0, 10**13)
patience = CameraTimeouts(silence_s=0.9, same_s=1.0)


@pytest.mark.parametrize(
    ("seen", "now_ms", "sight"),
    [
        (CameraHistory(0, 0), 0, "sees"),
        (CameraHistory(0, 0), 899, "sees"),
        (CameraHistory(0, 0), 900, "lost"),
        (CameraHistory(5000 * MS, 4001 * MS), 5010, "sees"),
        (CameraHistory(5000 * MS, 4000 * MS), 5010, "frozen"),
        (CameraHistory(5000 * MS, 4000 * MS), 5900, "lost"),
        (CameraHistory(5000 * MS, 5000 * MS, "unplugged"), 5001, "lost"),
    ],
)
def test_the_first_rule_that_applies(seen, now_ms, sight):
    assert judge(seen, now_ms * MS, patience).sight == sight


def test_the_fault_is_the_reason():
    assert judge(CameraHistory(0, 0, "unplugged"), 0, patience) == CameraHealth("lost", "unplugged")


@given(times, st.integers(0, 5 * SECOND_NS), st.integers(0, 5 * SECOND_NS), st.sampled_from(["", "gone"]))
def test_a_reason_is_given_exactly_when_something_is_wrong(start, same, silent, fault):
    found = judge(CameraHistory(start + same, start, fault), start + same + silent, patience)
    assert (found.sight == "sees") == (found.reason == "")
    assert (found.sight == "sees") == (not fault and silent < 0.9 * SECOND_NS and same < SECOND_NS)


@given(times, st.integers(0, 2 * SECOND_NS))
def test_whoever_waits_as_long_as_it_says_finds_the_silence(start, later):
    seen, now = CameraHistory(start, start), start + later
    then = now + round(silent_in_s(seen, now, patience) * SECOND_NS)
    assert judge(seen, then + 1, patience).sight == "lost"
    if then > now + 1:
        assert judge(seen, then - 2, patience).sight == "sees"


@given(st.integers(1, 100_000), st.floats(0.01, 10), st.floats(1, 100))
def test_waits_double_up_to_the_longest(failures, first_s, times_longer):
    backoff = Backoff(first_s, first_s * times_longer)
    wait_s = backoff.wait_s(failures)
    assert first_s <= wait_s <= backoff.longest_s
    assert backoff.wait_s(failures + 1) == min(2 * wait_s, backoff.longest_s)


def test_only_who_delivered_for_a_while_begins_anew():
    backoff = Backoff(first_s=0.25, longest_s=8, steady_s=2)
    assert [backoff.wait_s(n) for n in range(1, 8)] == [0.25, 0.5, 1, 2, 4, 8, 8]
    assert backoff.failures(5, delivered_s=1.9) == 6
    assert backoff.failures(5, delivered_s=2.0) == 1


@given(st.integers(0, 2**32 - 1), st.integers(0, 59), st.integers(0, 79))
def test_noise_in_one_seen_pixel_makes_another_picture(seed, row, column):
    picture = np.random.default_rng(seed).integers(0, 255, (480, 640, 3), np.uint8)
    other = picture.copy()
    assert digest(other) == digest(picture)
    other[8 * row, 8 * column, 1] += 1
    assert digest(other) != digest(picture)


@pytest.mark.parametrize(
    ("text", "kind"),
    [
        ("0", "index"),
        ("12", "index"),
        ("/dev/video0", "device"),
        ("/dev/v4l/by-id/usb-cam", "device"),
        ("/dev/disk/clip.mp4", "path"),
        ("rtsp://host/1", "url"),
        ("HTTP://host/1", "url"),
        ("ftp://host/1", "unknown scheme"),
        ("clip.mp4", "path"),
        ("pictures/", "path"),
        ("-1", "path"),
    ],
)
def test_what_a_text_names(text, kind):
    assert kind_of(text) == kind


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("rtsp://admin:s3cret@cam.lan:554/live/1", "rtsp://cam.lan:554/live/1"),
        ("http://[fe80::1]:80/v", "http://[fe80::1]:80/v"),
        ("http://cam/video?user=a&pwd=s3cret", "http://cam/video"),
        ("rtsp://cam:554/user=admin_password=s3cret_channel=1", "rtsp://cam:554/..."),
        ("rtsp://admin:pa/s3cret@cam/1", "rtsp://..."),
        ("clip.mp4", "clip.mp4"),
    ],
)
def test_addresses_as_they_are_shown(text, said):
    assert shown(text) == said


@given(st.text("/?#@:&=%[]ab1", max_size=6), st.text("/?#@:&=%[]ab1", max_size=6), st.sampled_from(["rtsp", "ftp"]))
def test_no_badly_quoted_password_is_ever_shown(before, after, scheme):
    for text in (f"{scheme}://u:{before}SECRET{after}@cam:1/v", f"{scheme}://cam:1/v?p={before}SECRET{after}"):
        assert "SECRET" not in shown(text)
