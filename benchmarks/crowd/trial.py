"""One crowd trial: real `labanmesh fuse` processes, the simulated observers, and what the processes cost."""

import os
import subprocess
import sys
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from benchmarks.crowd.crowd import MOVING_S, NAMES, OBSERVERS, Crowd, CrowdCounts, scene_name
from benchmarks.timing import cpu_seconds, free_port, resident_bytes
from common.config import MeshConfig
from common.errors import LabanmeshError
from common.link import Link
from common.text import plural

WARM_UP_S = 8.0
SETTLE_S = MOVING_S + 1.5
"""How long movements take to end, and the last verdicts to arrive."""
START_TIMEOUT_S = 60.0
IDS = tuple(f"fusion{n}" for n in range(16))


@dataclass(frozen=True, slots=True)
class CrowdPlan:
    """Scenes, rate of each observer, seconds after the warm-up. kill: kill one process halfway, start another later."""

    scenes: int
    rate_hz: float
    seconds: float
    processes: int = 1
    kill: bool = False
    warm_up_s: float = WARM_UP_S


@dataclass(slots=True)
class FusionProcess:
    """One fusion process, and its costs as read from /proc."""

    name: str
    popen: subprocess.Popen[bytes]
    begun_cpu_s: float = 0.0
    ended_cpu_s: float = 0.0
    first_bytes: int = 0
    last_bytes: int = 0

    @property
    def cpu_s(self) -> float:
        """User and system time of all its threads since its start."""
        return cpu_seconds(self.popen.pid)

    @property
    def resident(self) -> int:
        """Resident memory in bytes."""
        return resident_bytes(self.popen.pid)


@dataclass(frozen=True, slots=True)
class CrowdResult:
    """The counts of a trial; put, seconds: of the measured part."""

    plan: CrowdPlan
    counts: CrowdCounts
    put: int
    seconds: float
    processes: Sequence[FusionProcess] = field(default_factory=list)

    @property
    def whole(self) -> bool:
        """Whether every movement has its one verdict."""
        return self.counts.right == self.counts.movements and self.counts.doubled == 0

    @property
    def cpu_per_posterior_us(self) -> float:
        """Of all fusion processes together, judging and publishing included."""
        return sum(p.ended_cpu_s - p.begun_cpu_s for p in self.processes) / max(self.put, 1) * 1e6

    @property
    def age_p99_ms(self) -> float:
        """99th percentile of the age of the newest frame in a judgement when it arrives."""
        return float(np.percentile(self.counts.ages_s or [0.0], 99)) * 1e3

    def table(self) -> str:
        """The result for people."""
        counts, ages = self.counts, np.array(self.counts.ages_s or [0.0]) * 1e3
        scenes = plural(self.plan.scenes, "scene")
        lines = [
            f"SIMULATED: {self.plan.scenes * OBSERVERS} observers in {scenes}, {self.plan.rate_hz:g} Hz",
            f"posteriors     {self.put / self.seconds:,.0f} per second for {self.seconds:.0f} s",
            f"judgements     {counts.judgements / self.seconds:,.0f} per second; age on arrival: "
            f"median {np.percentile(ages, 50):.1f} ms, p99 {self.age_p99_ms:.1f} ms, greatest {ages.max():.0f} ms",
            f"movements      {counts.movements}, {counts.right} with their verdict, {counts.doubled} with two",
            f"per posterior  {self.cpu_per_posterior_us:.1f} us of a core, judging and publishing included",
            f"the crowd      at most {counts.late_s * 1e3:.0f} ms late itself",
        ]
        for process in self.processes:
            share = (process.ended_cpu_s - process.begun_cpu_s) / self.seconds
            lines.append(
                f"{process.name:14s} {share:.2f} of a core, {process.first_bytes / 1e6:.0f} MB after a tenth of the "
                f"time, {process.last_bytes / 1e6:.0f} MB at the end"
            )
        return "\n".join(lines)


def run_trial(plan: CrowdPlan, folder: Path, report: Callable[[str], None]) -> CrowdResult:
    """Run a trial and report its progress; raises LabanmeshError when the processes do not connect."""
    endpoint = f"tcp/127.0.0.1:{free_port()}"
    write_scenes(folder, plan.scenes, endpoint)
    with ExitStack() as stack:
        running = [stack.enter_context(started(folder, name)) for name in IDS[: plan.processes]]
        link = stack.enter_context(Link.open(MeshConfig(endpoint=endpoint), "observer"))
        crowd = Crowd(link, plan.scenes, plan.rate_hz)
        if not crowd.ready(START_TIMEOUT_S):
            raise LabanmeshError(f"not all observers found a fusion process within {START_TIMEOUT_S:g} s")
        report(f"{plan.scenes * OBSERVERS} observers are connected")
        crowd.publish(plan.warm_up_s)
        begun_s = time.monotonic()
        # The first movements began before fusion was ready.
        crowd.counts = CrowdCounts()
        for process in running:
            process.begun_cpu_s = process.cpu_s
        for part in range(10):
            if plan.kill and part == 5:
                running[-1].popen.kill()
                report(f"killed {running.pop().name}")
            if plan.kill and part == 7:
                running.append(stack.enter_context(started(folder, IDS[plan.processes])))
                report(f"started {running[-1].name}")
            crowd.publish(plan.seconds / 10)
            for process in running:
                process.first_bytes = process.first_bytes or process.resident
            report(_progress(crowd.counts, running, time.monotonic() - begun_s))
        for process in running:
            process.ended_cpu_s, process.last_bytes = process.cpu_s, process.resident
        put, seconds = crowd.counts.put, time.monotonic() - begun_s
        judgements, late_s = crowd.counts.judgements, crowd.counts.late_s
        crowd.settle(SETTLE_S)
        crowd.counts.judgements, crowd.counts.late_s = judgements, late_s
        return CrowdResult(plan, crowd.counts, put, seconds, running)


def _progress(counts: CrowdCounts, running: Sequence[FusionProcess], elapsed_s: float) -> str:
    memory = ", ".join(f"{process.name} {process.resident / 1e6:.0f} MB" for process in running)
    recent_ms = np.array(counts.ages_s[-20_000:] or [0.0]) * 1e3
    return (
        f"{elapsed_s:5.0f} s: {counts.put} posteriors, {counts.movements} movements, {counts.right} verdicts, "
        f"age p99 {np.percentile(recent_ms, 99):.1f} ms; {memory}"
    )


def write_scenes(folder: Path, scenes: int, endpoint: str) -> None:
    """Write one scene file per scene."""
    labels = ", ".join(f'"{label}"' for label in NAMES.labels)
    observers = "".join(f'[observers.cam{n}]\nsource = "simulated"\n' for n in range(OBSERVERS))
    for number in range(scenes):
        name = scene_name(number)
        text = f'scene = "{name}"\nvocabulary = [{labels}]\nvocabulary_name = "{NAMES.name}"\n'
        mesh = f'[mesh]\nendpoint = "{endpoint}"\n[fusion]\nid = "{IDS[0]}"\n'
        (folder / f"{name}.toml").write_text(text + mesh + observers)


@contextmanager
def started(folder: Path, name: str) -> Iterator[FusionProcess]:
    """A fusion process of all scenes in the folder; it ends with the context."""
    command = [str(Path(sys.executable).with_name("labanmesh")), "fuse", str(folder), "--id", name]
    defaults = {"LABANMESH_LOG": os.environ.get("LABANMESH_LOG", "warning")}
    environment = {**os.environ, **defaults, "OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"}
    popen = subprocess.Popen(command, env=environment)  # noqa: S603 - our own command
    try:
        yield FusionProcess(name, popen)
    finally:
        stop_process(popen)


def stop_process(process: subprocess.Popen[bytes], timeout_s: float = 10.0) -> None:
    """Terminate a process, kill it after the timeout, and wait for its end."""
    process.terminate()
    try:
        process.wait(timeout_s)
    except subprocess.TimeoutExpired:
        process.kill()
        process.wait()
