"""`labanmesh demo`: real processes on this machine, from motion to verdicts; ends by itself.

1. The performance, one model and one film per observer, and the scene file are written into a folder.
2. `labanmesh up` starts four observers and the fusion service; `labanmesh watch` shows them.
3. This process subscribes as any hub does, and at the end compares the verdicts with what was performed.
"""

import contextlib
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated

import typer

from common import SECOND_NS
from common.config import Scene, read_scene
from common.errors import LabanmeshError
from common.inbox import Inbox
from common.link import Link
from common.messages import JudgementMessage, PosteriorMessage, VerdictMessage
from common.progress import ProgressBar
from common.wire import BadMessage, decode

PLAY_TIMEOUT_S = 60.0
"""How much longer than the performance the processes may take: on a busy core they need half a minute to start."""
LOG_LOOK_S = 0.1
"""How often it looks whether the processes have ended before they published anything."""
STOP_TIMEOUT_S = 10.0
AFTER_DEMO = (
    """next, your own movements: labanmesh init, with your cameras; or labanmesh teach --rehearse, without a camera"""
)


@dataclass(slots=True)
class DemoTraffic:
    """The messages of one demo. began_ns, ended_ns: capture times of the first and the newest frame.

    first_words, last_words: by the verdict's id its first message and its newest one, which may correct the first.
    timed_out: the processes were stopped before the end of the performance.
    """

    began_ns: int | None = None
    ended_ns: int = 0
    judgements: list[JudgementMessage] = field(default_factory=list)
    first_words: dict[str, VerdictMessage] = field(default_factory=dict)
    last_words: dict[str, VerdictMessage] = field(default_factory=dict)
    timed_out: bool = False

    def add(self, key: str, payload: bytes, scene: Scene) -> None:
        """Decode and keep one message; raises BadMessage."""
        if key == scene.keys.judgement:
            self.judgements.append(decode(JudgementMessage, payload))
        elif key == scene.keys.verdict:
            verdict = decode(VerdictMessage, payload)
            self.first_words.setdefault(verdict.id, verdict)
            self.last_words[verdict.id] = verdict
        else:
            captured_ns = decode(PosteriorMessage, payload).captured_ns
            self.began_ns = captured_ns if self.began_ns is None else self.began_ns
            self.ended_ns = max(self.ended_ns, captured_ns)

    def seconds(self, at_ns: int) -> float:
        """Time since the performance began."""
        return (at_ns - (self.began_ns or at_ns)) / SECOND_NS


def demo(
    output: Annotated[Path, typer.Option(help="Folder for scene, models, log and figures.")] = Path("labanmesh-demo"),
    seed: Annotated[int, typer.Option(min=0, max=2**63 - 1, help="Seed of all random choices.")] = 0,
    pixels: Annotated[
        bool,
        typer.Option(help="Track hands and head in pictures of virtual cameras, or take their positions as given."),
    ] = True,
) -> None:
    """Run the whole system here: four observer processes in the corners, one fusion service, verdicts against truth.

    Virtual cameras film a synthetic performer.

    Example: labanmesh demo
    """
    from studies.demo_films import film_tracks
    from studies.demo_report import draw_figures, movement_rows, result_text
    from studies.demo_scene import PREVIEWED, synthetic_performance, write_demo

    performance = synthetic_performance(seed)
    print(performance.title)
    with ProgressBar() as bar:
        scene, rate = write_demo(performance, output, bar, pixels)
    length_s = len(performance.stream.positions) / performance.stream.rate_hz
    print(*([rate.text] if rate else []), sep="\n")
    print(f"starting four observers and the fusion service; the performance takes {length_s:.0f} s", flush=True)
    traffic = play(scene, output / "log.txt", length_s)
    rows = movement_rows(performance.stream, traffic)
    print(f"\n{performance.title}\n\n{result_text(rows, traffic, pixels)}\n", flush=True)
    files, note = draw_figures(performance.stream, traffic, performance.vocabulary.labels, output)
    if pixels:
        files.append(output / f"{PREVIEWED}-tracks.mp4")
        with ProgressBar() as bar:
            film_tracks(scene, PREVIEWED, files[-1], bar)
    print("written:", *files, scene, output / "log.txt", sep="\n  ")
    print(f"{note}\nto run it again: labanmesh up {scene}, and labanmesh watch {scene} in another terminal")
    print(AFTER_DEMO)
    if traffic.timed_out:
        raise typer.Exit(1)


def play(scene_file: Path, log: Path, length_s: float) -> DemoTraffic:
    """Run the scene to its end under the terminal view; returns the messages.

    Raises LabanmeshError that names the log when the processes do not end or publish nothing.
    """
    scene, traffic = read_scene(scene_file), DemoTraffic()
    keys = scene.keys
    python = [sys.executable, "-P", "-m", "labanmesh"]
    with (
        log.open("w", encoding="utf-8") as log_file,
        Link.open(scene.mesh, "hub") as link,
        _subscribed(link.inbox(keys.posterior(), keys.judgement, keys.verdict), scene, traffic) as is_received,
        _process([*python, "up", str(scene_file), "--exit-when-done"], stdout=log_file, stderr=log_file) as up,
    ):
        # Before anything is published watch would say that nothing runs.
        end_s = time.monotonic() + PLAY_TIMEOUT_S
        while up.poll() is None and time.monotonic() < end_s and not is_received.wait(LOG_LOOK_S):
            pass
        with _process([*python, "watch", str(scene_file)]):
            try:
                status = up.wait(length_s + PLAY_TIMEOUT_S)
            except subprocess.TimeoutExpired:
                status, traffic.timed_out = 0, True
    if status or traffic.began_ns is None or not traffic.judgements:
        raise LabanmeshError(f"the demo's processes failed or published nothing; {log} says why")
    return traffic


@contextlib.contextmanager
def _process(command: list[str], **streams: object) -> Iterator[subprocess.Popen[bytes]]:
    """A process that has ended when the block is left."""
    with subprocess.Popen(command, **streams) as process:  # type: ignore[call-overload]  # noqa: S603 - our own verbs
        try:
            yield process
        finally:
            if process.poll() is None:
                process.send_signal(signal.SIGTERM)
                try:
                    process.wait(STOP_TIMEOUT_S)
                except subprocess.TimeoutExpired:
                    process.kill()


@contextlib.contextmanager
def _subscribed(inbox: Inbox, scene: Scene, traffic: DemoTraffic) -> Iterator[threading.Event]:
    """Collect messages in a thread until the block ends and the inbox is empty; yields an event that the first sets."""
    done, arrived = threading.Event(), threading.Event()

    def collect() -> None:
        while True:
            over = done.is_set()
            for arrival in inbox.take(0.1):
                with contextlib.suppress(BadMessage):
                    traffic.add(arrival.key, arrival.payload, scene)
                    arrived.set()
            if over:
                return

    thread = threading.Thread(target=collect, name="demo-listener")
    thread.start()
    try:
        yield arrived
    finally:
        done.set()
        thread.join()
