"""axe-core finds nothing serious on both pages in any of their states, and what matters is in the first screen."""

import subprocess
from itertools import product

import pytest
from page_looks import AXE, NO_SIDEWAYS_SCROLLING, serious_findings
from played_scene import ROOT, environment
from processes import labanmesh
from teach_stage import teach_address

SIZES, SCHEMES = {"phone": (390, 844), "desktop": (1280, 800)}, ("light", "dark")
OUTSIDE = """names => names.filter(name => {
  const box = document.querySelector(name)?.getBoundingClientRect();
  return !box || !box.height || box.top < 0 || box.bottom > innerHeight;
})"""
DECIDED, NEXT = ("#verdict", "#verdicts tr.entry", "#verdicts .wrong"), ("#advice code", "#advice button")


@pytest.fixture
def everywhere(chromium, tmp_path):
    """Looks at an address on a phone and a desktop, light and dark; prints where the screenshots are."""

    def look(name, url, shown, prepare=lambda page: None):
        context = chromium.new_context()
        page = context.new_page()
        page.goto(url)
        for each in shown:
            page.wait_for_selector(each)
        prepare(page)
        for size, scheme in product(SIZES, SCHEMES):
            width, height = SIZES[size]
            page.set_viewport_size({"width": width, "height": height})
            page.emulate_media(color_scheme=scheme)
            page.evaluate("scrollTo(0, 0)")
            place = f"{name}, {size}, {scheme}"
            assert not (outside := page.evaluate(OUTSIDE, list(shown))), (place, outside)
            page.screenshot(path=tmp_path / f"{name}-{size}-{scheme}.png", full_page=True)
            assert not (findings := serious_findings(page)), (place, findings)
            assert page.evaluate(NO_SIDEWAYS_SCROLLING), place
        context.close()

    if not AXE.is_file():
        pytest.skip("no axe-core here (npm; tests/browser/install_chromium.sh)")
    print("screenshots:", tmp_path)
    return look


def unfold(page):
    """Open a judge, the reasons of one verdict and how to correct another."""
    page.locator(".observer summary").first.click()
    page.get_by_role("button", name="Why?").first.click()
    page.get_by_role("button", name="Wrong?").last.click()


@pytest.mark.timeout(500)
def test_the_page_that_watches(play, show, everywhere, tmp_path):
    scene, dashboard = play()
    facets = {"effort_time": [0.1, 0.9], "effort_flow": [0.8, 0.2], "shape_vertical": [0.1, 0.2, 0.7]}
    scene.how = {"facets": facets, "facing_deg": 40.0, "why": "ok 40 % of the 60 % needed"}
    for number, label in enumerate(("ok", "abstain", "maestro")):
        scene.publish(number, label, ended=True)
    scene.publish(4)
    everywhere("live", dashboard.url, DECIDED, unfold)
    scene.silent = frozenset(scene.observers)
    everywhere("no-judges", dashboard.url, (*NEXT, *DECIDED))
    scene.stop_judging()
    everywhere("no-referee", dashboard.url, ("#link[data-kind=silent]", *NEXT, *DECIDED))
    everywhere("token", show_door(show, tmp_path), ("#token",))


def show_door(show, folder):
    """The address of a page that asks for its token."""
    token = folder / "token"
    token.write_text("a-word-of-sixteen-and-more")
    return show(folder / "scene.toml", "--token-file", token).url


def test_both_pages_with_nothing_running(everywhere, tmp_path):
    text = 'scene = "room"\n[mesh]\nendpoint = "tcp/127.0.0.1:9"\n[observers.cam1]\nsource = "a.npz"\n'
    (tmp_path / "room.toml").write_text(text)
    command = labanmesh("dashboard", "room.toml", "--teach", "--listen", "127.0.0.1:0")
    process = subprocess.Popen(
        command, cwd=tmp_path, env=environment(PYTHONPATH=str(ROOT)), stdout=subprocess.PIPE, text=True
    )
    try:
        url, token = teach_address(process.stdout)
        everywhere("empty", url, NEXT, lambda page: says(page, "#advice", "Start it:", "labanmesh up room.toml"))
        everywhere(
            "teach", f"{url}/teach#{token}", ("#idle code", "#link[data-kind=waiting]"),
            lambda page: says(page, "#idle", "No camera runs now", "labanmesh up room.toml"),
        )  # fmt: skip
    finally:
        process.terminate()
        process.communicate()


def says(page, place, sentence, command):
    """What to do next, and nothing that looks as if it could be pressed to teach."""
    assert sentence in page.inner_text(f"{place} p") and page.inner_text(f"{place} code") == command
    assert page.locator("button.main:visible").count() == 0
