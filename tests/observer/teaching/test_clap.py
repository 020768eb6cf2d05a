"""Claps of recorded people, and what else they do."""

import numpy as np
import pytest

from common import SECOND_NS
from observer.geometry.views import parse_view
from observer.motion.projected import view_tracks
from observer.teaching.take_watch import ClapWatch
from observer.tracks import BODY_PARTS, Tracks


def claps_in(centres, rate_hz=15.0, body_parts=BODY_PARTS):
    """Claps in one recording, with a second of rest before and after it."""
    rest = round(rate_hz)
    watch = ClapWatch(body_parts)
    for n, frame in enumerate([centres[0]] * rest + [*centres] + [centres[-1]] * rest):
        watch.update(round(n * SECOND_NS / rate_hz) + SECOND_NS, Tracks(frame))
    return watch.count


def test_people_clap_once_and_seldom_when_they_do_something_else(msr):
    view = parse_view("door")
    claps = [each for each in msr.recordings if each.label == "hand_clap"]
    others = [each for each in msr.recordings if each.label != "hand_clap"][::10]

    def counts(recordings):
        tracks = [view_tracks(view, each, msr.body_parts, BODY_PARTS) for each in recordings]
        return [claps_in([each.centres for each in one]) for one in tracks]

    assert sum(count > 0 for count in counts(claps)) >= 0.85 * len(claps)
    minutes = sum(len(each.positions) / each.rate_hz for each in others) / 60
    assert sum(counts(others)) / minutes < 0.9


@pytest.mark.parametrize("parts", [("head", "left_foot"), ("left_hand", "head")])
def test_without_both_hands_there_is_no_clap(parts):
    assert claps_in(np.zeros((20, 2, 2)), body_parts=parts) == 0
