"""The day page in a browser: the strip, the list, the filter, other days."""

import time

import pytest
from page_looks import FAINT, NO_SIDEWAYS_SCROLLING, SMALL, serious_findings
from played_scene import PlayedScene

from common import SECOND_NS
from hub.history.history_file import HistoryFile
from hub.history.records import HistoryRow


def keep(path):
    """Movements of today and of the day before, a fall, and corrections."""
    midday = time.mktime((*time.localtime()[:3], 12, 0, 0, 0, 0, -1))
    with HistoryFile.to_write(path) as file:
        for number in range(240):
            at_ns = round((midday - 20_000 + number * 150) * SECOND_NS)
            label = ("wave", "squat", "abstain", "answer_phone")[number % 4]
            detail = '{"repetitions": 8}' if label == "squat" else "{}"
            ended_ns, revises = at_ns + SECOND_NS * 17 // 10, "point" if number % 9 == 0 else None
            file.add(HistoryRow("verdict", f"v{number}", label, "ended", at_ns, at_ns, ended_ns, 0.93, 3, 4, revises,
                                detail=detail))  # fmt: skip
        at_ns = round((midday + 3600) * SECOND_NS)
        file.add(HistoryRow("fall", "fall-1", "fallen", "fallen", at_ns, at_ns, at_ns + 19 * SECOND_NS, 0.94, 2, 2))
        file.correct({"v239": "point", "v238": ""})
        before_ns = round((midday - 86_400) * SECOND_NS)
        file.add(HistoryRow("verdict", "old", "wave", "ended", before_ns, before_ns, before_ns, 0.9, 3, 4))


@pytest.fixture
def watched(request, tmp_path, show):
    """A scene that keeps a history and watches for falls, and its dashboard."""
    scene = PlayedScene(session="s").__enter__()
    request.addfinalizer(lambda: scene.__exit__())
    more = '[fusion]\nquorum = 2\n[history]\nfile = "h.db"\n[watch.fallen]\n'
    return scene, show(scene.scene_file(tmp_path / "s.toml", more))


def test_an_alarm_is_large_and_goes_when_the_person_is_up(watched, look, tmp_path):
    scene, dashboard = watched
    page = look(dashboard.url)
    assert page.is_hidden("#fall")
    scene.fall("fallen")
    page.wait_for_selector("#fall[data-kind=fallen]")
    assert "Somebody has fallen" in page.inner_text("#fall") and "2 of 2 judges" in page.inner_text("#fall")
    assert page.get_attribute("#fall", "role") == "alert"
    assert page.evaluate(NO_SIDEWAYS_SCROLLING) and not page.evaluate(FAINT)
    assert not serious_findings(page)
    page.screenshot(path=tmp_path / "fall.png")
    scene.fall("up")
    page.wait_for_selector("#fall", state="hidden")
    assert page.is_visible("#day")


@pytest.mark.parametrize("width", [1280, 390])
def test_the_day_is_a_strip_and_a_list(watched, chromium, tmp_path, width):
    _, dashboard = watched
    keep(tmp_path / "h.db")
    page = chromium.new_page(viewport={"width": width, "height": 900})
    faults = []
    page.on("pageerror", lambda error: faults.append(str(error)))
    page.goto(f"{dashboard.url}day")
    page.wait_for_selector("tr.entry")
    assert page.inner_text("#sum") == "240 movements, 1 fall"
    assert page.locator("tr.entry").count() == 200 and page.locator("#strip rect").count() == 241
    page.click("#more")
    assert page.locator("tr.entry").count() == 241
    assert "was point" in page.inner_text("#rows") and "squat, 8 times" in page.inner_text("#rows")
    page.select_option("#label", "fallen")
    assert page.locator("tr.entry").count() == 1 and "Somebody fell" in page.inner_text("#rows")
    page.select_option("#label", "")
    for button, text in (("#before", "1 movement"), ("#before", "Nothing was kept"), ("#after", "1 movement"),
                         ("#after", "240 movements")):  # fmt: skip
        page.click(button)
        page.wait_for_selector(f"#sum:has-text('{text}')")
    assert page.evaluate(NO_SIDEWAYS_SCROLLING) and not page.evaluate(FAINT) and not page.evaluate(SMALL)
    assert not serious_findings(page) and not faults
    page.screenshot(path=tmp_path / f"day-{width}.png")
    page.close()
