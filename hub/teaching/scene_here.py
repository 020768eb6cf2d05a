"""The processes of the scene, started by `labanmesh teach` where nothing runs yet, so that one command teaches."""

import os
import subprocess
import sys
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager, suppress
from pathlib import Path

from common.errors import LabanmeshError, reason_of
from common.files import open_private
from common.lifecycle import SUPERVISOR_VARIABLE
from hub.teaching.interface import LOOK_S

SCENE_START_S = 60.0
"""Trackers with a pose model take some seconds to start."""
SCENE_END_S = 10.0


@contextmanager
def scene_here(
    file: Path, is_there: Callable[[], bool], pause: Callable[[float], None], environment: Mapping[str, str]
) -> Iterator[Path]:
    """The scene runs while the context lasts; yields the path of its log. It ends with the context.

    is_there: whether all observers run. pause: waits so many seconds; raises KeyboardInterrupt to give up. environment:
    variables for the scene's processes alone. Raises LabanmeshError, with the last line of the log, if the scene ends
    or does not start within SCENE_START_S.
    """
    log = file.with_suffix(".log")
    try:
        # What a home does is for this user alone.
        output = os.fdopen(open_private(log), "w", encoding="utf-8")
    except OSError as error:
        reason = reason_of(error)
        raise LabanmeshError(f"cannot write {log}: {reason}; start the scene yourself: labanmesh up {file}") from None
    with output:
        # A session of its own: Ctrl-C is for the lesson, which then ends the scene in order. The scene also ends with a
        # lesson that is killed, as when its terminal is closed.
        process = subprocess.Popen(  # noqa: S603 - the command line is ours
            [sys.executable, "-P", "-m", "labanmesh", "up", str(file)],
            stdin=subprocess.DEVNULL, stdout=output, stderr=subprocess.STDOUT, start_new_session=True,
            env={**os.environ, **environment, SUPERVISOR_VARIABLE: str(os.getpid())},
        )  # fmt: skip
        try:
            end_s = time.monotonic() + SCENE_START_S
            while not is_there():
                if process.poll() is not None or time.monotonic() > end_s:
                    text = log.read_text(encoding="utf-8", errors="replace").strip()
                    fault = text.rpartition("\n")[2] or "it says nothing"
                    raise LabanmeshError(f"the scene does not start: {fault} (all of it: {log})")
                pause(LOOK_S)
            yield log
        finally:
            process.terminate()
            with suppress(subprocess.TimeoutExpired):
                process.wait(SCENE_END_S)
