"""Real processes that can be killed, frozen and started again; their logs and resources."""

import os
import shutil
import signal
import subprocess
import threading
from pathlib import Path

from processes import SOON_S

ROOT = Path(__file__).parents[2]
# A process ends with the test process, also when that is killed.
BOUND = ("setpriv", "--pdeathsig", "KILL") if shutil.which("setpriv") else ()


class Process:
    """One process that can be started again and again. inside: what comes before its command, a namespace's entry."""

    def __init__(self, command, inside=(), environment=None):
        self.command = [*inside, *BOUND, *command]
        self._environment = {**os.environ, "PYTHONUNBUFFERED": "1", **(environment or {})}
        self._lines, self._changed = [], threading.Condition()
        self._popen = None

    def start(self, **environment):
        """Start it; environment: more of it for this start."""
        pipes = {"stdin": subprocess.DEVNULL, "stdout": subprocess.PIPE, "stderr": subprocess.STDOUT, "text": True}
        self._popen = subprocess.Popen(self.command, cwd=ROOT, env={**self._environment, **environment}, **pipes)
        threading.Thread(target=self._read, args=(self._popen.stdout,), daemon=True).start()
        return self

    def _read(self, stream):
        with stream:
            for line in stream:
                with self._changed:
                    self._lines.append(line)
                    self._changed.notify_all()

    @property
    def pid(self):
        return self._popen.pid

    @property
    def running(self):
        return self._popen is not None and self._popen.poll() is None

    @property
    def log(self):
        """Its output so far, over all starts."""
        with self._changed:
            return "".join(self._lines)

    def lines_from(self, first):
        """The lines that it has written since line `first`."""
        with self._changed:
            return self._lines[first:]

    @property
    def lines(self):
        """How many lines it has written so far."""
        with self._changed:
            return len(self._lines)

    def wait_for_more(self, count, timeout_s=SOON_S):
        """Wait for more than `count` lines; whether they came."""
        with self._changed:
            return self._changed.wait_for(lambda: len(self._lines) > count, timeout_s)

    def wait_for(self, words, times=1, timeout_s=SOON_S):
        """Wait until it has written `words` this many times."""
        with self._changed:
            written = self._changed.wait_for(lambda: "".join(self._lines).count(words) >= times, timeout_s)
        assert written, f"{words!r} was not written by {self.command}:\n{self.log}"

    def send(self, number):
        os.kill(self.pid, number)

    def kill(self):
        """SIGKILL, and wait until it is gone."""
        if self.running:
            self._popen.kill()
        if self._popen is not None:
            self._popen.wait(SOON_S)

    def wait(self):
        """The exit status, when it has ended by itself."""
        return self._popen.wait(SOON_S)

    def freeze(self):
        self.send(signal.SIGSTOP)

    def thaw(self):
        self.send(signal.SIGCONT)

    @property
    def rss_kb(self):
        """Resident memory."""
        return _number(Path(f"/proc/{self.pid}/status").read_text(), "VmRSS:")

    @property
    def descriptors(self):
        """Open file descriptors."""
        return len(list(Path(f"/proc/{self.pid}/fd").iterdir()))

    @property
    def waited_s(self):
        """How long its main thread has waited for a processor so far."""
        return int(Path(f"/proc/{self.pid}/schedstat").read_text().split()[1]) / 1e9

    @property
    def cpu_s(self):
        """Processor time so far."""
        fields = Path(f"/proc/{self.pid}/stat").read_text().rpartition(")")[2].split()
        return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")


def _number(text, name):
    return next(int(line.split()[1]) for line in text.splitlines() if line.startswith(name))
