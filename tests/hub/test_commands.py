"""`labanmesh watch` over a real link on this machine."""

import json

import pytest

import labanmesh
from common.config import MeshConfig
from common.link import Link
from common.wire import encode


@pytest.fixture
def scene_file(tmp_path, said):
    """A scene file, with somebody on its mesh who answers for the last judgement."""
    with Link.open(MeshConfig(), "fusion", listen=["tcp/127.0.0.1:0"]) as link:
        link.answer("laban/room/judgement", lambda: encode(said.judgement()))
        file = tmp_path / "scene.toml"
        file.write_text(f'scene = "room"\n[mesh]\nendpoint = "{link.locator}"\n[observers.cam1]\nsource = "a.npz"\n')
        yield file


def test_who_comes_late_reads_the_last_judgement(scene_file, capsys):
    assert labanmesh.main(["watch", str(scene_file), "--json", "--for", "0"]) == 0
    assert json.loads(capsys.readouterr().out)["label"] == "nthrow"


def test_without_a_terminal_it_speaks_plain_lines(scene_file, capsys):
    assert labanmesh.main(["watch", str(scene_file), "--for", "0"]) == 0
    assert "\x1b" not in capsys.readouterr().out


@pytest.mark.parametrize("words", [["nowhere.toml"], [], ["x.toml", "--for", "-1"]])
def test_bad_input_is_one_line_and_status_2(words, capsys):
    assert labanmesh.main(["watch", *words]) == 2
    assert capsys.readouterr().err.count("\n") == 1
