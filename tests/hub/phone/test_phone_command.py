"""The verb `labanmesh phone` without a phone: lists, revokes, fetches, and says what is wrong in one line."""

import io
import json
import tarfile

import pytest

pytest.importorskip("websockets")
pytest.importorskip("segno")

from tiny_pose_model import model

from common.errors import BadInput, LabanmeshError
from hub.phone.pages import OWN_NAMES, ShownCodes, code_page, terminal_code
from hub.phone.pose_model_file import DATA_FOLDER, HASHES, NPM_PACKAGES, fetch, read_files
from hub.phone.register_file import RegisterFile
from labanmesh import main

SCENE = 'scene = "dojo"\n[observers.phone1]\nsource = "phone"\n[observers.cam1]\nsource = "0"\n'


@pytest.fixture
def scene(tmp_path, monkeypatch):
    monkeypatch.setenv(DATA_FOLDER, str(tmp_path / "files"))
    (tmp_path / "scene.toml").write_text(SCENE)
    return tmp_path / "scene.toml"


def run(capsys, *words):
    status = main(["phone", *map(str, words)])
    out, err = capsys.readouterr()
    return status, out, err


def test_phones_are_listed_and_revoked(scene, capsys):
    assert run(capsys, scene, "--list")[1].startswith("no phone was here")
    file = RegisterFile(scene.parent / "dojo.phones.json")
    code = file.new_code("phone1")
    assert "(an open code)" in run(capsys, scene, "--list")[1]
    file.join(code, "Android Chrome")
    listed = run(capsys, scene, "--list")[1]
    assert listed.startswith("phone1") and "Android Chrome" in listed and "admitted" in listed
    status, out, _ = run(capsys, scene, "--revoke", "phone1", "--list")
    assert status == 0 and out.startswith("phone1: revoked\n") and "revoked 2" in out
    assert oct((scene.parent / "dojo.phones.json").stat().st_mode & 0o777) == "0o600"


@pytest.mark.parametrize(("words", "status", "line"), [
    ((), 2, "name a scene file"),
    (("SCENE", "--revoke", "phone1"), 2, "--revoke phone1: no phone and no open code; observers with a phone: none"),
    (("SCENE", "--revoke", "phone9"), 2, "'phone9': not in the scene; known: phone1, cam1"),
    (("SCENE", "cam1"), 2, "observers.cam1.source = '0': to see through a phone, write source = \"phone\""),
    (("SCENE", "--listen", "here"), 2, "--listen = 'here': must be HOST:PORT"),
    (("SCENE",), 1, "pose model once, 40 MB from npm: labanmesh phone --fetch"),
    (("--fetch", "--from", "nowhere"), 2, "has no mediapipe-tasks-vision-0.10.21.tgz; make it: npm pack @mediapipe"),
])  # fmt: skip
def test_what_is_wrong_is_one_line(scene, capsys, words, status, line):
    found, _, err = run(capsys, *(scene if word == "SCENE" else word for word in words))
    assert found == status and line in err and err.count("\n") == 1


def test_a_scene_without_phones_says_how_to_add_one(tmp_path, capsys):
    (tmp_path / "s.toml").write_text('scene = "dojo"\n[observers.cam1]\nsource = "0"\n')
    assert 'add [observers.phone1] with source = "phone"' in run(capsys, tmp_path / "s.toml")[2]


def package(folder, name, files):
    with tarfile.open(folder / name, "w:gz") as archive:
        for path, content in files.items():
            member = tarfile.TarInfo(f"package/{path}")
            member.size = len(content)
            archive.addfile(member, io.BytesIO(content))


def test_files_that_labanmesh_does_not_know_are_not_taken(tmp_path):
    runtime = {"vision_bundle.mjs": b"evil()"}
    package(tmp_path, "mediapipe-tasks-vision-0.10.21.tgz", runtime)
    package(tmp_path, "mediapipe-pose-0.5.1675469404.tgz", {})
    with pytest.raises(BadInput, match="a package has no file"):
        fetch(tmp_path / "files", tmp_path)
    names = ("vision_wasm_internal.js", "vision_wasm_internal.wasm")
    names += tuple(name.replace("internal", "nosimd_internal") for name in names)
    package(tmp_path, "mediapipe-tasks-vision-0.10.21.tgz", runtime | {f"wasm/{name}": b"" for name in names})
    models = {name: model() for name in ("pose_landmark_full.tflite", "pose_landmark_lite.tflite")}
    package(tmp_path, "mediapipe-pose-0.5.1675469404.tgz", models | {"pose_solution_packed_assets.data": model()})
    with pytest.raises(LabanmeshError, match=r"vision_bundle\.mjs: not the file that labanmesh knows"):
        fetch(tmp_path / "files", tmp_path)
    assert not (tmp_path / "files").exists()
    (tmp_path / "mediapipe-pose-0.5.1675469404.tgz").write_bytes(b"junk")
    with pytest.raises(BadInput, match="no package of npm"):
        fetch(tmp_path / "files", tmp_path)


def test_a_file_that_was_changed_is_not_served(tmp_path):
    for name in HASHES:
        (tmp_path / name).write_bytes(b"evil()")
    with pytest.raises(LabanmeshError, match=r"not the file that labanmesh knows \(SHA-256\); labanmesh phone --fetch"):
        read_files(tmp_path)
    assert all("@" in package and "/" in package for package in NPM_PACKAGES)


def test_a_code_is_shown_until_it_is_used(tmp_path):
    file = RegisterFile(tmp_path / "dojo.phones.json")
    codes = ShownCodes(file, ("phone1",), "https://192.168.1.20:8443/")
    link = codes.link("phone1")
    assert link == codes.link("phone1") and link.startswith("https://192.168.1.20:8443/#")
    assert len(terminal_code(link).splitlines()) > 15
    shown = code_page(codes, dict, "/", "127.0.0.1:8444")
    assert shown.status == 200 and b"<svg" in shown.body and shown.headers["cache-control"] == "no-store"
    file.join(link.partition("#")[2], "<script>")
    assert codes.link("phone1") is None
    used = code_page(codes, lambda: {"phone1": 1}, "/", "localhost:8444").body
    assert b"<svg" not in used and b"<script>" not in used and b"is here" in used
    file.revoke("phone1")
    assert codes.link("phone1") not in (None, link)


@pytest.mark.parametrize("host", ["evil.example:8444", "", "192.168.1.20:8444"])
def test_the_codes_are_shown_under_this_machines_own_names_alone(tmp_path, host):
    codes = ShownCodes(RegisterFile(tmp_path / "p.json"), ("phone1",), "https://sofa:8443/")
    assert code_page(codes, dict, "/", host).status == 421 and len(OWN_NAMES) == 3
    assert not (tmp_path / "p.json").exists()


def test_the_register_is_damaged(tmp_path, capsys, scene):
    (scene.parent / "dojo.phones.json").write_text(json.dumps({"phones": 3}))
    status, _, err = run(capsys, scene, "--list")
    assert status == 2 and "remove the file" in err
