"""A disk that is full."""

import contextlib


def fill(disk):
    """Take all the space that is left."""
    filler = disk / "filler"
    with filler.open("wb", buffering=0) as output, contextlib.suppress(OSError):
        while True:
            output.write(bytes(512))
    return filler
