"""The 16 clips of Florence 3D Actions, one setting for all: tracks against the joints, posteriors, and verdicts."""

import numpy as np
import pytest

from common import SECOND_NS
from common.config_sections import FusionConfig, default_quorum
from common.vocabulary import ABSTAIN, Vocabulary
from observer.geometry.views import View
from observer.learning.learn import learn_view
from observer.motion.archive import MotionArchive, labels_of
from observer.runtime.pipeline import Observer, PosteriorEncoder, Resampler
from observer.tracks import BODY_PARTS, Frame, Tracks
from studies.stream import ObservedStream, verdicts_in

pytest.importorskip("mediapipe")
pytestmark = pytest.mark.slow

PERIOD_NS = SECOND_NS // 10
FOUR = ("wave", "answer_phone", "clap", "read_watch")


class RecordedTracks:
    """A tracker that returns tracks computed before."""

    body_parts = BODY_PARTS

    def __init__(self, tracks):
        self._tracks = iter(tracks)

    def update(self, frame):
        return next(self._tracks)


def errors(clips, hand, lag=0):
    """(F, 3) distances from the truth in head-to-hip lengths over all frames of all clips; infinite: not seen.

    lag: frames by which the truth is later than the pictures.
    """
    rows = []
    for clip in clips:
        centres = np.array([tracks.centres for tracks in getattr(clip, hand)])[: len(clip.truth) - lag]
        rows.append(np.linalg.norm(centres - clip.truth[lag:], axis=2) / clip.head_to_hip[lag:, None])
    return np.where(np.isnan(every := np.concatenate(rows)), np.inf, every)


def test_the_joints_project_into_the_pictures(florence):
    for clip in florence.clips:
        assert ((clip.truth > 0) & (clip.truth < (640, 480))).all()
        assert ((clip.head_to_hip > 100) & (clip.head_to_hip < 200)).all()
        # After unmirroring, the left hand of a person who faces the camera is on the right.
        assert clip.truth[0, 0, 0] > clip.truth[0, 1, 0]


def test_hands_and_head_agree_with_the_joints(florence):
    off, off_wrist = errors(florence.clips, "palm"), errors(florence.clips, "wrist")[:, :2]
    seen = np.isfinite(off)
    lagging = np.median(errors(florence.clips, "palm", lag=1)[:, :2])
    hands, head = np.median(off[:, :2]), np.median(off[:, 2])
    outliers = (off[seen] > 0.5).mean()
    left, right = np.median(off[:, :2], axis=0)
    print(
        f"\n{len(off)} frames, seen {seen[:, :2].mean():.1%} of hands, {seen[:, 2].mean():.1%} of heads; median errors:"
    )
    print(f"hands {hands:.3f} (left {left:.3f}, right {right:.3f}), against the joints a frame later {lagging:.3f}")
    print(f"by the wrist {np.median(off_wrist):.3f}; head {head:.3f}; seen but off by more than a half {outliers:.1%}")
    assert len(off) == 252
    assert hands <= 0.10
    assert head <= 0.12
    assert seen.mean() > 0.95
    assert outliers <= 0.10


def test_left_and_right_are_those_of_the_person_in_every_clip(florence):
    for clip in florence.clips:
        centres = np.array([tracks.centres[:2] for tracks in clip.palm])
        own = np.linalg.norm(centres - clip.truth[:, :2], axis=2)
        exchanged = np.linalg.norm(centres - clip.truth[:, 1::-1], axis=2)
        assert np.nanmedian(own) < 0.5 * np.nanmedian(exchanged), clip.name


def posteriors(florence, labels, tracks_of):
    """(clip, vocabulary, posteriors): the observer's posterior after each frame, learned without the clip's person."""
    view, vocabulary = View("camera", florence.camera), Vocabulary(labels)
    models = {}
    for clip in florence.clips:
        if clip.subject not in models:
            others = tuple(r for r in florence.archive.recordings if r.subject != clip.subject)
            models[clip.subject] = learn_view(MotionArchive(BODY_PARTS, others), view, vocabulary)
        model, tracks = models[clip.subject], tracks_of(clip)
        observer = Observer(RecordedTracks(tracks), model, resampler=Resampler(model.header.rate_hz))
        yield clip, vocabulary, [observer.step(Frame(n * PERIOD_NS, np.zeros(0))) for n in range(len(tracks))]


def most_probable(florence, labels, tracks_of):
    """Clips whose last posterior is highest for the right label, and descriptions of the others. Not a verdict."""
    right, wrong = [], []
    for clip, _, each in posteriors(florence, labels, tracks_of):
        p = next(posterior.p for posterior in reversed(each) if posterior is not None)
        label = labels[int(np.argmax(p))]
        (right if label == clip.label else wrong).append(f"{clip.name} {clip.label}: {label} {p.max():.2f}")
    return right, wrong


def verdicts(florence, labels, tracks_of):
    """Per clip its label and the labels of the verdicts that the fusion service publishes about it."""
    for clip, vocabulary, each in posteriors(florence, labels, tracks_of):
        encoder = PosteriorEncoder(vocabulary, "clips")
        times = [SECOND_NS + n * PERIOD_NS for n in range(len(each))]
        messages = [
            {"camera": encoder.encode(posterior, at_ns, at_ns)}
            for posterior, at_ns in zip(each, times, strict=True)
            if posterior is not None
        ]
        stream = ObservedStream(florence.archive.recordings[0], vocabulary, messages)
        yield clip.label, [verdict.label for verdict in verdicts_in(stream, FusionConfig(quorum=default_quorum(1)))]


def test_the_last_posterior_is_highest_for_the_right_label(florence):
    """The argmax of the last posterior: what the tracks are worth, not what a user gets."""
    right, wrong = most_probable(florence, FOUR, lambda clip: clip.palm)
    by_wrist, _ = most_probable(florence, FOUR, lambda clip: clip.wrist)
    of_nine, wrong_of_nine = most_probable(florence, labels_of(florence.archive), lambda clip: clip.palm)
    print(f"\nargmax right: {len(right)} of 16 ({wrong}); by the wrist {len(by_wrist)}")
    print(f"among nine movements: {len(of_nine)} of 16 ({wrong_of_nine})")
    assert len(right) >= 13


VERDICTS_REACHED, VERDICTS_TARGET = 3, 13
"""Clips with the right verdict today, a bound against regressions; the target is not reached."""


def test_verdicts_of_the_fusion_service(florence):
    """What a user gets: the clips whose first verdict is right. Most clips end before a verdict is decided."""
    by_tracks, by_joints = (
        list(verdicts(florence, FOUR, tracks_of))
        for tracks_of in (lambda clip: clip.palm, lambda clip: [Tracks(centres) for centres in clip.truth])
    )
    right, of_joints = (sum(v[:1] == [label] for label, v in rows) for rows in (by_tracks, by_joints))
    wrong = [(label, v[0]) for label, v in by_tracks if v and v[0] not in (label, ABSTAIN)]
    print(f"\nverdicts right: {right} of 16 (target {VERDICTS_TARGET}), wrong: {wrong}; from the joints {of_joints}")
    assert right >= VERDICTS_REACHED
    assert len(wrong) <= 1


def test_the_joints_give_the_right_label(florence):
    right, wrong = most_probable(florence, FOUR, lambda clip: [Tracks(centres) for centres in clip.truth])
    assert len(right) >= 15, wrong


def test_a_person_who_is_never_seen_does_not_change_the_posterior(florence):
    blind = Tracks(np.full((3, 2), np.nan))
    model = learn_view(florence.archive, View("camera", florence.camera), Vocabulary(FOUR))
    observer = Observer(RecordedTracks([blind] * 30), model)
    p = [observer.step(Frame(n * PERIOD_NS, np.zeros(0))).p for n in range(30)]
    np.testing.assert_allclose(p[-1], p[0], atol=0.05)
