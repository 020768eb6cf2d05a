"""Makes the Python environment of a make target and shows how far it is. Nothing is installed yet: standard library.

python deploy/make_environment.py .venv '.[all,dev]' --target test --packages 90

On a terminal one line is written over and over; elsewhere a line for each step, and one every twenty seconds. All that
pip prints is in install.log of the environment. A failure ends with one line that says what to do.
"""

import argparse
import re
import shutil
import subprocess
import sys
import threading
import time
from collections.abc import Sequence
from pathlib import Path
from typing import IO

SHOW_S = 0.3
PROGRESS_LINE_S = 20.0
"""Between two lines of one step where the output is no terminal."""
FETCHED = re.compile(
    r"\s*(?:Downloading|Using cached|Processing) (?:\S*/)?(\w[\w.]*?)-\d\S*\.(?:whl|gz|zip)(?!\.metadata)"
    r"(?: \((\S+ .?B)\))?"
)
INSTALLING = "Installing collected packages: "
PIP = ("-m", "pip", "install", "--disable-pip-version-check", "--no-input", "--progress-bar", "off")
CONTRIB = "from importlib.metadata import version; print(version('opencv-contrib-python'))"
NO_ANSWER = ("Retrying (Retry", "Failed to establish", "Temporary failure in name resolution", "ConnectionError")
PIP_WAYS_OUT = (
    (("ensurepip is not", "No module named venv"), "Python has no venv; Debian: apt install python3-venv"),
    (("No space left",), "the disk is full; make room, 3 GB are enough"),
    (("Permission denied", "Read-only file system"), "this folder cannot be written; clone into a folder of your own"),
    (NO_ANSWER, "no package index answers; check the network, or name a mirror by PIP_INDEX_URL"),
)


class InstallFailure(Exception):  # noqa: N818 - the module has no other error
    """A step failed; the lines are those that its program printed."""

    def __init__(self, lines: Sequence[str]) -> None:
        super().__init__(reason_of(lines))


class StepDisplay:
    """What is shown of the steps: rewritten in place on a terminal, now and then a line elsewhere."""

    def __init__(self, name: str) -> None:
        self._name, self._terminal = name, sys.stderr.isatty()
        self._last, self._shown_s = "", 0.0

    def show(self, text: str, *, new: bool = False) -> None:
        """Show `text`; `new` begins a step, which is always shown."""
        if text == self._last:
            return
        if self._terminal:
            line = f"{self._name}: {text}"[: shutil.get_terminal_size().columns - 1]
            print(f"\r\033[K{line}", end="", file=sys.stderr, flush=True)
        elif new or time.monotonic() - self._shown_s >= PROGRESS_LINE_S:
            print(f"{self._name}: {text}", file=sys.stderr, flush=True)
        else:
            return
        self._last, self._shown_s = text, time.monotonic()

    def end(self, text: str) -> None:
        """The last line, which stays."""
        clear = "\r\033[K" if self._terminal else ""
        print(f"{clear}{self._name}: {text}", file=sys.stderr, flush=True)


class PipProgress:
    """How far pip is, from the lines that it prints and from what lies in the environment."""

    def __init__(self, folder: Path, packages: int) -> None:
        self._folder, self._expected = folder, packages
        self._fetched: set[str] = set()
        self._newest, self._begun_s = "", time.monotonic()
        self._installing, self._before = 0, self._installed()

    def read(self, line: str) -> None:
        """Take one line of pip's."""
        match = FETCHED.match(line)
        if match:
            self._fetched.add(match[1])
            self._newest = f", {match[1]} {match[2] or ''}".rstrip()
        elif line.startswith(INSTALLING):
            self._installing = line.count(",") + 1
        elif NO_ANSWER[0] in line:
            self._newest = ", no answer from the package index, trying again"

    def text(self) -> str:
        """The step and how far it is."""
        after = f"{time.monotonic() - self._begun_s:.0f} s"
        if self._installing:
            done = min(max(self._installed() - self._before, 0), self._installing)
            return f"3 of 3, installing: {done} of {self._installing} packages, {after}"
        count = len(self._fetched)
        total = f" of about {self._expected}" if count <= self._expected else ""
        return f"2 of 3, fetching: {count}{total} packages{self._newest}, {after}"

    def _installed(self) -> int:
        return len(list(self._folder.glob("lib/python*/site-packages/*.dist-info")))


def reason_of(lines: Sequence[str]) -> str:
    """Why the program that printed `lines` failed and what to do, in one line."""
    text = "\n".join(lines)
    for symptoms, way_out in PIP_WAYS_OUT:
        if any(symptom in text for symptom in symptoms):
            return way_out
    errors = [line for line in lines if line.lower().startswith("error")]
    return (errors or [line for line in lines if line.strip()] or ["it printed nothing"])[-1].strip()


def start(command: Sequence[str]) -> subprocess.Popen[str]:
    """A program of ours, its output and errors together."""
    return subprocess.Popen(  # noqa: S603 - python of the environment, without a shell
        command, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True, errors="replace"
    )


def run(command: Sequence[str]) -> str:
    """What a short program prints; raises InstallFailure."""
    with start(command) as process:
        text, _ = process.communicate()
    if process.returncode:
        raise InstallFailure(text.splitlines())
    return text.strip()


def run_pip(command: Sequence[str], log: IO[str], display: StepDisplay, progress: PipProgress) -> None:
    """Run pip and show how far it is; raises InstallFailure."""
    lines: list[str] = []
    process = start(command)

    def read() -> None:
        for line in process.stdout or ():
            log.write(line)
            lines.append(line.rstrip())
            progress.read(line)

    reader = threading.Thread(target=read)
    reader.start()
    step = ""
    try:
        while reader.is_alive():
            text = progress.text()
            display.show(text, new=text[:1] != step)
            step = text[:1]
            reader.join(SHOW_S)
    finally:
        if reader.is_alive():
            process.terminate()
        status = process.wait()
        reader.join()
    if status:
        raise InstallFailure(lines)


def make(folder: Path, package: str, packages: int, no_windows: bool, display: StepDisplay) -> None:
    """The three steps; raises InstallFailure and OSError."""
    display.show("1 of 3, an environment of Python (once; some minutes for all three)", new=True)
    run([sys.executable, "-m", "venv", str(folder)])
    python = str(folder / "bin" / "python")
    with (folder / "install.log").open("w", encoding="utf-8") as log:
        progress = PipProgress(folder, packages)
        run_pip([python, *PIP, "-e", package], log, display, progress)
        if no_windows:
            # MediaPipe brings an OpenCV with windows. Where the system lacks its libGL, the same version without
            # goes on top.
            try:
                run([python, "-c", "import cv2"])
            except InstallFailure:
                headless = f"opencv-python-headless=={run([python, '-c', CONTRIB])}"
                run_pip([python, *PIP, "--force-reinstall", "--no-deps", headless], log, display, progress)


def main() -> int:
    """Make one environment; returns the exit status."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("folder", type=Path)
    parser.add_argument("package", help="with its extras, e.g. .[all,dev]")
    parser.add_argument("--target", default="", help="of make, to be given again after a failure")
    parser.add_argument("--packages", type=int, default=0, help="about how many there are")
    parser.add_argument("--no-windows", action="store_true", help="an OpenCV that needs no libGL, where there is none")
    words = parser.parse_args()
    display, begun_s = StepDisplay(str(words.folder)), time.monotonic()
    again = f"make {words.target}".strip()
    try:
        make(words.folder, words.package, words.packages, words.no_windows, display)
    except KeyboardInterrupt:
        display.end(f"stopped; {again} goes on")
        return 130
    except (InstallFailure, OSError) as error:
        log = words.folder / "install.log"
        details = f" (all that pip printed: {log})" if log.exists() else ""
        display.end(f"not ready: {reason_of([str(error)])}; then {again} again{details}")
        return 1
    display.end(f"ready after {time.monotonic() - begun_s:.0f} s")
    return 0


if __name__ == "__main__":
    sys.exit(main())
