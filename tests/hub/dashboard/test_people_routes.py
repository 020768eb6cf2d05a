"""The names of people on the page: who may give them, and where they stay."""

import json

import pytest
from asgi_answers import answers_of

from common.config import read_scene
from common.errors import BadInput
from hub.dashboard.access import COOKIE, AccessControl
from hub.dashboard.application import application
from hub.dashboard.teach_routes import people_routes
from hub.people_names_file import PeopleNames

TOKEN = "a-word-of-sixteen-and-more"  # noqa: S105 - a test


@pytest.fixture
def scene(tmp_path):
    file = tmp_path / "scene.toml"
    file.write_text('scene = "dojo"\n[people]\nmost = 2\nnames = ["left"]\n[observers.cam1]\nsource = "0"\n')
    return read_scene(file)


def give(names, person, name, access=None, **headers):
    """The status and the text of the answer to a name that a page gives."""
    access = access or AccessControl(None)
    app = application(access, None, lambda: False, more=people_routes(names, access))
    request = ("POST", "/people", {"json": {"person": person, "name": name}, "headers": headers})
    (answer,) = answers_of(app, request, host="localhost", client="192.168.1.9")
    return answer.status_code, answer.text


def test_a_name_is_kept_beside_the_scene_file_until_it_is_empty(scene, tmp_path):
    names = PeopleNames(scene)
    assert give(names, "left", " Anna ")[0] == give(names, "2", "Björn")[0] == 204
    assert PeopleNames(scene).names == names.names == {"left": "Anna", "2": "Björn"}
    assert give(names, "left", "")[0] == 204 and PeopleNames(scene).names == {"2": "Björn"}
    assert json.loads((tmp_path / "dojo.people.json").read_text()) == {"2": "Björn"}


@pytest.mark.parametrize(("person", "name"), [
    ("right", "Anna"), (["left"], "Anna"), (None, "Anna"), ("left", None), ("left", "A" * 33), ("left", "An\nna"),
])  # fmt: skip
def test_what_is_no_name_of_a_person_is_refused(scene, person, name):
    names = PeopleNames(scene)
    status, words = give(names, person, name)
    assert status == 400 and words.count("\n") == 1 and not names.names


def test_the_cookie_only_reads(scene):
    names, access = PeopleNames(scene), AccessControl(TOKEN, TOKEN)
    cookie = {"cookie": f"{COOKIE}={access.cookie}"}
    assert give(names, "left", "Anna", access, **cookie)[0] == 403
    assert give(names, "left", "Anna", access, **cookie, authorization="Bearer another-word-of-sixteen")[0] == 403
    assert give(names, "left", "Anna", access, **cookie, **{"sec-fetch-site": "cross-site"})[0] == 403
    assert not names.names
    assert give(names, "left", "Anna", access, **cookie, authorization=f"Bearer {access.teach_key}")[0] == 204
    assert names.names == {"left": "Anna"}


def test_files_that_cannot_be_used_are_named(scene, tmp_path):
    names = PeopleNames(scene)
    (tmp_path / "dojo.people.json").write_text("[1")
    with pytest.raises(BadInput, match=r"dojo\.people\.json: no names of people; move it away"):
        PeopleNames(scene)
    (tmp_path / "dojo.people.json").unlink()
    names._path = tmp_path / "nowhere" / "dojo.people.json"
    status, words = give(names, "left", "Anna")
    assert status == 503 and "names of people are kept there" in words and not names.names
