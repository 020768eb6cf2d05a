"""Ctrl-C at any moment, as a terminal sends it: to the whole process group. The short form interrupts at moments that
stderr shows: Python lists each import there. The long form takes twenty random moments of each verb, and a second at
most for its end."""

import os
import random
import re
import signal
import subprocess
import sys
import time
from contextlib import suppress
from pathlib import Path

import pytest
from attack_history import SEED
from processes import SOON_S, labanmesh, until

from common.lifecycle import SUPERVISOR_VARIABLE
from labanmesh import main
from observer.motion.archive_file import write_archive
from studies.performer import perform

LONG = os.environ.get("LABANMESH_ATTACKS") == "long"
MOMENTS, LONGEST_S, END_S = 20, 6.0, 1.0
VIEWS = ("--views", "yaw:30,yaw:-45", "--leave-one-subject-out")
EVALUATE = ("evaluate", "known.npz", *VIEWS, "--jobs", "2")
SCENE = """scene = "room"
[observers.sofa]
source = "known.npz"
view = "yaw:30"
speed = 0.1
"""
VERBS = {
    "evaluate": EVALUATE,
    "learn": ("learn", "known.npz", "--view", "yaw:30", "-o", "new.model"),
    "paper": ("evaluate", "--paper", "known.npz", "--train-subjects", "1,2", "--test-subjects", "3"),
    "doctor": ("doctor", "room.toml", "--for", "10"),
    "observe": ("observe", "room.toml", "sofa"),
    "fuse": ("fuse", "room.toml"),
    "up": ("up", "room.toml"),
    "watch": ("watch", "room.toml"),
    "teach": ("teach", "room.toml", "wave", "clap", "--up"),
    "capture": ("capture", "room.toml", "-o", "{n}.mcap"),
    "dashboard": ("dashboard", "room.toml", "--listen", "127.0.0.1:0"),
    "demo": ("demo",),
}
"""What the long form interrupts."""


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    place = tmp_path_factory.mktemp("interrupts")
    write_archive(place / "known.npz", perform(people=("1", "2", "3"), movements=("byebye", "stretch"), trials=2))
    (place / "room.toml").write_text(SCENE)
    return place


def started(folder, command):
    """A process group as a terminal starts it, whatever the shell that runs the tests ignores."""
    return subprocess.Popen(
        command, cwd=folder, stdin=subprocess.DEVNULL, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True,
        env={name: value for name, value in os.environ.items() if name != SUPERVISOR_VARIABLE}, start_new_session=True,
        preexec_fn=lambda: signal.signal(signal.SIGINT, signal.SIG_DFL),
    )  # fmt: skip


def catches_interrupts(process):
    """Whether Python has begun so far that Ctrl-C is an exception."""
    status = dict(line.split(":", 1) for line in Path(f"/proc/{process.pid}/status").read_text().splitlines())
    return int(status["SigCgt"], 16) >> (signal.SIGINT - 1) & 1


PYTHON_STARTS = ("<frozen site>", "Could not import runpy module", "<frozen runpy>")
"""One of these is in each stack of Python's own start."""
HANDLER_IMPORT = re.compile(r'labanmesh\.py", line \d+, in <module>\n    import signal\n')


def is_of_python_itself(text):
    """Whether it was Python that was interrupted, before labanmesh.py could set its handler; and no worker of ours."""
    ours = 'labanmesh.py"' in text and not HANDLER_IMPORT.search(text)
    return any(step in text for step in PYTHON_STARTS) and not ours and "multiprocessing" not in text


def running_in_group(group):
    """The numbers of the group's processes; those that have ended and that nobody waited for do not count."""
    numbers = []
    for entry in Path("/proc").glob("[0-9]*/stat"):
        with suppress(OSError):
            state, _, its_group = entry.read_text().rpartition(")")[2].split()[:3]
            if int(its_group) == group and state != "Z":
                numbers.append(int(entry.parent.name))
    return numbers


def end_of(process):
    """Interrupt the process; what it still prints, and its seconds. Fails if one of its group is left."""
    began_s = time.monotonic()
    os.killpg(process.pid, signal.SIGINT)
    try:
        text, _ = process.communicate(timeout=SOON_S)
        duration_s = time.monotonic() - began_s
        until(lambda: not running_in_group(process.pid), lambda: f"left: {running_in_group(process.pid)}")
    finally:
        with suppress(ProcessLookupError):
            os.killpg(process.pid, signal.SIGKILL)
    return text, duration_s


@pytest.mark.parametrize(
    ("words", "moment", "count"),
    [
        (EVALUATE, "inspect", 1),  # labanmesh.py imports it, after little else
        (EVALUATE, "numpy", 1),
        (EVALUATE, "multiprocessing.spawn", 2),  # the first worker starts
        (EVALUATE, "learning and judging: ", 1),
        (VERBS["learn"], "observer.model.rocket", 1),
    ],
)
def test_ctrl_c_ends_a_command_without_a_word_and_without_orphans(folder, words, moment, count):
    python, *rest = labanmesh(*words)
    process = started(folder, [python, "-X", "importtime", *rest])
    lines = []
    while sum(moment in line for line in lines) < count:
        lines.append(process.stdout.readline())
        assert lines[-1], "".join(lines[-20:])
    text, _ = end_of(process)
    # Two workers write to one pipe, so that a line about an import may come in parts.
    words = [line for line in text.splitlines() if not line.startswith("import time:") and "|" not in line]
    assert process.returncode == 130 and all(" of " in line for line in words if line.strip()), text


def test_an_end_at_once_says_nothing_of_semaphores(folder):
    ends = "import os, common.parallel as p; p.run_parts(abs, [1, 2], 2, lambda n, _: n and os._exit(130))"
    process = started(folder, [sys.executable, "-P", "-c", ends])
    assert (process.communicate(timeout=SOON_S)[0], process.returncode) == ("", 130)


@pytest.mark.skipif(not LONG, reason="LABANMESH_ATTACKS=long: twenty moments of each verb")
@pytest.mark.parametrize("verb", VERBS)
def test_ctrl_c_at_a_random_moment(folder, verb):
    if not (folder / "sofa.model").exists():
        assert main(["learn", str(folder / "known.npz"), "--view", "yaw:30", "-o", str(folder / "sofa.model")]) == 0
    moments = random.Random(os.environ.get(SEED, "1"))  # noqa: S311 - moments, no secrets
    slowest_s = 0.0
    for n in range(MOMENTS):
        at_s = moments.uniform(0.0, LONGEST_S)
        process = started(folder, labanmesh(*(word.format(n=n) for word in VERBS[verb])))
        until(lambda p=process: catches_interrupts(p), "Python begins")
        with suppress(subprocess.TimeoutExpired):
            process.wait(at_s)
        if process.poll() is not None:
            process.communicate()
            continue
        text, duration_s = end_of(process)
        if not is_of_python_itself(text):
            # While Python itself ends it has no handler any more; a shell says 130 of both.
            assert process.returncode in (130, -signal.SIGINT) and "Traceback" not in text, (at_s, text)
        slowest_s = max(slowest_s, duration_s)
    print(f"{verb}: {MOMENTS} moments, {slowest_s:.2f} s at most")
    assert slowest_s <= END_S
