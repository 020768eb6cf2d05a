"""Publishes what an observer sees of the person's posture, for the watch for falls (docs/design/falls.md)."""

import logging
from collections.abc import Sequence

import numpy as np

from common import SECOND_NS
from common.config_watch import Area
from common.fall_messages import PostureMessage
from common.subsession import Publisher
from common.wire import encode
from observer.lying import LyingReader
from observer.preview.small_picture import Sighting

HEARTBEAT_NS = SECOND_NS // 2
MOST_CHANGE = 0.05
"""The evidence is published when it has changed by so much, and every HEARTBEAT_NS."""
HIPS = ("left_hip", "right_hip", "pelvis")
CANNOT_TELL = (
    "watch.fallen: the tracker of this observer finds no torso and legs, so it takes no part in the watch; use a "
    'tracker with a pose model (tracker = "mediapipe")'
)

log = logging.getLogger("labanmesh.observer")


class PostureOutlet:
    """Takes every sighting. areas: where people usually lie: whoever has the hips there does not lie."""

    def __init__(self, publisher: Publisher, areas: Sequence[Area] = ()) -> None:
        self._publisher, self._areas = publisher, areas
        self._reader: LyingReader | None = None
        self._hips: list[int] = []
        self._sent: tuple[int, float | None] = (0, None)

    def is_due(self, now_ns: int) -> bool:
        """Always: a fall is short."""
        return True

    def show(self, sighting: Sighting, now_ns: int) -> None:
        """Read one frame; raises LabanmeshError if the link is closed."""
        if self._reader is None:
            self._reader = LyingReader(sighting.body_parts)
            self._hips = [row for row, part in enumerate(sighting.body_parts) if part in HIPS]
            if not self._reader.can_tell:
                log.warning(CANNOT_TELL)
        if not self._reader.can_tell:
            return
        lying = self._reader.update(sighting.tracks.centres, sighting.captured_ns)
        if lying is not None and self._areas and self._is_left_out(sighting):
            lying = 0.0
        sent_ns, before = self._sent
        is_old = not 0 <= sighting.captured_ns - sent_ns < HEARTBEAT_NS
        if is_old or (lying is None) != (before is None) or abs((lying or 0.0) - (before or 0.0)) >= MOST_CHANGE:
            self._sent = sighting.captured_ns, lying
            self._publisher.put(encode(PostureMessage(captured_ns=sighting.captured_ns, lying=lying)))

    def close(self) -> None:
        """Nothing to complete."""

    def _is_left_out(self, sighting: Sighting) -> bool:
        hips = sighting.tracks.centres[self._hips]
        hips = hips[np.isfinite(hips[:, 0])]
        if not len(hips):
            return False
        u, v = hips.mean(axis=0)
        if sighting.picture is not None:
            height, width = sighting.picture.shape[:2]
            u, v = u / width, v / height
        return any(left <= u <= right and top <= v <= bottom for left, top, right, bottom in self._areas)
