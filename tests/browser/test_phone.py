"""A phone's page in Chromium: the pose model runs there, real processes take its tracks, and nothing else leaves it."""

import json
import os
import statistics
import time

import pytest
from phone_stage import Cable, Intruder, PhoneScene, Sniffer, ages_ms, film_of_wave, phone_browser, port_of, with_port
from processes import until

from hub.phone.phone_messages import MESSAGE_LIMIT, read_message
from observer.tracks import WHOLE_BODY

BUSY_S = 60.0
FIRST_POSTERIOR_S = 20.0
BACK_S = 15.0
LOOK_S = 8.0
LONG = os.environ.get("LABANMESH_FAULTS") == "long"
CUTS_S = (1.0, 10.0, 60.0) if LONG else (1.0, 6.0)
SLOW_S = 180.0
"""How long a slow browser is looked at: in thirds."""
REQUEST_BYTES = 7000
"""Of a request for a file with its TLS handshake; those of Chromium have 5,300. A second of pictures has far more."""
OLD_MS = 1200.0
"""No track that reaches the observer is older: phone_session.py drops later ones, and its clock may be off."""


# A headless browser never hides a page: the page is told so, and its pictures stop as they do then.
VISIBILITY = """hidden => {
  Object.defineProperty(document, "hidden", { value: hidden, configurable: true });
  document.getElementById("video")[hidden ? "pause" : "play"]();
  document.dispatchEvent(new Event("visibilitychange"));
}"""


@pytest.fixture(scope="module")
def film(pose_model, tmp_path_factory):
    return film_of_wave(tmp_path_factory.mktemp("film"))


@pytest.fixture(scope="module")
def browser(chromium, film):
    browser = phone_browser(chromium.browser_type, film)
    yield browser
    browser.close()


@pytest.fixture
def scene(film, tmp_path):
    with PhoneScene(tmp_path) as running:
        yield running


@pytest.fixture
def phone(browser):
    """Opens the page as a phone of its own."""
    contexts = []

    def open_page(link):
        contexts.append(browser.new_context(ignore_https_errors=True, viewport={"width": 390, "height": 800}))
        page = contexts[-1].new_page()
        page.sniffer = Sniffer(page)
        page.goto(link)
        return page

    yield open_page
    for context in contexts:
        context.close()


def wait(page, condition, what, timeout_s=BUSY_S):
    """Until the condition holds; the page's own events go on meanwhile."""
    end_s = time.monotonic() + timeout_s
    while not (value := condition()):
        assert time.monotonic() < end_s, f"not within {timeout_s} s: {what()}"
        page.wait_for_timeout(50)
    return value


def looks(page):
    return lambda: f"state {page.inner_text('#state')!r}, fault {page.inner_text('#fault')!r}"


def test_from_the_code_to_the_first_posterior_only_tracks_leave_the_phone(scene, phone):
    with Cable(port_of(scene.link)) as cable:
        link = with_port(scene.link, cable.port)
        began_s = time.monotonic()
        page = phone(link)
        wait(page, lambda: scene.posteriors.take(0.0), looks(page))
        first_s = time.monotonic() - began_s
        page.wait_for_timeout(3000)
        messages = sum(map(len, page.sniffer.sent))
        requests = len(page.sniffer.requests)
        print(f"\n{cable.sent} bytes left the phone, {messages} of them messages, for {requests} requests")
        assert cable.sent < 1.2 * messages + REQUEST_BYTES * requests, "only the messages that are looked at below"
    assert page.evaluate("location.hash") == "" and page.inner_text("#observer") == "phone1"
    assert page.evaluate("document.getElementById('drawing').width") > 0
    kinds = {}
    for text in page.sniffer.sent:
        assert len(text) <= MESSAGE_LIMIT
        kinds.setdefault(type(read_message(text)).__name__, []).append(json.loads(text))
    print(f"first posterior after {first_s:.1f} s; sent { {kind: len(each) for kind, each in kinds.items()} }")
    assert set(kinds) == {"Join", "ClockAnswer", "PhoneTracks", "CameraState"} and len(kinds["Join"]) == 1
    assert all(set(each["tracks"]["parts"]) == set(WHOLE_BODY) for each in kinds["PhoneTracks"])
    place = link.partition("#")[0]
    code = scene.link.partition("#")[2]
    for method, url, body in page.sniffer.requests:
        assert method == "GET" and url.startswith(place) and body is None and code not in url.partition("#")[0]
    assert first_s < FIRST_POSTERIOR_S


def test_over_a_secured_router_a_phone_is_a_camera_that_may_be_taught(phone, film, tmp_path):
    with PhoneScene(tmp_path, is_secured=True) as scene:
        page = phone(scene.link)
        wait(page, lambda: scene.posteriors.take(0.0), looks(page))
        page.get_by_role("button", name="Teach more").click()
        page.get_by_role("button", name="Begin the lesson").wait_for()
        assert not scene.taken(), "tracks are for the observer alone"


def test_a_cut_line_and_a_page_that_was_left_come_back_by_themselves(scene, phone):
    with Cable(port_of(scene.link)) as cable:
        page = phone(with_port(scene.link, cable.port))
        wait(page, scene.taken, looks(page))
        for cut_s in CUTS_S:
            cable.cut()
            page.locator("#next", has_text="the connection is lost; trying again").or_(
                page.locator("#next", has_text="connecting again")
            ).wait_for()
            page.wait_for_timeout(1000 * cut_s)
            scene.taken(), scene.posteriors.take(0.0)
            cable.mend()
            back_s = time.monotonic()
            arrived = wait(page, scene.taken, looks(page), BACK_S)
            tracks_s = time.monotonic() - back_s
            wait(page, lambda: scene.posteriors.take(0.0), looks(page), BACK_S)
            print(
                f"\ncut for {cut_s:g} s: tracks after {tracks_s:.1f} s, a posterior {time.monotonic() - back_s:.1f} s"
            )
            assert max(ages_ms(arrived)) < OLD_MS and page.locator("#fault").text_content() == ""
        page.goto("about:blank")
        scene.taken()
        page.goto(with_port(scene.link, cable.port).partition("#")[0])
        wait(page, scene.taken, looks(page))


def test_two_phones_with_one_code_and_one_that_is_revoked(scene, phone):
    first = phone(scene.link)
    wait(first, scene.taken, looks(first))
    second = phone(scene.link)
    wait(second, lambda: "used already" in second.inner_text("#fault"), looks(second))
    scene.taken()
    wait(first, scene.taken, looks(first))
    forged = phone(scene.link.partition("#")[0] + "#forged")
    wait(forged, lambda: "not known" in forged.inner_text("#fault"), looks(forged))
    scene.revoke()
    wait(first, lambda: "revoked" in first.inner_text("#fault"), looks(first))
    first.reload()
    wait(first, lambda: "scan the code" in first.inner_text("#fault"), looks(first))
    scene.taken()
    first.wait_for_timeout(1000)
    assert not scene.taken()


def test_a_page_that_was_hidden_goes_on_when_it_is_shown(scene, phone):
    page = phone(scene.link)
    wait(page, scene.taken, looks(page))
    page.evaluate(VISIBILITY, True)
    wait(page, lambda: any("is hidden" in line for line in scene.lines), lambda: scene.lines[-3:])
    page.wait_for_timeout(1000)  # for what was on the way
    scene.taken()
    page.wait_for_timeout(2000)
    assert not scene.taken(), "a hidden page sees nothing"
    page.evaluate(VISIBILITY, False)
    assert max(ages_ms(wait(page, scene.taken, looks(page), BACK_S))) < OLD_MS


def test_nothing_reaches_the_observer_that_is_not_from_the_holder_of_the_code(scene, phone):
    code = scene.link.partition("#")[2]
    intruder = Intruder(scene.link)
    page = phone(scene.link)
    wait(page, scene.taken, looks(page))
    secret = page.evaluate("localStorage.getItem('labanmesh-phone')")
    forged = [{"tracks": intruder.tracks()}, {"join": {"code": "forged"}}, {"resume": {"secret": secret[:-1]}}]
    replayed = [{"join": {"code": code}}, *map(json.loads, page.sniffer.sent[:6])]
    endings = [intruder.ending(**each) for each in forged + replayed]
    print("\n" + "\n".join(sorted(set(endings))))
    assert all(each and "\n" not in each for each in endings)
    arrived = wait(page, scene.taken, looks(page))
    page.wait_for_timeout(2000)
    arrived += scene.taken()
    assert len(arrived) > 5 and not any(intruder.made(line) for _, line in arrived)
    assert page.locator("#fault").is_hidden() and scene.posteriors.take(0.0)
    scene.revoke()
    wait(page, lambda: "revoked" in page.inner_text("#fault"), looks(page))
    assert "revoked" in intruder.ending(resume={"secret": secret})
    scene.taken()
    page.wait_for_timeout(1000)
    assert not scene.taken()


@pytest.mark.skipif(not LONG, reason="three minutes: LABANMESH_FAULTS=long; a minute of it is in test_phone_slow.py")
@pytest.mark.parametrize("times", [4, 6])
@pytest.mark.timeout(2 * SLOW_S + 120)
def test_tracks_of_a_slow_browser_do_not_grow_old(scene, phone, times):
    page = phone(scene.link)
    page.context.new_cdp_session(page).send("Emulation.setCPUThrottlingRate", {"rate": times})
    wait(page, scene.taken, looks(page))
    page.wait_for_timeout(1000 * LOOK_S)  # with the full model first, which may be exchanged for the smaller one
    scene.taken()
    ages = []
    for _ in range(3):
        page.wait_for_timeout(1000 * SLOW_S / 3)
        ages.append(ages_ms(scene.taken()))
    medians = [statistics.median(each) for each in ages if each]
    rates = [round(3 * len(each) / SLOW_S, 1) for each in ages]
    print(f"\n{times} times slower: {rates} tracks a second, {[round(each) for each in medians]} ms old")
    assert len(medians) == 3 and medians[2] < medians[0] + 200


def test_the_code_stands_on_the_screen_of_the_machine_alone(scene, phone, browser):
    local = until(lambda: next((line.split()[-1] for line in scene.lines if "http://127.0.0.1" in line), ""))
    page = browser.new_page()
    page.goto(local)
    assert page.locator("svg").count() == 1
    seen = phone(scene.link)
    wait(seen, scene.taken, looks(seen))
    page.goto(local)
    assert page.locator("svg").count() == 0 and "is here" in page.inner_text("section")
    page.close()
