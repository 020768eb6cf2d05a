"""The picture of a phone's page for the guide: the real page with a drawn person, whose scene says what is decided."""

import gzip
import json

from hub.phone.pages import StaticPages
from hub.phone.serving import REFUSED

HOST = "192.168.1.20:8443"
# A person who raises the right hand, as shares of the picture; landmarks that no part is made of lie in the head.
PLACES = {
    "ears": [(0.515, 0.15), (0.485, 0.15)], "shoulders": [(0.55, 0.27), (0.45, 0.27)],
    "elbows": [(0.585, 0.38), (0.385, 0.2)], "wrists": [(0.59, 0.5), (0.4, 0.08)],
    "hips": [(0.53, 0.52), (0.47, 0.52)], "knees": [(0.54, 0.71), (0.46, 0.71)], "feet": [(0.55, 0.9), (0.45, 0.9)],
}  # fmt: skip
MARKS = {"ears": (7,), "shoulders": (11,), "elbows": (13,), "wrists": (15, 17, 19), "hips": (23,), "knees": (25,),
         "feet": (27, 31)}  # fmt: skip
VERDICT = {"id": "v1", "label": "wave", "k": 3, "n": 4, "began_ms": 1_795_690_931_000, "ended": False}
WORDS = {"own": {"label": "wave", "p": 0.94}, "judged": {"label": "wave", "p": 0.97}, "moves": True, "why": "",
         "observer": "running", "known": ["wave", "point", "clap"], "teaches": True, "verdict": VERDICT}  # fmt: skip


def landmarks():
    rows = [{"x": 0.5, "y": 0.15, "visibility": 1} for _ in range(33)]
    for name, first in MARKS.items():
        for side in (0, 1):
            for mark in first:
                rows[mark + side] |= dict(zip("xy", PLACES[name][side], strict=True))
    return rows


def drawn_model(rows, busy_ms=0):
    """In place of the pose model: it finds these landmarks in every picture; nobody for none."""
    people = json.dumps({"landmarks": [rows] if rows else []})
    return (
        "export class PoseLandmarker { static async createFromOptions() { return new PoseLandmarker(); }"
        f" detectForVideo() {{ const end = performance.now() + {busy_ms}; while (performance.now() < end);"
        f" return {people}; }} close() {{}} }}"
    ).encode()


def open_phone(browser, words, rows=None, refusal="", busy_ms=0, **look):
    """The page, which sees the drawn person, or the landmarks `rows`, and gets these words of its server. refusal: with
    what the server ends the connection instead. busy_ms: how long the model needs for a picture."""
    files = {"vision_bundle.mjs": drawn_model(landmarks() if rows is None else rows, busy_ms)}
    pages = StaticPages(files, b"", {"scene": "dojo", "fingerprint": ""})
    page = browser.new_page(**look, bypass_csp=True, ignore_https_errors=True)

    def answer(route):
        found = pages.answer(route.request.url.partition(HOST)[2], HOST)
        headers = dict(found.headers)
        body = gzip.decompress(found.body) if headers.pop("content-encoding", "") else found.body
        route.fulfill(status=found.status, headers=headers, body=body)

    def scene(socket):
        socket.on_message(lambda text: None)
        if refusal:
            socket.send(json.dumps({"ended": refusal}))
            socket.close(code=REFUSED, reason=refusal)
            return
        socket.send(json.dumps({"welcome": {"scene": "dojo", "observer": "phone1", "secret": "s"}}))
        socket.send(json.dumps({"words": words}))

    page.route("**/*", answer)
    page.route_web_socket("**/socket", scene)
    page.goto(f"https://{HOST}/#code")
    return page


def launch(chromium, path):
    """Chromium with a camera that shows no person."""
    words = ["--no-sandbox", "--use-fake-device-for-media-stream", "--use-fake-ui-for-media-stream"]
    return chromium.launch(executable_path=path, args=words)


def draw_phone(driver, path, look):
    """A screenshot of the page; the bytes of a PNG."""
    browser = launch(driver.chromium, path)
    page = open_phone(browser, WORDS, **look)
    page.wait_for_function("document.getElementById('drawing').width > 100")
    page.locator("#next", has_text="Do one: wave").wait_for()
    # The picture of the browser's own fake camera is no person's.
    page.add_style_tag(content="#video { visibility: hidden }")
    page.evaluate("document.getElementById('state').textContent = 'running, 15 pictures/s'")
    picture = page.screenshot()
    browser.close()
    return picture
