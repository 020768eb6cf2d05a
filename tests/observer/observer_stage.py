"""Builders that several of the observer's tests share."""

from contextlib import contextmanager

import numpy as np
import pytest

from common import SECOND_NS
from common.errors import BadInput


@contextmanager
def rejected(*texts, error=BadInput):
    """The block raises this error with one line that contains the texts."""
    with pytest.raises(error) as caught:
        yield
    line = str(caught.value)
    assert caught.type is error and "\n" not in line and all(str(text) in line for text in texts), line


def printed_board(columns=4, rows=7, side=40):
    """A chessboard of (columns, rows) inner corners as a grey picture, with a white margin of one square."""
    y, x = np.mgrid[: (rows + 1) * side, : (columns + 1) * side] // side
    return np.pad(np.where((x + y) % 2 == 1, 255, 0).astype(np.uint8), side, constant_values=255)


def pose2sim_markers(data, *markers):
    """(100, P, 3) metres of the markers in the room of the calibration, which is (Z, X, Y) of the file."""
    lines = (data / "pose2sim_single/reference_3d/Pose2Sim_markers.trc").read_text().splitlines()
    columns = [lines[3].split("\t").index(marker) for marker in markers]
    rows = [line.split("\t") for line in lines[5:] if line.strip()]
    return np.array([[[float(row[c + k]) for k in (2, 0, 1)] for c in columns] for row in rows])


class WaitingClock:
    """A clock that only `wait` advances; stands in for the time and for the stop event, set after so many waits."""

    def __init__(self, stopped_after=None):
        self.now_ns = self.began_ns = 1_000 * SECOND_NS
        self.waits, self.stopped_after = [], stopped_after

    def __call__(self):
        return self.now_ns

    def is_set(self):
        return self.stopped_after == len(self.waits)

    def wait(self, seconds):
        self.waits.append(seconds)
        self.now_ns += round(seconds * SECOND_NS)
