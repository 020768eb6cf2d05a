"""`labanmesh init`: it writes a scene file, also with its comments as settings, and never overwrites one."""

import json
import re

import pytest
from hypothesis import given
from hypothesis import strategies as st

from common.config import read_scene
from common.errors import BadInput, LabanmeshError
from deploy.doctor.cameras import Webcam
from deploy.first_scene import commands
from deploy.first_scene.commands import first_camera, init
from deploy.first_scene.scene_text import scene_text

WEBCAMS = [Webcam(f"/dev/video{2 * number}", f"Camera {number}") for number in range(6)]
CAMERAS = [first_camera(webcam) for webcam in WEBCAMS]


@pytest.mark.parametrize("many", range(7))
@pytest.mark.parametrize("uncommented", [False, True])
def test_the_file_is_a_scene_of_these_cameras(tmp_path, many, uncommented):
    text = scene_text(CAMERAS[:many], "scene.toml", "home")
    if uncommented:
        text = re.sub(r"^#(?=\w)", "", text, flags=re.MULTILINE)
    (tmp_path / "scene.toml").write_text(text)
    scene = read_scene(tmp_path / "scene.toml", {})
    assert [section.source for section in scene.observers.values()] == [
        str(2 * number) for number in range(max(many, 1))
    ]
    assert len({section.view for section in list(scene.observers.values())[:4]}) == min(max(many, 1), 4)
    assert scene.fusion.quorum == (len(scene.roster) + 1) // 2 and scene.scene == "home"


def test_the_comments_name_the_next_steps():
    text = scene_text(CAMERAS[:2], "dojo.toml", "dojo")
    for command in (
        "camera look 0", "camera look 2", "learn motion.npz --view yaw:30 -o cam1.model",
        "doctor dojo.toml", "teach dojo.toml wave",
        "learn motion.npz --view yaw:-30 -o cam2.model", "up dojo.toml", "watch dojo.toml",
    ):  # fmt: skip
        assert f"labanmesh {command}" in text
    assert "Camera 1, /dev/video2" in text and "No camera was found" not in text
    assert "No camera was found" in scene_text([], "dojo.toml", "dojo")
    assert max(map(len, text.splitlines())) <= 120


@given(st.text(max_size=30))
def test_a_cameras_name_cannot_break_the_file(tmp_path_factory, name):
    place = tmp_path_factory.mktemp("scene") / "s.toml"
    place.write_text(scene_text([first_camera(Webcam("/dev/video0", name))], "s.toml", "home"), encoding="utf-8")
    assert read_scene(place, {}).roster == ("cam1",)


def test_it_writes_a_file_once(tmp_path, monkeypatch, capsys):
    monkeypatch.setattr(commands, "webcams", lambda: WEBCAMS[:2])
    init(tmp_path / "My Dojo.toml")
    output = capsys.readouterr().out
    assert "/dev/video2: Camera 1" in output and "labanmesh doctor '" in output
    scene = read_scene(tmp_path / "My Dojo.toml", {})
    assert scene.scene == "my-dojo" and scene.roster == ("cam1", "cam2")
    before = (tmp_path / "My Dojo.toml").read_bytes()
    (tmp_path / "any").touch()
    assert (tmp_path / "My Dojo.toml").stat().st_mode == (tmp_path / "any").stat().st_mode, "it holds no address"
    monkeypatch.setattr(commands, "webcams", lambda: pytest.fail("the file is checked before cameras are looked for"))
    with pytest.raises(BadInput, match="exists already and is not overwritten"):
        init(tmp_path / "My Dojo.toml")
    assert (tmp_path / "My Dojo.toml").read_bytes() == before


def test_an_editor_finds_the_schema_beside_the_file(tmp_path, monkeypatch):
    monkeypatch.setattr(commands, "webcams", list)
    (tmp_path / ".scene.schema.json").write_text("of an earlier version")
    init(tmp_path / "scene.toml")
    named = re.match(r"#:schema (\S+)\n", (tmp_path / "scene.toml").read_text())[1]
    assert "observers" in json.loads((tmp_path / named).read_text())["properties"]


def test_a_file_that_cannot_be_written_is_one_line(tmp_path, monkeypatch):
    monkeypatch.setattr(commands, "webcams", lambda: pytest.fail("the folder is checked first"))
    with pytest.raises(LabanmeshError, match=r"^cannot write .*: no such file or directory\. Name another file"):
        init(tmp_path / "no" / "scene.toml")
    with pytest.raises(BadInput, match="cannot be printed"):
        init(tmp_path / "a\nb.toml")


@pytest.mark.parametrize(("file", "scene"), [("scene.toml", "home"), ("Küche.toml", "k-che"), ("---.toml", "home")])
def test_the_scenes_name_is_the_files_where_that_is_legal(tmp_path, monkeypatch, file, scene):
    monkeypatch.setattr(commands, "webcams", list)
    init(tmp_path / file)
    assert read_scene(tmp_path / file, {}).scene == scene


def test_cameras_can_be_named_and_films_begin_anew(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "rooms").mkdir()
    (tmp_path / "wave.mp4").write_bytes(b"film")
    init(tmp_path / "rooms" / "s.toml", ["rtsp://10.0.0.7/stream", "wave.mp4", "1"])
    scene = read_scene(tmp_path / "rooms" / "s.toml", {})
    assert [(s.source, s.loop) for s in scene.observers.values()] == [
        ("rtsp://10.0.0.7/stream", False), ("../wave.mp4", True), ("1", False),
    ]  # fmt: skip
    # An address may hold a password.
    assert (tmp_path / "rooms" / "s.toml").stat().st_mode & 0o077 == 0
    assert "labanmesh teach" in (output := capsys.readouterr().out) and "--up" in output and "webcam" not in output
    init(tmp_path / "phone.toml", ["phone"])
    assert "labanmesh phone" in capsys.readouterr().out
    assert read_scene(tmp_path / "phone.toml", {}).observers["cam1"].source == "phone"
    steps = (tmp_path / "phone.toml").read_text("utf-8").partition("# Or learn")[0]
    assert "# 3. labanmesh phone phone.toml" in steps and "# 5. labanmesh watch" in steps and "camera look" not in steps
    for wrong in (" ", "wave.mp5"):
        with pytest.raises(BadInput, match=f"--source '?{wrong}"):
            init(tmp_path / "other.toml", [wrong])
    assert not (tmp_path / "other.toml").exists()


def test_in_a_terminal_it_shows_what_cameras_see_and_offers_a_lesson(tmp_path, monkeypatch, capsys):
    asked, run = [], []
    monkeypatch.setattr(commands, "webcams", lambda: WEBCAMS[:2])
    monkeypatch.setattr(commands.sys, "stdin", type("Keyboard", (), {"isatty": lambda self: True})())
    monkeypatch.setattr(type(commands.sys.stdout), "isatty", lambda self: True)
    monkeypatch.setattr("builtins.input", lambda question: asked.append(question) or "nod bow")
    monkeypatch.setattr(commands, "_labanmesh", lambda file, *words: run.append(words) or 0)
    init(tmp_path / "s.toml")
    assert [words[:2] for words in run] == [("camera", "look"), ("camera", "look"), ("teach", str(tmp_path / "s.toml"))]
    assert run[0][-1] == str(tmp_path / "cam1.png") and run[2][2:] == ("nod", "bow", "--up") and len(asked) == 1
    init(tmp_path / "t.toml", look=False)
    assert len(run) == 4
    monkeypatch.setattr(commands, "webcams", list)
    for answer, count in (("", 5), ("n", 5)):
        monkeypatch.setattr("builtins.input", lambda question, answer=answer: answer)
        init(tmp_path / f"without{answer}.toml")
        assert len(run) == count and run[4] == ("teach", "--rehearse")
    assert "labanmesh teach --rehearse shows a whole lesson" in capsys.readouterr().out
