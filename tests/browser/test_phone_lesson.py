"""Taught from the phone alone, in one flow: place it, stand there, learn five takes, see one recognised."""

import time

import pytest
from page_looks import FAINT, NO_SIDEWAYS_SCROLLING, SMALL, serious_findings
from phone_stage import PhoneScene, Sniffer, performer

from hub.phone.phone_messages import read_message

LEARN_S = 120.0
WHOLE_S = 300.0
"""From the code to the first own movement that is recognised (issue 32)."""
LIFE_S = 15.0
WIDTH, HEIGHT = 390, 844


@pytest.fixture
def scene(pose_model, tmp_path):
    with PhoneScene(tmp_path, labels=()) as running:
        yield running


@pytest.fixture
def phone(chromium, scene):
    context = chromium.new_context(
        ignore_https_errors=True, viewport={"width": WIDTH, "height": HEIGHT}, has_touch=True, is_mobile=True
    )
    context.add_init_script(performer())
    page = context.new_page()
    page.sniffer = Sniffer(page)
    page.set_default_timeout(LEARN_S * 1000)
    yield page
    context.close()


def looks_right(page, name, folder):
    """A screenshot; what is to be pressed next is on it, and nothing is faint, small, or wider than the phone."""
    page.screenshot(path=folder / f"{name}.png")
    for each in page.locator("button.main:visible").all():
        box = each.bounding_box()
        assert box is None or box["y"] + box["height"] <= HEIGHT, (name, "below the screen", box)
    assert not (faint := page.evaluate(FAINT)), (name, faint)
    assert not (small := page.evaluate(SMALL)), (name, small)
    assert page.evaluate(NO_SIDEWAYS_SCROLLING), name
    assert not (findings := serious_findings(page)), (name, findings)


def tap(page, name):
    page.get_by_role("button", name=name, exact=True).tap()


@pytest.mark.timeout(600)
def test_from_the_code_to_the_first_own_movement_recognised(scene, phone, tmp_path):
    began_s = time.monotonic()
    phone.goto(scene.link)
    phone.locator("#next", has_text="It knows no movement yet. Choose at least two").wait_for()
    looks_right(phone, "1-choose", tmp_path)
    tap(phone, "Add wave")
    phone.fill("#label", "both")
    tap(phone, "Add")
    tap(phone, "Begin the lesson")
    for coming in ("Next: both", "Go on"):
        phone.get_by_role("button", name="Start", exact=True).wait_for()
        looks_right(phone, f"2-ready-{coming[:2]}", tmp_path)
        tap(phone, "Start")
        phone.wait_for_selector("#stage[data-kind=countdown]")
        phone.screenshot(path=tmp_path / "3-countdown.png")
        phone.wait_for_selector("#stage[data-kind=now]")
        phone.screenshot(path=tmp_path / "3-now.png")
        phone.wait_for_selector("#stage[data-kind=between]")
        phone.screenshot(path=tmp_path / "3-between.png")
        phone.get_by_role("button", name=coming).wait_for()
        looks_right(phone, "4-review", tmp_path)
        tap(phone, coming)
    phone.wait_for_selector("#stage[data-kind=ready]:has-text('Ordinary life')")
    tap(phone, "Start")
    phone.wait_for_timeout(1000 * LIFE_S)
    tap(phone, "That is enough")
    phone.get_by_role("button", name="Use it").wait_for()
    looks_right(phone, "5-learned", tmp_path)
    print(phone.inner_text("#stage"))
    tap(phone, "Use it")
    tap(phone, "Start the test")
    phone.wait_for_selector("#stage[data-kind=alarms]")
    looks_right(phone, "6-alarms", tmp_path)
    tap(phone, "That is enough")
    phone.get_by_role("button", name="See it recognised").wait_for()
    looks_right(phone, "7-done", tmp_path)
    print(phone.inner_text("#stage"))
    tap(phone, "See it recognised")
    phone.locator("#next", has_text="Do one: wave, both.").wait_for()
    phone.evaluate("window.performs = 'wave'")
    phone.wait_for_function("() => document.getElementById('verdict').textContent === 'wave'")
    whole_s = time.monotonic() - began_s
    looks_right(phone, "8-recognised", tmp_path)
    print(f"from the code to the first own movement recognised: {whole_s:.0f} s; {LIFE_S:g} s of them ordinary life")
    print("screenshots:", tmp_path)
    assert whole_s < WHOLE_S
    kinds = {type(read_message(text)).__name__ for text in phone.sniffer.sent}
    # A busy machine may lose the line; the phone then resumes.
    assert kinds - {"Resume"} == {"Join", "ClockAnswer", "PhoneTracks", "CameraState", "LessonRequest"}
    assert {method for method, _, _ in phone.sniffer.requests} == {"GET"}
