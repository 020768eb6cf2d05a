"""`labanmesh demo`: real processes on this machine, from recorded or synthetic motion to verdicts, ends by itself.

1. Performance, models and scene file are written into a folder.
2. `labanmesh up` starts four observers and the referee; `labanmesh watch` shows them.
3. This process listens like any hub, and at the end holds the verdicts against what was performed.
"""

import contextlib
import signal
import subprocess
import sys
import threading
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated

import typer

from common.config import Scene, read_scene
from common.errors import LabanmeshError
from common.inbox import Inbox
from common.link import Link
from common.messages import JudgementMessage, PosteriorMessage, VerdictMessage
from common.progress import ProgressBar
from common.wire import BadMessage, decode

SECOND_NS = 1_000_000_000
PLAY_PATIENCE_S = 30.0
STOP_PATIENCE_S = 10.0


def demo(
    motion: Annotated[Path | None, typer.Option(help="A motion archive: recorded people instead of ours.")] = None,
    subject: Annotated[str | None, typer.Option(help="Who performs, of the archive; the last one.")] = None,
    output: Annotated[Path, typer.Option(help="Folder for scene, models, log and figures.")] = Path("labanmesh-demo"),
    seed: Annotated[int, typer.Option(min=0, help="Seeds all chance.")] = 0,
    pixels: Annotated[
        bool, typer.Option(help="Track hands and head in pictures of virtual cameras, or be told where they are.")
    ] = True,
) -> None:
    """The whole system on this machine: four observer processes in the corners, one referee, verdicts against truth.

    The performer is synthetic unless --motion names recorded people, and filmed by virtual cameras. Ends by itself.

    Example: labanmesh demo

    Example: labanmesh demo --motion msr.npz --subject 8
    """
    from observer.motion.archive_file import read_archive
    from studies.demo_report import draw, rows_of, table
    from studies.demo_scene import PREVIEW, recorded_performance, synthetic_performance, write_demo

    if motion is None:
        performance = synthetic_performance(seed)
    else:
        performance = recorded_performance(read_archive(motion), motion.name, subject, seed)
    print(performance.title)
    with ProgressBar() as bar:
        scene = write_demo(performance, output, bar, pixels)
    stream = performance.stream
    length_s = len(stream.positions) / stream.rate_hz
    print(f"five processes start: four observers, one referee; the performance takes {length_s:.0f} s", flush=True)
    heard = play(scene, output / "log.txt", length_s)
    figures = draw(stream, heard, performance.vocabulary.labels, output)
    print(f"\n{performance.title}\n\n{table(rows_of(stream, heard))}\n")
    film = [output / PREVIEW] if pixels else []
    print("written:", *figures, *film, scene, output / "log.txt", sep="\n  ")
    print(f"\nagain, by hand: labanmesh up {scene}, and labanmesh watch {scene} in another terminal")


@dataclass(slots=True)
class Heard:
    """Everything the mesh said during the demo. began_ns: capture time of the first frame."""

    began_ns: int | None = None
    judgements: list[JudgementMessage] = field(default_factory=list)
    verdicts: dict[str, VerdictMessage] = field(default_factory=dict)
    first_words: dict[str, VerdictMessage] = field(default_factory=dict)

    def note(self, key: str, payload: bytes, scene: Scene) -> None:
        """Take one message; the last word of a verdict replaces the one before, the first is kept beside it."""
        if key == scene.keys.judgement:
            self.judgements.append(decode(JudgementMessage, payload))
        elif key == scene.keys.verdict:
            verdict = decode(VerdictMessage, payload)
            self.first_words.setdefault(verdict.id, verdict)
            self.verdicts[verdict.id] = verdict
        elif self.began_ns is None:
            self.began_ns = decode(PosteriorMessage, payload).captured_ns

    def seconds(self, at_ns: int) -> float:
        """Time since the performance began."""
        return (at_ns - (self.began_ns or at_ns)) / SECOND_NS


def play(scene_file: Path, log: Path, length_s: float) -> Heard:
    """Run the scene to its end under the terminal view; returns what was heard.

    Raises LabanmeshError when the processes do not end or do not speak, naming the log.
    """
    scene, heard = read_scene(scene_file), Heard()
    python = [sys.executable, "-P", "-m", "labanmesh"]
    with (
        log.open("w", encoding="utf-8") as log_file,
        Link.open(scene.mesh, "hub") as link,
        _listening(link.inbox(scene.keys.posterior(), scene.keys.judgement, scene.keys.verdict), scene, heard),
        _process([*python, "up", str(scene_file), "--exit-when-done"], stdout=log_file, stderr=log_file) as up,
        _process([*python, "watch", str(scene_file)]),
    ):
        try:
            status = up.wait(length_s + PLAY_PATIENCE_S)
        except subprocess.TimeoutExpired:
            raise LabanmeshError(f"the demo's processes did not end in time; {log} says why") from None
    if status or not heard.judgements:
        raise LabanmeshError(f"the demo's processes failed or said nothing; {log} says why")
    return heard


@contextlib.contextmanager
def _process(command: list[str], **streams: object) -> Iterator[subprocess.Popen[bytes]]:
    """A process that is over, one way or another, when the block is left."""
    with subprocess.Popen(command, **streams) as process:  # type: ignore[call-overload]  # noqa: S603 - our own verbs
        try:
            yield process
        finally:
            if process.poll() is None:
                process.send_signal(signal.SIGTERM)
                try:
                    process.wait(STOP_PATIENCE_S)
                except subprocess.TimeoutExpired:
                    process.kill()


@contextlib.contextmanager
def _listening(inbox: Inbox, scene: Scene, heard: Heard) -> Iterator[None]:
    """Note in a thread what comes, until the block is left and the inbox is empty."""
    done = threading.Event()

    def listen() -> None:
        while True:
            over = done.is_set()
            for arrival in inbox.take(0.1):
                with contextlib.suppress(BadMessage):
                    heard.note(arrival.key, arrival.payload, scene)
            if over:
                return

    thread = threading.Thread(target=listen, name="demo-listener")
    thread.start()
    try:
        yield
    finally:
        done.set()
        thread.join()
