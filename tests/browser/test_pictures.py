"""Live pictures on the page: a real observer process with a real tracker films a person, or noise where there is none.
The pictures appear only of an observer that the scene file switches on, and only after a click."""

import os
import subprocess
import sys
import time
from pathlib import Path

import cv2
import numpy as np
import pytest
from played_scene import ROOT, environment
from processes import SOON_S

OBSERVER = """
import sys, threading
from pathlib import Path
from common.config import read_scene
from common.link import Link
from common.vocabulary import Vocabulary
from observer.preview.shown_pictures import shown_pictures
from observer.runtime.scene_inputs import open_inputs
from observer.runtime.service import serve

scene = read_scene(Path(sys.argv[1]), {})
inputs = open_inputs(scene, "cam1")

class Tracking:
    vocabulary, complaint, leans_on = Vocabulary(("ok", "nthrow")), "", None
    def step(self, frame):
        inputs.tracker.update(frame)
    def end(self):
        return None

with Link.open(scene.mesh, "observer") as link:
    with shown_pictures(scene, "cam1", Tracking(), inputs.tracker, link) as pictured:
        print("here", flush=True)
        serve(scene, "cam1", pictured, inputs.source, link, threading.Event())
"""
WATCHED_S, HZ, BYTES_PER_S = 6.0, 2.0, 50_000
# Width, height and the brightest value of the picture on the page.
BRIGHT = """() => {
  const canvas = document.querySelector('.sight-box canvas:not([hidden])');
  const values = canvas.getContext('2d').getImageData(0, 0, canvas.width, canvas.height).data;
  return [canvas.width, canvas.height, values.reduce((most, value, i) => i % 4 < 3 ? Math.max(most, value) : most, 0)];
}"""


@pytest.fixture
def film(tmp_path):
    """A person who waves, recorded; noise, the worst that can be compressed, on a machine without recordings."""
    wave = Path(os.environ.get("LABANMESH_DATA", "")) / "wave_webcam" / "wave.mp4"
    if wave.is_file():
        return wave
    writer = cv2.VideoWriter(str(tmp_path / "noise.avi"), cv2.VideoWriter.fourcc(*"MJPG"), 15.0, (640, 480))
    for _ in range(30):
        writer.write(np.random.default_rng().integers(0, 256, (480, 640, 3), np.uint8))
    writer.release()
    return tmp_path / "noise.avi"


@pytest.fixture
def observer(play, film, tmp_path):
    """The dashboard of a scene whose observer cam1 films; cam2 to cam4 share no pictures."""
    _, dashboard = play(pictures=f'source = "{film}"\nloop = true\ntracker = "camshift"\npicture_hz = {HZ:g}\n')
    command = [sys.executable, "-c", OBSERVER, str(tmp_path / "scene.toml")]
    process = subprocess.Popen(command, cwd=ROOT, env=environment(), stdout=subprocess.PIPE, text=True)
    assert process.stdout.readline() == "here\n"
    yield dashboard
    process.kill()
    process.communicate()


def test_a_picture_appears_only_when_it_is_switched_on(observer, look, tmp_path):
    page = look(observer.url)
    page.wait_for_selector(".observer")
    for summary in page.locator(".observer summary").all():
        summary.click()
    requests, sizes, arrived_s = [], [], []

    def note(response):
        if "/picture/" in response.url and response.status == 200:
            sizes.append(int(response.headers["content-length"]))
            arrived_s.append(time.monotonic())

    page.on("request", lambda request: requests.append(request.url))
    page.on("response", note)
    assert page.locator(".eye:visible").count() == 1, "only of the judge whose section sets picture_hz"
    page.wait_for_timeout(1500)
    assert not requests, "nothing is asked for before a click"
    page.get_by_role("button", name="Show picture of cam1").click()
    page.wait_for_function("() => document.querySelector('.sight-box canvas:not([hidden])').width > 0")
    del sizes[:], arrived_s[:]
    page.wait_for_timeout(1000 * WATCHED_S)
    rate_hz, per_s = len(sizes) / WATCHED_S, sum(sizes) / WATCHED_S
    width, height, brightest = page.evaluate(BRIGHT)
    size = f"{width}x{height} px, {per_s / 1000:.1f} kB/s, largest {max(sizes)} bytes"
    print(f"{rate_hz:.2f} pictures a second of {size}")
    page.screenshot(path=tmp_path / "page.png", full_page=True)
    assert rate_hz == pytest.approx(HZ, abs=0.35) and per_s < BYTES_PER_S
    assert max(width, height) == 320 and brightest > 100
    page.get_by_role("button", name="Hide picture of cam1").click()
    page.wait_for_timeout(700)
    del requests[:]
    page.wait_for_timeout(1500)
    assert not requests and page.locator(".sight-box canvas:visible").count() == 0


def test_an_observer_that_sends_nothing_is_said_to(play, look):
    _, dashboard = play(pictures='source = "0"\npicture_hz = 2\n')
    page = look(dashboard.url, width=360)
    page.locator(".observer summary", has_text="cam1").click()
    page.get_by_role("button", name="Show picture of cam1").click()
    page.wait_for_function(
        "() => [...document.querySelectorAll('.sight-box p')].some(p => p.textContent.includes('no picture yet'))",
        timeout=1000 * SOON_S,
    )
    assert page.evaluate("document.documentElement.scrollWidth <= innerWidth"), "no sideways scrolling"
