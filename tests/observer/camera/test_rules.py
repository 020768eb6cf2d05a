"""Rules 1 to 4 of live.py, and addresses without their secrets."""

import re

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from common import SECOND_NS
from common.backoff import Backoff
from common.text import without_secrets
from observer.camera.base import kind_of
from observer.camera.live import CameraHistory, CameraTimeouts, assess, digest, silent_in_s

MS = 1_000_000
times = st.integers(0, 10**13)
TIMEOUTS = CameraTimeouts(silence_s=0.9, same_s=1.0)


@pytest.mark.parametrize(
    ("history", "now_ms", "state"),
    [
        (CameraHistory(0, 0), 0, "delivering"),
        (CameraHistory(0, 0), 899, "delivering"),
        (CameraHistory(0, 0), 900, "lost"),
        (CameraHistory(5000 * MS, 4001 * MS), 5010, "delivering"),
        (CameraHistory(5000 * MS, 4000 * MS), 5010, "frozen"),
        (CameraHistory(5000 * MS, 4000 * MS), 5900, "lost"),
        (CameraHistory(5000 * MS, 5000 * MS, "unplugged"), 5001, "lost"),
    ],
)
def test_the_first_rule_that_applies(history, now_ms, state):
    assert assess(history, now_ms * MS, TIMEOUTS).state == state


@given(times, st.integers(0, 5 * SECOND_NS), st.integers(0, 5 * SECOND_NS), st.sampled_from(["", "gone"]))
def test_there_is_a_reason_exactly_when_the_camera_does_not_deliver(start, same, silent, fault):
    health = assess(CameraHistory(start + same, start, fault), start + same + silent, TIMEOUTS)
    assert (health.state == "delivering") == (health.reason == "")
    assert (health.state == "delivering") == (not fault and silent < 0.9 * SECOND_NS and same < SECOND_NS)


@given(times, st.integers(0, 2 * SECOND_NS))
def test_silence_begins_exactly_after_the_stated_wait(start, later):
    history, now = CameraHistory(start, start), start + later
    then = now + round(silent_in_s(history, now, TIMEOUTS) * SECOND_NS)
    assert assess(history, then + 1, TIMEOUTS).state == "lost"
    if then > now + 1:
        assert assess(history, then - 2, TIMEOUTS).state == "delivering"


def test_the_wait_starts_over_only_for_a_camera_that_had_delivered():
    backoff = Backoff(first_s=0.25, longest_s=8, steady_s=2)
    assert [backoff.wait_s(n) for n in range(1, 8)] == [0.25, 0.5, 1, 2, 4, 8, 8]
    assert backoff.failures(5, worked_s=1.9) == 6
    assert backoff.failures(5, worked_s=2.0) == 1


@given(st.integers(0, 2**32 - 1), st.integers(0, 59), st.integers(0, 79))
def test_noise_in_one_sampled_pixel_changes_the_digest(seed, row, column):
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
def test_kinds_of_source(text, kind):
    assert kind_of(text) == kind


@pytest.mark.parametrize(
    ("text", "printed", "with_path"),
    [
        ("rtsp://admin:s3cret@cam.lan:554/live/1", "rtsp://cam.lan:554/...", "rtsp://cam.lan:554/live/1"),
        ("rtsps://nvr:7441/TOKEN", "rtsps://nvr:7441/...", "rtsps://nvr:7441/TOKEN"),
        ("http://[fe80::1]:80/v", "http://[fe80::1]:80/...", "http://[fe80::1]:80/v"),
        ("http://cam/video?user=a&pwd=s3cret", "http://cam/...", "http://cam/video"),
        ("rtsp://cam:554/user=admin_password=s3cret_channel=1", "rtsp://cam:554/...", "rtsp://cam:554/..."),
        ("rtsp://admin:pa/s3cret@cam/1", "rtsp://...", "rtsp://..."),
        ("rtsp://cam", "rtsp://cam", "rtsp://cam"),
        ("admin:s3cret@cam", "...@cam", "...@cam"),
        ("admin:s3cret@cam:554/live", "...@cam:554/...", "...@cam:554/live"),
        ("admin:pa/s3cret@cam", "...", "..."),
        ("nvr:7441/TOKEN", "nvr:7441/...", "nvr:7441/TOKEN"),
        ("rtsps:nvr:7441/TOKEN", "rtsps:nvr:7441/...", "rtsps:nvr:7441/TOKEN"),
        ("rtsps:/admin:s3cret@nvr:7441/TOKEN", "rtsps:/nvr:7441/...", "rtsps:/nvr:7441/TOKEN"),
        ("clip.mp4", "clip.mp4", "clip.mp4"),
        ("user:/s3cret@cam", "...", "..."),
        ("user://s3cret@cam:1/live", "...@cam:1/...", "...@cam:1/live"),
        ("films/me@home.mp4", "films/me@home.mp4", "films/me@home.mp4"),
        ("zenoh:tracks/cam1", "zenoh:tracks/cam1", "zenoh:tracks/cam1"),
    ],
)
def test_addresses_are_printed_without_secrets(text, printed, with_path):
    assert without_secrets(text) == printed
    assert without_secrets(text, show_path=True) == with_path


secrets = st.text("abcXYZ019:/@?#%&=;. []")


@given(secrets, secrets, st.sampled_from(["rtsp://", "ftp://", "rtsps:/", ""]), st.text("abc/?&=@#", max_size=9))
def test_a_badly_quoted_password_is_never_printed(before, after, scheme, behind):
    for text in (f"{scheme}user:{before}SECRET{after}@cam:1/{behind}", f"{scheme}cam:1/v?p={before}SECRET{after}"):
        assert not {"SECRET", "user"} & set(re.findall("SECRET|user", without_secrets(text, show_path=True)))
