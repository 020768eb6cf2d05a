"""The counter in a real browser: live, large enough for three metres, with a target and a reset."""

MOST_PIXELS = 120
"""Least height of a digit's line: 3 cm on a usual screen, which is read from three metres."""


def test_the_counter_shows_the_number_large_and_counts_to_a_target(play, look):
    scene, dashboard = play()
    page = look(dashboard.url)
    assert not page.is_visible("#counter"), "nothing is repeated"
    scene.publish(1, "ok", repetitions=7, partial_repetitions=2)
    page.wait_for_selector("#counter:not([hidden])")
    assert page.inner_text("#counted") == "7" and page.inner_text("#counted-words") == "times, 2 partial"
    assert (
        page.evaluate("() => parseFloat(getComputedStyle(document.querySelector('#counted')).fontSize)") >= MOST_PIXELS
    )
    page.fill("#target", "10")
    page.press("#target", "Enter")
    scene.publish(1, "ok", ended=True, repetitions=10)
    page.wait_for_selector("#counter[data-kind=complete]")
    assert page.inner_text("#counted") == "10" and "of 10" in page.inner_text("#counted-words")
    page.click("#reset")
    assert page.inner_text("#counted") == "0"
