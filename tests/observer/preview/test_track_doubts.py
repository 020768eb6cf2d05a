"""Signs that tracks are wrong, on a made person of 340 px who stands and waves, and on that person spoilt."""

import numpy as np
import pytest

from common import SECOND_NS
from observer.preview.track_doubts import (
    CAMSHIFT_REMEDIES,
    FINDINGS,
    POSE_REMEDIES,
    confirmed_faces,
    doubts,
    explain,
)
from observer.tracks import BODY_PARTS

PARTS = (*BODY_PARTS, "pelvis")
RATE_HZ, PICTURES = 10, 30
AT_NS = [number * SECOND_NS // RATE_HZ for number in range(PICTURES)]
FACE = (180.0, 55.0, 40.0, 40.0)
FACES = {number: [FACE] for number in range(0, PICTURES, 3)}


def waving():
    """The right hand waves beside the head, the left one hangs: tracks (30, 4, 2)."""
    t = np.arange(PICTURES)
    tracks = np.empty((PICTURES, 4, 2))
    tracks[:, 0], tracks[:, 2], tracks[:, 3] = (250.0, 230.0), (200.0, 75.0), (200.0, 211.0)
    tracks[:, 1] = np.stack([150 + 30 * np.sin(t), 40 + 5 * np.cos(t)], axis=1)
    return tracks


def spoilt(kind):
    tracks = waving()
    if kind == "off":
        tracks[:18, 2] = tracks[:18, 0]
    elif kind == "sides":
        tracks[:, :2] = tracks[:, [1, 0]]
    elif kind == "jumps":
        tracks[::10, 0] += 300.0, -60.0
    elif kind == "exchanged":
        tracks[10:20, :2] = tracks[10:20, [1, 0]]
    elif kind == "together":
        tracks[5:, 0] = tracks[5:, 1] + 5.0
    elif kind == "beyond":
        tracks[10:, 0] = 250.0, 400.0
    elif kind == "rarely":
        tracks[8:, 0] = np.nan
    return tracks


@pytest.mark.parametrize("faces", [FACES, {}])
def test_good_tracks_leave_no_doubt(faces):
    assert doubts(waving(), PARTS, AT_NS, faces) == []
    assert doubts(waving()[:, :3], BODY_PARTS, AT_NS, faces) == []


@pytest.mark.parametrize("kind", FINDINGS)
@pytest.mark.parametrize("parts", [PARTS, BODY_PARTS])
def test_each_fault_is_named_with_its_share_and_a_remedy(kind, parts):
    found = doubts(spoilt(kind)[:, : len(parts)], parts, AT_NS, FACES)
    assert kind in [doubt.kind for doubt in found]
    for doubt in found:
        for tracker, remedies in (("camshift", CAMSHIFT_REMEDIES), ("mediapipe", POSE_REMEDIES)):
            finding, _, remedy = explain(doubt, tracker).partition(": ")
            assert f" {100 * doubt.count / doubt.pictures:.0f} %" in finding and "{" not in finding
            assert remedy == remedies[doubt.kind]


def test_a_face_counts_when_it_is_found_twice_in_one_place():
    far, larger = (20.0, 300.0, 40.0, 40.0), (170.0, 45.0, 80.0, 80.0)
    boxes = {0: [FACE], 3: [far], 6: [FACE, far], 9: [larger], 12: [], 15: [FACE]}
    assert confirmed_faces(boxes) == {6: [far]}
    tracks = waving()
    tracks[:, 2] = np.nan
    assert doubts(tracks, PARTS, AT_NS, FACES) == [], "without a head nothing is known of it"


def test_nothing_seen_is_no_doubt_and_no_error():
    nothing = np.full((PICTURES, 4, 2), np.nan)
    assert doubts(nothing, PARTS, AT_NS, {}) == [] == doubts(nothing[:1], PARTS, AT_NS[:1], FACES)
