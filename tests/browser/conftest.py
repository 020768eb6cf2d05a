"""A real browser before a real dashboard process, and a referee that says on a real mesh what the test wants."""

import re
import shutil
import subprocess
import sys
import threading
import time
from pathlib import Path

import pytest

from common.capture_file import CaptureRecord, CaptureWriter
from common.config import MeshConfig, read_scene
from common.link import Link
from common.messages import (
    Agreement,
    Contribution,
    JudgementMessage,
    VerdictMessage,
    VocabularyMessage,
    VocabularyReference,
    Vote,
)
from common.vocabulary import Vocabulary
from common.wire import encode

ROOT = Path(__file__).parents[2]
SOON_S = 20.0
VOCABULARY = Vocabulary(("byebye", "maestro", "ok", "nthrow"))
REFERENCE = VocabularyReference(name="movements", hash=VOCABULARY.digest)
SIDES = (45, 135, 225, 315)


def fields(names, silent, label, seq, at_ns):
    """A judgement's fields: every fourth judge holds ok, the others nthrow."""
    p, other = [0.02, 0.03, 0.05, 0.9], [0.1, 0.1, 0.6, 0.2]
    votes = {}
    for i, name in enumerate(names):
        here = name not in silent
        own = ("nthrow", p) if i % 4 else ("ok", other)
        votes[name] = Vote(label=own[0] if here else None, entropy=0.61 if here else None, p=own[1] if here else None,
                           weight=1 / len(names), age_s=0.04, state="counted" if here else "silent")  # fmt: skip
    k = sum(vote.label == label for vote in votes.values())
    return {
        "scene": "room", "fusion": "main", "seq": seq, "at_ns": at_ns, "vocabulary": REFERENCE, "p": p, "label": label,
        "certainty_bits": 0.62, "rule": "inverse_entropy", "votes": votes, "agreement": Agreement(k=k, n=len(votes)),
    }  # fmt: skip


class Referee:
    """Says judgements ten times a second, and verdicts when asked; each observer is a link with its token.

    how: further fields of each judgement and verdict.
    """

    def __init__(self, names):
        self.names, self.silent, self.seq, self.how = names, set(), 0, {}
        self.link = Link.open(MeshConfig(), "fusion", listen=["tcp/127.0.0.1:0"])
        self.endpoint = self.link.locator
        told = VocabularyMessage(scene="room", name="movements", hash=VOCABULARY.digest, labels=list(VOCABULARY.labels))
        self.link.answer("laban/room/vocabulary", lambda: encode(told))
        self._judgement, self._verdict = (self.link.publisher(f"laban/room/{k}") for k in ("judgement", "verdict"))
        self._ended = threading.Event()
        self._thread = threading.Thread(target=self._repeat)
        self._thread.start()

    def _fields(self, label="nthrow"):
        self.seq += 1
        return {**fields(self.names, self.silent, label, self.seq, time.time_ns()), **self.how}

    def judge(self):
        self._judgement.put(encode(JudgementMessage(**self._fields())))

    def say(self, name, label="nthrow", ended=False):
        """Publish a verdict; returns when, in ms since 1970."""
        now_ns = time.time_ns()
        more = {"began_ns": now_ns - 10**9, "decided_ns": now_ns, "ended_ns": now_ns if ended else None}
        if self.how:
            more["contributions"] = {n: Contribution(nats=0.5 - i, stands=i > 0) for i, n in enumerate(self.names)}
        payload = encode(VerdictMessage(**self._fields(label), id=name, **more))
        at_ms = time.time() * 1000
        self._verdict.put(payload)
        return at_ms

    def _repeat(self):
        while not self._ended.wait(0.1):
            self.judge()

    def close(self):
        self._ended.set()
        self._thread.join()
        self.link.close()


class Dashboard:
    """A `labanmesh dashboard` process; `url` is where it is."""

    def __init__(self, *words):
        command = [sys.executable, "-P", "-m", "labanmesh", "dashboard", *map(str, words), "--listen", "127.0.0.1:0"]
        self.process = subprocess.Popen(command, cwd=ROOT, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
        self.said = []
        for line in self.process.stdout:
            self.said.append(line)
            if found := re.match(r"(http://\S+) shows", line):
                self.url = found[1]
                return
        raise AssertionError(self.process.communicate())

    def memory_kb(self):
        return int(re.search(r"VmRSS:\s+(\d+)", Path(f"/proc/{self.process.pid}/status").read_text())[1])

    def close(self):
        self.process.terminate()
        _, err = self.process.communicate(timeout=SOON_S)
        assert self.process.returncode == 0 and not err, err


@pytest.fixture
def theatre(tmp_path):
    """Makes (referee, dashboard) for observers of these names; closes both."""
    opened = []

    def make(names=("cam1", "cam2", "cam3", "cam4")):
        referee = Referee(names)
        opened.append(referee)
        text = f'scene = "room"\n[mesh]\nendpoint = "{referee.endpoint}"\n[fusion]\nquorum = 2\n'
        text += "".join(
            f'[observers.{n}]\nsource = "a.npz"\nview = "yaw:{SIDES[i % 4]}"\n' for i, n in enumerate(names)
        )
        (tmp_path / "scene.toml").write_text(text)
        opened.append(Dashboard(tmp_path / "scene.toml"))
        return referee, opened[-1]

    yield make
    for each in reversed(opened):
        each.close()


@pytest.fixture
def show():
    """Makes the Dashboard of other words, closed at the end."""
    opened = []
    yield lambda *words: opened.append(Dashboard(*words)) or opened[-1]
    for each in opened:
        each.close()


@pytest.fixture(scope="session")
def chromium():
    """A browser of this machine; the tests skip where there is none."""
    playwright = pytest.importorskip("playwright.sync_api", reason="playwright is not installed")
    path = shutil.which("chromium") or shutil.which("chromium-browser") or shutil.which("google-chrome")
    if path is None:
        pytest.skip("no chromium here (Debian: chromium)")
    with playwright.sync_playwright() as driver:
        browser = driver.chromium.launch(executable_path=path, args=["--no-sandbox"])
        yield browser
        browser.close()


@pytest.fixture
def look(chromium):
    """Opens a page as a person would see it; at the end its console must have been quiet."""
    contexts, complaints = [], []

    def open_page(url, width=1280, height=900, quiet=True, **more):
        context = chromium.new_context(viewport={"width": width, "height": height}, **more)
        contexts.append(context)
        page = context.new_page()
        page.set_default_timeout(SOON_S * 1000)
        if quiet:
            page.on("console", lambda said: complaints.append(said.text))
            page.on("pageerror", lambda error: complaints.append(str(error)))
        page.goto(url)
        return page

    yield open_page
    for context in contexts:
        context.close()
    assert not complaints


@pytest.fixture
def chapter(tmp_path):
    """A capture of twelve seconds: at three a verdict, at nine another."""
    file = tmp_path / "scene.toml"
    file.write_text('scene = "room"\n[observers.cam1]\nsource = "a.npz"\n[observers.cam2]\nsource = "a.npz"\n')
    scene, began_ns, at = read_scene(file, {}), 1_700_000_000 * 10**9, tmp_path / "chapter.mcap"
    told = VocabularyMessage(scene="room", name="movements", hash=VOCABULARY.digest, labels=list(VOCABULARY.labels))
    with CaptureWriter(at, scene, file.read_text(), began_ns) as writer:
        writer.write(CaptureRecord("answer", "laban/room/vocabulary", encode(told), began_ns))
        for step in range(121):
            now_ns = began_ns + step * 10**8
            said = fields(("cam1", "cam2"), set(), "nthrow", step, now_ns)
            writer.write(CaptureRecord("put", "laban/room/judgement", encode(JudgementMessage(**said)), now_ns))
            if step in (30, 90):
                label = "ok" if step == 30 else "maestro"
                more = {"began_ns": now_ns - 10**9, "decided_ns": now_ns, "ended_ns": now_ns, "id": f"v{step}"}
                verdict = VerdictMessage(**{**said, "label": label}, **more)
                writer.write(CaptureRecord("put", "laban/room/verdict", encode(verdict), now_ns))
    return at
