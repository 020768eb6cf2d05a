"""The message that carries one live picture of an observer, and its bounds. Pure."""

from typing import Annotated, Final

from pydantic import Field

from common.message_types import Time
from common.messages import Message

PICTURE_BYTES_PER_S: Final = 48_000
"""Most bytes of live pictures that an observer sends in a second."""
MOST_PICTURE_BYTES: Final = PICTURE_BYTES_PER_S // 2
"""Most bytes of one picture, at any rate."""
PICTURE_SIDE_PX: Final = 320
"""Most pixels of its longer side."""


class PictureMessage(Message):
    """One picture with what its tracker finds drawn into it. The key names scene and observer.

    captured_ns: when the frame was captured. width, height: of the JPEG, px. jpeg: the whole file.
    """

    captured_ns: Time
    width: Annotated[int, Field(ge=1, le=PICTURE_SIDE_PX)]
    height: Annotated[int, Field(ge=1, le=PICTURE_SIDE_PX)]
    jpeg: Annotated[bytes, Field(min_length=2, max_length=MOST_PICTURE_BYTES)]
