"""Synthetic performers, models that watch them, and a tracker of given tracks."""

from observer.geometry.views import parse_view
from observer.motion.archive import MotionArchive
from observer.motion.projected import view_tracks
from observer.tracks import BODY_PARTS, Tracks

DOOR = parse_view("door")


class PassThrough:
    """A tracker whose frames are tracks."""

    body_parts = BODY_PARTS

    def update(self, frame):
        return Tracks(frame.content)


def recordings_of(archive, subjects, labels, trials=99):
    """The archive's first recordings of these people with these labels, `trials` of each."""
    chosen, counts = [], {}
    for r in archive.recordings:
        counts[r.subject, r.label] = counts.get((r.subject, r.label), 0) + 1
        if r.subject in subjects and r.label in labels and counts[r.subject, r.label] <= trials:
            chosen.append(r)
    return MotionArchive(archive.body_parts, tuple(chosen))


def watching(model, recording, onset):
    """The model's watch after each frame of the recording, seen from the door."""
    watch = model.watch(onset)
    for tracks in view_tracks(DOOR, recording, BODY_PARTS, BODY_PARTS):
        watch.update(tracks)
        yield watch
