"""The lock that keeps one scene from being started twice."""

import os

import pytest

from common.config import read_scene
from common.errors import LabanmeshError
from deploy.commands import only_once, runtime_folder


@pytest.fixture
def scene(tmp_path):
    def read(more="", file="scene.toml"):
        (tmp_path / file).write_text(f'scene = "dojo"\n[observers.a]\nsource = "0"\n{more}')
        return read_scene(tmp_path / file, {})

    return read


def is_free(scene, folder):
    try:
        with only_once(scene, folder):
            return True
    except LabanmeshError as error:
        assert "stop that one first" in str(error)
        return False


def test_a_scene_starts_once_whatever_becomes_of_its_file(scene, tmp_path):
    with only_once(scene(), tmp_path):
        # Another file, as an editor leaves one that it saves, and a copy of it.
        (tmp_path / "scene.toml").unlink()
        assert not is_free(scene(), tmp_path)
        assert not is_free(scene(file="copy.toml"), tmp_path)
        assert is_free(scene('[mesh]\nendpoint = "tcp/127.0.0.1:7448"\n'), tmp_path)
    assert is_free(scene(), tmp_path)


def test_the_lock_lies_in_a_folder_that_only_its_user_can_write(tmp_path, monkeypatch):
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path))
    mine, anybodys, run = (tmp_path / name for name in ("mine", "anybodys", "run"))
    for folder, mode in ((mine, 0o700), (anybodys, 0o777)):
        folder.mkdir()
        folder.chmod(mode)
    assert runtime_folder({"XDG_RUNTIME_DIR": str(mine)}, run) == mine
    made = runtime_folder({"XDG_RUNTIME_DIR": str(anybodys)}, run)
    assert made == tmp_path / f"labanmesh-{os.getuid()}" and made.stat().st_mode & 0o777 == 0o700
    logged_in = run / str(os.getuid())
    logged_in.mkdir(parents=True, mode=0o700)
    assert runtime_folder({}, run) == logged_in
    logged_in.rmdir()
    made.rmdir()
    made.symlink_to(mine)
    with pytest.raises(LabanmeshError, match="name a folder of yours as XDG_RUNTIME_DIR"):
        runtime_folder({}, run)
