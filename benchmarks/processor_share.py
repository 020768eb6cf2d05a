"""Gives a group of processes a share of processor time: by a quota of the kernel, or else beside busy processes.

1. Where the cpu controller of cgroups can be written (root), the group gets exactly its share, in slices of PERIOD_S,
   on as many cores as that takes. On more, the kernel would give a small quota to one core at a time, in slices of 5
   ms, and processes on the others would wait for ever so long.
2. Elsewhere all processes of the group are pinned to one core, on which busy processes run as well.
"""

import math
import os
import subprocess
import sys
from collections.abc import Iterable, Iterator
from contextlib import ExitStack, contextmanager, suppress
from pathlib import Path

PERIOD_S = 0.02
"""Short against a frame's age, as between processes that compete."""
LEAST_QUOTA_S = 0.001
"""The kernel accepts no less."""
CONTROLLERS = (Path("/sys/fs/cgroup/cpu"), Path("/sys/fs/cgroup"))
"""Of cgroups in the first and in the second version."""
BUSY = "while True: pass"


class ProcessorShare:
    """The processor time of `root` and its descendants. Shares are in cores, e.g. 0.5: half of one."""

    def __init__(self, root: int, folder: Path | None, stack: ExitStack) -> None:
        self._root, self._folder, self._stack = root, folder, stack

    @property
    def by(self) -> str:
        """How the share is given."""
        return "a quota of the kernel" if self._folder else "busy processes on the same core"

    def limit(self, cores: float) -> None:
        """From now on give the processes that run now, and those that they start, so much of the machine."""
        if self._folder is None:
            self._crowd(cores)
            return
        _set_quota(self._folder, cores)
        family, used = _family(self._root), sorted(os.sched_getaffinity(0))[: math.ceil(cores)]
        for pid in family:
            with suppress(ProcessLookupError):
                (self._folder / "cgroup.procs").write_text(str(pid))
        _pin(family, used)

    def free(self) -> None:
        """Give the processes the whole machine again."""
        if self._folder is None:
            self._stack.close()
        else:
            _set_quota(self._folder, os.cpu_count() or 1)
            _pin(_family(self._root), os.sched_getaffinity(0))

    def spent_s(self) -> float:
        """Processor time of all processes that run now, seconds."""
        return sum(map(_spent_s, _family(self._root)))

    def _crowd(self, cores: float) -> None:
        core, family = min(os.sched_getaffinity(0)), _family(self._root)
        _pin(family, (core,))
        # Each runnable process gets the same share of the core; most of the family is runnable when time is short.
        for _ in range(round(len(family) * max(1 / cores - 1, 0))):
            busy = self._stack.enter_context(subprocess.Popen([sys.executable, "-c", BUSY]))  # noqa: S603 - our own words
            self._stack.callback(busy.kill)
            os.sched_setaffinity(busy.pid, {core})


@contextmanager
def processor_share(root: int) -> Iterator[ProcessorShare]:
    """The share of a process and its descendants; leave the block when they have ended."""
    folder = _new_group()
    try:
        with ExitStack() as stack:
            yield ProcessorShare(root, folder, stack)
    finally:
        if folder is not None:
            folder.rmdir()


def _new_group() -> Path | None:
    for controller in CONTROLLERS:
        folder = controller / f"labanmesh-{os.getpid()}"
        try:
            folder.mkdir()
        except OSError:
            continue
        if (folder / "cpu.max").exists() or (folder / "cpu.cfs_quota_us").exists():
            return folder
        folder.rmdir()
    return None


def _pin(family: Iterable[int], cores: Iterable[int]) -> None:
    """All threads of these processes run on these cores only."""
    chosen = set(cores)
    for pid in family:
        # A process or a thread may have ended meanwhile.
        with suppress(OSError):
            for thread in Path(f"/proc/{pid}/task").iterdir():
                with suppress(OSError):
                    os.sched_setaffinity(int(thread.name), chosen)


def _set_quota(folder: Path, cores: float) -> None:
    quota_us, period_us = round(max(cores * PERIOD_S, LEAST_QUOTA_S) * 1e6), round(PERIOD_S * 1e6)
    if (folder / "cpu.max").exists():
        (folder / "cpu.max").write_text(f"{quota_us} {period_us}")
    else:
        (folder / "cpu.cfs_period_us").write_text(str(period_us))
        (folder / "cpu.cfs_quota_us").write_text(str(quota_us))


def _family(root: int) -> list[int]:
    """The process and its descendants."""
    pids = [root]
    for parent in pids:  # grows while it is read
        tasks = Path(f"/proc/{parent}/task")
        try:
            pids += [int(pid) for task in tasks.iterdir() for pid in (task / "children").read_text().split()]
        except OSError:
            continue  # it has ended
    return pids


def _spent_s(pid: int) -> float:
    try:
        fields = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()
    except OSError:
        return 0.0
    return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")
