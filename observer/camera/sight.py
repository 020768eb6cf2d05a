"""What a live camera's silence, sameness and failures mean, and when to try again. Pure: time is passed in.

1. A camera that cannot be opened or read is lost, from that moment until it delivers a picture.
2. A camera that has delivered nothing for `silence_s` is lost too, whatever it is waiting for.
3. A camera whose pictures have been identical for `same_s` is frozen: the noise of a sensor makes real ones differ.
4. A lost camera is opened again after a wait that doubles with each failure; only a camera that delivered for
   `steady_s` begins at the short wait again, so that one that dies at every start is not hammered.
"""

import zlib
from dataclasses import dataclass
from typing import Literal

from observer.camera.base import Picture

SECOND_NS = 1_000_000_000
STRIDE = 8
"""Every 8th pixel of every 8th row tells two pictures apart: 1/64 of the bytes, and still thousands of noisy pixels."""

Sight = Literal["sees", "lost", "frozen"]


@dataclass(frozen=True, slots=True)
class Patience:
    """How long, in seconds, a camera may be silent, and deliver the same picture.

    A second is what an observer may take to say that it is degraded; the missing tenth is for noticing and saying.
    """

    silence_s: float = 0.9
    same_s: float = 1.0


@dataclass(frozen=True, slots=True)
class Seen:
    """What is known of a live camera; times in ns of one clock that is never set back.

    newest_ns: of the newest picture, or of the beginning when there is none yet. changed_ns: of the newest picture
    that differed from the one before it, or of the beginning. fault: why it was lost; "" when it delivers.
    """

    newest_ns: int
    changed_ns: int
    fault: str = ""


@dataclass(frozen=True, slots=True)
class Judgement:
    """How the camera is, and the reason in words, "" when it sees."""

    sight: Sight
    reason: str = ""


def judge(seen: Seen, now_ns: int, patience: Patience) -> Judgement:
    """How a camera of which this is known is at `now_ns`: rules 1 to 3, the first that applies."""
    if seen.fault:
        return Judgement("lost", seen.fault)
    if now_ns - seen.newest_ns >= patience.silence_s * SECOND_NS:
        return Judgement("lost", f"no picture for {patience.silence_s:g} s")
    # From picture to picture: a camera that is merely slow has not shown the same for so long.
    if seen.newest_ns - seen.changed_ns >= patience.same_s * SECOND_NS:
        return Judgement("frozen", f"frozen: the same picture for {patience.same_s:g} s")
    return Judgement("sees")


def silent_in_s(seen: Seen, now_ns: int, patience: Patience) -> float:
    """Seconds from `now_ns` until rule 2 applies if nothing comes; 0 when it does already."""
    return max(0.0, patience.silence_s - (now_ns - seen.newest_ns) / SECOND_NS)


def digest(picture: Picture) -> int:
    """A number that is the same for identical pictures and, by their noise, differs between real ones."""
    return zlib.crc32(picture[::STRIDE, ::STRIDE].tobytes())


@dataclass(frozen=True, slots=True)
class Backoff:
    """Rule 4: the wait before a lost camera is opened again, `first_s` doubled with each failure up to `longest_s`."""

    first_s: float = 0.25
    longest_s: float = 8.0
    steady_s: float = 2.0

    def failures(self, before: int, delivered_s: float) -> int:
        """How many failures in a row there are, after one more by a camera that had delivered for so many seconds."""
        return 1 if delivered_s >= self.steady_s else before + 1

    def wait_s(self, failures: int) -> float:
        """Seconds to wait after so many failures in a row (at least 1)."""
        # 2 ** 60 quarter seconds outlast any camera; without the bound a float would overflow after a night.
        return min(self.first_s * 2.0 ** min(failures - 1, 60), self.longest_s)
