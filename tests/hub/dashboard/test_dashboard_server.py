"""The dashboard's web server: its door, its headers, and a real mesh told over real HTTP."""

import asyncio
import json
import re
import subprocess
import sys
from contextlib import contextmanager
from pathlib import Path

import httpx
import pytest

from common.address import Address
from common.config import MeshConfig
from common.errors import BadInput, LabanmeshError
from common.link import Link
from common.wire import encode
from hub.dashboard.application import COOKIE, AccessControl, application
from hub.dashboard.commands import dashboard
from hub.dashboard.serving import bound_socket

ROOT = Path(__file__).parents[3]
WORD = "a-word-of-sixteen-and-more"
SOON_S = 20.0


async def one_event(head):
    yield b"event: state\ndata: %d\n\n" % head.at_s


def ask(*requests, gate=None, full=False, host="127.0.0.1"):
    """The answers to (method, path, more) of one application."""

    async def main():
        app = application(gate or AccessControl(None), one_event, lambda: full)
        transport = httpx.ASGITransport(app)
        async with httpx.AsyncClient(transport=transport, base_url=f"http://{host}") as client:
            return [await client.request(method, path, **more) for method, path, more in requests]

    return asyncio.run(main())


def test_the_page_and_what_it_needs_are_ours_alone():
    for answer in ask(("GET", "/", {}), ("GET", "/page.js", {}), ("GET", "/style.css", {}), ("GET", "/icon.svg", {})):
        assert answer.status_code == 200
        policy = answer.headers["content-security-policy"]
        assert "default-src 'none'" in policy and "unsafe" not in policy and "*" not in policy
        assert answer.headers["x-content-type-options"] == "nosniff"
        assert not re.search(r"(src|href|url\()\W*https?:", answer.text), "nothing from elsewhere"
        assert "innerHTML" not in answer.text and "style=" not in answer.text
    missing, written = ask(("GET", "/etc/passwd", {}), ("POST", "/events", {}))
    assert (missing.status_code, written.status_code) == (404, 405)


@pytest.mark.parametrize("host", ["evil.example", "127.0.0.1.evil.example:8420"])
def test_a_strangers_name_for_this_machine_is_refused(host):
    (answer,) = ask(("GET", "/events", {}), host=host)
    assert answer.status_code == 421


def test_the_token_opens_the_door():
    gate = AccessControl(WORD)
    door, events, wrong, right = ask(
        ("GET", "/", {}),
        ("GET", "/events", {}),
        ("POST", "/enter", {"data": {"token": "wrong"}}),
        ("POST", "/enter", {"data": {"token": WORD}}),
        gate=gate, host="dojo.local",
    )  # fmt: skip
    assert door.status_code == 401 and "<form" in door.text and "judge" not in door.text
    assert events.status_code == 401 and wrong.status_code == 401 and COOKIE not in wrong.cookies
    cookie = right.headers["set-cookie"]
    assert right.status_code == 303 and "HttpOnly" in cookie and "SameSite=strict" in cookie and WORD not in cookie
    kept, bearer = ask(
        ("GET", "/", {"headers": {"cookie": f"{COOKIE}={gate.cookie}"}}),
        ("GET", "/events?at=7", {"headers": {"authorization": f"Bearer {WORD}"}}),
        gate=gate, host="dojo.local",
    )  # fmt: skip
    assert "tatami" in kept.text and "data: 7" in bearer.text
    (long,) = ask(("POST", "/enter", {"content": b"x" * 10_000}), gate=gate)
    assert long.status_code == 413


def test_too_many_browsers_are_told_so():
    (answer,) = ask(("GET", "/events", {}), full=True)
    assert answer.status_code == 503


@pytest.mark.parametrize("query", ["at=x", "at=nan", "at=-5", "at=", "at=1e308", "speed=inf", "speed=65", "speed=-1"])
def test_a_playhead_that_is_no_number_in_range_is_one_line_and_400(query):
    (answer,) = ask(("GET", f"/events?{query}", {}))
    assert answer.status_code == 400 and answer.text.count("\n") == 1
    assert f"{query.partition('=')[0]} = " in answer.text and "must be a number from 0 to" in answer.text


@pytest.fixture
def scene_file(tmp_path):
    def write(text=""):
        (tmp_path / "scene.toml").write_text(f'scene = "room"\n[observers.cam1]\nsource = "a.npz"\n{text}')
        return tmp_path / "scene.toml"

    return write


def refusal(error, *words, **more):
    with pytest.raises(error) as refused:
        dashboard(*words, **more)
    assert "\n" not in str(refused.value)
    return str(refused.value)


def test_bad_input_is_one_line(scene_file, tmp_path):
    assert "either a scene file or a capture" in refusal(BadInput)
    assert "other machines can reach that" in refusal(BadInput, scene_file(), listen="[::]:0")
    assert "HOST:PORT" in refusal(BadInput, scene_file('[hub.dashboard]\nlisten = "8420"\n'))
    named = scene_file('[hub.dashboard]\ntoken_file = "token"\n')
    assert "openssl rand" in refusal(BadInput, named)
    (tmp_path / "token").write_text("short")
    assert "at least 16" in refusal(BadInput, named) and "short" not in refusal(BadInput, named)
    assert "labanmesh capture" in refusal(BadInput, capture=tmp_path / "nothing.mcap")


def test_a_port_that_is_taken_is_one_line(scene_file):
    with bound_socket(Address("127.0.0.1", 0)) as port:
        where = f"127.0.0.1:{port.getsockname()[1]}"
        said = refusal(LabanmeshError, scene_file(), listen=where)
        assert where in said and "in use" in said and "--listen" in said


@contextmanager
def running(scene):
    """A dashboard process and where it is; ended by SIGTERM, which must be clean."""
    code = f"from pathlib import Path; from hub.dashboard.commands import dashboard; dashboard(Path({str(scene)!r}))"
    with subprocess.Popen([sys.executable, "-c", code], cwd=ROOT, stdout=subprocess.PIPE, stderr=subprocess.PIPE,
                          text=True) as process:  # fmt: skip
        try:
            yield re.match(r"(http://\S+/) shows scene room", process.stdout.readline())[1]
        finally:
            process.terminate()
            _, err = process.communicate(timeout=SOON_S)
        assert (process.returncode, err) == (0, "")


def events(lines):
    kind = ""
    for line in lines:
        if line.startswith("event: "):
            kind = line[7:]
        elif line.startswith("data: "):
            yield kind, json.loads(line[6:])


def test_what_is_said_on_the_mesh_comes_to_a_browser(scene_file, said):
    with Link.open(MeshConfig(), "fusion", listen=["tcp/127.0.0.1:0"]) as fusion:
        fusion.answer("laban/room/vocabulary", lambda: encode(said.vocabulary()))
        text = f'[mesh]\nendpoint = "{fusion.locator}"\n[hub.dashboard]\nlisten = "127.0.0.1:0"\n'
        publisher = fusion.publisher("laban/room/verdict")
        with running(scene_file(text)) as url, httpx.stream("GET", f"{url}events", timeout=SOON_S) as answer:
            heard = events(answer.iter_lines())
            kind, whole = next(heard)
            assert kind == "snapshot" and whole["scene"] == "room" and not whole["verdicts"]
            assert publisher.wait_for_subscriber(SOON_S)
            publisher.put(encode(said.verdict(1)))
            verdict = next(fields for kind, fields in heard if kind == "verdict")
            assert verdict["label"] == "nthrow" and verdict["why"]
