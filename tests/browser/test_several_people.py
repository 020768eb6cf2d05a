"""The page of a scene that judges two people: what each does, and the names that its user gives them."""

import json

import pytest
from page_looks import FAINT

from common.messages import JudgementMessage
from common.wire import decode, encode


@pytest.fixture
def scene(play):
    """Two people at rest: the judgements of both are published at once, as a fusion service does."""
    made, dashboard = play(more='[people]\nmost = 2\nnames = ["left", "right"]\n')
    made.url, made.how = dashboard.url, {"person": "left"}
    publisher = made._publishers[made.keys.judgement]

    class Both:
        def put(self, payload):
            publisher.put(payload)
            publisher.put(encode(decode(JudgementMessage, payload).model_copy(update={"person": "right"})))

    made._publishers[made.keys.judgement] = Both()
    return made


def test_each_person_has_the_name_that_a_user_gives_in_all_browsers(scene, look, tmp_path):
    page = look(scene.url, width=390, height=844)
    lines = page.locator("#people li")
    lines.nth(1).wait_for()
    assert [line.replace("\n", " ") for line in lines.all_inner_texts()] == ["left at rest", "right at rest"]
    assert page.evaluate(FAINT) == []
    page.get_by_role("button", name="right").click()
    field = page.get_by_label("Name of right")
    field.fill("Anna")
    field.press("Enter")
    page.get_by_role("button", name="Anna", exact=True).wait_for()
    scene.publish_verdict("ok", 1, ended=True)
    page.get_by_text("left: ok").first.wait_for()
    page.reload()
    page.get_by_role("button", name="Anna", exact=True).wait_for()
    other = look(scene.url)
    other.get_by_role("button", name="Anna", exact=True).wait_for()
    other.get_by_role("button", name="left", exact=True).click()
    other.get_by_label("Name of left").fill("Bert")
    other.get_by_label("Name of left").press("Enter")
    page.get_by_role("button", name="Bert", exact=True).wait_for()
    page.get_by_text("Bert: ok").first.wait_for()
    page.get_by_role("heading", name="Judges: Bert").wait_for()
    page.screenshot(path=tmp_path / "names.png", full_page=True)
    other.screenshot(path=tmp_path / "names-wide.png", full_page=True)
    assert json.loads((tmp_path / f"{scene.name}.people.json").read_text()) == {"left": "Bert", "right": "Anna"}
    assert page.evaluate("() => document.documentElement.scrollWidth <= innerWidth")


def test_an_empty_name_gives_the_scenes_own_back_and_escape_changes_nothing(scene, look):
    page = look(scene.url)
    page.get_by_role("button", name="right", exact=True).wait_for()
    for text, key, shown in (("Anna", "Enter", "Anna"), ("Bert", "Escape", "Anna"), ("", "Enter", "left")):
        page.locator("#people li button").first.click()
        page.get_by_label("Name of left").fill(text)
        page.get_by_label("Name of left").press(key)
        page.locator("#people li button").first.get_by_text(shown, exact=True).wait_for()
