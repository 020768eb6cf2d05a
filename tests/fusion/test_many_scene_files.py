"""`labanmesh fuse` of many scene files: what cannot be judged together is one line."""

import pytest

from common.config import read_scene
from common.errors import BadInput
from fusion.commands import scene_files
from fusion.fleet import require_shareable

SCENE = 'scene = "{name}"\n{more}\n[observers.cam1]\nsource = "m.npz"\n'
WORDS = 'vocabulary = ["bow", "lunge"]'


def written(folder, **scenes):
    for file, text in scenes.items():
        (folder / f"{file}.toml").write_text(text)
    return [read_scene(path, {}) for path in scene_files([folder])]


def test_scenes_of_one_mesh_with_their_vocabularies_can_be_judged_together(tmp_path):
    scenes = written(tmp_path, a=SCENE.format(name="a", more=WORDS), b=SCENE.format(name="b", more=WORDS))
    assert [scene.scene for scene in scenes] == ["a", "b"]
    require_shareable(scenes)


@pytest.mark.parametrize(
    ("second", "line"),
    [
        (SCENE.format(name="a", more=WORDS), "scene 'a': in two of the files; each scene is judged once"),
        (SCENE.format(name="b", more=""), "scene 'b': no vocabulary; add vocabulary"),
        (SCENE.format(name="b", more=WORDS) + '[mesh]\nmode = "process"\n', "scene 'b': another [mesh] than 'a'"),
        (
            SCENE.format(name="b", more=WORDS) + '[fusion]\nmemory = "x"\n',
            "fusion.memory is for a process of one scene",
        ),
        (
            SCENE.format(name="b", more=WORDS) + '[fusion]\nstandby = ["c"]\n',
            "fusion.standby is for a process of one scene",
        ),
    ],
)
def test_what_cannot_be_judged_together_is_one_line(tmp_path, second, line):
    scenes = written(tmp_path, a=SCENE.format(name="a", more=WORDS), b=second)
    with pytest.raises(BadInput) as told:
        require_shareable(scenes)
    assert line in str(told.value) and "\n" not in str(told.value)


def test_a_folder_without_scene_files_is_one_line(tmp_path):
    with pytest.raises(BadInput, match=r"no scene file in this folder; scene files end in \.toml"):
        list(scene_files([tmp_path]))
