"""Pictures in a terminal."""

import re

import numpy as np
import pytest

from observer.preview.terminal_picture import picture_lines


@pytest.mark.parametrize(("exact", "red"), [(True, "2;255;0;0"), (False, "5;196")])
def test_a_picture_keeps_its_shape_and_colours(exact, red):
    picture = np.zeros((120, 160, 3), np.uint8)
    picture[:60, :, 2] = 255
    lines = picture_lines(picture, 40, 100, exact=exact)
    assert len(lines) == 15 and all(len(re.findall("▀", line)) == 40 for line in lines)
    assert lines[0].startswith(f"\x1b[38;{red};48;{red}m") and red not in lines[-1] and lines[0].endswith("\x1b[0m")
    assert len(picture_lines(picture, 200, 9)) == 9
