"""The counter in a real browser: live, large enough for three metres, with a target and a reset."""

LEAST_PIXELS = 120
"""Least height of a digit's line: 3 cm on a usual screen, which is read from three metres."""


def test_the_counter_is_large_for_an_exercise_and_counts_to_a_target(play, look):
    scene, dashboard = play()
    page = look(dashboard.url)

    def is_large():
        size = page.evaluate("parseFloat(getComputedStyle(document.querySelector('#counted')).fontSize)")
        return size >= LEAST_PIXELS

    assert not page.is_visible("#counter"), "nothing is repeated"
    scene.publish(1, "ok", ended=True, repetitions=2)
    page.wait_for_selector("#counted:has-text('2')")
    assert not is_large(), "a movement that is done once or twice is no exercise"
    scene.publish(2, "ok", repetitions=7, partial_repetitions=2)
    page.wait_for_selector("#counted:has-text('9')")
    assert page.inner_text("#counted-words") == "times, 2 partial" and is_large()
    scene.publish(3)
    page.wait_for_selector("#counter[data-size=small]")
    page.fill("#target", "10")
    page.press("#target", "Enter")
    scene.publish(2, "ok", ended=True, repetitions=8)
    page.wait_for_selector("#counter[data-kind=complete]")
    assert page.inner_text("#counted") == "10" and "of 10" in page.inner_text("#counted-words") and is_large()
    page.click("#reset")
    assert page.inner_text("#counted") == "0"
