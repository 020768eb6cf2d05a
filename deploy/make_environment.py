"""Makes the Python environment of a make target and shows how far it is. Nothing is installed yet: standard library.

python deploy/make_environment.py .venv '.[all,dev]' --target test

It shows pip's newest line: on a terminal in one line that is written over and over, elsewhere every twenty seconds. All
that pip prints is in install.log of the environment. A failure ends with one line that says what to do.
"""

import argparse
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
"""Between two lines where the output is no terminal."""
LONGEST_LINE = 60
"""Characters of pip's line that are shown."""
PIP = ("-m", "pip", "install", "--disable-pip-version-check", "--no-input", "--progress-bar", "off")
CONTRIB = "from importlib.metadata import version; print(version('opencv-contrib-python'))"
WAYS_OUT = (
    (("ensurepip is not", "No module named venv"), "Python has no venv; Debian: apt install python3-venv"),
    (("No space left",), "the disk is full; make room, 3 GB are enough"),
    (("Permission denied", "Read-only file system"), "this folder cannot be written; clone into a folder of your own"),
    (
        ("Retrying (Retry", "Failed to establish", "Temporary failure in name resolution", "ConnectionError"),
        "no package index answers; check the network, or name a mirror by PIP_INDEX_URL",
    ),
)


class InstallFailure(Exception):  # noqa: N818 - the module has no other error
    """A step failed; the text is what its program printed."""


class StepDisplay:
    """What is shown of the steps: rewritten in place on a terminal, now and then a line elsewhere."""

    def __init__(self, name: str) -> None:
        self._name, self._terminal = name, sys.stderr.isatty()
        self._begun_s, self._shown_s = time.monotonic(), float("-inf")

    @property
    def lasted_s(self) -> float:
        """Seconds since the beginning."""
        return time.monotonic() - self._begun_s

    def show(self, text: str) -> None:
        """Show `text` and the seconds so far."""
        line = f"{self._name}: {text[:LONGEST_LINE]}, {self.lasted_s:.0f} s"
        if self._terminal:
            line = line[: shutil.get_terminal_size().columns - 1]
            print(f"\r\033[K{line}", end="", file=sys.stderr, flush=True)
        elif self.lasted_s - self._shown_s >= PROGRESS_LINE_S:
            self._shown_s = self.lasted_s
            print(line, file=sys.stderr, flush=True)

    def end(self, text: str) -> None:
        """The last line, which stays."""
        clear = "\r\033[K" if self._terminal else ""
        print(f"{clear}{self._name}: {text}", file=sys.stderr, flush=True)


def reason_of(text: str) -> str:
    """Why the program that printed `text` failed and what to do, in one line."""
    for symptoms, way_out in WAYS_OUT:
        if any(symptom in text for symptom in symptoms):
            return way_out
    lines = [line.strip() for line in text.splitlines() if line.strip()] or ["it printed nothing"]
    return ([line for line in lines if line.lower().startswith("error")] or lines)[-1]


def run(command: Sequence[str], display: StepDisplay | None = None, log: IO[str] | None = None) -> str:
    """What a program prints, meanwhile shown line by line and logged; raises InstallFailure."""
    lines: list[str] = []
    process = subprocess.Popen(  # noqa: S603 - python of the environment, without a shell
        command, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True, errors="replace"
    )

    def read() -> None:
        for line in process.stdout or ():
            lines.append(line)
            if log is not None:
                log.write(line)

    reader = threading.Thread(target=read)
    reader.start()
    try:
        while reader.is_alive():
            if display is not None and lines:
                display.show(lines[-1].strip())
            reader.join(SHOW_S)
    finally:
        if reader.is_alive():
            process.terminate()
        status = process.wait()
        reader.join()
    if status:
        raise InstallFailure("".join(lines))
    return "".join(lines).strip()


def make(folder: Path, package: str, no_windows: bool, display: StepDisplay) -> None:
    """Make the environment, and then install the packages; raises InstallFailure and OSError."""
    display.show("an environment of Python (once; some minutes)")
    run([sys.executable, "-m", "venv", str(folder)])
    python = str(folder / "bin" / "python")
    with (folder / "install.log").open("w", encoding="utf-8") as log:
        run([python, *PIP, "-e", package], display, log)
        if no_windows:
            # MediaPipe brings an OpenCV with windows. Where the system lacks its libGL, the same version without
            # goes on top.
            try:
                run([python, "-c", "import cv2"])
            except InstallFailure:
                headless = f"opencv-python-headless=={run([python, '-c', CONTRIB])}"
                run([python, *PIP, "--force-reinstall", "--no-deps", headless], display, log)


def main() -> int:
    """Make one environment; returns the exit status."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("folder", type=Path)
    parser.add_argument("package", help="with its extras, e.g. .[all,dev]")
    parser.add_argument("--target", default="", help="of make, to be given again after a failure")
    parser.add_argument("--no-windows", action="store_true", help="an OpenCV that needs no libGL, where there is none")
    words = parser.parse_args()
    display, again = StepDisplay(str(words.folder)), f"make {words.target}".strip()
    try:
        make(words.folder, words.package, words.no_windows, display)
    except KeyboardInterrupt:
        display.end(f"stopped; {again} goes on")
        return 130
    except (InstallFailure, OSError) as error:
        log = words.folder / "install.log"
        details = f" (all that pip printed: {log})" if log.exists() else ""
        display.end(f"not ready: {reason_of(str(error))}; then {again} again{details}")
        return 1
    display.end(f"ready after {display.lasted_s:.0f} s")
    return 0


if __name__ == "__main__":
    sys.exit(main())
