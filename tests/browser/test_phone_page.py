"""What a phone's page says to do next, in all states, on small and large screens, light and dark."""

import shutil
from itertools import product

import pytest
from page_looks import FAINT, NO_SIDEWAYS_SCROLLING, SMALL, serious_findings
from phone_picture import WORDS, landmarks, launch, open_phone

SIZES, SCHEMES = ((390, 844), (1280, 800)), ("light", "dark")
UNTAUGHT = {**WORDS, "known": [], "verdict": None, "own": None, "judged": None, "moves": False, "file": "room.toml"}
LEFT_HAND, FEET = (15, 17, 19), (27, 28, 31, 32)
VISIBLE = """name => {
  const box = document.querySelector(name).getBoundingClientRect();
  return box.height > 0 && box.top >= 0 && box.bottom <= innerHeight;
}"""


def without(marks):
    """The drawn person's landmarks, of which these are not seen."""
    return [{**row, "visibility": 0 if number in marks else 1} for number, row in enumerate(landmarks())]


@pytest.fixture(scope="module")
def browser(chromium):
    path = shutil.which("chromium") or shutil.which("chromium-browser") or shutil.which("google-chrome")
    browser = launch(chromium.browser_type, path)
    yield browser
    browser.close()


@pytest.mark.parametrize(("name", "what"), [
    ("live", ({}, None, "", "Do one: wave, point, clap.")),
    ("no-feet", ({}, without(FEET), "", "Your feet are not in the picture")),
    ("no-hand", ({}, without(LEFT_HAND), "", "A hand is not seen")),
    ("nobody", (UNTAUGHT, [], "", "Nobody is in the picture")),
    ("untaught", (UNTAUGHT, None, "", "It knows no movement yet. Choose at least two")),
    ("not-here", ({**UNTAUGHT, "teaches": False}, None, "", "labanmesh teach room.toml wave point")),
    ("no-observer", ({**UNTAUGHT, "observer": "silent"}, None, "", "labanmesh up room.toml")),
    ("refused", ({}, None, "this code was used already", "Scan a new code")),
])  # fmt: skip
def test_what_to_do_next_is_on_the_first_screen(browser, tmp_path, name, what):
    more, rows, refusal, sentence = what
    page = open_phone(browser, {**WORDS, **more}, rows, refusal)
    page.locator("#next", has_text=sentence).wait_for()
    for (width, height), scheme in product(SIZES, SCHEMES):
        page.set_viewport_size({"width": width, "height": height})
        page.emulate_media(color_scheme=scheme)
        place = f"{name}-{width}-{scheme}"
        page.screenshot(path=tmp_path / f"{place}.png")
        shown = ["#next", *(["#setup .main"] if name == "untaught" else []), *(["#verdict"] if name == "live" else [])]
        assert all(page.evaluate(VISIBLE, each) for each in shown), place
        assert not (faint := page.evaluate(FAINT)), (place, faint)
        assert not (small := page.evaluate(SMALL)), (place, small)
        assert page.evaluate(NO_SIDEWAYS_SCROLLING), place
        assert not (findings := serious_findings(page)), (place, findings)
    if refusal:
        assert page.inner_text("#fault") == refusal
    page.close()
    print("screenshots:", tmp_path)


def test_a_phone_that_is_too_slow_says_so(browser):
    page = open_phone(browser, WORDS, busy_ms=900)
    page.locator("#fault", has_text="this phone needs a second for a picture").wait_for(timeout=60_000)
    page.close()
