"""`labanmesh new`: each kind of package is written once, is found by its entry point, and passes its own test."""

import os
import subprocess
import sys
import tomllib
from pathlib import Path

import pytest
from processes import SOON_S

from common import plugins
from common.config import read_scene
from common.errors import BadInput, LabanmeshError
from deploy.commands import jobs
from deploy.new_package.commands import ENTRY_POINT_GROUPS, new, package

ROOT = Path(__file__).parents[2]


def install(folder, kind, name):
    """Put a package, with the metadata that pip would write, into a folder of the path."""
    files = package(kind, name)
    project = tomllib.loads(files["pyproject.toml"])["project"]
    metadata = folder / f"labanmesh_{name}-{project['version']}.dist-info"
    metadata.mkdir(parents=True)
    (metadata / "METADATA").write_text(f"Metadata-Version: 2.1\nName: {project['name']}\nVersion: 0.1.0\n")
    lines = [
        line
        for group, entries in project["entry-points"].items()
        for line in (f"[{group}]", *(f"{each} = {value}" for each, value in entries.items()))
    ]
    (metadata / "entry_points.txt").write_text("\n".join(lines))
    for file, text in files.items():
        (folder / file).write_text(text)


def test_each_kind_works_where_it_is_installed(tmp_path):
    # median: a rule of an earlier version.
    names = {**{kind: f"my_{kind}" for kind in ENTRY_POINT_GROUPS}, "rule": "median"}
    for kind, name in names.items():
        install(tmp_path, kind, name)
    environment = {**os.environ, "PYTHONPATH": f"{ROOT}{os.pathsep}{tmp_path}"}
    command = [sys.executable, "-P", "-m", "pytest", "-q", "-p", "no:cacheprovider", "--rootdir", tmp_path, tmp_path]
    done = subprocess.run(command, cwd=tmp_path, env=environment, capture_output=True, text=True, timeout=SOON_S)
    assert done.returncode == 0, done.stdout + done.stderr
    overview = subprocess.run(
        [sys.executable, "-P", "-m", "labanmesh", "--help"],
        env=environment,
        capture_output=True,
        text=True,
        timeout=SOON_S,
    )
    assert "  my_hub       of the package labanmesh-my_hub" in overview.stdout


def test_a_scene_file_may_start_an_installed_hub(tmp_path, monkeypatch):
    install(tmp_path, "hub", "lamp")
    monkeypatch.syspath_prepend(tmp_path)
    file = tmp_path / "scene.toml"
    file.write_text('scene = "dojo"\n[observers.a]\nsource = "a.npz"\n[hub]\nstart = ["lamp"]\n')
    assert jobs(file, read_scene(file))[-1].command[-2:] == ["lamp", str(file)]
    file.write_text(file.read_text().replace("lamp", "lump"))
    with pytest.raises(BadInput, match=r"hub.start = 'lump': unknown hub; did you mean lamp\?"):
        jobs(file, read_scene(file))


def test_nothing_is_overwritten_and_bad_names_are_one_line(tmp_path, capsys):
    new("hub", "lamp", tmp_path / "lamp")
    assert f"pip install -e '{tmp_path}/lamp[test]'" in capsys.readouterr().out
    assert all(len(line) <= 120 for file in (tmp_path / "lamp").iterdir() for line in file.read_text().splitlines())
    with pytest.raises(BadInput, match="exists already and is not overwritten"):
        new("hub", "lamp", tmp_path / "lamp")
    for kind, name in (("lamp", "a"), ("hub", "My Lamp"), ("hub", "class"), ("hub", "a" * 33)):
        with pytest.raises(BadInput, match=r"^'"):
            package(kind, name)


def test_a_package_that_cannot_be_imported_is_one_line(tmp_path, monkeypatch):
    install(tmp_path, "rule", "broken")
    (tmp_path / "labanmesh_broken.py").write_text("import no_such_library")
    monkeypatch.syspath_prepend(tmp_path)
    assert "broken" in plugins.plugins("rules") and plugins.plugin("rules", "unknown") is None
    with pytest.raises(LabanmeshError, match=r"^labanmesh-broken: its 'broken' cannot be loaded: ModuleNotFound"):
        plugins.plugin("rules", "broken")
