"""Judges that publish what they saw of a person, frame by frame, in any number of scenes."""

import threading
import time

from common import SECOND_NS
from common.messages import PosteriorMessage, VocabularyReference
from common.wire import encode

TICK_S = 1 / 15


class Judges:
    """Honest observers of several scenes, which all see the same person; those in `silent` publish nothing."""

    def __init__(self, link, scenes, person, names):
        self._courses, self.silent = person.courses(), set()
        self._reference = VocabularyReference(name=person.vocabulary.name, hash=person.vocabulary.digest)
        self._publishers = {
            (scene.scene, name): link.publisher(scene.keys.posterior(name)) for scene in scenes for name in names
        }
        for scene in scenes:
            for name in names:
                link.announce(scene.keys.observer_alive(name))
        self.frame, self.seq = 0, 0

    def publish(self, stop):
        """Until `stop` is set, one posterior of each judge for each frame; the film begins anew at its end."""
        begun_s = time.monotonic()
        while not stop.is_set():
            self.seq += 1
            for name, course in self._courses.items():
                if name not in self.silent:
                    self._publish(name, course)
            threading.Event().wait(max(0.0, begun_s + self.seq * TICK_S - time.monotonic()))

    def _publish(self, name, course):
        frame = self.frame = self.seq % len(course.p)
        for (scene, judge), publisher in self._publishers.items():
            if judge == name:
                publisher.put(self.posterior(scene, name, course, frame))

    def posterior(self, scene, name, course, frame, **fields):
        """The bytes of one posterior, captured now."""
        now_ns = time.time_ns() - SECOND_NS // 200
        values = {
            "v": 1, "scene": scene, "observer": name, "seq": self.seq, "session": f"honest-{name}",
            "captured_ns": now_ns, "sent_ns": now_ns, "vocabulary": self._reference, "p": course.p[frame].tolist(),
            "rest": float(course.rest[frame]), "frames": self.seq,
            "visible": {"left_hand": bool(course.visible[frame])},
        }  # fmt: skip
        return encode(PosteriorMessage(**{**values, **fields}))
