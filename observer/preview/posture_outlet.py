"""Publishes what an observer sees of the person's posture, for the watch for falls (docs/design/falls.md)."""

import logging
from collections.abc import Mapping, Sequence

import numpy as np

from common import SECOND_NS
from common.config_people import Area
from common.fall_messages import TRACKS_LIMIT, PostureMessage
from common.subsession import Publisher
from common.wire import encode
from observer.lying import LyingReader
from observer.preview.small_picture import Sighting
from observer.tracks import Floats

HEARTBEAT_NS = SECOND_NS // 2
MOST_CHANGE = 0.05
"""The evidence is published when it has changed by so much, and every HEARTBEAT_NS."""
THE_PERSON = ""
"""The track of an observer that follows one person."""
HIPS = ("left_hip", "right_hip", "pelvis")
CANNOT_TELL = (
    "watch.fallen: the tracker of this observer finds no torso and legs, so it takes no part in the watch; use a "
    'tracker with a pose model (tracker = "mediapipe")'
)

log = logging.getLogger("labanmesh.observer")


class PostureOutlet:
    """Takes every sighting. areas: where people usually lie; a person with the hips there does not count as lying."""

    def __init__(self, publisher: Publisher, areas: Sequence[Area] = ()) -> None:
        self._publisher, self._areas = publisher, areas
        self._readers: dict[str, LyingReader] = {}
        self._can_tell: bool | None = None
        self._hips: list[int] = []
        self._sent_ns = 0
        self._sent: dict[str, float] = {}

    def is_due(self, now_ns: int) -> bool:
        """Always: a fall is short."""
        return True

    def show(self, sighting: Sighting, now_ns: int) -> None:
        """Read one frame; raises LabanmeshError if the link is closed."""
        if self._can_tell is None:
            self._can_tell = LyingReader(sighting.body_parts).can_tell
            self._hips = [row for row, part in enumerate(sighting.body_parts) if part in HIPS]
            if not self._can_tell:
                log.warning(CANNOT_TELL)
        if not self._can_tell:
            return
        tracks = sighting.tracks
        several = {str(person.id): person.centres for person in tracks.persons}
        lying = self._lying(several or {THE_PERSON: tracks.centres}, sighting)
        changed = lying.keys() != self._sent.keys() or any(
            abs(p - self._sent[track]) >= MOST_CHANGE for track, p in lying.items()
        )
        if changed or not 0 <= sighting.captured_ns - self._sent_ns < HEARTBEAT_NS:
            self._sent_ns, self._sent = sighting.captured_ns, lying
            message = PostureMessage(
                captured_ns=sighting.captured_ns,
                lying=max(lying.values(), default=None),
                people=dict(list(lying.items())[:TRACKS_LIMIT]) if several else None,
            )
            self._publisher.put(encode(message))

    def _lying(self, people: Mapping[str, Floats], sighting: Sighting) -> dict[str, float]:
        """P(lying) of those who are seen well enough, by track."""
        self._readers = {
            track: self._readers.get(track) or LyingReader(sighting.body_parts) for track in people
        }  # fmt: skip
        known = {}
        for track, centres in people.items():
            p = self._readers[track].update(centres, sighting.captured_ns)
            if p is not None:
                known[track] = 0.0 if self._areas and self._is_left_out(centres, sighting) else p
        return known

    def _is_left_out(self, centres: Floats, sighting: Sighting) -> bool:
        hips = centres[self._hips]
        hips = hips[np.isfinite(hips[:, 0])]
        if not len(hips):
            return False
        u, v = hips.mean(axis=0)
        if sighting.picture is not None:
            height, width = sighting.picture.shape[:2]
            u, v = u / width, v / height
        return any(left <= u <= right and top <= v <= bottom for left, top, right, bottom in self._areas)
