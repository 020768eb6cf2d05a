"""Starts the processes of a scene on this machine, supervises them, merges their logs, and ends them all cleanly."""

import contextlib
import os
import queue
import subprocess
import sys
import threading
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import IO

from common.lifecycle import SUPERVISOR, as_json_line
from deploy.supervision import Career, Outcome, Patience

TERM_PATIENCE_S = 5.0
"""How long a process may take to end after SIGTERM before it is killed."""
LAST_WORDS_S = 1.0
"""How long to wait for the last lines of a process that ended."""
OWN = "[up]"
"""The launcher's own name in the log; ids hold no brackets, so no observer can be called so."""
LOOK_S = 0.1
"""How often the loop looks whether it should stop; ends of processes wake it at once."""


@dataclass(frozen=True, slots=True)
class Job:
    """One process: its name in the log, its command line, and whether it is meant to run until it is stopped.

    environment: what this one process is told besides.
    """

    name: str
    command: Sequence[str]
    lasting: bool = False
    environment: Mapping[str, str] = field(default_factory=dict)


class Log:
    """One stream for all: each line with the name of the process that wrote it; `as_json`: each line is JSON."""

    def __init__(self, stream: IO[str], names: Sequence[str], *, as_json: bool = False) -> None:
        self._stream, self._as_json = stream, as_json
        self._width = max(map(len, names))
        self._lock = threading.Lock()

    def say(self, name: str, line: str) -> None:
        """One line of `name`; a reader who has gone away does not stop the scene."""
        said = as_json_line(name, line) if self._as_json else f"{name:<{self._width}} | {line}"
        with self._lock, contextlib.suppress(BrokenPipeError, ValueError):
            print(said, file=self._stream, flush=True)


class Launcher:
    """Runs jobs until `stop` is set, or until nothing is left that could do something.

    environment: added to this process's own. patience: when to give up on a failing job.
    linger_s: with `exit_when_done`, how long the lasting jobs go on after all others have finished.
    """

    def __init__(
        self,
        jobs: Sequence[Job],
        *,
        environment: Mapping[str, str] | None = None,
        patience: Patience | None = None,
        stream: IO[str] | None = None,
    ) -> None:
        self._jobs = {job.name: job for job in jobs}
        self._environment = {**os.environ, "PYTHONUNBUFFERED": "1", SUPERVISOR: str(os.getpid()), **(environment or {})}
        self._careers = {job.name: Career(job.lasting, patience or Patience()) for job in jobs}
        as_json = self._environment.get("LABANMESH_LOG_FORMAT", "").lower() == "json"
        self._log = Log(stream or sys.stderr, [*self._jobs, OWN], as_json=as_json)
        self._running: dict[str, subprocess.Popen[str]] = {}
        self._followers: dict[str, threading.Thread] = {}
        self._started_s: dict[str, float] = {}
        self._due_s: dict[str, float] = dict.fromkeys(self._jobs, 0.0)
        self._over: dict[str, Outcome] = {}
        self._ends: queue.Queue[str] = queue.Queue()

    def run(self, stop: threading.Event, *, exit_when_done: bool = False, linger_s: float = 0.0) -> int:
        """Supervise; returns 0, or 1 when a job was given up on. All processes have ended when it returns."""
        done_s: float | None = None
        try:
            while not stop.is_set() and not self._hopeless():
                now_s = time.monotonic()
                self._start_due(now_s)
                if exit_when_done and self._workers_over():
                    done_s = now_s if done_s is None else done_s
                    if now_s - done_s >= linger_s:
                        break
                self._look()
        finally:
            self._end_all()
        return int(Outcome.GIVEN_UP in self._over.values())

    def _start_due(self, now_s: float) -> None:
        for name in [name for name, due_s in self._due_s.items() if due_s <= now_s]:
            del self._due_s[name]
            self._start(self._jobs[name], now_s)

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
        """In a thread for each process: pass its lines on until it ends, then say so."""
        assert process.stdout is not None  # noqa: S101 - it was opened as a pipe
        with process.stdout:
            for line in process.stdout:
                self._log.say(name, line.rstrip("\n"))
        process.wait()
        self._ends.put(name)

    def _look(self) -> None:
        """Wait for the next end of a process, for a moment."""
        try:
            name = self._ends.get(timeout=LOOK_S)
        except queue.Empty:
            return
        status = self._running.pop(name).returncode
        ran_s = time.monotonic() - self._started_s[name]
        career = self._careers[name]
        outcome = career.ended(status, ran_s)
        if outcome is Outcome.RESTART:
            self._due_s[name] = time.monotonic() + career.pause_s
            self._log.say(OWN, f"{name} ended with status {status} after {ran_s:.1f} s; again in {career.pause_s:g} s")
        else:
            self._over[name] = outcome
            self._log.say(OWN, f"{name} {outcome.value} (status {status}) after {ran_s:.1f} s")

    def _workers_over(self) -> bool:
        return all(name in self._over for name, job in self._jobs.items() if not job.lasting)

    def _hopeless(self) -> bool:
        """Whether a lasting job, or every worker, was given up on: then the scene cannot work any more."""
        given_up = {name for name, outcome in self._over.items() if outcome is Outcome.GIVEN_UP}
        workers = {name for name, job in self._jobs.items() if not job.lasting}
        return bool(given_up - workers) or (bool(workers) and workers <= given_up)

    def _end_all(self) -> None:
        """SIGTERM to all, wait, SIGKILL to those who did not listen."""
        for process in self._running.values():
            process.terminate()
        deadline_s = time.monotonic() + TERM_PATIENCE_S
        for name, process in self._running.items():
            try:
                process.wait(max(0.0, deadline_s - time.monotonic()))
            except subprocess.TimeoutExpired:
                self._log.say(OWN, f"{name} did not end on SIGTERM within {TERM_PATIENCE_S:g} s and is killed")
                process.kill()
                process.wait()
        for name in self._running:
            self._followers[name].join(LAST_WORDS_S)
        self._running.clear()
