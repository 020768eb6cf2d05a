"""Makes the pictures of docs/guide anew: `make guide-pictures`, or `python tests/browser/guide_pictures.py FOLDER`.
Real processes before a real browser: the demo's scene with its synthetic performer for the dashboard, and a lesson with
the same performer for the Teach page. The page of a phone that is a camera shows a drawn person, and the README's
stories a played scene. With --dark the Teach page is drawn in dark colours, to be looked at."""

import os
import random
import shutil
import subprocess
import sys
import tempfile
import time
from contextlib import contextmanager
from io import BytesIO
from pathlib import Path

from PIL import Image
from playwright.sync_api import sync_playwright

# The person in the pictures is synthetic: recordings belong to others.
os.environ.pop("LABANMESH_DATA", None)
sys.path += [
    str(Path(__file__).parents[n] / folder) for n, folder in ((2, ""), (1, "shared"), (1, "hub"), (1, "e2e"), (0, ""))
]

from e2e_stage import free_endpoint, write_scene
from phone_picture import draw_phone
from played_scene import ROOT, Dashboard, PlayedScene, environment
from processes import labanmesh
from teach_stage import TaughtScene

from benchmarks.simulated_falls import fall
from common import SECOND_NS
from common.progress import ProgressBar
from hub.history.history_file import HistoryFile
from hub.history.records import HistoryRow
from observer.motion.archive import MotionArchive
from observer.motion.archive_file import write_archive
from observer.tracks import WHOLE_BODY
from studies.demo_scene import synthetic_performance, write_demo
from studies.performer.perform import PEOPLE

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


def draw_fall(chromium, folder, work):
    """The page while a simulated person lies, and the day page of movements that are made up."""
    recording = fall(PEOPLE[0], 90, slow=True).recording
    write_archive(work / "fall.npz", MotionArchive(WHOLE_BODY, (recording,)))
    observers = {name: f'source = "fall.npz"\nview = "{name}"\n' for name in ("door", "wheel")}
    scene = write_scene(work / "fall.toml", free_endpoint(), observers)
    scene.write_text(scene.read_text() + '[watch.fallen]\n[history]\nfile = "history.db"\n')
    with (work / "fall.txt").open("w") as log, Dashboard(scene) as dashboard:
        page = chromium.new_page(viewport={"width": 1180, "height": 560}, color_scheme="light")
        page.goto(dashboard.url)
        processes = subprocess.Popen(labanmesh("up", scene), cwd=ROOT, env=environment(), stdout=log, stderr=log)
        try:
            page.wait_for_selector("#fall[data-kind=fallen]", timeout=WAIT_MS)
            save(page.screenshot(clip={"x": 0, "y": 0, "width": 1180, "height": 172}), folder / "fall.png")
        finally:
            processes.terminate()
            processes.wait()
        keep(work / "history.db")
        page.goto(f"{dashboard.url}day")
        page.wait_for_selector("tr.entry")
        take(page, folder / "day.png")
        page.close()


def draw_stories(chromium, folder, work):
    """The README's first two stories, told by a fusion service that publishes what they say."""
    with PlayedScene("dojo", ("sofa", "shelf", "door")) as scene:
        scene.teach(("wave", "squat", "clap", "point"))
        scene.repeat("squat")
        with Dashboard(scene.scene_file(work / "stories.toml")) as dashboard:
            page = chromium.new_page(viewport={"width": 420, "height": 844}, color_scheme="light")
            page.goto(dashboard.url)
            scene.publish_verdict("wave", 1)
            page.wait_for_selector("#last[data-kind=open]:has-text('wave')")
            take(page.locator("#last"), folder / "story-wave.png")
            scene.publish_verdict("wave", 1, ended=True)
            scene.publish_verdict("squat", 2, repetitions=8, partial_repetitions=1)
            page.fill("#target", "10")
            page.press("#target", "Tab")
            page.evaluate("document.activeElement.blur()")
            page.wait_for_selector("#counted:has-text('8')")
            count = page.locator("#counter").screenshot()
            scores = {"sofa": 7.6, "shelf": 8.1, "door": 7.9}
            remarks = ("left knee: 12 degrees too straight at 60 %",)
            scene.publish_verdict("squat", 2, ended=True, repetitions=8, score=7.9, scores=scores, remarks=remarks)
            page.wait_for_selector("#verdicts tr:has-text('7.9 of 10')")
            save(stacked(count, page.locator("section:has(#log)").screenshot()), folder / "story-squat.png")
            page.close()


def stacked(*pictures):
    """PNGs, one below the other."""
    drawn = [Image.open(BytesIO(picture)).convert("RGB") for picture in pictures]
    whole = Image.new("RGB", (max(each.width for each in drawn), sum(each.height for each in drawn)), "white")
    for number, each in enumerate(drawn):
        whole.paste(each, (0, sum(above.height for above in drawn[:number])))
    whole.save(file := BytesIO(), "PNG")
    return file.getvalue()


def keep(path):
    """Movements of this day until now, so many that the strip shows something."""
    rng = random.Random(0)  # noqa: S311 - moments, no secrets
    midnight_s = time.mktime((*time.localtime()[:3], 0, 0, 0, 0, 0, -1))
    with HistoryFile.to_write(path) as file:
        file.forget()
        for number in range(60):
            begin_ns = round((midnight_s + rng.choice((7, 8, 12, 17, 18, 20)) * 3600 + rng.random() * 3000) * SECOND_NS)
            label, seconds = rng.choice((("wave", 2), ("squat", 31), ("answer_phone", 3), ("abstain", 2)))
            detail = '{"repetitions": 10}' if label == "squat" else "{}"
            end_ns = begin_ns + round(seconds * (0.8 + 0.4 * rng.random()) * SECOND_NS)
            file.add(HistoryRow("verdict", f"v{number}", label, "ended", begin_ns, end_ns, end_ns,
                                0.7 + 0.29 * rng.random(), rng.choice((3, 4)), 4, detail=detail))  # fmt: skip
        begin_ns = round((midnight_s + 14.3 * 3600) * SECOND_NS)
        end_ns = begin_ns + 19 * SECOND_NS
        file.add(HistoryRow("fall", "fall-1", "fallen", "fallen", begin_ns, end_ns, end_ns, 0.94, 2, 2))


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
        draw_stories(chromium, folders[0], Path(work))
        draw_dashboard(chromium, folders[0], Path(work))
        draw_fall(chromium, folders[0], Path(work))
        draw_teach(chromium, folders[0], Path(work), "dark" if "--dark" in words else "light")
        chromium.close()
        save(draw_phone(driver, path, PHONE | {"viewport": {"width": 390, "height": 604}}), folders[0] / "phone.png")


if __name__ == "__main__":
    main(sys.argv[1:])
