"""The codes for phones on the page: who sees them, what they are worth, and what is shown where no server runs."""

import asyncio
import socket
import threading
from contextlib import contextmanager
from functools import partial

import pytest
from asgi_answers import answers_of
from processes import SOON_S

pytest.importorskip("websockets")
pytest.importorskip("segno")

from common.config import read_scene
from common.errors import LabanmeshError
from hub.dashboard.access import COOKIE, AccessControl
from hub.dashboard.application import application
from hub.dashboard.phone_routes import NO_SERVER, ask_for_phones, phone_routes
from hub.phone.pages import ShownCodes, code_page
from hub.phone.register import read_shown_phones
from hub.phone.register_file import RegisterFile, register_path
from hub.phone.serving import serve_files

TOKEN = "a-word-of-sixteen-and-more"  # noqa: S105 - a test
ADDRESS = "https://192.168.1.20:8443/"


@pytest.fixture
def scene(tmp_path):
    file = tmp_path / "scene.toml"
    file.write_text('scene = "dojo"\n[observers.phone1]\nsource = "phone"\n[observers.cam1]\nsource = "0"\n')
    return read_scene(file)


@contextmanager
def codes_of(scene, live=()):
    """The page with the codes, served as labanmesh phone serves it."""
    codes = ShownCodes(RegisterFile(register_path(scene)), ("phone1",), ADDRESS)
    ready, loops = threading.Event(), []

    async def main():
        ended = asyncio.Event()
        loops.extend((asyncio.get_running_loop(), ended))
        ready.set()
        await serve_files(port, partial(code_page, codes, lambda: dict.fromkeys(live)), ended)

    with socket.create_server(("127.0.0.1", 0)) as port, codes.file.naming_page(port.getsockname()[1]):
        thread = threading.Thread(target=lambda: asyncio.run(main()))
        thread.start()
        assert ready.wait(SOON_S)
        yield codes
        loops[0].call_soon_threadsafe(loops[1].set)
        thread.join(SOON_S)


def ask(scene, access=None, host="127.0.0.1", **more):
    access = access or AccessControl(None)
    app = application(access, None, lambda: False, more=phone_routes(scene, access))
    return answers_of(app, ("GET", "/phones", more), host=host)[0]


def test_the_code_is_shown_until_a_phone_has_used_it(scene):
    with codes_of(scene, live=("phone1",)) as codes:
        answer = ask(scene)
        assert answer.status_code == 200 and answer.headers["cache-control"] == "no-store"
        (shown,) = answer.json()
        assert shown["observer"] == "phone1" and shown["address"] == ADDRESS and shown["expires"] > 0
        assert shown["link"] == codes.link("phone1"), "the code of the terminal stays good"
        assert len(shown["modules"]) == len(shown["modules"][0]) >= 21 and shown["modules"][0].startswith("1111111")
        phone, _ = codes.file.join(shown["link"].partition("#")[2], "Android Chrome")
        assert phone.observer == "phone1"
        (shown,) = ask(scene).json()
        assert shown["link"] is None and shown["modules"] == []
        assert shown["phone"] == "Android Chrome" and shown["live"]
        codes.file.revoke("phone1")
        assert ask(scene).json()[0]["link"]


def test_where_the_page_has_a_token_only_who_may_teach_sees_a_code(scene):
    both, reads = AccessControl(TOKEN, TOKEN), AccessControl(TOKEN)
    ask_ = partial(ask, scene, host="dojo.local")
    with codes_of(scene) as codes:
        assert ask_(both).status_code == 401
        cookie = {"cookie": f"{COOKIE}={both.cookie}"}
        for headers in (cookie, {**cookie, "authorization": "Bearer wrong"}):
            answer = ask_(both, headers=headers)
            assert answer.status_code == 403 and ADDRESS not in answer.text
        assert ask_(reads, headers={"authorization": f"Bearer {TOKEN}"}).status_code == 403, "nobody may teach"
        assert not codes.file.register.codes, "and no code was made"
        for word in (TOKEN, both.teach_key):
            assert ask_(both, headers={"authorization": f"Bearer {word}"}).json()[0]["link"]


def test_wrong_words_beside_a_good_cookie_are_counted(scene, monkeypatch):
    monkeypatch.setattr("hub.dashboard.teach_routes.WRONG_TOKEN_S", 0.0)
    access = AccessControl(TOKEN, TOKEN)
    cookie = {"cookie": f"{COOKIE}={access.cookie}"}
    answers = [ask(scene, access, headers={**cookie, "authorization": f"Bearer {n}"}).status_code for n in range(40)]
    assert answers[0] == 403 and answers[-1] == 429


@pytest.mark.parametrize("headers", [{"sec-fetch-site": "cross-site"}, {"origin": "http://evil.example"}])
def test_a_foreign_page_gets_no_code(scene, headers):
    with codes_of(scene) as codes:
        assert ask(scene, headers=headers).status_code == 403
        assert ask(scene, host="evil.example").status_code == 421
        assert not codes.file.register.codes


def test_without_a_server_the_page_says_so(scene):
    assert ask(scene).status_code == 503 and ask(scene).text == f"{NO_SERVER}\n"
    with codes_of(scene) as codes:
        port = codes.file.register.page_port
        assert ask(scene).status_code == 200
    assert RegisterFile(register_path(scene)).register.page_port is None
    # As after a power cut.
    RegisterFile(register_path(scene))._name_page(port)
    assert ask(scene).status_code == 503 and ask(scene).text == f"{NO_SERVER}\n"


def test_a_server_that_ends_leaves_the_page_of_the_next_one(scene):
    file = RegisterFile(register_path(scene))
    with file.naming_page(1001):
        file._name_page(1002)
    assert file.register.page_port == 1002


@pytest.mark.parametrize("body", [
    b"", b"hello", b"{}", b'[{"observer": "phone1"}]',
    b'[{"observer": "phone1", "address": "javascript:alert(1)"}]',
    b'[{"observer": "phone1", "address": "https://a/", "link": "http://a/"}]',
    b'[{"observer": "phone1", "address": "https://a/", "modules": ["012"]}]',
])  # fmt: skip
def test_what_is_not_from_labanmesh_phone_is_not_shown(body):
    with pytest.raises(LabanmeshError, match="not labanmesh phone"):
        read_shown_phones(body)


def test_another_server_at_the_port_is_not_believed(scene):
    with socket.create_server(("127.0.0.1", 0)) as port:

        def answer():
            connection, _ = port.accept()
            with connection:
                connection.recv(4096)
                connection.sendall(b"HTTP/1.1 200 OK\r\ncontent-length: 2\r\n\r\nhi")

        thread = threading.Thread(target=answer)
        thread.start()
        file = RegisterFile(register_path(scene))
        with file.naming_page(port.getsockname()[1]), pytest.raises(LabanmeshError, match="not labanmesh phone"):
            ask_for_phones(file)
        thread.join(SOON_S)


def test_a_scene_without_phones_has_no_such_page(tmp_path):
    (tmp_path / "scene.toml").write_text('scene = "dojo"\n[observers.cam1]\nsource = "0"\n')
    assert phone_routes(read_scene(tmp_path / "scene.toml"), AccessControl(None)) == []
