"""The section [watch.fallen] of a scene file."""

import pytest

from common.config import read_scene
from common.errors import BadInput

HEAD = 'scene = "room"\n[observers.cam1]\nsource = "a.npz"\n'


def read(tmp_path, text):
    (tmp_path / "s.toml").write_text(HEAD + text)
    return read_scene(tmp_path / "s.toml", {})


def test_the_watch_is_off_unless_its_section_is_there(tmp_path):
    assert read(tmp_path, "").watch.fallen is None
    assert read(tmp_path, "[watch.fallen]\n").watch.fallen.after_s == 1.5
    scene = read(tmp_path, "[watch.fallen]\nafter_s = 10\n[watch.fallen.leave_out]\ncam1 = [[0.1, 0.5, 0.4, 0.9]]\n")
    assert scene.watch.fallen.leave_out["cam1"] == ((0.1, 0.5, 0.4, 0.9),)


@pytest.mark.parametrize(
    ("text", "fault"),
    [
        ("after_s = 0.1", "after_s"),
        ('after_s = "soon"', "after_s"),
        ("seconds = 3", "seconds"),
        ("[watch.fallen.leave_out]\nbed = [[0.1, 0.1, 0.2, 0.2]]", "bed: not an observer of the scene; known: cam1"),
        ("[watch.fallen.leave_out]\ncam1 = [[0.4, 0.1, 0.2, 0.2]]", "left < right"),
        ("[watch.fallen.leave_out]\ncam1 = [[0.1, 0.2]]", "leave_out"),
        ("[watch.fallen.leave_out]\ncam1 = [[0.1, nan, 0.2, 0.3]]", "leave_out"),
    ],
)
def test_bad_settings_are_one_line(tmp_path, text, fault):
    with pytest.raises(BadInput) as caught:
        read(tmp_path, f"[watch.fallen]\n{text}\n")
    assert fault in str(caught.value) and "\n" not in str(caught.value) and "s.toml" in str(caught.value)
