"""Makes the pictures of docs/guide anew: `make guide-pictures`, or `python tests/browser/guide_pictures.py FOLDER`.

Real processes before a real browser: the demo's scene with its synthetic performer for the dashboard, and a lesson with
the same performer for the Teach page. The page of a phone that is a camera shows a drawn person. With --dark the Teach
page is drawn in dark colours, to be looked at.
"""

import os
import shutil
import subprocess
import sys
import tempfile
from contextlib import contextmanager
from io import BytesIO
from pathlib import Path

from PIL import Image
from playwright.sync_api import sync_playwright

# The person in the pictures is synthetic: recordings belong to others.
os.environ.pop("LABANMESH_DATA", None)
sys.path += [str(Path(__file__).parents[n] / folder) for n, folder in ((2, ""), (1, "shared"), (1, "hub"), (0, ""))]

from phone_picture import draw_phone
from played_scene import ROOT, Dashboard, environment
from processes import labanmesh
from teach_stage import TaughtScene

from common.progress import ProgressBar
from studies.demo_scene import synthetic_performance, write_demo

DASHBOARD = {
    "dashboard-light": {"viewport": {"width": 1180, "height": 900}, "color_scheme": "light"},
    "dashboard-dark": {"viewport": {"width": 1180, "height": 900}, "color_scheme": "dark"},
    "dashboard-phone": {"viewport": {"width": 390, "height": 844}, "color_scheme": "light"},
}
PHONE = {"viewport": {"width": 390, "height": 760}, "device_scale_factor": 1.5, "has_touch": True}
WAIT_MS = 300_000
"""On a machine that does much else a lesson takes this long."""
DECIDED = """() => {
  const rows = document.querySelectorAll('#verdicts tr.entry').length;
  return rows > 5 || (rows > 3 && document.querySelector('#last').dataset.kind === 'open');
}"""
"""A movement goes on that is decided, and there were some before; or, where verdicts come late, enough of them."""


@contextmanager
def played_demo(folder):
    """The demo's scene, with its dashboard; yields the dashboard's address."""
    with ProgressBar() as bar:
        scene, _ = write_demo(synthetic_performance(0), folder, bar, False)
    with (folder / "log.txt").open("w") as log, Dashboard(scene) as dashboard:
        processes = subprocess.Popen(labanmesh("up", scene), cwd=ROOT, env=environment(), stdout=log, stderr=log)
        try:
            yield dashboard.url
        finally:
            processes.terminate()
            processes.wait()


def draw_dashboard(chromium, folder, work):
    """One moment of the page in three windows: the performance is short, so that no window waits for its own."""
    with played_demo(work) as url:
        pages = {name: chromium.new_page(**look) for name, look in DASHBOARD.items()}
        for page in pages.values():
            page.goto(url)
        next(iter(pages.values())).wait_for_function(DECIDED, timeout=WAIT_MS)
        pictures = {name: page.screenshot() for name, page in pages.items()}
        for name, picture in pictures.items():
            save(picture, folder / f"{name}.png")
            pages[name].close()


def draw_teach(chromium, folder, work, scheme):
    """The Teach page after a take, after a movement, and with a verdict that can be corrected."""
    with TaughtScene(work) as scene:
        page = chromium.new_page(**PHONE, color_scheme=scheme)
        page.set_default_timeout(WAIT_MS)
        page.goto(f"{scene.url}/teach#{scene.token}")
        begin_lesson(page)
        page.wait_for_selector("#stage[data-kind=between]:has-text('3 of 4')")
        take_drawn(page, folder / "teach-phone.png")
        page.get_by_role("button", name="Next: clap").wait_for()
        take_drawn(page, folder / "teach-phone-takes.png")
        for name in ("Next: clap", "Start", "Go on", "Start", "Use it", "Start the test", "Teach more"):
            page.get_by_role("button", name=name, exact=True).tap()
        page.get_by_role("button", name="Wrong?").first.tap()
        take(page.locator("section", has_text="Was it wrong?").last, folder / "teach-phone-correct.png")


def begin_lesson(page):
    """Two movements, four takes of each, and little of anything else."""
    for label in ("wave", "clap"):
        page.fill("#label", label)
        page.get_by_role("button", name="Add", exact=True).tap()
    page.locator("summary", has_text="More settings").tap()
    for setting, value in {"takes": "4", "minutes": "0.15", "alarm_minutes": "0.1"}.items():
        page.fill(f"#{setting}", value)
    for name in ("Begin the lesson", "Start"):
        page.get_by_role("button", name=name, exact=True).tap()


def take_drawn(page, path):
    """A screenshot of the page once the ways of the hands are drawn."""
    page.wait_for_timeout(500)
    take(page, path)


def take(shown, path):
    """A screenshot of a page, or of a part of it."""
    save(shown.screenshot(), path)


def save(picture, path):
    """Write a PNG in 256 colours: half the bytes."""
    Image.open(BytesIO(picture)).convert("RGB").quantize(256, dither=Image.Dither.NONE).save(path, optimize=True)


def main(words):
    """Draw all pictures into the folder that is named."""
    folders = [Path(word) for word in words if not word.startswith("-")]
    path = shutil.which("chromium") or shutil.which("chromium-browser") or shutil.which("google-chrome")
    if len(folders) != 1 or not folders[0].is_dir() or path is None:
        sys.exit(f"guide_pictures: {'name one folder that exists' if path else 'no chromium here (Debian: chromium)'}")
    with sync_playwright() as driver, tempfile.TemporaryDirectory() as work:
        chromium = driver.chromium.launch(executable_path=path, args=["--no-sandbox"])
        draw_dashboard(chromium, folders[0], Path(work))
        draw_teach(chromium, folders[0], Path(work), "dark" if "--dark" in words else "light")
        chromium.close()
        save(draw_phone(driver, path, PHONE), folders[0] / "phone.png")


if __name__ == "__main__":
    main(sys.argv[1:])
