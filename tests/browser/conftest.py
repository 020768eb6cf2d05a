"""A real browser before a real dashboard process, which shows a scene that the test plays on a real mesh."""

import shutil
import time

import pytest
from played_scene import VOCABULARY, Dashboard, PlayedScene
from processes import SOON_S

from common.arrival import CaptureRecord
from common.capture_file import CaptureWriter
from common.config import read_scene
from common.errors import LabanmeshError
from common.messages import Contribution, JudgementMessage, StatusMessage, VerdictMessage, Vote
from common.wire import encode, encode_vocabulary

VIEWS = ("yaw:45", "yaw:135", "yaw:225", "yaw:315")
P, OTHER = (0.02, 0.03, 0.05, 0.9), (0.1, 0.1, 0.6, 0.2)


class BrowserScene(PlayedScene):
    """Every fourth observer votes ok, the others nthrow."""

    def vote(self, place, label, p):
        own, p = ("nthrow", P) if place % 4 else ("ok", OTHER)
        weight = 1 / len(self.observers)
        return Vote(label=own, entropy=0.61, p=list(p), weight=weight, age_s=0.04, state="counted")

    def judgement(self):
        with self._lock:
            return JudgementMessage(**self._fields("nthrow", P))

    def report(self, observer, reason, **more):
        """An observer's status: degraded."""
        status = StatusMessage(scene=self.name, id=observer, state="degraded", reason=reason, rate_hz=11.0, **more)
        self._link._session.put(self.keys.observer_status(observer), encode(status))

    def publish(self, number, label="nthrow", ended=False, **more):
        """Publish a verdict; returns when, in ms since 1970."""
        if "facets" in self.how:
            nats = {name: 0.5 - place for place, name in enumerate(self.observers)}
            more["contributions"] = {name: Contribution(nats=n, stands=n < 0) for name, n in nats.items()}
        at_ms = time.time() * 1000
        self.publish_verdict(label, number, ended, **more)
        return at_ms


@pytest.fixture
def show(request):
    """Starts a dashboard with these words; it ends with the test."""

    def start(*words):
        dashboard = Dashboard(*words)
        request.addfinalizer(lambda: dashboard.__exit__())
        return dashboard

    return start


@pytest.fixture
def play(request, tmp_path, show):
    """Starts a scene of these observers and its dashboard; both end with the test. pictures: keys of cam1. more: other
    sections of the scene file."""

    def start(observers=("cam1", "cam2", "cam3", "cam4"), pictures="", more="", views=VIEWS):
        scene = BrowserScene(observers=observers).__enter__()
        request.addfinalizer(lambda: scene.__exit__())
        file = scene.scene_file(tmp_path / "scene.toml", f"[fusion]\nquorum = 2\n{more}", views)
        if pictures:
            plain = '[observers.cam1]\nsource = "a.npz"\n'
            file.write_text(file.read_text().replace(plain, f"[observers.cam1]\n{pictures}"))
        return scene, show(file)

    return start


@pytest.fixture(scope="session")
def chromium():
    """A browser of this machine; the tests are skipped without one."""
    playwright = pytest.importorskip("playwright.sync_api", reason="playwright is not installed")
    path = shutil.which("chromium") or shutil.which("chromium-browser") or shutil.which("google-chrome")
    if path is None:
        pytest.skip("no chromium here (Debian: chromium)")
    with playwright.sync_playwright() as driver:
        browser = driver.chromium.launch(executable_path=path, args=["--no-sandbox"])
        yield browser
        browser.close()


@pytest.fixture(scope="session")
def pose_model():
    """The pose model for phones' browsers; the tests are skipped without it."""
    from hub.phone.pose_model_file import data_folder, read_files

    try:
        return read_files(data_folder())
    except LabanmeshError as error:
        pytest.skip(str(error))


@pytest.fixture
def look(chromium):
    """Opens a page; at the end its console must be empty, unless `quiet` is false."""
    contexts, complaints = [], []

    def open_page(url, width=1280, height=900, quiet=True, **more):
        contexts.append(chromium.new_context(viewport={"width": width, "height": height}, **more))
        page = contexts[-1].new_page()
        page.set_default_timeout(SOON_S * 1000)
        if quiet:
            page.on("console", lambda message: complaints.append(message.text))
            page.on("pageerror", lambda error: complaints.append(str(error)))
        page.goto(url)
        page.wait_for_selector("#link:not([data-kind=waiting])")
        return page

    yield open_page
    for context in contexts:
        context.close()
    assert not complaints


@pytest.fixture
def capture(tmp_path):
    """A capture of twelve seconds with two verdicts, at three and at nine seconds."""
    file, path, began_ns = tmp_path / "scene.toml", tmp_path / "capture.mcap", 1_700_000_000 * 10**9
    with BrowserScene(observers=("cam1", "cam2")) as played:
        scene = read_scene(played.scene_file(file), {})
    with CaptureWriter(path, scene, file.read_text(), began_ns) as writer:
        vocabulary = encode_vocabulary("room", VOCABULARY)
        writer.write(CaptureRecord("answer", "laban/room/vocabulary", vocabulary, began_ns))
        for step in range(121):
            now_ns = began_ns + step * 10**8
            fields = {**played._fields("nthrow", P), "at_ns": now_ns}
            judgement = encode(JudgementMessage(**fields))
            writer.write(CaptureRecord("put", "laban/room/judgement", judgement, now_ns))
            if step in (30, 90):
                fields["label"] = "ok" if step == 30 else "maestro"
                times = {"began_ns": now_ns - 10**9, "decided_ns": now_ns, "ended_ns": now_ns}
                verdict = encode(VerdictMessage(**fields, **times, id=f"v{step}"))
                writer.write(CaptureRecord("put", "laban/room/verdict", verdict, now_ns))
    return path
