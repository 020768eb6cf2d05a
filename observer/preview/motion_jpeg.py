"""JPEGs as one film: an AVI file with Motion JPEG, which players and OpenCV read, made without encoding again. Pure."""

import struct
from collections.abc import Sequence

MICROSECONDS = 1_000_000
HAS_INDEX = 0x10
KEY_FRAME = 0x10


def motion_jpeg(jpegs: Sequence[bytes], size_px: tuple[int, int], rate_hz: float) -> bytes:
    """The whole file. size_px: width and height of every picture. Source: Microsoft, AVI RIFF File Reference."""
    chunks = [_chunk(b"00dc", jpeg) for jpeg in jpegs]
    places, place = [], 4
    for chunk in chunks:
        places.append(place)
        place += len(chunk)
    index = b"".join(
        struct.pack("<4sIII", b"00dc", KEY_FRAME, at, len(jpeg)) for at, jpeg in zip(places, jpegs, strict=True)
    )
    header = _header(len(jpegs), max(map(len, jpegs)), size_px, rate_hz)
    body = b"".join([header, _chunk(b"LIST", b"".join([b"movi", *chunks])), _chunk(b"idx1", index)])
    return _chunk(b"RIFF", b"AVI " + body)


def _header(frames: int, largest: int, size_px: tuple[int, int], rate_hz: float) -> bytes:
    width, height = size_px
    per_frame = round(MICROSECONDS / rate_hz)
    main = struct.pack(
        "<14I", per_frame, round(largest * rate_hz), 0, HAS_INDEX, frames, 0, 1, largest, width, height, 0, 0, 0, 0
    )
    stream = struct.pack(
        "<4s4sIHHIIIIIIII4H", b"vids", b"MJPG", 0, 0, 0, 0, per_frame, MICROSECONDS, 0, frames, largest, 0xFFFFFFFF, 0,
        0, 0, width, height,
    )  # fmt: skip
    picture = struct.pack("<IiiHH4sIiiII", 40, width, height, 1, 24, b"MJPG", 3 * width * height, 0, 0, 0, 0)
    streams = _chunk(b"LIST", b"strl" + _chunk(b"strh", stream) + _chunk(b"strf", picture))
    return _chunk(b"LIST", b"hdrl" + _chunk(b"avih", main) + streams)


def _chunk(name: bytes, content: bytes) -> bytes:
    """A RIFF chunk; its content starts at an even place."""
    return b"".join([name, struct.pack("<I", len(content)), content, b"\0" * (len(content) % 2)])
