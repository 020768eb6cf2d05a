"""One crowd trial: real `labanmesh fuse` processes, the simulated observers, and what the processes cost."""

import os
import socket
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from benchmarks.crowd.crowd import JUDGES, MOVING_S, NAMES, Account, Crowd, scene_name
from benchmarks.timing import Row, row
from common.config import MeshConfig
from common.errors import LabanmeshError
from common.link import Link

WARM_UP_S = 8.0
SETTLE_S = MOVING_S + 1.5
"""How long everybody takes to come to rest at the end, and the last verdicts to come."""
SOON_S = 60.0
TICKS_S = 1 / os.sysconf("SC_CLK_TCK")
PAGE = os.sysconf("SC_PAGE_SIZE")
IDS = tuple(f"referee{n}" for n in range(16))


@dataclass(frozen=True, slots=True)
class Plan:
    """What to try, for how long after the warm-up. kill: kill one process in the middle, start another soon after."""

    scenes: int
    rate_hz: float
    seconds: float
    processes: int = 1
    kill: bool = False
    warm_up_s: float = WARM_UP_S


@dataclass(slots=True)
class Process:
    """One fusion process, and what /proc says of it."""

    name: str
    popen: subprocess.Popen[bytes]
    begun_cpu_s: float = 0.0
    ended_cpu_s: float = 0.0
    first_bytes: int = 0
    last_bytes: int = 0

    @property
    def cpu_s(self) -> float:
        """User and system time of all its threads since its start."""
        fields = Path(f"/proc/{self.popen.pid}/stat").read_text().rpartition(")")[2].split()
        return (int(fields[11]) + int(fields[12])) * TICKS_S

    @property
    def resident(self) -> int:
        """Bytes in memory now."""
        return int(Path(f"/proc/{self.popen.pid}/statm").read_text().split()[1]) * PAGE


@dataclass(frozen=True, slots=True)
class Outcome:
    """What came of it. seconds: of the part that was measured."""

    plan: Plan
    account: Account
    put: int
    seconds: float
    processes: Sequence[Process] = field(default_factory=list)

    @property
    def whole(self) -> bool:
        """Every movement has its one verdict."""
        return self.account.right == self.account.movements and self.account.doubled == 0

    @property
    def cpu_per_posterior_us(self) -> float:
        """Of all fusion processes together, judging and saying included."""
        return sum(p.ended_cpu_s - p.begun_cpu_s for p in self.processes) / max(self.put, 1) * 1e6

    @property
    def age_p99_ms(self) -> float:
        """Of judgements when they came, since the newest frame that they rest on."""
        return float(np.percentile(self.account.ages_s or [0.0], 99)) * 1e3

    def table(self) -> str:
        """For people."""
        ages = np.array(self.account.ages_s or [0.0]) * 1e3
        median, p99 = np.percentile(ages, 50), self.age_p99_ms
        lines = [
            f"SIMULATED: {self.plan.scenes * JUDGES} observers of {self.plan.scenes} scenes, {self.plan.rate_hz:g} Hz",
            f"posteriors     {self.put / self.seconds:,.0f} a second for {self.seconds:.0f} s",
            f"judgements     {self.account.judgements / self.seconds:,.0f} a second; "
            f"age when they come: median {median:.1f} ms, p99 {p99:.1f} ms, most {ages.max():.0f} ms",
            f"movements      {self.account.movements}, of which {self.account.right} with their verdict; "
            f"{self.account.doubled} said twice",
            f"per posterior  {self.cpu_per_posterior_us:.1f} us of a core, judging and saying included",
            f"the crowd      at most {self.account.late_s * 1e3:.0f} ms late itself",
        ]
        for process in self.processes:
            share = (process.ended_cpu_s - process.begun_cpu_s) / self.seconds
            lines.append(
                f"{process.name:14s} {share:.2f} of a core, {process.first_bytes / 1e6:.0f} MB after a tenth of the "
                f"time, {process.last_bytes / 1e6:.0f} MB at the end"
            )
        return "\n".join(lines)


def run(plan: Plan, folder: Path, tell: Callable[[str], None]) -> Outcome:
    """Play it; raises LabanmeshError when the processes do not meet."""
    endpoint = f"tcp/127.0.0.1:{free_port()}"
    write_scenes(folder, plan.scenes, endpoint)
    with ExitStack() as stack:
        running = [stack.enter_context(started(folder, name)) for name in IDS[: plan.processes]]
        link = stack.enter_context(Link.open(MeshConfig(endpoint=endpoint), "observer"))
        crowd = Crowd(link, plan.scenes, plan.rate_hz)
        if not crowd.ready(SOON_S):
            raise LabanmeshError("the fusion processes did not listen to all observers within a minute")
        tell(f"{plan.scenes * JUDGES} observers are heard")
        crowd.speak(plan.warm_up_s)
        begun_s = time.monotonic()
        # The first movements began while nobody judged yet.
        crowd.account = Account()
        for process in running:
            process.begun_cpu_s = process.cpu_s
        for part in range(10):
            if plan.kill and part == 5:
                running[-1].popen.kill()
                tell(f"killed {running.pop().name}")
            if plan.kill and part == 7:
                running.append(stack.enter_context(started(folder, IDS[plan.processes])))
                tell(f"started {running[-1].name}")
            crowd.speak(plan.seconds / 10)
            for process in running:
                process.first_bytes = process.first_bytes or process.resident
            tell(_line(crowd.account, running, begun_s))
        for process in running:
            process.ended_cpu_s, process.last_bytes = process.cpu_s, process.resident
        put, seconds = crowd.account.put, time.monotonic() - begun_s
        judgements, late_s = crowd.account.judgements, crowd.account.late_s
        crowd.settle(SETTLE_S)
        crowd.account.judgements, crowd.account.late_s = judgements, late_s
        return Outcome(plan, crowd.account, put, seconds, running)


def free_port() -> int:
    """A port on this machine that nobody listens on now."""
    with socket.socket() as opened:
        opened.bind(("127.0.0.1", 0))
        return int(opened.getsockname()[1])


def write_scenes(folder: Path, scenes: int, endpoint: str) -> None:
    """A scene file for each."""
    labels = ", ".join(f'"{label}"' for label in NAMES.labels)
    judges = "".join(f'[observers.cam{judge}]\nsource = "simulated"\n' for judge in range(JUDGES))
    for number in range(scenes):
        name = scene_name(number)
        text = f'scene = "{name}"\nvocabulary = [{labels}]\nvocabulary_name = "{NAMES.name}"\n'
        mesh = f'[mesh]\nendpoint = "{endpoint}"\n[fusion]\nid = "{IDS[0]}"\n'
        (folder / f"{name}.toml").write_text(text + mesh + judges)


@contextmanager
def started(folder: Path, name: str) -> Iterator[Process]:
    """A fusion process of all the scenes in the folder, ended with the context."""
    command = [str(Path(sys.executable).with_name("labanmesh")), "fuse", str(folder), "--id", name]
    environment = {
        **os.environ,
        "LABANMESH_LOG": os.environ.get("LABANMESH_LOG", "warning"),
        "OMP_NUM_THREADS": "1",
        "OPENBLAS_NUM_THREADS": "1",
    }
    popen = subprocess.Popen(command, env=environment)  # noqa: S603 - our own command
    try:
        yield Process(name, popen)
    finally:
        popen.terminate()
        try:
            popen.wait(10)
        except subprocess.TimeoutExpired:
            popen.kill()
            popen.wait()


def _line(account: Account, running: Sequence[Process], begun_s: float) -> str:
    told = ", ".join(f"{process.name} {process.resident / 1e6:.0f} MB" for process in running)
    recent = np.array(account.ages_s[-20_000:] or [0.0]) * 1e3
    return (
        f"{time.monotonic() - begun_s:5.0f} s: {account.put} posteriors, {account.movements} movements, "
        f"{account.right} verdicts, age p99 {np.percentile(recent, 99):.1f} ms; {told}"
    )


SECONDS = 10.0
FEW, MANY = 1, 250
"""Scenes, of four observers each."""


def rows(seconds: float = SECONDS) -> Iterator[Row]:
    """Processor time of the fusion process for each posterior, and how old judgements are at the 99th percentile."""
    few, many = (_run(scenes, seconds) for scenes in (FEW, MANY))
    observers = f"{many[2]} observers, floor: {few[2]}"
    yield row(f"one posterior, {observers}", many[0], few[0], "us", 1)
    yield row(f"age of a judgement, p99, {observers}", many[1], few[1], "ms", 1)


def _run(scenes: int, seconds: float) -> tuple[float, float, int]:
    with tempfile.TemporaryDirectory() as folder:
        outcome = run(Plan(scenes, 30.0, seconds), Path(folder), lambda line: None)
    return outcome.cpu_per_posterior_us, outcome.age_p99_ms, scenes * JUDGES
