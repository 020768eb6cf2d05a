"""What a scene file says of credentials: where they lie, and that half a security is none."""

import pytest

from common.config import read_scene
from common.errors import BadInput

OBSERVER = '[observers.cam1]\nsource = "m.npz"\n'


def read(tmp_path, mesh, environment=None):
    (tmp_path / "scene.toml").write_text(f'scene = "dojo"\n[mesh]\n{mesh}\n{OBSERVER}')
    return read_scene(tmp_path / "scene.toml", environment or {})


@pytest.mark.parametrize(
    ("named", "place"), [("credentials", "{}/credentials"), ("/etc/mesh", "/etc/mesh"), ("../c", "{}/../c")]
)
def test_the_folder_starts_from_the_scene_file(tmp_path, named, place):
    mesh = f'mode = "router"\nendpoint = "tls/judge.example:7447"\ncredentials = "{named}"'
    assert read(tmp_path, mesh).mesh.credentials == place.format(tmp_path)
    unsecured = 'mode = "router"\nendpoint = "tls/judge.example:7447"'
    assert read(tmp_path, unsecured, {"LABANMESH_MESH_CREDENTIALS": named}).mesh.credentials == place.format(tmp_path)


@pytest.mark.parametrize(
    ("mesh", "line"),
    [
        ('credentials = "c"', 'only a router can refuse anybody; set mesh.mode = "router", or take it out'),
        ('mode = "process"\nendpoint = "tls/a:1"\ncredentials = "c"', "only a router can refuse anybody"),
        ('mode = "router"\ncredentials = "c"', "mesh.endpoint = 'tcp/127.0.0.1:7447' is not encrypted; write tls/"),
        ("credentials = 7", "mesh.credentials = 7"),
        ('credential = "c"', "mesh.credential: unknown key; did you mean credentials?"),
    ],
)
def test_half_a_security_is_one_line(tmp_path, mesh, line):
    with pytest.raises(BadInput) as caught:
        read(tmp_path, mesh)
    assert line in str(caught.value) and "\n" not in str(caught.value)
