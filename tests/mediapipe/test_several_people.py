"""Two people in films side by side, each does another movement: both are followed, and named as each is alone."""

from itertools import combinations

import numpy as np
import pytest
from mediapipe_stage import follow, side_by_side

from benchmarks.clips.judging import judge
from benchmarks.clips.learning import Learning, chosen_labels
from benchmarks.clips.material import gesture_clips, pictures_of, recordings
from common.config_sections import FusionConfig
from observer.model.registry import DEFAULT_MODEL
from observer.tracking.mediapipe_pose import MediapipeTracker, open_people
from observer.tracking.several_poses import SeveralPoses
from observer.tracks import BODY_PARTS, WHOLE_BODY

pytest.importorskip("mediapipe")
pytestmark = [pytest.mark.slow, pytest.mark.timeout(900)]
RATE_HZ = 10.0
HANDS = [WHOLE_BODY.index(part) for part in BODY_PARTS]


def pairs_of(data):
    """Fourteen pairs of clips of different people and movements."""
    clips = gesture_clips(data)
    apart = [(a, b) for a, b in combinations(clips, 2) if a.subject != b.subject and a.label != b.label]
    return apart[:: len(apart) // 14][:14]


def centres_of(tracks, side, width):
    """(F, 3, 2) of whoever is on that side, px of their own film; and the ids of who was seen there."""
    rows, ids = [], []
    for each in tracks:
        here = [p for p in each.persons if side * width <= p.u < (side + 1) * width]
        rows.append(here[0].centres[HANDS] - [side * width, 0] if here else np.full((3, 2), np.nan))
        ids += [p.id for p in here]
    return np.array(rows), set(ids)


def is_named(result):
    """Whether the movement is named, and nothing else. These clips begin in the movement: a first word may abstain."""
    return {verdict.last for verdict in result.words} == {result.label}


def test_two_people_side_by_side_are_both_followed_and_named_as_alone(data, pose_model):
    archive = recordings(data)
    learning = Learning(archive, chosen_labels(archive, "four"), DEFAULT_MODEL, {})
    alone_right, both_right, ids, unseen = 0, 0, [], []
    known = {}
    for pair in pairs_of(data):
        films = [list(pictures_of(clip)) for clip in pair]
        tracker = SeveralPoses(lambda: open_people(pose_model), "mediapipe", 2)
        tracks = follow(tracker, side_by_side(*films), RATE_HZ)
        tracker.close()
        words = []
        for side, (clip, film) in enumerate(zip(pair, films, strict=True)):
            centres, seen = centres_of(tracks[: len(film)], side, film[0].shape[1])
            ids.append(len(seen))
            unseen.append(np.isnan(centres).all(axis=(1, 2)).mean())
            model = learning.model(clip.subject, "camera")
            if clip.name not in known:
                single = MediapipeTracker(pose_model)
                by_itself = np.array([each.centres for each in follow(single, film, RATE_HZ)])
                single.close()
                known[clip.name] = judge(clip.name, clip.label, by_itself, RATE_HZ, model, FusionConfig())
            word = judge(clip.name, clip.label, centres, RATE_HZ, model, FusionConfig())
            words.append((is_named(known[clip.name]), is_named(word)))
        alone_right += all(alone for alone, _ in words)
        both_right += all(both for _, both in words)
        print(pair[0].name, pair[1].name, words, flush=True)
    seen = f"ids {max(ids)} at most; unseen {np.mean(unseen):.3f}"
    print(f"\nboth named: {both_right} of 14 pairs, each alone {alone_right}; {seen}")
    assert max(ids) == 1
    assert both_right >= min(alone_right, 12)
