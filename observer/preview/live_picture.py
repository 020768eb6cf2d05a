"""The live picture of an observer: published under a key of its own, only while somebody subscribes to it."""

from common import SECOND_NS
from common.picture_message import MOST_PICTURE_BYTES, PICTURE_BYTES_PER_S, PICTURE_SIDE_PX, PictureMessage
from common.subsession import Publisher
from common.wire import encode
from observer.preview.sight import Sighting
from observer.preview.small_picture import encode_jpeg, small_picture


class LivePicture:
    """Publishes at most `rate_hz` pictures a second, and at most PICTURE_BYTES_PER_S bytes."""

    def __init__(self, publisher: Publisher, rate_hz: float) -> None:
        self._publisher, self._every_ns = publisher, round(SECOND_NS / rate_hz)
        self._limit = min(MOST_PICTURE_BYTES, int(PICTURE_BYTES_PER_S / rate_hz))
        self._next_ns = 0

    def is_due(self, now_ns: int) -> bool:
        """Whether a picture is wanted at `now_ns`."""
        # A clock that was set back must not silence it.
        early = now_ns < self._next_ns <= now_ns + self._every_ns
        return not early and self._publisher.has_subscriber

    def show(self, sighting: Sighting, now_ns: int) -> None:
        """Publish one picture; raises LabanmeshError if the link is closed."""
        # Counted from when it was due, so that the rate is right whatever the camera's is.
        late_ns = now_ns - self._next_ns
        self._next_ns = (self._next_ns if 0 <= late_ns < self._every_ns else now_ns) + self._every_ns
        jpeg, (width, height) = encode_jpeg(small_picture(sighting, PICTURE_SIDE_PX), self._limit)
        message = PictureMessage(captured_ns=sighting.captured_ns, width=width, height=height, jpeg=jpeg)
        self._publisher.put(encode(message))
