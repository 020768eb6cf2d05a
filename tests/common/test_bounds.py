"""Every number of a scene file has bounds, and what is no scene file is refused in one line."""

from pathlib import Path
from typing import get_args

import pytest
from pydantic import BaseModel

from common.config import Scene, read_scene
from common.errors import BadInput
from common.files import TEXT_FILE_BYTES, parse_toml, read_text, replace_file

LEAST = 'scene = "dojo"\n[observers.cam1]\nsource = "m.npz"\n'


def numbers(model, place=()):
    """(place, types) of every key whose value is a number or a list of numbers."""
    for name, field in model.model_fields.items():
        section = next(
            (
                each
                for each in (field.annotation, *get_args(field.annotation))
                if isinstance(each, type) and issubclass(each, BaseModel)
            ),
            None,
        )
        if section is not None:
            yield from numbers(section, (*place, name, *(["cam1"] if name == "observers" else [])))
        elif "float" in str(field.annotation) or "int" in str(field.annotation):
            yield (*place, name), str(field.annotation)


NUMBERS = dict(numbers(Scene))
SIGNED = {"facing", "place", "face"}


def test_all_numbers_are_found():
    assert {("fusion", "hold_s"), ("observers", "cam1", "speed"), ("hub", "mqtt", "port")} <= set(NUMBERS)


@pytest.fixture
def refusal(tmp_path):
    def read(text):
        path = tmp_path / "scene.toml"
        path.write_text(text)
        with pytest.raises(BadInput) as refused:
            read_scene(path, {})
        line = str(refused.value)
        assert "\n" not in line and len(line) < 400 and line.startswith(str(path))
        return line

    return read


@pytest.mark.parametrize("place", NUMBERS, ids=".".join)
def test_absurd_numbers_in_a_scene_file_are_refused(place, refusal):
    *section, key = place
    for value in ("nan", "inf", "-inf", "1e308", "-1e308", "9" * 400, "9" * 30, *(["-1"] if key not in SIGNED else [])):
        values = [value]
        if "tuple" in NUMBERS[place]:
            # Every list of numbers has two to six of them.
            values = [f"[{', '.join([value] * n)}]" for n in (2, 3, 4)] + [f"[[{', '.join([value] * 6)}]]"]
        for text in values:
            line = (
                LEAST
                if section[:2] == ["observers", "cam1"] and len(section) == 2
                else f"{LEAST}[{'.'.join(section)}]\n"
            )
            assert f"{'.'.join(place)}" in refusal(f"{line}{key} = {text}\n")


@pytest.mark.parametrize("key", ["temperature", "threshold", "fade_s", "blind_s", "drop_s", "takeover_s", "step_hz"])
def test_numbers_that_divide_are_not_next_to_zero(key, refusal):
    for value in ("0.0", "1e-320"):
        assert f"fusion.{key}" in refusal(f"{LEAST}[fusion]\n{key} = {value}\n")


@pytest.mark.parametrize(
    ("content", "reason"),
    [("a = " + "[" * 100_000, "nested too deeply"), ("scene = " + "9" * 6000, "4300 digits"), ("scene = [", "not TOML"),
     ("scene = 9999-99-99", "not TOML"), (b"\xff\xfe", "not UTF-8 text"), ('scene = "a\\u0000b"', "scene")],
)  # fmt: skip
def test_files_that_are_no_scene_are_one_line(content, reason, tmp_path):
    path = tmp_path / "scene.toml"
    path.write_bytes(content if isinstance(content, bytes) else content.encode())
    with pytest.raises(BadInput, match=reason) as refused:
        read_scene(path, {})
    assert "\n" not in str(refused.value)


@pytest.mark.parametrize(
    "path", [Path("/dev/zero"), Path("/"), Path("x" * 300)], ids=["endless", "folder", "long name"]
)
def test_what_is_no_file_is_one_line_and_ends(path):
    with pytest.raises(BadInput) as refused:
        read_scene(path, {})
    assert "\n" not in str(refused.value)


def test_a_text_is_read_up_to_its_limit(tmp_path):
    path = tmp_path / "t"
    path.write_text("x" * 11)
    assert read_text(path, 11) == "x" * 11 and TEXT_FILE_BYTES > 2**20
    with pytest.raises(ValueError, match="longer than"):
        read_text(path, 10)
    assert parse_toml("a = 1") == {"a": 1}


def test_a_file_is_replaced_as_a_whole(tmp_path, monkeypatch):
    path, synced = tmp_path / "register.json", []
    monkeypatch.setattr("common.files.os.fsync", synced.append)
    replace_file(path, b"old", 0o600)
    assert path.stat().st_mode & 0o777 == 0o600 and len(synced) == 2, "the file, and its folder"

    def full(number):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr("common.files.os.fsync", full)
    with pytest.raises(OSError, match="No space"):
        replace_file(path, b"new")
    assert path.read_bytes() == b"old" and [each.name for each in tmp_path.iterdir()] == ["register.json"]
