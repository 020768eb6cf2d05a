"""Which frames an observer judges when it is too slow for all of them. Pure.

An observer in a hurry spends its time on following the body parts: a hand that is lost between two frames costs more
than a judgement that is some tenths of a second old. A frame that is not judged is not published either.
"""

from common import SECOND_NS
from observer.tracks import Frame

HURRIED_S = 1.0
"""An observer that left out a frame is in a hurry for so long: the next frames will take as long as those before."""


class Hurry:
    """Decides for each frame whether the movement is judged with it; judged_s: interval for an observer in a hurry."""

    def __init__(self, judged_s: float) -> None:
        self._judged_ns = round(judged_s * SECOND_NS)
        self._last_judged_ns: int | None = None
        self._last_skipped_ns: int | None = None

    def judges(self, frame: Frame) -> bool:
        """Whether to judge with this frame; the last one of a recording always is."""
        if frame.skipped:
            self._last_skipped_ns = frame.at_ns
        hurried = _within(self._last_skipped_ns, frame.at_ns, HURRIED_S * SECOND_NS)
        if hurried and not frame.last and _within(self._last_judged_ns, frame.at_ns, self._judged_ns):
            return False
        self._last_judged_ns = frame.at_ns
        return True


def _within(before_ns: int | None, now_ns: int, most_ns: float) -> bool:
    """Whether it is less than this long ago; a clock that was set back starts anew."""
    return before_ns is not None and 0 <= now_ns - before_ns < most_ns
