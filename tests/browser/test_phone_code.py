"""The button "Use a phone": the code on the page is that of the real server of phones, and gives way to the phone."""

import re
import subprocess

import cv2
import numpy as np
import pytest
from page_looks import AXE, NO_SIDEWAYS_SCROLLING, serious_findings
from played_scene import ROOT, environment
from processes import SOON_S, labanmesh

from benchmarks.timing import free_port
from hub.phone.register_file import RegisterFile

TOKEN = "a-word-of-sixteen-and-more"  # noqa: S105 - a test


@pytest.fixture
def file(tmp_path):
    path = tmp_path / "scene.toml"
    mesh = f'[mesh]\nendpoint = "tcp/127.0.0.1:{free_port()}"\n'
    path.write_text(f'scene = "dojo"\n{mesh}[observers.phone1]\nsource = "phone"\n')
    return path


@pytest.fixture
def server(pose_model, file):
    """A `labanmesh phone` process, and its address with the code of the terminal."""
    command = labanmesh("phone", file, "--listen", "127.0.0.1:0")
    with subprocess.Popen(command, env=environment(), cwd=ROOT, stdout=subprocess.PIPE, text=True) as process:
        for line in process.stdout:
            if match := re.search(r"https://\S+#\S+", line):
                process.link = match[0]
            if "this machine's screen" in line:
                break
        yield process
        process.terminate()
        assert process.wait(SOON_S) == 0


def scanned(page):
    """What a phone reads from the code on the screen."""
    picture = np.frombuffer(page.locator("#phones svg.qr").screenshot(), np.uint8)
    return cv2.QRCodeDetector().detectAndDecode(cv2.imdecode(picture, cv2.IMREAD_COLOR))[0]


def open_page(chromium, url, **more):
    page = chromium.new_context(**more).new_page()
    page.set_default_timeout(SOON_S * 1000)
    page.goto(url)
    page.get_by_role("button", name="Use a phone").click()
    return page


@pytest.mark.timeout(300)
def test_the_code_on_the_page_is_scanned_and_used(chromium, show, file, server):
    page = open_page(chromium, show(file).url, color_scheme="dark", viewport={"width": 390, "height": 844})
    page.wait_for_selector("#phones svg.qr")
    assert scanned(page) == server.link, "the same as in the terminal"
    assert page.get_by_role("link", name=server.link).is_visible() and "phone1" in page.inner_text("#phones h3")
    assert page.evaluate(NO_SIDEWAYS_SCROLLING)
    assert not AXE.is_file() or not serious_findings(page)
    register = RegisterFile(file.parent / "dojo.phones.json")
    register.join(server.link.partition("#")[2], "Android Chrome")
    page.wait_for_function("() => document.querySelector('#phones').innerText.includes('Android Chrome, is not here')")
    assert page.locator("#phones svg").count() == 0 and "--revoke phone1" in page.inner_text("#phones code")
    register.revoke("phone1")
    page.wait_for_selector("#phones svg.qr")
    assert scanned(page) not in ("", server.link)
    page.get_by_role("button", name="Use a phone").click()
    assert page.locator("#phones").is_hidden() and page.locator("#phones svg").count() == 0
    page.context.close()


@pytest.mark.timeout(300)
def test_without_the_server_or_the_token_the_page_says_what_to_do(chromium, show, file):
    page = open_page(chromium, show(file).url)
    page.wait_for_selector("#phones code")
    assert page.inner_text("#phones code") == f"labanmesh phone {file}"
    (file.parent / "token").write_text(TOKEN)
    address = show(file, "--teach", "--token-file", file.parent / "token").url
    page.goto(address)
    page.fill("[name=token]", TOKEN)
    page.keyboard.press("Enter")
    page.get_by_role("button", name="Use a phone").click()
    page.locator("#phones").get_by_role("link", name="Teach page").click()
    page.fill("#token", TOKEN)
    page.keyboard.press("Enter")
    page.wait_for_function("() => localStorage.getItem('teach-key')")
    page.goto(address)
    page.get_by_role("button", name="Use a phone").click()
    page.wait_for_selector("#phones code")
    assert page.inner_text("#phones code") == f"labanmesh phone {file}", "who has the token is told of the server"
    page.context.close()
