"""`labanmesh fuse`: which scenes one service can serve, and as whom; what it cannot is one line."""

from threading import Event
from unittest.mock import MagicMock

import pytest

from common.config import read_scene
from common.errors import BadInput
from common.keys import SceneKeys
from fusion.commands import require_compatible, scene_files
from fusion.same_id import IdCheck
from fusion.server import SteadyClock


def text(name, more=""):
    return f'scene = "{name}"\n[observers.cam1]\nsource = "m.npz"\n{more}'


def written(folder, first, second):
    """Both scenes, read from a folder with both files."""
    (folder / "a.toml").write_text(first)
    (folder / "b.toml").write_text(second)
    return [read_scene(path, {}) for path in scene_files([folder])]


@pytest.mark.parametrize("more", ["", '[fusion]\nstandby = ["c"]\n', '[fusion]\nmemory = "b.json"\n'])
def test_scenes_of_one_mesh_are_served_together(tmp_path, more):
    scenes = written(tmp_path, text("a"), text("b", more))
    assert [scene.scene for scene in scenes] == ["a", "b"]
    require_compatible(scenes)


MEMORY = '[fusion]\nmemory = "x"\n'


@pytest.mark.parametrize(
    ("first", "second", "line"),
    [
        (text("a"), text("a"), "scene 'a': in two of the files; each scene is fused once"),
        (text("a"), text("b", '[mesh]\nmode = "process"\n'), "scene 'b': another [mesh] than 'a'"),
        (text("a", MEMORY), text("b", MEMORY), "scene 'b': fusion.memory = 'x' is the file of 'a' too; each scene"),
    ],
)
def test_what_cannot_be_served_together_is_one_line(tmp_path, first, second, line):
    with pytest.raises(BadInput) as error:
        require_compatible(written(tmp_path, first, second))
    assert line in str(error.value) and "\n" not in str(error.value)


def test_a_folder_without_scene_files_is_one_line(tmp_path):
    with pytest.raises(BadInput, match=r"no scene file in this folder; scene files end in \.toml"):
        list(scene_files([tmp_path]))


def test_a_service_is_one_that_the_scene_names_or_any_where_scenes_are_shared(tmp_path):
    plain, standby = written(tmp_path, text("a"), text("b", '[fusion]\nstandby = ["second"]\n'))
    plain.require_service("fusion")
    plain.require_service("north", shared=True)
    standby.require_service("second", shared=True)
    for scene, shared in ((plain, False), (standby, True)):
        with pytest.raises(BadInput, match=r"fusion service 'north': not in the scene .*; known: fusion.*standby"):
            scene.require_service("north", shared=shared)


def test_a_service_waits_for_another_one_of_its_id_only_where_it_does_not_listen_itself(tmp_path, monkeypatch):
    asked = []
    monkeypatch.setattr("fusion.same_id.SameIdWatch.ask", lambda *_, **__: asked.append(1))
    monkeypatch.setattr("fusion.same_id.DISCOVERY_S", 0.0)
    link, token = MagicMock(), SceneKeys("a").fusion_alive("fusion")
    link.sub_session.return_value.presence.return_value.alive = {token}
    for more, waits in (("", False), ('[mesh]\nmode = "router"\n', True)):
        (tmp_path / "a.toml").write_text(text("a", more))
        check = IdCheck([read_scene(tmp_path / "a.toml", {})], "fusion", link)
        monkeypatch.setattr("fusion.same_id.TOKEN_TIMEOUT_S", 0.0)
        assert check.is_free(Event()) and bool(asked) is waits


def test_the_services_clock_does_not_jump_within_a_movement_and_follows_at_rest():
    wall, ticks = [1_000_000_000_000], [5]
    clock = SteadyClock(lambda: wall[0], lambda: ticks[0])
    assert clock() == wall[0]
    wall[0] -= 500_000_000
    ticks[0] += 7
    assert clock() == 1_000_000_000_007
    clock.follow()
    assert clock() == wall[0]
    wall[0] += 1_000_000
    clock.follow()
    assert clock() == wall[0] - 1_000_000, "a difference as small as the measurement is not followed"
