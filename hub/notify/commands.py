"""The verb `labanmesh notify`: what waits for each receiver, and a test."""

import time
from pathlib import Path
from typing import Annotated

import typer

from common.config import read_scene
from common.errors import BadInput, LabanmeshError
from hub.notify.notification import request_of, test_notification
from hub.notify.notifying import queue_path, receivers_of
from hub.notify.sender import NotificationQueue

NO_RECEIVERS = "in the scene file: [notify.phone] with url and preset (docs/guide/notify.md)"


def notify(
    scene: Annotated[Path, typer.Argument(help="The scene file; its [notify.NAME] name the receivers.")],
    name: Annotated[str, typer.Argument(help="Only this receiver.")] = "",
    test: Annotated[bool, typer.Option("--test", help="Send a test to each of them now.")] = False,
) -> None:
    """List whom the scene tells of movements and falls, and how many notifications wait for each; or send a test.

    `labanmesh hub events SCENE` sends them.

    Example: labanmesh notify scene.toml --test
    """
    config = read_scene(scene)
    receivers = [each for each in receivers_of(config) if name in ("", each.name)]
    if not receivers:
        known = ", ".join(config.notify)
        raise BadInput(f"no receiver {name!r}; known: {known}" if known else f"the scene tells nobody; {NO_RECEIVERS}")
    failed = []
    path = queue_path(config)
    for receiver in receivers:
        if test:
            note = test_notification(config.scene, time.time_ns())
            result = receiver.send(request_of(note, receiver.config, receiver.token))
            print(f"{receiver.name}: {result.fault or 'accepted'}", flush=True)
            failed += [receiver.name] if result.fault else []
            continue
        waiting = 0
        if path.exists():
            queue = NotificationQueue(path)
            waiting = queue.count(receiver.name)
            queue.close()
        print(f"{receiver.name}: {receiver.config.preset}, {waiting} waiting")
    if failed:
        raise LabanmeshError(f"{', '.join(failed)}: the lines above say why")
