"""Which tracker an observer gets when the scene file names none."""

from types import SimpleNamespace

import pytest

from common import tracker_choice
from common.config_sections import ObserverConfig
from common.tracker_choice import CARRIED_MODEL, chosen_tracker


@pytest.fixture
def installed(monkeypatch, tmp_path):
    """Installs a mediapipe: None, or with or without its model."""

    def install(model):
        folder = SimpleNamespace(submodule_search_locations=[str(tmp_path)])
        monkeypatch.setattr(tracker_choice, "find_spec", lambda name: None if model is None else folder)
        if model:
            (tmp_path / CARRIED_MODEL).parent.mkdir(parents=True)
            (tmp_path / CARRIED_MODEL).touch()

    return install


def choice(source="0", **keys):
    return chosen_tracker(ObserverConfig(source=source, **keys))


@pytest.mark.parametrize(
    ("model", "name", "reason", "lacks"),
    [
        (None, "camshift", "not installed: pip install 'labanmesh[mediapipe]'", True),
        (False, "camshift", "carries no pose model: name a .task file", True),
        (True, "mediapipe", "is installed, with its model", False),
    ],
)
def test_pictures_get_the_best_tracker_that_is_here(installed, model, name, reason, lacks):
    installed(model)
    chosen = choice()
    assert (chosen.name, bool(chosen.lacks)) == (name, lacks) and reason in chosen.reason
    assert chosen.fallback == ("camshift" if name == "mediapipe" else "")


@pytest.mark.parametrize(
    ("keys", "name", "reason"),
    [
        ({"skin": "skin.npz"}, "camshift", "skin is set"),
        ({"face": (0, 0, 9, 9)}, "camshift", "face is set"),
        ({"pose_model": "p.task"}, "mediapipe", "pose_model is set"),
        ({"source": "m.npz"}, "projected", "positions"),
        ({"source": "zenoh:k"}, "foreign", "tracks"),
        ({"tracker": "camshift"}, "camshift", ""),
        ({"tracker": "mediapipe"}, "mediapipe", ""),
    ],
)
def test_what_the_scene_file_says_decides_first(installed, keys, name, reason):
    installed(True)
    chosen = choice(**keys)
    assert (chosen.name, chosen.fallback, chosen.lacks) == (name, "", "") and reason in chosen.reason
