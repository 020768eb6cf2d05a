"""Verdicts and ages of posteriors when a scene gets less processor time than it needs.

    python -m benchmarks.starved [--shares 1,.5,.25] [--runs 1] [--folder build/starved]

Four observers with camshift play films of the synthetic performer, as real processes beside a fusion service. The first
run has the whole machine and shows what the scene needs; in each further one it gets a share of that, from its first
posterior on. The age of a posterior is from the capture of its frame until it is sent.
"""

import subprocess
import sys
import time
from collections import Counter, defaultdict
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from itertools import chain
from pathlib import Path
from statistics import median
from typing import Annotated

import typer

from benchmarks.command_line import run_command
from benchmarks.processor_share import ProcessorShare, processor_share
from common import SECOND_NS
from common.config import Scene, read_scene
from common.errors import BadInput, LabanmeshError
from common.keys import observer_of
from common.link import Link
from common.message_types import OVERLOADED
from common.messages import PosteriorMessage, StatusMessage
from common.progress import ProgressBar
from common.vocabulary import ABSTAIN
from common.wire import BadMessage, decode
from observer.motion.archive import Recording
from studies.demo import DemoTraffic
from studies.demo_report import movement_rows
from studies.demo_scene import synthetic_performance, write_demo

TIMEOUT_S = 120.0
"""How much longer than the performance the processes may take, also to start."""
TAKE_S, SEED = 0.1, 0
HEAD = "      given  cores       age      most  right  wrong  undecided  extra   of all"


@dataclass(slots=True)
class AgedTraffic(DemoTraffic):
    """ages_s: of each observer's posteriors, when they were sent. complaints: what observers said of themselves."""

    ages_s: dict[str, list[float]] = field(default_factory=lambda: defaultdict(list))
    complaints: set[str] = field(default_factory=set)

    def add(self, key: str, payload: bytes, scene: Scene) -> None:
        """Decode and keep one message; raises BadMessage."""
        if key.endswith("/status"):
            status = decode(StatusMessage, payload)
            if OVERLOADED in status.reason:
                self.complaints.add(f"{observer_of(key)}: {status.reason}")
            return
        DemoTraffic.add(self, key, payload, scene)
        if key.endswith("/posterior"):
            posterior = decode(PosteriorMessage, payload)
            self.ages_s[observer_of(key)].append((posterior.sent_ns - posterior.captured_ns) / SECOND_NS)


@dataclass(slots=True)
class StarvedRun:
    """One run of a performance of `length_s` seconds."""

    length_s: float
    traffic: AgedTraffic = field(default_factory=AgedTraffic)
    _begun: tuple[float, float] | None = None
    _newest: tuple[float, float] | None = None

    def measure(self, processor: ProcessorShare, cores: float | None) -> None:
        """Limit the processes when the films have begun, and note what they use until the films end."""
        if self.traffic.began_ns is None:
            return
        now_s = time.monotonic()
        if self._begun is None:
            if cores is not None:
                processor.limit(cores)
            self._begun = now_s, processor.spent_s()
        elif now_s - self._begun[0] < self.length_s and now_s - (self._newest or self._begun)[0] > 1:
            self._newest = now_s, processor.spent_s()

    @property
    def cores(self) -> float:
        """Processor time that the processes used per second."""
        (begun_s, before_s), (now_s, after_s) = self._begun or (0.0, 0.0), self._newest or (1.0, 0.0)
        return (after_s - before_s) / (now_s - begun_s)


def starved(
    shares: Annotated[str, typer.Option(help="Parts of the processor time that the scene needs.")] = "1,.5,.25",
    runs: Annotated[int, typer.Option(min=1, help="How often each is run.")] = 1,
    folder: Annotated[Path, typer.Option(help="Scene, models and films; those that are there are used.")] = Path(
        "build/starved"
    ),
) -> None:
    """Run a scene of four camshift observers with less and less processor time."""
    try:
        parts = [float(part) for part in shares.split(",")]
    except ValueError:
        raise BadInput(f"--shares {shares}: numbers such as 1,.5,.25 are expected") from None
    if not all(part > 0 for part in parts):
        raise BadInput(f"--shares {shares}: each must be above 0")
    performance, scene = synthetic_performance(SEED), folder / "scene.toml"
    if not scene.exists():
        with ProgressBar() as bar:
            write_demo(performance, folder, bar)
    print(HEAD)
    stream = performance.stream
    whole = [_run(scene, stream, None) for _ in range(runs)]
    need, right = median(run.cores for run in whole), sum(_grades(stream, run.traffic)["right"] for run in whole)
    print(*_table("all", stream, whole, right), sep="\n", flush=True)
    for part in parts:
        limited = [_run(scene, stream, need * part) for _ in range(runs)]
        print(*_table(f"{part:g} of {need:.2f}", stream, limited, right), sep="\n", flush=True)


def _run(scene_file: Path, stream: Recording, cores: float | None) -> StarvedRun:
    """Play the films once. cores: the processor time that the scene gets from its first posterior on; None: all."""
    scene, log = read_scene(scene_file), scene_file.with_name("log.txt")
    keys, run = scene.keys, StarvedRun(len(stream.positions) / stream.rate_hz)
    command = [sys.executable, "-P", "-m", "labanmesh", "up", str(scene_file), "--exit-when-done"]
    ends_s = time.monotonic() + run.length_s + TIMEOUT_S
    with (
        log.open("w") as output,
        Link.open(scene.mesh, "hub") as link,
        subprocess.Popen(command, stdout=output, stderr=output) as up,  # noqa: S603 - our own verb
        processor_share(up.pid) as processor,
    ):
        inbox = link.inbox(keys.posterior(), keys.observer_status(), keys.judgement, keys.verdict)
        while up.poll() is None and time.monotonic() < ends_s:
            for arrival in inbox.take(TAKE_S):
                with suppress(BadMessage):
                    run.traffic.add(arrival.key, arrival.payload, scene)
            run.measure(processor, cores)
        processor.free()
        up.terminate()
    if run.traffic.began_ns is None or not run.traffic.judgements:
        raise LabanmeshError(f"the processes failed or published nothing; {log} says why")
    return run


def _grades(stream: Recording, traffic: DemoTraffic) -> Counter[str]:
    """Movements by their first verdict: right, wrong, undecided; and `extra`, decided verdicts beyond these."""
    result, grades = movement_rows(stream, traffic), Counter[str]()
    for row in result.rows:
        label = traffic.first_words[row.verdict_ids[0]].label if row.verdict_ids else ABSTAIN
        grades["right" if label == row.label else "undecided" if label == ABSTAIN else "wrong"] += 1
    others = [*result.unmatched, *(name for row in result.rows for name in row.verdict_ids[1:])]
    grades["extra"] = sum(traffic.first_words[name].label != ABSTAIN for name in others)
    return grades


def _table(name: str, stream: Recording, runs: Sequence[StarvedRun], right: int) -> list[str]:
    """The line of several runs with one share, and a line for each observer. right: verdicts at full speed."""
    grades = sum((_grades(stream, run.traffic) for run in runs), Counter[str]())
    ages: dict[str, list[float]] = defaultdict(list)
    for run in runs:
        for observer, ages_s in run.traffic.ages_s.items():
            ages[observer] += ages_s
    line = (
        f"{name:>11}{median(run.cores for run in runs):>7.2f}{_age([*chain(*ages.values())])}"
        f"{grades['right']:>7}{grades['wrong']:>7}{grades['undecided']:>11}{grades['extra']:>7}"
        f"{grades['right'] / max(right, 1):>9.0%}"
    )
    complaints = sorted(set().union(*(run.traffic.complaints for run in runs)))
    return [line, *(f"{observer:>18}{_age(ages_s)}" for observer, ages_s in sorted(ages.items())), *complaints]


def _age(ages_s: Sequence[float]) -> str:
    return f"{median(ages_s) * 1000:>7.0f} ms{max(ages_s) * 1000:>7.0f} ms"


if __name__ == "__main__":
    sys.exit(run_command(starved, "starved"))
