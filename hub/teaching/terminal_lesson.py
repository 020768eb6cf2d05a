"""A lesson in a terminal: the scene's processes where nothing runs yet, which observers can be taught, the lesson, and
what follows it.
"""

import os
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path

from common.config import Scene
from common.errors import BadInput, LabanmeshError, reason_of
from common.files import open_private
from common.inbox import Presence
from common.lifecycle import SUPERVISOR_VARIABLE
from common.link import Link
from common.teaching_messages import TeachRequest
from hub.session import SceneListener
from hub.teaching.interface import LOOK_S
from hub.teaching.lesson import Lesson, LessonPlan
from hub.teaching.rehearsal import Rehearsal, RehearsalTerminal, show_recognition
from hub.teaching.teaching_client import TeachingClient, names_of
from hub.teaching.terminal import Terminal, single_keys
from hub.teaching.wording import NO_RIGHT

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


PICTURES_S = 6.0
CAMERAS_S = 20.0
"""So long the lesson waits for a first camera; for the others PICTURES_S."""


def run_lesson(
    plan: LessonPlan,
    config: Scene,
    link: Link,
    presence: Presence,
    stop: threading.Event,
    rehearsal: Rehearsal | None,
    file: Path,
) -> None:
    """Teach the observers of the scene `file` that run; after a rehearsal show what is recognised.

    Raises BadInput for a plan that needs a keyboard where there is none, LabanmeshError if the lesson cannot go on.
    """
    present, client = present_observers(config, file, presence), TeachingClient(link, config.keys)
    with SceneListener(config, link) as listener, single_keys() as keyboard:
        if plan.begin == "key" and not keyboard:
            raise BadInput("--begin key: there is no keyboard here; take still, clap or now")
        interface = Terminal(stop, listener, keyboard)
        if rehearsal is not None:
            interface = RehearsalTerminal(rehearsal, stop, listener, keyboard)
        observers = teachable_observers(client, plan.teacher, present, interface, file)
        Lesson(plan, interface, client.ask, observers).run()
        if rehearsal is not None:
            show_recognition(rehearsal, interface)


def present_observers(scene: Scene, file: Path, presence: Presence) -> list[str]:
    """The observers of the scene file that run; raises LabanmeshError without any."""
    present = names_of(presence, scene)
    if not present:
        raise LabanmeshError(f"no observer of {scene.scene} runs; start them: labanmesh up {file} (or teach with --up)")
    for name in scene.roster:
        if name not in present:
            print(f"{name}: does not run; the others are taught without it", flush=True)
    return present


def teachable_observers(
    client: TeachingClient, teacher: str, present: Sequence[str], interface: Terminal, file: Path
) -> list[str]:
    """The observers that answer; raises LabanmeshError if none does, or none has pictures."""
    status = TeachRequest(command="status", teacher=teacher)
    answers, begun_s, waits = client.ask(status, present), interface.now_s(), False
    # A scene that has just been started has no pictures yet.
    while not all(reply.pictures for reply in answers.replies.values()):
        waited_s = interface.now_s() - begun_s
        if waited_s >= (PICTURES_S if any(reply.pictures for reply in answers.replies.values()) else CAMERAS_S):
            break
        if waited_s >= PICTURES_S and not waits:
            interface.say("waiting for the cameras ...")
            waits = True
        interface.pause(LOOK_S)
        answers = client.ask(status, present)
    if not answers.replies:
        raise LabanmeshError(NO_RIGHT)
    if not any(reply.pictures for reply in answers.replies.values()):
        raise LabanmeshError(
            f"no pictures from {', '.join(answers.replies)}: are the cameras plugged in and switched on? "
            f"labanmesh doctor {file} says why; without a webcam let the source be a film or a phone: "
            "docs/guide/cameras.md"
        )
    for name in answers.silent:
        interface.say(f"{name}: does not answer a request to teach; the others are taught without it")
    return list(answers.replies)
