"""Starts the processes of a scene on this machine, supervises them, merges their logs, and ends them all cleanly.

1. Status 0 is an end, not a failure: the process has finished. For a lasting process such as fusion it is a failure.
2. Status 2 is bad input: the process has printed the fault, and another start would only repeat it.
3. Any other end is a failure: the process is started again, after 0.5 s and then ever later, up to 30 s.
4. A process that has run for a minute has recovered: the next pause is short again.
"""

import contextlib
import os
import queue
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from enum import Enum
from typing import IO

from common.backoff import Backoff
from common.lifecycle import SUPERVISOR_VARIABLE, as_json_line

TERM_TIMEOUT_S = 5.0
"""How long a process may take to end after SIGTERM before it is killed."""
LAST_LINES_S = 1.0
"""How long to wait for the last lines of a process that ended."""
OWN_NAME = "[up]"
"""The launcher's name in the log; ids hold no brackets, so no observer can have this name."""
PROCESS_POLL_S = 0.1
"""How often the loop checks whether it should stop; the end of a process wakes it at once."""
BAD_INPUT = 2
RESTARTING = Backoff(0.5, 30.0, 60.0)


class RunDecision(Enum):
    """What happens to a process that ended."""

    FINISHED = "finished"
    RESTART = "restart"
    GIVEN_UP = "given up"


@dataclass(slots=True)
class RunHistory:
    """One process's successive runs. lasting: it is not meant to end by itself.

    most: how many failures in a row are too many; None: never.
    """

    lasting: bool
    backoff: Backoff = RESTARTING
    most: int | None = None
    failures: int = 0

    def decide(self, status: int, ran_s: float) -> RunDecision:
        """What to do after a run that ended with `status` (negative: by that signal) after `ran_s`."""
        if status == 0 and not self.lasting:
            return RunDecision.FINISHED
        if status == BAD_INPUT:
            return RunDecision.GIVEN_UP
        self.failures = self.backoff.failures(self.failures, ran_s)
        is_hopeless = self.most is not None and self.failures >= self.most
        return RunDecision.GIVEN_UP if is_hopeless else RunDecision.RESTART

    @property
    def pause_s(self) -> float:
        """How long to wait before the next start."""
        return self.backoff.wait_s(self.failures)


@dataclass(frozen=True, slots=True)
class Job:
    """One process: its name in the log, its command line, and whether it is meant to run until it is stopped.

    environment: variables for this process alone.
    """

    name: str
    command: Sequence[str]
    lasting: bool = False
    environment: Mapping[str, str] = field(default_factory=dict)


class MergedLog:
    """One stream for all processes: each line with the name of the one that wrote it; `as_json`: each line is JSON."""

    def __init__(self, stream: IO[str], names: Sequence[str], *, as_json: bool = False) -> None:
        self._stream, self._as_json = stream, as_json
        self._width = max(map(len, names))
        self._lock = threading.Lock()

    def write(self, name: str, line: str) -> None:
        """One line of `name`; a reader that has gone away, or a full disk, does not stop the scene."""
        text = as_json_line(name, line) if self._as_json else f"{name:<{self._width}} | {line}"
        with self._lock, contextlib.suppress(OSError, ValueError):
            print(text, file=self._stream, flush=True)


class Launcher:
    """Runs jobs until `stop` is set, or until no job is left that could do something.

    environment: added to this process's own. backoff: when a failing job is started again. most_failures: in a row,
    after which it is given up; None: never. ended: called with the name of each job that has ended, whether or not it
    is started again.
    """

    def __init__(
        self,
        jobs: Sequence[Job],
        *,
        environment: Mapping[str, str] | None = None,
        backoff: Backoff = RESTARTING,
        most_failures: int | None = None,
        stream: IO[str] | None = None,
        ended: Callable[[str], None] = lambda name: None,
    ) -> None:
        self._on_end = ended
        self._jobs = {job.name: job for job in jobs}
        self._workers = {job.name for job in jobs if not job.lasting}
        self._environment = {
            **os.environ,
            "PYTHONUNBUFFERED": "1",
            SUPERVISOR_VARIABLE: str(os.getpid()),
            **(environment or {}),
        }
        self._histories = {job.name: RunHistory(job.lasting, backoff, most_failures) for job in jobs}
        as_json = self._environment.get("LABANMESH_LOG_FORMAT", "").lower() == "json"
        self._log = MergedLog(stream or sys.stderr, [*self._jobs, OWN_NAME], as_json=as_json)
        self._running: dict[str, subprocess.Popen[str]] = {}
        self._followers: dict[str, threading.Thread] = {}
        self._started_s: dict[str, float] = {}
        self._due_s: dict[str, float] = dict.fromkeys(self._jobs, 0.0)
        self._over: dict[str, RunDecision] = {}
        self._ended: queue.Queue[str] = queue.Queue()

    def run(self, stop: threading.Event, *, exit_when_done: bool = False, linger_s: float = 0.0) -> int:
        """Supervise; returns 0, or 1 when a job was given up. All processes have ended when it returns.

        linger_s: with `exit_when_done`, how long the lasting jobs go on after all others have finished.
        """
        done_s: float | None = None
        try:
            while not stop.is_set() and not self._is_hopeless():
                now_s = time.monotonic()
                for name in [name for name, due_s in self._due_s.items() if due_s <= now_s]:
                    del self._due_s[name]
                    self._start(self._jobs[name], now_s)
                if self._workers <= self._over.keys():
                    if done_s is None and self._workers and not exit_when_done:
                        ends = ", ".join(f"{name} {self._over[name].value}" for name in sorted(self._workers))
                        line = f"no observer that was started here runs any more ({ends})"
                        self._log.write(OWN_NAME, f"{line}; Ctrl-C or SIGTERM ends the others")
                    done_s = now_s if done_s is None else done_s
                    if exit_when_done and now_s - done_s >= linger_s:
                        break
                self._wait_for_end()
        finally:
            self._end_all()
        return int(bool(self.given_up))

    @property
    def given_up(self) -> list[str]:
        """The names of the jobs that failed and are not started again."""
        return [name for name, decision in self._over.items() if decision is RunDecision.GIVEN_UP]

    def _start(self, job: Job, now_s: float) -> None:
        # A session of its own: Ctrl-C at the terminal reaches the launcher alone, which ends the others in order.
        process = subprocess.Popen(  # noqa: S603 - the command line is ours
            job.command,
            env={**self._environment, **job.environment},
            stdin=subprocess.DEVNULL,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
            errors="replace",
            start_new_session=True,
        )
        self._running[job.name] = process
        self._started_s[job.name] = now_s
        follower = threading.Thread(target=self._follow, args=(job.name, process), daemon=True)
        self._followers[job.name] = follower
        follower.start()

    def _follow(self, name: str, process: subprocess.Popen[str]) -> None:
        """In a thread for each process: pass its lines on until it ends, then report its end."""
        assert process.stdout is not None  # noqa: S101 - it was opened as a pipe
        with process.stdout:
            for line in process.stdout:
                self._log.write(name, line.rstrip("\n"))
        process.wait()
        self._ended.put(name)

    def _wait_for_end(self) -> None:
        try:
            name = self._ended.get(timeout=PROCESS_POLL_S)
        except queue.Empty:
            return
        status = self._running.pop(name).returncode
        self._on_end(name)
        ran_s = time.monotonic() - self._started_s[name]
        history = self._histories[name]
        decision = history.decide(status, ran_s)
        if decision is RunDecision.RESTART:
            self._due_s[name] = time.monotonic() + history.pause_s
            end = f"ended with status {status} after {ran_s:.1f} s"
            self._log.write(OWN_NAME, f"{name} {end}; again in {history.pause_s:g} s")
        else:
            self._over[name] = decision
            self._log.write(OWN_NAME, f"{name} {decision.value} (status {status}) after {ran_s:.1f} s")

    def _is_hopeless(self) -> bool:
        """Whether a lasting job, or every worker, was given up: then the scene cannot work any more."""
        given_up = set(self.given_up)
        return bool(given_up - self._workers) or (bool(self._workers) and self._workers <= given_up)

    def _end_all(self) -> None:
        """SIGTERM to all, wait, SIGKILL to those that did not end."""
        for process in self._running.values():
            process.terminate()
        deadline_s = time.monotonic() + TERM_TIMEOUT_S
        for name, process in self._running.items():
            try:
                process.wait(max(0.0, deadline_s - time.monotonic()))
            except subprocess.TimeoutExpired:
                self._log.write(OWN_NAME, f"{name} did not end on SIGTERM within {TERM_TIMEOUT_S:g} s and is killed")
                process.kill()
                process.wait()
        for name in self._running:
            self._followers[name].join(LAST_LINES_S)
        self._running.clear()
